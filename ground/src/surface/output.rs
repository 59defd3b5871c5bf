//! relief.tif for programs, relief.png for people.

use std::fs::File;
use std::io::BufWriter;
use std::path::Path;

use tiff::encoder::{TiffEncoder, colortype};
use tiff::tags::Tag;

use super::error::{SurfaceError, at_path};
use super::store::SurfaceStore;
use crate::texture::{Lattice, write_png};

/// Rows read and written at a time.
const ROWS: usize = 64;
/// The picture is coarser than the relief where the tunnel has more rows than this.
const MOST_PICTURE_ROWS: usize = 8192;
/// Relief that gets the full colour: the 98th percentile of its size, but no less.
const LEAST_FULL_M: f32 = 0.005;
/// Colours of hollows, of the ring and of what stands out.
const COLOURS: [[f32; 3]; 3] = [[33.0, 102.0, 172.0], [247.0, 247.0, 247.0], [178.0, 24.0, 43.0]];

/// Writes `relief.tif`: heights over the rings in metres as 32-bit floats, one row per row of cells, NaN where unknown.
///
/// # Frame
/// The scale and tie point of a geographic TIFF in metres, as in the exported panorama: x of the map = arc length, y of the map = -x of the
/// tunnel, so that the rows run along the tunnel from above.
pub(super) fn write_tiff(path: &Path, store: &SurfaceStore, lattice: &Lattice) -> Result<(), SurfaceError> {
    let failed = |source| SurfaceError::Tiff { path: path.to_owned(), source };
    let file = BufWriter::new(File::create(path).map_err(at_path(path))?);
    let mut encoder = TiffEncoder::new(file).map_err(failed)?;
    let (columns, rows) = (lattice.columns as u32, lattice.rows as u32);
    let mut image = encoder.new_image::<colortype::Gray32Float>(columns, rows).map_err(failed)?;
    image.rows_per_strip(ROWS as u32).map_err(failed)?;
    let tags = image.encoder();
    let scale = [lattice.step_s_m, lattice.step_x_m, 0.0];
    tags.write_tag(Tag::ModelPixelScaleTag, &scale[..]).map_err(failed)?;
    tags.write_tag(Tag::ModelTiepointTag, &[0.0, 0.0, 0.0, 0.0, -lattice.x0_m, 0.0][..]).map_err(failed)?;
    tags.write_tag(Tag::GdalNodata, "nan").map_err(failed)?;
    for row in (0..lattice.rows).step_by(ROWS) {
        let heights = rows_of(store, lattice, row, ROWS.min(lattice.rows - row))?;
        image.write_strip(&heights).map_err(failed)?;
    }
    image.finish().map_err(failed)
}

/// Writes `relief.png`: red stands out, blue lies back, white is the ring; transparent where unknown. Returns the height of
/// full colour in metres.
pub(super) fn write_picture(path: &Path, store: &SurfaceStore, lattice: &Lattice) -> Result<f64, SurfaceError> {
    let stride = lattice.rows.div_ceil(MOST_PICTURE_ROWS);
    let mut heights = Vec::new();
    for row in (0..lattice.rows).step_by(stride) {
        heights.extend(rows_of(store, lattice, row, 1)?);
    }
    let mut sizes: Vec<f32> = heights.iter().filter(|height| height.is_finite()).map(|height| height.abs()).collect();
    let full_m = if sizes.is_empty() {
        LEAST_FULL_M
    } else {
        let place = sizes.len() * 98 / 100;
        sizes.select_nth_unstable_by(place, f32::total_cmp).1.max(LEAST_FULL_M)
    };
    let pixels: Vec<u8> = heights.iter().flat_map(|height| colour(height / full_m)).collect();
    write_png(path, lattice.columns, heights.len() / lattice.columns, &pixels)?;
    Ok(f64::from(full_m))
}

fn colour(share: f32) -> [u8; 4] {
    if !share.is_finite() {
        return [0; 4];
    }
    let [hollow, ring, bulge] = COLOURS;
    let end = if share < 0.0 { hollow } else { bulge };
    let mix = |channel: usize| (ring[channel] + share.abs().min(1.0) * (end[channel] - ring[channel])) as u8;
    [mix(0), mix(1), mix(2), 255]
}

/// Relief of whole rows, NaN where unknown.
fn rows_of(store: &SurfaceStore, lattice: &Lattice, row0: usize, rows: usize) -> Result<Vec<f32>, SurfaceError> {
    let x_m = |row: usize| lattice.x_m(row as i64);
    let window = store.window([x_m(row0), x_m(row0 + rows - 1)])?;
    let mut heights = Vec::with_capacity(rows * lattice.columns);
    for row in row0..row0 + rows {
        heights.extend((0..lattice.columns as i64).map(|column| {
            let relief_m = window.relief_m(lattice.s_m(column), x_m(row));
            relief_m.map_or(f32::NAN, |relief_m| relief_m as f32)
        }));
    }
    Ok(heights)
}
