//! The textured model in the formats that other programs open, made from the panorama's tiles: GLB, OBJ, PLY.

pub mod colmap;
mod error;
mod glb;
mod mesh;
mod obj;
pub mod ply;
mod points;
mod wall;

use std::path::Path;

use rayon::prelude::*;
use serde::{Deserialize, Serialize};

pub use error::ModelError;
pub use points::{DensePoint, PointSource};
pub use wall::TexturedWall;

use crate::surface::SurfaceStore;
use crate::texture::PanoramaGrid;
use glb::GlbWriter;
use mesh::{Chunk, ChunkBox, ChunkOptions};
use obj::ObjWriter;

/// No texture may be larger: the limit of many graphics cards and of the JPEG encoder's care.
const LARGEST_TEXTURE_PX: usize = 8192;
/// Chunks are made side by side as long as their pictures together take no more than this.
const CHUNKS_BYTES: usize = 512 << 20;

/// What may be chosen.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ModelOptions {
    /// Longest side of a chunk's texture, 64 to 8192.
    pub texture_px: usize,
    /// Size of a texture's pixel on the wall, at most (pixels are doubled as long as they fit); `None`: by the budget.
    pub mm_per_px: Option<f64>,
    /// Pixels of all textures together; a longer tunnel gets coarser textures, the panorama keeps the fine ones.
    pub texture_budget_px: u64,
    /// Quality of the textures' JPEGs, 1 to 100.
    pub jpeg_quality: u8,
    /// Largest distance of a facet from the arc that it stands for.
    pub sagitta_m: f64,
    /// Longest side of a facet.
    pub facet_m: f64,
    /// Distance between the points of the point cloud, about (texels are halved until they fit).
    pub point_step_m: f64,
}

impl Default for ModelOptions {
    fn default() -> Self {
        Self {
            texture_px: 4096,
            mm_per_px: None,
            // 10 m of a 6 m bore at 2 mm are 47 million; a desktop viewer holds a quarter of a gigapixel unpacked.
            texture_budget_px: 100_000_000,
            jpeg_quality: 88,
            sagitta_m: 0.002,
            // A bulge of 50 mm over 0.3 m departs from such a facet by 1.6 mm at most.
            facet_m: 0.075,
            point_step_m: 0.008,
        }
    }
}

/// What the model stage made.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ModelReport {
    /// Meshes with a texture of their own.
    pub chunks: usize,
    /// Triangles.
    pub triangles: usize,
    /// Resolution of the textures.
    pub texture_mm_per_px: f64,
    /// Size of model.glb.
    pub glb_bytes: u64,
    /// Points of points.ply.
    pub points: u64,
}

/// Writes `model.glb`, `model.obj` (with `model.mtl` and `model_textures/`) and `points.ply` from the tiles in `out`, on the
/// wall `surface`.
///
/// # Errors
/// [`ModelError`] if the tiles cannot be read or a file cannot be written.
pub fn write(
    surface: SurfaceStore,
    grid: &PanoramaGrid,
    options: &ModelOptions,
    out: &Path,
) -> Result<ModelReport, ModelError> {
    let wall = TexturedWall::new(surface, grid, out);
    let glb = out.join("model.glb");
    let sinks: Vec<Box<dyn ChunkSink>> = vec![Box::new(GlbWriter::create(&glb)?), Box::new(ObjWriter::create(out)?)];
    let meshes = MeshPlan::new(&wall, options).write(sinks, &|| ())?;
    let points = ply::write(&out.join("points.ply"), &PointSource::new(&wall, options.point_step_m), &|| ())?;
    Ok(ModelReport {
        chunks: meshes.chunks,
        triangles: meshes.triangles,
        texture_mm_per_px: meshes.texture_mm_per_px,
        glb_bytes: std::fs::metadata(&glb).map_err(error::at_path(&glb))?.len(),
        points,
    })
}

/// A file format that textured chunks are written to, one after the other.
trait ChunkSink {
    fn add(&mut self, chunk: &Chunk) -> Result<(), ModelError>;
    fn finish(self: Box<Self>) -> Result<(), ModelError>;
}

/// What became of a [`MeshPlan`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MeshReport {
    /// Meshes with a texture of their own.
    pub chunks: usize,
    /// Triangles.
    pub triangles: usize,
    /// Resolution of the textures.
    pub texture_mm_per_px: f64,
}

/// The wall divided into chunks, to be written as GLB or OBJ.
#[derive(Debug)]
pub struct MeshPlan<'a> {
    wall: &'a TexturedWall,
    options: ChunkOptions,
    level: u32,
    boxes: Vec<ChunkBox>,
}

impl<'a> MeshPlan<'a> {
    /// Divides the wall at the resolution that the options ask for.
    pub fn new(wall: &'a TexturedWall, options: &ModelOptions) -> Self {
        let reader = &wall.reader;
        let fits = |level: &u32| {
            let (width, height) = reader.size(*level);
            width as u64 * height as u64 <= options.texture_budget_px
        };
        let by_budget = || (0..=reader.last_level()).rev().find(fits).unwrap_or(0);
        let level = options.mm_per_px.map_or_else(by_budget, |mm_per_px| wall.level(mm_per_px));
        let options = ChunkOptions {
            largest_texture_px: options.texture_px.clamp(64, LARGEST_TEXTURE_PX),
            sagitta_m: options.sagitta_m,
            facet_m: options.facet_m,
            jpeg_quality: options.jpeg_quality.clamp(1, 100),
        };
        Self { wall, options, level, boxes: mesh::plan(reader, level, &options) }
    }

    /// Chunks that are looked at, one tick each; those that no photo saw are left out.
    pub fn len(&self) -> usize {
        self.boxes.len()
    }

    /// Whether there is nothing to write.
    pub fn is_empty(&self) -> bool {
        self.boxes.is_empty()
    }

    /// Writes a binary glTF file.
    ///
    /// # Errors
    /// [`ModelError`] if a tile cannot be read or the file cannot be written.
    pub fn write_glb(&self, path: &Path, tick: &(dyn Fn() + Sync)) -> Result<MeshReport, ModelError> {
        self.write(vec![Box::new(GlbWriter::create(path)?)], tick)
    }

    /// Writes `model.obj`, `model.mtl` and `model_textures/` to a folder.
    ///
    /// # Errors
    /// [`ModelError`] if a tile cannot be read or a file cannot be written.
    pub fn write_obj(&self, folder: &Path, tick: &(dyn Fn() + Sync)) -> Result<MeshReport, ModelError> {
        self.write(vec![Box::new(ObjWriter::create(folder)?)], tick)
    }

    fn write(&self, mut sinks: Vec<Box<dyn ChunkSink>>, tick: &(dyn Fn() + Sync)) -> Result<MeshReport, ModelError> {
        let wall = self.wall;
        let mut report = MeshReport { chunks: 0, triangles: 0, texture_mm_per_px: wall.mm_per_px(self.level) };
        // RGBA and RGB of a picture are in memory at the same time.
        let batch = (CHUNKS_BYTES / (self.options.largest_texture_px.pow(2) * 7)).max(1);
        for boxes in self.boxes.chunks(batch) {
            let made: Vec<Option<Chunk>> = boxes
                .par_iter()
                .map(|area| {
                    let chunk = mesh::chunk(area, &wall.reader, &wall.grid, &wall.surface, &self.options);
                    tick();
                    chunk
                })
                .collect::<Result<_, _>>()?;
            for chunk in made.iter().flatten() {
                sinks.iter_mut().try_for_each(|sink| sink.add(chunk))?;
                report.chunks += 1;
                report.triangles += chunk.indices.len() / 3;
            }
        }
        sinks.into_iter().try_for_each(ChunkSink::finish)?;
        Ok(report)
    }
}
