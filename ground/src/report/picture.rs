//! Pictures as data addresses, so that the page is one file.
//!
//! Maps of the wall lie on their side here: along the axis from left to right, from crown to crown from top to bottom.

use std::path::Path;

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use jpeg_encoder::{ColorType, Encoder};

use super::ReportError;
use crate::texture::{PanoramaGrid, PixelBox, Rgba8, TileReader, read_png};

/// Grey of what no photo saw.
const UNSEEN: u8 = 236;
const QUALITY: u8 = 82;

/// The panorama, at most `longest_px` long.
pub(super) fn panorama(grid: &PanoramaGrid, tiles: &Path, longest_px: usize) -> Result<String, ReportError> {
    let reader = TileReader::new(tiles, grid.width_px, grid.height_px);
    let longest_of = |level| {
        let (width, height) = reader.size(level);
        width.max(height)
    };
    let level = (0..=reader.last_level()).rev().find(|&level| longest_of(level) <= longest_px).unwrap_or(0);
    let (width, height) = reader.size(level);
    lying(&reader.read(level, PixelBox { column: 0, row: 0, width, height })?, longest_px)
}

/// A map of the wall from a PNG file, thinned to at most `longest_px`.
pub(super) fn map(path: &Path, longest_px: usize) -> Result<String, ReportError> {
    lying(&read_png(path)?, longest_px)
}

fn lying(picture: &Rgba8, longest_px: usize) -> Result<String, ReportError> {
    let stride = picture.width.max(picture.height).div_ceil(longest_px).max(1);
    let (width, height) = (picture.height.div_ceil(stride), picture.width.div_ceil(stride));
    let mut rgb = Vec::with_capacity(width * height * 3);
    for column in (0..picture.width).step_by(stride) {
        for row in (0..picture.height).step_by(stride) {
            let [r, g, b, alpha] = picture.at(column, row).map(u32::from);
            let over = |value: u32| ((value * alpha + u32::from(UNSEEN) * (255 - alpha)) / 255) as u8;
            rgb.extend([over(r), over(g), over(b)]);
        }
    }
    let mut jpeg = Vec::new();
    Encoder::new(&mut jpeg, QUALITY).encode(&rgb, width as u16, height as u16, ColorType::Rgb)?;
    Ok(format!("data:image/jpeg;base64,{}", STANDARD.encode(jpeg)))
}
