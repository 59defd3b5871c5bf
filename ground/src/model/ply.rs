//! points.ply: the wall as dense points with normals, colours and confidence, binary, written band by band.
//!
//! Tunnel frame (x forward, y right, z down), metres, single precision (0.06 mm at a kilometre); normals inwards.

use std::fs::File;
use std::io::{BufWriter, Seek, SeekFrom, Write};
use std::path::Path;

use super::error::{ModelError, at_path};
use crate::surface::{SurfaceStore, WallPlace};
use crate::texture::{PanoramaGrid, PixelBox, TILE_PX, TileReader};

/// Six single-precision numbers, a colour, the confidence (0: height not measured).
const POINT_BYTES: usize = 31;

/// Writes the points of the pyramid's level that is nearest to `step_m` per pixel; returns how many there are.
pub(super) fn write(
    path: &Path,
    reader: &TileReader,
    grid: &PanoramaGrid,
    surface: &SurfaceStore,
    step_m: f64,
) -> Result<u64, ModelError> {
    let halvings = (step_m / grid.texel_m()).log2().round().clamp(0.0, f64::from(reader.last_level()));
    let level = reader.last_level() - halvings as u32;
    let scale = halvings.exp2();
    let (width, height) = reader.size(level);
    let around: Vec<f64> =
        (0..width).map(|column| grid.s_m(((column as f64 + 0.5) * scale).min(grid.width_px as f64 - 0.5))).collect();
    let x_of = |row: usize| grid.x_m(((row as f64 + 0.5) * scale).min(grid.height_px as f64 - 0.5));
    let mut file = BufWriter::new(File::create(path).map_err(at_path(path))?);
    let mut count = 0;
    file.write_all(header(count).as_bytes()).map_err(at_path(path))?;
    for row in (0..height).step_by(TILE_PX) {
        let rows = TILE_PX.min(height - row);
        let band = reader.read(level, PixelBox { column: 0, row, width, height: rows })?;
        let window = surface.window([x_of(row), x_of(row + rows - 1)])?;
        let mut bytes = Vec::with_capacity(width * POINT_BYTES);
        for line in 0..rows {
            let x_m = x_of(row + line);
            bytes.clear();
            for (&s_m, pixel) in around.iter().zip(band.data[line * width * 4..].chunks_exact(4)) {
                if pixel[3] >= 128 {
                    let WallPlace { position, normal } = window.point(s_m, x_m);
                    let numbers = position.iter().chain(normal.iter()).map(|number| *number as f32);
                    bytes.extend(numbers.flat_map(f32::to_le_bytes));
                    bytes.extend_from_slice(&pixel[..3]);
                    bytes.extend((window.confidence(s_m, x_m) as f32).to_le_bytes());
                    count += 1;
                }
            }
            file.write_all(&bytes).map_err(at_path(path))?;
        }
    }
    file.seek(SeekFrom::Start(0)).map_err(at_path(path))?;
    file.write_all(header(count).as_bytes()).map_err(at_path(path))?;
    file.flush().map_err(at_path(path))?;
    Ok(count)
}

/// The header, equally long for every count: it is written again when the count is known.
fn header(count: u64) -> String {
    let digits = count.to_string();
    let padding = ".".repeat(20_usize.saturating_sub(digits.len()));
    format!(
        "ply\nformat binary_little_endian 1.0\ncomment adit {} {padding}\n\
         comment tunnel frame, metres: x forward, y right, z down; normals point inwards\n\
         element vertex {digits}\n\
         property float x\nproperty float y\nproperty float z\n\
         property float nx\nproperty float ny\nproperty float nz\n\
         property uchar red\nproperty uchar green\nproperty uchar blue\n\
         property float confidence\nend_header\n",
        env!("CARGO_PKG_VERSION")
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_header_keeps_its_length() {
        assert_eq!(header(0).len(), header(123_456_789).len());
        assert!(header(42).contains("\nelement vertex 42\n"));
    }
}
