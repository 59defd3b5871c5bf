//! Pictures as data addresses, so that the page is one file.
//!
//! Maps of the wall are turned by a quarter here: along the axis from left to right, clockwise looking forward from bottom to
//! top. A turn, not a reflection: what is written on the wall stays readable.

use std::path::Path;

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use jpeg_encoder::{ColorType, Encoder, EncodingError};

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
    Ok(wall_address(&reader.read(level, PixelBox { column: 0, row: 0, width, height })?, longest_px)?)
}

/// A map of the wall from a PNG file, thinned to at most `longest_px`.
pub(super) fn map(path: &Path, longest_px: usize) -> Result<String, ReportError> {
    Ok(wall_address(&read_png(path)?, longest_px)?)
}

/// A map of the wall, thinned to at most `longest_px`.
pub(crate) fn wall_address(picture: &Rgba8, longest_px: usize) -> Result<String, EncodingError> {
    let stride = picture.width.max(picture.height).div_ceil(longest_px).max(1);
    let (width, height) = (picture.height.div_ceil(stride), picture.width.div_ceil(stride));
    let mut rgb = Vec::with_capacity(width * height * 3);
    for column in (0..picture.width).step_by(stride).rev() {
        for row in (0..picture.height).step_by(stride) {
            let [r, g, b, alpha] = picture.at(column, row).map(u32::from);
            let over = |value: u32| ((value * alpha + u32::from(UNSEEN) * (255 - alpha)) / 255) as u8;
            rgb.extend([over(r), over(g), over(b)]);
        }
    }
    jpeg_address(&rgb, [width, height], ColorType::Rgb)
}

/// A picture of `[width, height]` pixels as a JPEG in a data address.
///
/// # Errors
/// If a side is 0 or above 65,535.
pub(crate) fn jpeg_address(pixels: &[u8], size: [usize; 2], colours: ColorType) -> Result<String, EncodingError> {
    let mut jpeg = Vec::new();
    Encoder::new(&mut jpeg, QUALITY).encode(pixels, size[0] as u16, size[1] as u16, colours)?;
    Ok(format!("data:image/jpeg;base64,{}", STANDARD.encode(jpeg)))
}

#[cfg(test)]
mod tests {
    use zune_jpeg::JpegDecoder;
    use zune_jpeg::zune_core::bytestream::ZCursor;

    use super::*;

    #[test]
    fn maps_are_turned_and_not_reflected() {
        // Bright where s and x are small: the panorama's upper left corner.
        let mut map = Rgba8::new(32, 16);
        for row in 0..16 {
            for column in 0..32 {
                let value = if row < 8 && column < 16 { 250 } else { 5 };
                map.set(column, row, [value, value, value, 255]);
            }
        }
        let address = wall_address(&map, 64).unwrap();
        let jpeg = STANDARD.decode(address.trim_start_matches("data:image/jpeg;base64,")).unwrap();
        let mut decoder = JpegDecoder::new(ZCursor::new(jpeg));
        let pixels = decoder.decode().unwrap();
        let at = |column: usize, row: usize| pixels[(row * 16 + column) * 3];
        assert_eq!(decoder.dimensions(), Some((16, 32)));
        // Small x is left, small s is at the bottom.
        assert!(at(2, 28) > 200 && at(13, 28) < 50 && at(2, 3) < 50);
    }
}
