//! The deep-zoom pyramid: written strip by strip while the panorama is made, read back by the model and the report.
//!
//! Layout as Deep Zoom viewers (`OpenSeadragon` and others) expect it: `panorama.dzi` beside
//! `panorama_files/<level>/<column>_<row>.png`; level 0 is one pixel, each level doubles, the last is full size.
//! Tiles of 256 pixels without overlap, PNG because pixels that no photo saw are transparent.

use std::fs::{self, File};
use std::io::{BufReader, BufWriter};
use std::path::{Path, PathBuf};

use rayon::prelude::*;

use super::error::{TextureError, at_path};
use crate::raster::Raster;

/// Side of a tile.
pub const TILE_PX: usize = 256;

/// An image with opacity.
pub type Rgba8 = Raster<u8, 4>;

/// Number of levels of a pyramid, and the size of one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Shape {
    width_px: usize,
    height_px: usize,
}

impl Shape {
    /// Number of the full-size level.
    fn last_level(self) -> u32 {
        self.width_px.max(self.height_px).next_power_of_two().trailing_zeros()
    }

    fn size(self, level: u32) -> (usize, usize) {
        let halvings = self.last_level() - level;
        let side = |full: usize| full.div_ceil(1 << halvings).max(1);
        (side(self.width_px), side(self.height_px))
    }
}

/// Writes the pyramid from top to bottom.
pub(super) struct TileWriter {
    folder: PathBuf,
    /// From the full-size level down to the single pixel.
    levels: Vec<LevelWriter>,
}

struct LevelWriter {
    folder: PathBuf,
    width: usize,
    height: usize,
    /// Rows of the tile row under way.
    pending: Vec<u8>,
    tile_row: usize,
    rows_done: usize,
    /// A row that waits for its partner before both are halved.
    odd_row: Option<Vec<u8>>,
}

impl TileWriter {
    /// Empties and prepares the folder.
    pub(super) fn create(folder: &Path, width_px: usize, height_px: usize) -> Result<Self, TextureError> {
        if folder.exists() {
            fs::remove_dir_all(folder).map_err(at_path(folder))?;
        }
        let shape = Shape { width_px, height_px };
        let mut levels = Vec::new();
        for level in (0..=shape.last_level()).rev() {
            let (width, height) = shape.size(level);
            let folder = folder.join("panorama_files").join(level.to_string());
            fs::create_dir_all(&folder).map_err(at_path(&folder))?;
            levels.push(LevelWriter {
                folder,
                width,
                height,
                pending: Vec::new(),
                tile_row: 0,
                rows_done: 0,
                odd_row: None,
            });
        }
        Ok(Self { folder: folder.to_owned(), levels })
    }

    /// Adds full-width rows (RGBA) below those written so far.
    pub(super) fn push(&mut self, rows: &[u8]) -> Result<(), TextureError> {
        let mut rows = std::borrow::Cow::Borrowed(rows);
        for level in &mut self.levels {
            if rows.is_empty() {
                break;
            }
            rows = std::borrow::Cow::Owned(level.push(&rows)?);
        }
        Ok(())
    }

    /// Writes the description; all rows must have been pushed.
    pub(super) fn finish(self) -> Result<(), TextureError> {
        let path = self.folder.join("panorama.dzi");
        let (width, height) = self.levels.first().map_or((0, 0), |level| (level.width, level.height));
        let text = format!(
            "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<Image xmlns=\"http://schemas.microsoft.com/deepzoom/2008\" \
             Format=\"png\" Overlap=\"0\" TileSize=\"{TILE_PX}\"><Size Width=\"{width}\" Height=\"{height}\"/></Image>\n"
        );
        fs::write(&path, text).map_err(at_path(&path))
    }
}

impl LevelWriter {
    /// Takes rows, writes the tiles that are complete, and returns the rows of the next smaller level.
    fn push(&mut self, rows: &[u8]) -> Result<Vec<u8>, TextureError> {
        let stride = self.width * 4;
        let mut smaller = Vec::new();
        for row in rows.chunks_exact(stride) {
            self.pending.extend_from_slice(row);
            self.rows_done += 1;
            match self.odd_row.take() {
                Some(upper) => halve(&upper, row, &mut smaller),
                None if self.rows_done == self.height => halve(row, row, &mut smaller),
                None => self.odd_row = Some(row.to_vec()),
            }
            if self.pending.len() == stride * TILE_PX || self.rows_done == self.height {
                self.write_tile_row()?;
            }
        }
        Ok(smaller)
    }

    fn write_tile_row(&mut self) -> Result<(), TextureError> {
        let stride = self.width * 4;
        let rows = self.pending.len() / stride;
        (0..self.width.div_ceil(TILE_PX)).into_par_iter().try_for_each(|column| {
            let first = column * TILE_PX;
            let width = TILE_PX.min(self.width - first);
            let mut tile = Vec::with_capacity(width * rows * 4);
            for row in self.pending.chunks_exact(stride) {
                tile.extend_from_slice(&row[first * 4..][..width * 4]);
            }
            write_png(&self.folder.join(format!("{column}_{}.png", self.tile_row)), width, rows, &tile)
        })?;
        self.tile_row += 1;
        self.pending.clear();
        Ok(())
    }
}

/// Averages two rows 2 x 2; transparent pixels do not count.
fn halve(upper: &[u8], lower: &[u8], out: &mut Vec<u8>) {
    for (a, b) in upper.chunks(8).zip(lower.chunks(8)) {
        let mut sum = [0_u32; 3];
        let (mut opaque, mut count) = (0_u32, 0_u32);
        for pixel in a.chunks_exact(4).chain(b.chunks_exact(4)) {
            let alpha = u32::from(pixel[3]);
            for (sum, &value) in sum.iter_mut().zip(pixel) {
                *sum += alpha * u32::from(value);
            }
            opaque += alpha;
            count += 1;
        }
        if opaque == 0 {
            out.extend([0; 4]);
        } else {
            out.extend(sum.map(|value| ((value + opaque / 2) / opaque) as u8));
            out.push(((opaque + count / 2) / count) as u8);
        }
    }
}

/// Writes an RGBA picture.
pub(crate) fn write_png(path: &Path, width: usize, height: usize, rgba: &[u8]) -> Result<(), TextureError> {
    let file = File::create(path).map_err(at_path(path))?;
    let failed = |source| TextureError::PngWrite { path: path.to_owned(), source };
    let mut encoder = png::Encoder::new(BufWriter::new(file), width as u32, height as u32);
    encoder.set_color(png::ColorType::Rgba);
    encoder.set_depth(png::BitDepth::Eight);
    encoder.set_compression(png::Compression::Fast);
    let mut writer = encoder.write_header().map_err(failed)?;
    writer.write_image_data(rgba).map_err(failed)?;
    writer.finish().map_err(failed)
}

/// Reads an RGBA picture.
pub(crate) fn read_png(path: &Path) -> Result<Rgba8, TextureError> {
    let file = File::open(path).map_err(at_path(path))?;
    let failed = |source| TextureError::PngRead { path: path.to_owned(), source };
    let mut reader = png::Decoder::new(BufReader::new(file)).read_info().map_err(failed)?;
    let mut data = vec![0; reader.output_buffer_size().unwrap_or_default()];
    let frame = reader.next_frame(&mut data).map_err(failed)?;
    data.truncate(frame.buffer_size());
    Ok(Raster { width: frame.width as usize, height: frame.height as usize, data })
}

/// A box of pixels of a level.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PixelBox {
    /// Left column.
    pub column: usize,
    /// Upper row.
    pub row: usize,
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
}

/// Reads boxes of the pyramid.
#[derive(Clone, Debug)]
pub struct TileReader {
    folder: PathBuf,
    shape: Shape,
}

impl TileReader {
    /// Opens the pyramid of a panorama of the given size; `folder` holds `panorama_files`.
    pub fn new(folder: &Path, width_px: usize, height_px: usize) -> Self {
        Self { folder: folder.to_owned(), shape: Shape { width_px, height_px } }
    }

    /// Number of the full-size level.
    pub fn last_level(&self) -> u32 {
        self.shape.last_level()
    }

    /// Width and height of a level.
    pub fn size(&self, level: u32) -> (usize, usize) {
        self.shape.size(level)
    }

    /// Reads a box of a level; what lies outside the picture is transparent.
    ///
    /// # Errors
    /// If a tile cannot be read.
    pub fn read(&self, level: u32, area: PixelBox) -> Result<Rgba8, TextureError> {
        let (width, height) = self.size(level);
        let mut out = Rgba8::new(area.width, area.height);
        let (columns, rows) =
            (area.column..(area.column + area.width).min(width), area.row..(area.row + area.height).min(height));
        if columns.is_empty() || rows.is_empty() {
            return Ok(out);
        }
        let tiles: Vec<(usize, usize)> = (rows.start / TILE_PX..=(rows.end - 1) / TILE_PX)
            .flat_map(|row| (columns.start / TILE_PX..=(columns.end - 1) / TILE_PX).map(move |column| (column, row)))
            .collect();
        let folder = self.folder.join("panorama_files").join(level.to_string());
        let pictures: Vec<Rgba8> = tiles
            .par_iter()
            .map(|(column, row)| read_png(&folder.join(format!("{column}_{row}.png"))))
            .collect::<Result<_, _>>()?;
        for ((tile_column, tile_row), picture) in tiles.into_iter().zip(pictures) {
            let (left, top) = (tile_column * TILE_PX, tile_row * TILE_PX);
            let from = columns.start.max(left)..columns.end.min(left + picture.width);
            for row in rows.start.max(top)..rows.end.min(top + picture.height) {
                let source = &picture.data[((row - top) * picture.width + from.start - left) * 4..][..from.len() * 4];
                out.data[((row - area.row) * area.width + from.start - area.column) * 4..][..from.len() * 4]
                    .copy_from_slice(source);
            }
        }
        Ok(out)
    }
}

/// Writes a whole picture as a pyramid.
#[cfg(test)]
pub(crate) fn write_tiles_for_tests(folder: &Path, grid: &super::PanoramaGrid, rgba: &[u8]) {
    let mut writer = TileWriter::create(folder, grid.width_px, grid.height_px).unwrap();
    writer.push(rgba).unwrap();
    writer.finish().unwrap();
}

#[cfg(test)]
mod tests {
    use super::*;

    fn picture(width: usize, height: usize) -> Vec<u8> {
        (0..width * height).flat_map(|at| [(at % 251) as u8, (at / width % 256) as u8, 9, 255]).collect()
    }

    #[test]
    fn what_is_written_in_strips_is_read_back_in_boxes() {
        let folder = tempfile::tempdir().unwrap();
        let (width, height) = (601, 523);
        let data = picture(width, height);
        let mut writer = TileWriter::create(folder.path(), width, height).unwrap();
        for strip in data.chunks(width * 4 * 100) {
            writer.push(strip).unwrap();
        }
        writer.finish().unwrap();
        let reader = TileReader::new(folder.path(), width, height);
        assert_eq!(reader.last_level(), 10);
        let all = reader.read(10, PixelBox { column: 0, row: 0, width, height }).unwrap();
        assert_eq!(all.data, data);
        let part = reader.read(10, PixelBox { column: 250, row: 255, width: 400, height: 9 }).unwrap();
        assert_eq!(part.at(7, 3), all.at(257, 258));
        assert_eq!(part.at(399, 3), [0; 4]);
        assert_eq!(reader.size(0), (1, 1));
        assert_eq!(reader.read(0, PixelBox { column: 0, row: 0, width: 1, height: 1 }).unwrap().data[3], 255);
    }

    #[test]
    fn halving_ignores_transparent_pixels() {
        let mut out = Vec::new();
        halve(&[10, 20, 30, 255, 99, 99, 99, 0], &[20, 30, 40, 255, 99, 99, 99, 0], &mut out);
        assert_eq!(out, [15, 25, 35, 128]);
    }
}
