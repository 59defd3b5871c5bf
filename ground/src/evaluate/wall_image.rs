//! An unrolled picture of the wall with its place: a panorama of ours, or the truth's texture.

use std::fs::{self, File};
use std::io::{self, BufReader, Cursor};
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use zune_jpeg::JpegDecoder;
use zune_jpeg::zune_core::colorspace::ColorSpace;
use zune_jpeg::zune_core::options::DecoderOptions;

/// Where the pixels of an unrolled picture lie: panorama.json, texture.json. Other keys are not looked at.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct WallGrid {
    /// Size of a pixel.
    pub mm_per_px: f64,
    /// Columns, along the arc length.
    pub width_px: usize,
    /// Rows, along the axis.
    pub height_px: usize,
    /// Axial place of the upper edge.
    pub x0_m: f64,
    /// Arc length of the left edge.
    pub s0_m: f64,
    /// Length of the wall once around.
    pub perimeter_m: f64,
}

/// Why an unrolled picture cannot be read.
#[derive(Debug, thiserror::Error)]
pub enum WallImageError {
    /// A file cannot be read.
    #[error("{}: cannot be read", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// The description is wrong.
    #[error("{}: not the description of an unrolled picture", path.display())]
    Json {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        source: serde_json::Error,
    },
    /// The PNG is wrong.
    #[error("{}: cannot be decoded as PNG", path.display())]
    Png {
        /// The file.
        path: PathBuf,
        /// What the decoder said.
        source: png::DecodingError,
    },
    /// The JPEG is wrong.
    #[error("{}: cannot be decoded as JPEG: {reason}", path.display())]
    Jpeg {
        /// The file.
        path: PathBuf,
        /// What the decoder said.
        reason: String,
    },
    /// Picture and description disagree.
    #[error(
        "{}: the picture is {width_px} x {height_px} pixels, its description says {} x {}",
        path.display(), grid.width_px, grid.height_px
    )]
    Size {
        /// The picture.
        path: PathBuf,
        /// Its columns.
        width_px: usize,
        /// Its rows.
        height_px: usize,
        /// What the description says.
        grid: WallGrid,
    },
}

/// An unrolled grey picture; 0 of `coverage` is "no photo saw it".
pub(super) struct WallImage {
    pub(super) grid: WallGrid,
    grey: Vec<u8>,
    coverage: Option<Vec<u8>>,
}

impl WallImage {
    /// Reads `folder/stem.json` and `folder/stem.png` (or `.jpg`). `None` if either is not there.
    pub(super) fn read(folder: &Path, stem: &str) -> Result<Option<Self>, WallImageError> {
        let json_path = folder.join(format!("{stem}.json"));
        let picture = ["png", "jpg"].iter().map(|e| folder.join(format!("{stem}.{e}"))).find(|path| path.is_file());
        let Some(path) = picture.filter(|_| json_path.is_file()) else { return Ok(None) };
        let json = fs::read(&json_path).map_err(|source| WallImageError::Io { path: json_path.clone(), source })?;
        let grid: WallGrid =
            serde_json::from_slice(&json).map_err(|source| WallImageError::Json { path: json_path, source })?;
        let (width_px, height_px, grey, coverage) =
            if path.extension().is_some_and(|e| e == "png") { read_png(&path)? } else { read_jpeg(&path)? };
        if (width_px, height_px) != (grid.width_px, grid.height_px) {
            return Err(WallImageError::Size { path, width_px, height_px, grid });
        }
        Ok(Some(Self { grid, grey, coverage }))
    }

    #[cfg(test)]
    pub(super) fn from_fn(grid: WallGrid, shade: impl Fn(f64, f64) -> Option<u8>) -> Self {
        let at = |i: usize| grid.place(i % grid.width_px, i / grid.width_px);
        let shades: Vec<Option<u8>> = (0..grid.width_px * grid.height_px).map(|i| shade(at(i).0, at(i).1)).collect();
        let coverage = shades.iter().map(|shade| if shade.is_some() { 255 } else { 0 }).collect();
        Self { grid, grey: shades.iter().map(|shade| shade.unwrap_or(0)).collect(), coverage: Some(coverage) }
    }

    /// The pixel's grey value if it is covered and inside.
    pub(super) fn pixel(&self, column: usize, row: usize) -> Option<f32> {
        if column >= self.grid.width_px || row >= self.grid.height_px {
            return None;
        }
        let index = row * self.grid.width_px + column;
        let covered = self.coverage.as_ref().is_none_or(|coverage| coverage[index] > 0);
        covered.then(|| f32::from(self.grey[index]))
    }

    /// The grey value at a place of the wall, bilinear; around the seam where the picture spans the whole section.
    /// `None` outside and where one of the four pixels is not covered.
    pub(super) fn sample(&self, s_m: f64, x_m: f64) -> Option<f32> {
        let grid = &self.grid;
        let metres_per_px = grid.mm_per_px / 1000.0;
        let columns_around = grid.perimeter_m / metres_per_px;
        let column = ((s_m - grid.s0_m) / metres_per_px).rem_euclid(columns_around) - 0.5;
        let row = (x_m - grid.x0_m) / metres_per_px - 0.5;
        let (column0, row0) = (column.floor(), row.floor());
        let (right, below) = ((column - column0) as f32, (row - row0) as f32);
        let full_circle = columns_around - (grid.width_px as f64) < 1.0;
        let wrap = |column: f64| -> Option<usize> {
            let width = grid.width_px as f64;
            let wrapped = if full_circle { column.rem_euclid(width) } else { column };
            (wrapped >= 0.0 && wrapped < width).then_some(wrapped as usize)
        };
        if row0 < 0.0 {
            return None;
        }
        let (left_column, right_column, row0) = (wrap(column0)?, wrap(column0 + 1.0)?, row0 as usize);
        let upper = self.pixel(left_column, row0)? * (1.0 - right) + self.pixel(right_column, row0)? * right;
        let lower = self.pixel(left_column, row0 + 1)? * (1.0 - right) + self.pixel(right_column, row0 + 1)? * right;
        Some(upper * (1.0 - below) + lower * below)
    }

    /// Tells whether the pixel that holds this place is covered.
    pub(super) fn covers(&self, s_m: f64, x_m: f64) -> bool {
        let metres_per_px = self.grid.mm_per_px / 1000.0;
        let columns_around = self.grid.perimeter_m / metres_per_px;
        let column = ((s_m - self.grid.s0_m) / metres_per_px).rem_euclid(columns_around);
        let row = (x_m - self.grid.x0_m) / metres_per_px;
        // A picture may be a fraction of a pixel narrower than the section's length.
        let column = (column as usize).min(self.grid.width_px.saturating_sub(usize::from(column < columns_around)));
        row >= 0.0 && self.pixel(column, row as usize).is_some()
    }
}

impl WallGrid {
    /// Arc length and axial place of a pixel's centre.
    pub(super) fn place(&self, column: usize, row: usize) -> (f64, f64) {
        let metres_per_px = self.mm_per_px / 1000.0;
        (self.s0_m + (column as f64 + 0.5) * metres_per_px, self.x0_m + (row as f64 + 0.5) * metres_per_px)
    }
}

/// Width, height, grey values, coverage.
type Decoded = (usize, usize, Vec<u8>, Option<Vec<u8>>);

fn read_png(path: &Path) -> Result<Decoded, WallImageError> {
    let file = File::open(path).map_err(|source| WallImageError::Io { path: path.to_owned(), source })?;
    let png_error = |source| WallImageError::Png { path: path.to_owned(), source };
    let mut decoder = png::Decoder::new(BufReader::new(file));
    decoder.set_transformations(png::Transformations::normalize_to_color8());
    let mut reader = decoder.read_info().map_err(png_error)?;
    let (width, height) = (reader.info().width as usize, reader.info().height as usize);
    let (colour_type, _) = reader.output_color_type();
    let channels = colour_type.samples();
    let has_alpha = channels.is_multiple_of(2);
    let mut grey = Vec::with_capacity(width * height);
    let mut coverage = has_alpha.then(|| Vec::with_capacity(width * height));
    while let Some(row) = reader.next_row().map_err(png_error)? {
        for pixel in row.data().chunks_exact(channels) {
            grey.push(match pixel {
                [red, green, blue, ..] => luma(*red, *green, *blue),
                [grey, ..] => *grey,
                [] => 0,
            });
            if let (Some(coverage), Some(alpha)) = (&mut coverage, pixel.last()) {
                coverage.push(*alpha);
            }
        }
    }
    Ok((width, height, grey, coverage))
}

/// ITU-R BT.601 luma in 1/256.
fn luma(red: u8, green: u8, blue: u8) -> u8 {
    ((77 * u32::from(red) + 150 * u32::from(green) + 29 * u32::from(blue)) >> 8) as u8
}

fn read_jpeg(path: &Path) -> Result<Decoded, WallImageError> {
    let bytes = fs::read(path).map_err(|source| WallImageError::Io { path: path.to_owned(), source })?;
    let options = DecoderOptions::new_fast()
        .set_max_width(usize::from(u16::MAX))
        .set_max_height(usize::from(u16::MAX))
        .jpeg_set_out_colorspace(ColorSpace::Luma);
    let mut decoder = JpegDecoder::new_with_options(Cursor::new(bytes), options);
    let jpeg_error = |reason: String| WallImageError::Jpeg { path: path.to_owned(), reason };
    let grey = decoder.decode().map_err(|error| jpeg_error(format!("{error:?}")))?;
    let info = decoder.info().ok_or_else(|| jpeg_error("no size in it".to_owned()))?;
    Ok((usize::from(info.width), usize::from(info.height), grey, None))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ring() -> WallGrid {
        WallGrid { mm_per_px: 10.0, width_px: 200, height_px: 50, x0_m: -0.1, s0_m: 0.0, perimeter_m: 2.0 }
    }

    #[test]
    fn sampling_at_a_pixel_s_centre_gives_the_pixel_and_between_two_their_mean() {
        let image = WallImage::from_fn(ring(), |s_m, _| Some((s_m * 100.0) as u8));
        let (s_m, x_m) = ring().place(20, 7);
        assert!((image.sample(s_m, x_m).unwrap() - 20.0).abs() < 1e-3);
        assert!((image.sample(s_m + 0.005, x_m).unwrap() - 20.5).abs() < 1e-3);
    }

    #[test]
    fn a_full_ring_is_sampled_across_its_seam() {
        let image = WallImage::from_fn(ring(), |s_m, _| Some(if s_m < 1.0 { 100 } else { 200 }));
        assert!((image.sample(0.0, 0.1).unwrap() - 150.0).abs() < 1e-3);
        assert!((image.sample(2.0, 0.1).unwrap() - 150.0).abs() < 1e-3);
        assert!((image.sample(-0.5, 0.1).unwrap() - 200.0).abs() < 1e-3);
    }

    #[test]
    fn nothing_is_sampled_outside_or_where_no_photo_saw() {
        let image = WallImage::from_fn(ring(), |s_m, _| (s_m < 1.0).then_some(9));
        assert_eq!(image.sample(1.5, 0.1), None);
        assert_eq!(image.sample(0.5, -0.2), None);
        assert_eq!(image.sample(0.5, 0.5), None);
        assert!(image.covers(0.5, 0.1) && !image.covers(1.5, 0.1) && !image.covers(0.5, 0.45));
    }
}
