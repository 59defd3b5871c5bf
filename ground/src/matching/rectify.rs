//! A photo laid onto the wall grid.

use nalgebra::{Isometry3, Point3};

use super::Pixels;
use super::filter::Plane;
use super::wall::{BLOCK, Footprint, WallGrid};

/// Added before the logarithm, grey levels: keeps the noise of dark pixels from being blown up.
const LOG_OFFSET: f32 = 8.0;

/// Entries of the logarithm's table per grey level.
const LOG_STEPS: usize = 16;

/// Returns the logarithm of a photo, halved `halvings` times; NaN where the mask hides it.
fn log_image(pixels: &Pixels<'_>, halvings: u32) -> Plane {
    let table: Vec<f32> =
        (0..=256 * LOG_STEPS).map(|index| (index as f32 / LOG_STEPS as f32 + LOG_OFFSET).ln()).collect();
    let (grey, mask) = (&*pixels.grey, pixels.mask.as_deref());
    let (mut width, mut height) = (grey.width, grey.height);
    if halvings == 0 {
        let logs: [f32; 256] = std::array::from_fn(|level| table[level * LOG_STEPS]);
        let log = |&level: &u8| logs[usize::from(level)];
        let hidden = |(level, &mask): (&u8, &u8)| if mask < 128 { f32::NAN } else { log(level) };
        let data = match mask {
            Some(mask) => grey.data.iter().zip(&mask.data).map(hidden).collect(),
            None => grey.data.iter().map(log).collect(),
        };
        return Plane { width, height, data };
    }
    let mut data = halved(&grey.data, width, height);
    let mut mask = mask.map(|mask| halved_mask(&mask.data, width, height));
    (width, height) = (width / 2, height / 2);
    for _ in 1..halvings {
        data = halved(&data, width, height);
        mask = mask.map(|mask| halved_mask(&mask, width, height));
        (width, height) = (width / 2, height / 2);
    }
    for value in &mut data {
        *value = table[((*value * LOG_STEPS as f32 + 0.5) as usize).min(table.len() - 1)];
    }
    for (value, _) in data.iter_mut().zip(mask.iter().flatten()).filter(|(_, mask)| **mask < 128) {
        *value = f32::NAN;
    }
    Plane { width, height, data }
}

/// Bilinear sample at a position counted from the first pixel's centre; NaN outside or beside a pixel that is NaN.
#[inline]
fn sample(image: &Plane, x: f32, y: f32) -> f32 {
    let (width, height) = (image.width, image.height);
    // Also false for NaN.
    if !(x >= 0.0 && y >= 0.0 && x < (width - 1) as f32 && y < (height - 1) as f32) {
        return f32::NAN;
    }
    let (column, row) = (x as usize, y as usize);
    let (tx, ty) = (x - column as f32, y - row as f32);
    let index = row * width + column;
    let top = &image.data[index..index + 2];
    let bottom = &image.data[index + width..index + width + 2];
    let upper = top[0] + tx * (top[1] - top[0]);
    let lower = bottom[0] + tx * (bottom[1] - bottom[0]);
    upper + ty * (lower - upper)
}

/// Means of two by two pixels.
fn halved<S: Copy + Into<f32>>(source: &[S], width: usize, height: usize) -> Vec<f32> {
    let mut out = Vec::with_capacity((width / 2) * (height / 2));
    for rows in source[..height / 2 * 2 * width].chunks_exact(2 * width) {
        let (upper, lower) = rows.split_at(width);
        let pairs = upper.as_chunks::<2>().0.iter().zip(lower.as_chunks::<2>().0);
        out.extend(pairs.map(|(upper, lower)| {
            let [a, b, c, d] = [upper[0], upper[1], lower[0], lower[1]].map(Into::into);
            0.25 * (a + b + c + d)
        }));
    }
    out
}

fn halved_mask(mask: &[u8], width: usize, height: usize) -> Vec<u8> {
    let mut out = Vec::with_capacity((width / 2) * (height / 2));
    for rows in mask[..height / 2 * 2 * width].chunks_exact(2 * width) {
        let (upper, lower) = rows.split_at(width);
        let pairs = upper.as_chunks::<2>().0.iter().zip(lower.as_chunks::<2>().0);
        out.extend(pairs.map(|(upper, lower)| upper[0].min(upper[1]).min(lower[0]).min(lower[1])));
    }
    out
}

/// Returns the logarithm of the photo on the footprint's window of the grid; NaN where it does not see the wall.
///
/// Goes block by block: a row of the wall may run along a column of the photo, and then misses the cache at every texel.
pub(super) fn rectify(
    grid: &WallGrid<'_>,
    tunnel_from_cam: &Isometry3<f64>,
    footprint: &Footprint,
    pixels: &Pixels<'_>,
) -> Plane {
    let focal_px = 0.5 * (grid.camera.focal_px[0] + grid.camera.focal_px[1]);
    let texel_px = grid.step_m * focal_px / footprint.distance_m;
    // Halve when a texel is at least about 1.6 pixels wide.
    let halvings = (texel_px.log2() - 0.2).round().clamp(0.0, 6.0) as u32;
    let image = log_image(pixels, halvings);
    let knots = Knots::new(grid, tunnel_from_cam, footprint, 0.5_f64.powi(halvings as i32));
    let weights: [[f32; 4]; BLOCK] = std::array::from_fn(|phase| cubic_weights(phase as f32 / BLOCK as f32));
    let [blocks_wide, blocks_high] = footprint.size;
    let (width, height) = (blocks_wide * BLOCK, blocks_high * BLOCK);
    let mut plane = Plane { width, height, data: vec![f32::NAN; width * height] };
    for (block_row, block_column) in (0..blocks_high).flat_map(|row| (0..blocks_wide).map(move |column| (row, column))) {
        if !footprint.sees_around([block_column, block_row]) {
            continue;
        }
        let start = block_column * BLOCK;
        for (phase, weights) in weights.iter().enumerate() {
            let at = |axis: usize| knots.blended(axis, block_row, start, weights);
            let (xs, ys) = (at(0), at(1));
            let facing = &knots.facing[(block_row + 1 + 2 * phase / BLOCK) * width + start..][..BLOCK];
            let target = &mut plane.row_mut(block_row * BLOCK + phase)[start..start + BLOCK];
            for (((value, &x), &y), &facing) in target.iter_mut().zip(&xs).zip(&ys).zip(facing) {
                if facing {
                    *value = sample(&image, x, y);
                }
            }
        }
    }
    plane
}

/// Exact projections of every column, every [`BLOCK`] rows, from one knot before the window on. Between them pixels follow a
/// cubic, to 1e-4 px for walls farther than 30 knots.
struct Knots {
    /// Position along x and y in the halved image, counted from the first pixel's centre; NaN where there is none.
    pixels: [Plane; 2],
    /// The wall faces the camera there.
    facing: Vec<bool>,
}

impl Knots {
    fn new(
        grid: &WallGrid<'_>,
        tunnel_from_cam: &Isometry3<f64>,
        footprint: &Footprint,
        pixels_per_photo_pixel: f64,
    ) -> Self {
        let width = footprint.size[0] * BLOCK;
        let rows = footprint.size[1] + 3;
        let unknown = Plane { width, height: rows, data: vec![f32::NAN; width * rows] };
        let mut knots = Self { pixels: [unknown.clone(), unknown], facing: vec![false; width * rows] };
        let centre = Point3::from(tunnel_from_cam.translation.vector);
        let cam_from_tunnel = tunnel_from_cam.inverse();
        let [column0, row0] = footprint.block0.map(|block| (block * BLOCK as i64) as f64);
        for column in 0..width {
            let s = column0 + column as f64;
            let Some(start) = grid.point(s, row0 - BLOCK as f64) else { continue };
            let open = grid.is_open(s, &centre);
            for knot in 0..rows {
                let mut point = start;
                point.position.x += (knot * BLOCK) as f64 * grid.step_m;
                let in_cam = cam_from_tunnel.transform_point(&point.position).coords;
                let Some(pixel) = grid.camera.project(&in_cam) else { continue };
                let index = knot * width + column;
                knots.facing[index] = open && grid.faces(&point, &centre);
                for axis in [0, 1] {
                    knots.pixels[axis].data[index] = (pixel[axis] * pixels_per_photo_pixel - 0.5) as f32;
                }
            }
        }
        knots
    }

    /// Positions along an axis of a block's columns, which begin at `start`, between the knots of a block row.
    fn blended(&self, axis: usize, block_row: usize, start: usize, weights: &[f32; 4]) -> [f32; BLOCK] {
        let mut positions = [0.0; BLOCK];
        for (knot, weight) in (block_row..).zip(weights) {
            for (position, value) in positions.iter_mut().zip(&self.pixels[axis].row(knot)[start..start + BLOCK]) {
                *position += weight * value;
            }
        }
        positions
    }
}

/// Lagrange weights of knots at -1, 0, 1, 2 for a place `t` in 0..1.
fn cubic_weights(t: f32) -> [f32; 4] {
    [
        -t * (t - 1.0) * (t - 2.0) / 6.0,
        (t + 1.0) * (t - 1.0) * (t - 2.0) / 2.0,
        -(t + 1.0) * t * (t - 2.0) / 2.0,
        (t + 1.0) * t * (t - 1.0) / 6.0,
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_cubic_passes_through_a_cubic() {
        let cubic = |t: f32| 1.0 + 2.0 * t - 0.5 * t * t + 0.25 * t * t * t;
        for step in 0..8 {
            let t = step as f32 / 8.0;
            let w = cubic_weights(t);
            let value: f32 = w.iter().zip([-1.0, 0.0, 1.0, 2.0]).map(|(w, knot)| w * cubic(knot)).sum();
            assert!((value - cubic(t)).abs() < 1e-6);
        }
    }
}
