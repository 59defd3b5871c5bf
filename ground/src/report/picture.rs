//! Pictures as data addresses, so that the page is one file.

use std::path::Path;

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use jpeg_encoder::{ColorType, Encoder};

use super::ReportError;
use crate::texture::{PanoramaGrid, PixelBox, TileReader};

/// Grey of what no photo saw.
const UNSEEN: u8 = 236;
const QUALITY: u8 = 82;

/// The panorama at most `longest_px` long, lying on its side: along the axis from left to right, crown at the top edge.
pub(super) fn panorama(grid: &PanoramaGrid, tiles: &Path, longest_px: usize) -> Result<String, ReportError> {
    let reader = TileReader::new(tiles, grid.width_px, grid.height_px);
    let mut level = reader.last_level();
    while level > 0 && {
        let (width, height) = reader.size(level);
        width.max(height) > longest_px
    } {
        level -= 1;
    }
    let (width, height) = reader.size(level);
    let picture = reader.read(level, PixelBox { column: 0, row: 0, width, height })?;
    // Transposed: the picture's columns are the panorama's rows.
    let mut rgb = Vec::with_capacity(width * height * 3);
    for column in 0..width {
        for row in 0..height {
            let [r, g, b, alpha] = picture.at(column, row);
            let over = |value: u8| {
                let alpha = u32::from(alpha);
                ((u32::from(value) * alpha + u32::from(UNSEEN) * (255 - alpha)) / 255) as u8
            };
            rgb.extend([over(r), over(g), over(b)]);
        }
    }
    let mut jpeg = Vec::new();
    Encoder::new(&mut jpeg, QUALITY).encode(&rgb, height as u16, width as u16, ColorType::Rgb)?;
    Ok(format!("data:image/jpeg;base64,{}", STANDARD.encode(jpeg)))
}

/// A PNG file as it is; nothing if it is not there.
pub(super) fn file(path: &Path) -> Option<String> {
    let content = std::fs::read(path).ok()?;
    Some(format!("data:image/png;base64,{}", STANDARD.encode(content)))
}
