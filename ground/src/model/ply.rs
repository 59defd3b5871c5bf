//! points.ply: the wall as dense points with normals, colours and confidence, binary, written row by row.
//!
//! Tunnel frame (x forward, y right, z down), metres, single precision (0.06 mm at a kilometre); normals inwards.

use std::fs::File;
use std::io::{BufWriter, Seek, SeekFrom, Write};
use std::path::Path;

use super::error::{ModelError, at_path};
use super::points::PointSource;

/// Writes the points; returns how many there are.
///
/// # Errors
/// If a tile cannot be read or the file cannot be written.
pub fn write(path: &Path, source: &PointSource<'_>, tick: &dyn Fn()) -> Result<u64, ModelError> {
    let mut file = BufWriter::new(File::create(path).map_err(at_path(path))?);
    file.write_all(header(0).as_bytes()).map_err(at_path(path))?;
    let mut bytes = Vec::new();
    let count = source.stream(tick, |points| {
        bytes.clear();
        for point in points {
            let numbers = point.position_m.map(|metres| metres as f32).into_iter().chain(point.normal);
            bytes.extend(numbers.flat_map(f32::to_le_bytes));
            bytes.extend(point.colour);
            bytes.extend(point.confidence.to_le_bytes());
        }
        file.write_all(&bytes).map_err(at_path(path))
    })?;
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
