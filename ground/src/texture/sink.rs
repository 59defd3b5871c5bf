//! Where finished strips go: one big PNG, the deep-zoom pyramid, a picture per planar part.

use std::fs::{self, File};
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

use adit_geometry::profile::{Part, Profile};
use serde::{Deserialize, Serialize};
use serde_json::json;

use super::error::{TextureError, at_path};
use super::grid::PanoramaGrid;
use super::tiles::TileWriter;

/// Larger panoramas are left as tiles only: few programs open larger PNGs.
const LARGEST_PNG_PX: u64 = 400_000_000;
/// Longest side of a PNG, for the same reason.
const LONGEST_PNG_PX: usize = 65_000;

/// A planar part of the wall and where it lies on the panorama.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Sheet {
    /// File in `sheets/`.
    pub file: String,
    /// The part's name.
    pub part: String,
    /// First column, as a column of the panorama; negative where the part lies over the seam at the crown.
    pub column0: i64,
    /// Columns.
    pub width_px: usize,
}

/// A PNG that grows row by row.
struct PngStream {
    path: PathBuf,
    writer: png::StreamWriter<'static, BufWriter<File>>,
}

impl PngStream {
    fn create(path: PathBuf, width: usize, height: usize) -> Result<Self, TextureError> {
        let file = File::create(&path).map_err(at_path(&path))?;
        let mut encoder = png::Encoder::new(BufWriter::new(file), width as u32, height as u32);
        encoder.set_color(png::ColorType::Rgba);
        encoder.set_depth(png::BitDepth::Eight);
        encoder.set_compression(png::Compression::Fast);
        let writer = encoder
            .write_header()
            .and_then(png::Writer::into_stream_writer)
            .map_err(|source| TextureError::PngWrite { path: path.clone(), source })?;
        Ok(Self { path, writer })
    }

    fn push(&mut self, rows: &[u8]) -> Result<(), TextureError> {
        self.writer.write_all(rows).map_err(at_path(&self.path))
    }

    fn finish(self) -> Result<(), TextureError> {
        let path = self.path;
        self.writer.finish().map_err(|source| TextureError::PngWrite { path, source })
    }
}

/// Everything that is written while strips are finished.
pub(super) struct Sinks {
    panorama: Option<PngStream>,
    tiles: TileWriter,
    sheets: Vec<(Sheet, PngStream)>,
    sheet_list: PathBuf,
    grid: PanoramaGrid,
}

impl Sinks {
    /// Prepares `panorama/` and `sheets/` below `out`.
    pub(super) fn create(out: &Path, grid: PanoramaGrid, profile: &Profile<f64>) -> Result<Self, TextureError> {
        let folder = out.join("panorama");
        let sheet_folder = out.join("sheets");
        fs::create_dir_all(&folder).map_err(at_path(&folder))?;
        if sheet_folder.exists() {
            fs::remove_dir_all(&sheet_folder).map_err(at_path(&sheet_folder))?;
        }
        let tiles = TileWriter::create(&folder.join("tiles"), grid.width_px, grid.height_px)?;
        let path = folder.join("panorama.png");
        let small = grid.width_px as u64 * grid.height_px as u64 <= LARGEST_PNG_PX
            && grid.width_px.max(grid.height_px) <= LONGEST_PNG_PX;
        let panorama = if small {
            Some(PngStream::create(path, grid.width_px, grid.height_px)?)
        } else {
            if path.exists() {
                fs::remove_file(&path).map_err(at_path(&path))?;
            }
            None
        };
        let mut sheets = Vec::new();
        let planned = if grid.height_px <= LONGEST_PNG_PX { sheets_of(&grid, profile) } else { Vec::new() };
        if !planned.is_empty() {
            fs::create_dir_all(&sheet_folder).map_err(at_path(&sheet_folder))?;
        }
        for sheet in planned {
            let stream = PngStream::create(sheet_folder.join(&sheet.file), sheet.width_px, grid.height_px)?;
            sheets.push((sheet, stream));
        }
        Ok(Self { panorama, tiles, sheets, sheet_list: sheet_folder.join("sheets.json"), grid })
    }

    /// Adds finished rows (RGBA, full width).
    pub(super) fn push(&mut self, rows: &[u8]) -> Result<(), TextureError> {
        self.tiles.push(rows)?;
        let width = self.grid.width_px;
        for (sheet, stream) in &mut self.sheets {
            let mut cropped = Vec::with_capacity(rows.len() / width * sheet.width_px);
            for row in rows.chunks_exact(width * 4) {
                for column in sheet.column0..sheet.column0 + sheet.width_px as i64 {
                    let at = column.rem_euclid(width as i64) as usize * 4;
                    cropped.extend_from_slice(&row[at..at + 4]);
                }
            }
            stream.push(&cropped)?;
        }
        self.panorama.as_mut().map_or(Ok(()), |stream| stream.push(rows))
    }

    /// Closes all files; returns the panorama's file, if it was small enough for one, and the sheets.
    pub(super) fn finish(self) -> Result<(Option<String>, Vec<Sheet>), TextureError> {
        let has_panorama = self.panorama.is_some();
        self.panorama.map_or(Ok(()), PngStream::finish)?;
        self.tiles.finish()?;
        let mut sheets = Vec::new();
        for (sheet, stream) in self.sheets {
            stream.finish()?;
            sheets.push(sheet);
        }
        if !sheets.is_empty() {
            let list = json!({
                "format": 1,
                "mm_per_px": self.grid.mm_per_px,
                "height_px": self.grid.height_px,
                "x0_m": self.grid.x0_m,
                "sheets": sheets.iter().map(|sheet| json!({
                    "file": sheet.file,
                    "part": sheet.part,
                    "width_px": sheet.width_px,
                    "s0_m": self.grid.s_m(sheet.column0 as f64),
                })).collect::<Vec<_>>(),
            });
            fs::write(&self.sheet_list, format!("{list:#}\n")).map_err(at_path(&self.sheet_list))?;
        }
        Ok((has_panorama.then(|| "panorama.png".to_owned()), sheets))
    }
}

/// Finds the planar parts; pieces of the same part that follow each other (over the crown, too) make one sheet.
fn sheets_of(grid: &PanoramaGrid, profile: &Profile<f64>) -> Vec<Sheet> {
    let mut runs: Vec<(Part, f64, f64)> = Vec::new();
    for piece in profile.pieces().iter().filter(|piece| piece.is_planar()) {
        let (start_m, end_m) = (piece.start_s_m(), piece.start_s_m() + piece.length_m());
        match runs.last_mut() {
            Some((part, _, end)) if *part == piece.part() && (start_m - *end).abs() < 1e-6 => *end = end_m,
            _ => runs.push((piece.part(), start_m, end_m)),
        }
    }
    if let [first, .., last] = runs.as_slice()
        && first.0 == last.0
        && first.1 < 1e-6
        && (last.2 - grid.perimeter_m).abs() < 1e-6
    {
        let start_m = last.1 - grid.perimeter_m;
        runs[0].1 = start_m;
        runs.pop();
    }
    let texel_m = grid.texel_m();
    let mut sheets: Vec<Sheet> = Vec::new();
    for (part, start_m, end_m) in runs {
        let (first, end) = ((start_m / texel_m).round() as i64, (end_m / texel_m).round() as i64);
        let name = part_name(part);
        let same = sheets.iter().filter(|sheet| sheet.part == name).count();
        let file = if same == 0 { format!("{name}.png") } else { format!("{name}-{}.png", same + 1) };
        if end > first {
            sheets.push(Sheet { file, part: name.to_owned(), column0: first, width_px: (end - first) as usize });
        }
    }
    sheets
}

/// The part's name in files.
pub(crate) fn part_name(part: Part) -> &'static str {
    match part {
        Part::Lining => "lining",
        Part::Ceiling => "ceiling",
        Part::RightWall => "right-wall",
        Part::Floor => "floor",
        Part::LeftWall => "left-wall",
    }
}

#[cfg(test)]
mod tests {
    use adit_geometry::profile::ProfileSpec;

    use super::*;

    #[test]
    fn a_rectangle_has_four_sheets_and_its_ceiling_lies_over_the_seam() {
        let spec = ProfileSpec::Rectangle { width_m: 4.0, height_m: 3.0, axis_height_m: 1.5 };
        let profile = spec.build().unwrap();
        let grid = PanoramaGrid::new(profile.perimeter_m(), 10.0, 0.0, 1.0);
        let sheets = sheets_of(&grid, &profile);
        let found: Vec<_> = sheets.iter().map(|s| (s.part.as_str(), s.column0, s.width_px)).collect();
        let expected = [("ceiling", -200, 400), ("right-wall", 200, 300), ("floor", 500, 400), ("left-wall", 900, 300)];
        assert_eq!(found, expected);
    }

    #[test]
    fn a_circle_has_no_sheet_and_an_underpass_three() {
        let count = |spec: ProfileSpec<f64>| {
            let profile = spec.build().unwrap();
            sheets_of(&PanoramaGrid::new(profile.perimeter_m(), 10.0, 0.0, 1.0), &profile).len()
        };
        assert_eq!(count(ProfileSpec::Circle { radius_m: 3.0 }), 0);
        assert_eq!(count(ProfileSpec::Underpass { width_m: 4.0, wall_m: 2.5, rise_m: 1.0, axis_height_m: 1.4 }), 3);
    }
}
