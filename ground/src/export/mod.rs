//! What a reconstruction has left, in the formats of other programs.
//!
//! Everything is made from the poses of stage adjust and from the panorama's tiles, piece by piece, so memory does not
//! grow with the tunnel's length. A result takes its place whole or not at all.

mod e57;
mod error;
mod finished;
mod laz;
mod place;
mod poses;
mod tiff;

use std::fmt;
use std::fs::File;
use std::io::{BufWriter, Write};
use std::ops::Neg;
use std::path::{Path, PathBuf};

use serde::Serialize;

pub use error::ExportError;
pub use tiff::TiffCompression;

use crate::model::{MeshPlan, ModelOptions, PointSource, colmap, ply};
use crate::pipeline::{Stage, StageProgress, Verbosity};
use crate::poses::write_poses;
use error::at_path;
use finished::Finished;
use place::Destination;
use tiff::Picture;

/// What can be exported.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, clap::ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub enum Format {
    /// colmap/: COLMAP's model as text
    Colmap,
    /// colmap-bin/: the same as binary files
    ColmapBin,
    /// points.ply: dense points, tunnel frame
    Ply,
    /// points.laz: dense points, z up
    Laz,
    /// points.e57: dense points, z up
    E57,
    /// obj/: textured meshes, y up
    Obj,
    /// model.glb: textured meshes, y up
    Glb,
    /// panorama.tif: the panorama with overviews and metric axes
    Tiff,
    /// relief.tif: heights of the wall over its section
    Relief,
    /// tiles/: the panorama as a deep-zoom pyramid
    Dzi,
    /// poses.json
    PosesJson,
    /// poses.csv
    PosesCsv,
}

impl Format {
    /// All of them.
    pub const ALL: [Self; 12] = [
        Self::Colmap,
        Self::ColmapBin,
        Self::Ply,
        Self::Laz,
        Self::E57,
        Self::Obj,
        Self::Glb,
        Self::Tiff,
        Self::Relief,
        Self::Dzi,
        Self::PosesJson,
        Self::PosesCsv,
    ];

    /// File or folder that it makes, and its name on screen.
    fn names(self) -> (&'static str, &'static str) {
        match self {
            Self::Colmap => ("colmap", "colmap"),
            Self::ColmapBin => ("colmap-bin", "colmap-bin"),
            Self::Ply => ("points.ply", "ply"),
            Self::Laz => ("points.laz", "laz"),
            Self::E57 => ("points.e57", "e57"),
            Self::Obj => ("obj", "obj"),
            Self::Glb => ("model.glb", "glb"),
            Self::Tiff => ("panorama.tif", "tiff"),
            Self::Relief => ("relief.tif", "relief"),
            Self::Dzi => ("tiles", "dzi"),
            Self::PosesJson => ("poses.json", "poses-json"),
            Self::PosesCsv => ("poses.csv", "poses-csv"),
        }
    }
}

/// What may be chosen.
#[derive(Clone, Debug)]
pub struct ExportOptions {
    /// The reconstruction's folder.
    pub out: PathBuf,
    /// Where files go.
    pub folder: PathBuf,
    /// What is made.
    pub formats: Vec<Format>,
    /// Largest size of a pixel of TIFF, GLB and OBJ; `None`: the panorama's for TIFF, by a budget for the meshes.
    pub mm_per_px: Option<f64>,
    /// Longest side of a mesh's texture.
    pub texture_px: usize,
    /// Distance between points, about (pixels are doubled until it is met).
    pub point_step_m: f64,
    /// How the TIFF's pixels are stored.
    pub compression: TiffCompression,
    /// Quality of JPEGs, 1 to 100.
    pub jpeg_quality: u8,
    /// Replace what is there.
    pub replace: bool,
    /// Bars and lines on standard error.
    pub verbosity: Verbosity,
}

impl ExportOptions {
    /// Exports from `out` to `folder` with the choices of [`ModelOptions`].
    pub fn new(out: &Path, folder: &Path, formats: &[Format]) -> Self {
        let ModelOptions { texture_px, jpeg_quality, point_step_m, .. } = ModelOptions::default();
        Self {
            out: out.to_owned(),
            folder: folder.to_owned(),
            formats: formats.to_owned(),
            mm_per_px: None,
            texture_px,
            point_step_m,
            compression: TiffCompression::default(),
            jpeg_quality,
            replace: false,
            verbosity: Verbosity::Quiet,
        }
    }
}

/// What is in a file.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(untagged)]
pub enum Content {
    /// Photos with their poses.
    Poses {
        /// How many.
        photos: usize,
    },
    /// A point cloud.
    Points {
        /// How many.
        points: u64,
        /// Distance between neighbours.
        step_mm: f64,
    },
    /// Textured meshes.
    Meshes {
        /// How many.
        chunks: usize,
        /// Triangles of all of them.
        triangles: usize,
        /// Resolution of the textures.
        mm_per_px: f64,
    },
    /// A picture.
    Picture {
        /// Columns.
        width_px: usize,
        /// Rows.
        height_px: usize,
        /// Resolution.
        mm_per_px: f64,
    },
    /// As it was.
    Copy {},
}

impl fmt::Display for Content {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Poses { photos } => write!(f, "{photos} photos"),
            Self::Points { points, step_mm } => write!(f, "{points} points, {step_mm:.2} mm apart"),
            Self::Meshes { chunks, triangles, mm_per_px } => {
                write!(f, "{triangles} triangles in {chunks} chunks at {mm_per_px:.2} mm per pixel")
            }
            Self::Picture { width_px, height_px, mm_per_px } => {
                write!(f, "{width_px} x {height_px} px at {mm_per_px:.2} mm")
            }
            Self::Copy {} => write!(f, "copied"),
        }
    }
}

/// A finished file or folder.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Exported {
    /// What it is.
    pub format: Format,
    /// Where it is.
    pub path: PathBuf,
    /// Its size, of a folder that of all its files.
    pub bytes: u64,
    /// What is in it.
    #[serde(flatten)]
    pub content: Content,
}

/// Makes the files that are asked for, one after the other.
///
/// # Errors
/// [`ExportError`]: before anything is made, if something is there that may not be replaced; else at the first failure.
/// Formats that were finished before stay, of the one that failed nothing does.
pub fn export(options: &ExportOptions) -> Result<Vec<Exported>, ExportError> {
    let names = options.formats.iter().map(|format| format.names().0);
    let destination = Destination::open(&options.folder, options.replace, names)?;
    let finished = Finished::new(&options.out);
    let job = Job { options, finished: &finished };
    options
        .formats
        .iter()
        .map(|&format| {
            let progress = StageProgress::start(options.verbosity, format.names().1, 0);
            let (path, content) = destination.place(format.names().0, |path| job.make(format, path, &progress))?;
            progress.finish(&content.to_string());
            Ok(Exported { format, bytes: place::bytes(&path)?, path, content })
        })
        .collect()
}

struct Job<'a> {
    options: &'a ExportOptions,
    finished: &'a Finished,
}

impl Job<'_> {
    fn make(&self, format: Format, path: &Path, progress: &StageProgress) -> Result<Content, ExportError> {
        match format {
            Format::Colmap | Format::ColmapBin | Format::PosesJson | Format::PosesCsv => self.poses(format, path),
            Format::Ply | Format::Laz | Format::E57 => self.points(format, path, progress),
            Format::Obj | Format::Glb => self.meshes(format, path, progress),
            Format::Tiff => self.picture(path, progress),
            Format::Relief => self.copy("relief.tif", Stage::Surface, path, progress),
            Format::Dzi => self.copy("panorama/tiles", Stage::Texture, path, progress),
        }
    }

    fn poses(&self, format: Format, path: &Path) -> Result<Content, ExportError> {
        let reconstruction = self.finished.reconstruction()?;
        match format {
            Format::Colmap => colmap::write(reconstruction, path)?,
            Format::ColmapBin => colmap::write_binary(reconstruction, path)?,
            Format::PosesJson => poses::write_json(path, reconstruction)?,
            _ => {
                let write = || {
                    let mut file = BufWriter::new(File::create(path)?);
                    write_poses(&mut file, &reconstruction.poses)?;
                    file.flush()
                };
                write().map_err(at_path(path))?;
            }
        }
        Ok(Content::Poses { photos: reconstruction.poses.len() })
    }

    fn points(&self, format: Format, path: &Path, progress: &StageProgress) -> Result<Content, ExportError> {
        let source = PointSource::new(self.finished.wall()?, self.options.point_step_m);
        progress.restart(source.bands());
        let tick = || progress.tick();
        let points = match format {
            Format::Laz => laz::write(path, &source, &tick)?,
            Format::E57 => e57::write(path, &source, &tick)?,
            _ => ply::write(path, &source, &tick)?,
        };
        Ok(Content::Points { points, step_mm: source.step_m() * 1000.0 })
    }

    fn meshes(&self, format: Format, path: &Path, progress: &StageProgress) -> Result<Content, ExportError> {
        let options = ModelOptions {
            mm_per_px: self.options.mm_per_px,
            texture_px: self.options.texture_px,
            jpeg_quality: self.options.jpeg_quality,
            ..ModelOptions::default()
        };
        let plan = MeshPlan::new(self.finished.wall()?, &options);
        progress.restart(plan.len());
        let tick = || progress.tick();
        let made = if format == Format::Glb { plan.write_glb(path, &tick)? } else { plan.write_obj(path, &tick)? };
        Ok(Content::Meshes { chunks: made.chunks, triangles: made.triangles, mm_per_px: made.texture_mm_per_px })
    }

    fn picture(&self, path: &Path, progress: &StageProgress) -> Result<Content, ExportError> {
        let wall = self.finished.wall()?;
        let level = self.options.mm_per_px.map_or(wall.reader.last_level(), |mm_per_px| wall.level(mm_per_px));
        let Self { options: ExportOptions { compression, jpeg_quality, .. }, .. } = *self;
        let picture = Picture { wall, level, compression: *compression, jpeg_quality: *jpeg_quality };
        progress.restart(picture.tiles());
        picture.write(path, &|| progress.tick())?;
        let (width_px, height_px) = wall.reader.size(level);
        Ok(Content::Picture { width_px, height_px, mm_per_px: wall.mm_per_px(level) })
    }

    fn copy(&self, name: &str, stage: Stage, path: &Path, progress: &StageProgress) -> Result<Content, ExportError> {
        let from = self.finished.file(name, stage)?;
        progress.restart(if from.is_dir() { place::count(&from)? } else { 1 });
        place::copy(&from, path, &|| progress.tick())?;
        Ok(Content::Copy {})
    }
}

/// The tunnel frame turned by half a turn about x: x forward, y left, z up.
fn z_up<T: Neg<Output = T>>([x, y, z]: [T; 3]) -> [T; 3] {
    [x, -y, -z]
}
