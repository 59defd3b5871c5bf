//! points.ply: the wall as dense points with normals and colours, binary, written band by band.
//!
//! Tunnel frame (x forward, y right, z down), metres, single precision (0.06 mm at a kilometre); normals inwards.

use std::fs::File;
use std::io::{BufWriter, Seek, SeekFrom, Write};
use std::path::Path;

use adit_geometry::profile::Profile;

use super::error::{ModelError, at_path};
use crate::texture::{PanoramaGrid, PixelBox, TILE_PX, TileReader};

/// Writes the points of the pyramid's level that is nearest to `step_m` per pixel; returns how many there are.
pub(super) fn write(
    path: &Path,
    reader: &TileReader,
    grid: &PanoramaGrid,
    profile: &Profile<f64>,
    step_m: f64,
) -> Result<u64, ModelError> {
    let halvings = (step_m / grid.texel_m()).log2().round().clamp(0.0, f64::from(reader.last_level()));
    let level = reader.last_level() - halvings as u32;
    let scale = halvings.exp2();
    let (width, height) = reader.size(level);
    let wall: Vec<Wall> = (0..width)
        .filter_map(|column| {
            let s_m = grid.s_m(((column as f64 + 0.5) * scale).min(grid.width_px as f64 - 0.5));
            let surface = profile.at(s_m)?;
            Some(Wall {
                point: [surface.point.x as f32, surface.point.y as f32],
                normal: [surface.normal.x as f32, surface.normal.y as f32],
            })
        })
        .collect();
    let mut file = BufWriter::new(File::create(path).map_err(at_path(path))?);
    let mut count = 0;
    file.write_all(header(count).as_bytes()).map_err(at_path(path))?;
    for row in (0..height).step_by(TILE_PX) {
        let rows = TILE_PX.min(height - row);
        let band = reader.read(level, PixelBox { column: 0, row, width, height: rows })?;
        let mut bytes = Vec::with_capacity(width * 27);
        for line in 0..rows {
            let v = ((row + line) as f64 + 0.5) * scale;
            let x_m = grid.x_m(v.min(grid.height_px as f64 - 0.5)) as f32;
            bytes.clear();
            for (wall, pixel) in wall.iter().zip(band.data[line * width * 4..].chunks_exact(4)) {
                if pixel[3] >= 128 {
                    let numbers = [x_m, wall.point[0], wall.point[1], 0.0, wall.normal[0], wall.normal[1]];
                    bytes.extend(numbers.into_iter().flat_map(f32::to_le_bytes));
                    bytes.extend_from_slice(&pixel[..3]);
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

/// One place around the wall, `[y, z]`.
struct Wall {
    point: [f32; 2],
    normal: [f32; 2],
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
         property uchar red\nproperty uchar green\nproperty uchar blue\nend_header\n",
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
