//! A photo laid onto the wall grid.

use nalgebra::{Isometry3, Point3};

use super::Pixels;
use super::filter::Plane;
use super::wall::{BLOCK, Footprint, WallGrid};
use crate::raster::{Grey, Mask};

/// Rows between exact projections; between them pixels follow a cubic, to 1e-4 px for walls farther than 30 knots.
const KNOT_ROWS: usize = 8;

/// Added before the logarithm, grey levels: keeps the noise of dark pixels from being blown up.
const LOG_OFFSET: f32 = 8.0;

/// Entries of the logarithm's table per grey level.
const LOG_STEPS: f32 = 16.0;

/// Logarithm of a photo, halved until its pixels are about as large as the grid's texels, with its mask.
struct LogImage {
    plane: Plane,
    /// 1 where this pixel and its right, lower and lower right neighbours may be used.
    usable: Option<Vec<u8>>,
    pixels_per_photo_pixel: f64,
}

impl LogImage {
    fn new(pixels: &Pixels<'_>, halvings: u32) -> Self {
        let grey: &Grey = &pixels.grey;
        let mut plane = Plane { width: grey.width, height: grey.height, data: Vec::new() };
        let mut mask = pixels.mask.as_deref().map(|mask: &Mask| mask.data.clone());
        for halving in 0..halvings {
            let source = if halving == 0 { &grey.data } else { &plane.data };
            let halved = halved(source, plane.width, plane.height);
            mask = mask.map(|mask| halved_mask(&mask, plane.width, plane.height));
            plane = halved;
        }
        let table: Vec<f32> =
            (0..=256 * LOG_STEPS as usize).map(|index| (index as f32 / LOG_STEPS + LOG_OFFSET).ln()).collect();
        let log = |value: f32| table[((value * LOG_STEPS + 0.5) as usize).min(table.len() - 1)];
        let source = if halvings == 0 { &grey.data } else { &plane.data };
        plane.data = source.iter().map(|&value| log(value)).collect();
        let usable = mask.map(|mask| usable(&mask, plane.width, plane.height));
        Self { plane, usable, pixels_per_photo_pixel: 0.5_f64.powi(halvings as i32) }
    }

    /// Bilinear sample at a position counted from the first pixel's centre; NaN outside or where masked.
    #[inline]
    fn sample(&self, x: f32, y: f32) -> f32 {
        let (width, height) = (self.plane.width, self.plane.height);
        // Also false for NaN.
        if !(x >= 0.0 && y >= 0.0 && x < (width - 1) as f32 && y < (height - 1) as f32) {
            return f32::NAN;
        }
        let (column, row) = (x as usize, y as usize);
        let (tx, ty) = (x - column as f32, y - row as f32);
        let index = row * width + column;
        if let Some(usable) = &self.usable
            && usable[index] == 0
        {
            return f32::NAN;
        }
        let top = &self.plane.data[index..index + 2];
        let bottom = &self.plane.data[index + width..index + width + 2];
        let upper = top[0] + tx * (top[1] - top[0]);
        let lower = bottom[0] + tx * (bottom[1] - bottom[0]);
        upper + ty * (lower - upper)
    }
}

fn halved(source: &[f32], width: usize, height: usize) -> Plane {
    let mut out = Plane::new(width / 2, height / 2);
    for row in 0..height / 2 {
        let (upper, lower) = (&source[2 * row * width..], &source[(2 * row + 1) * width..]);
        for (column, value) in out.row_mut(row).iter_mut().enumerate() {
            let c = 2 * column;
            *value = 0.25 * (upper[c] + upper[c + 1] + lower[c] + lower[c + 1]);
        }
    }
    out
}

fn halved_mask(mask: &[u8], width: usize, height: usize) -> Vec<u8> {
    let mut out = Vec::with_capacity((width / 2) * (height / 2));
    for row in 0..height / 2 {
        for column in 0..width / 2 {
            let index = 2 * row * width + 2 * column;
            out.push(mask[index].min(mask[index + 1]).min(mask[index + width]).min(mask[index + width + 1]));
        }
    }
    out
}

fn usable(mask: &[u8], width: usize, height: usize) -> Vec<u8> {
    let mut out = vec![0; width * height];
    for row in 0..height.saturating_sub(1) {
        for column in 0..width.saturating_sub(1) {
            let index = row * width + column;
            let least = mask[index].min(mask[index + 1]).min(mask[index + width]).min(mask[index + width + 1]);
            out[index] = u8::from(least >= 128);
        }
    }
    out
}

/// Returns the logarithm of the photo on the footprint's window of the grid; NaN where it does not see the wall.
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
    let image = LogImage::new(pixels, halvings);
    let knots = Knots::new(grid, tunnel_from_cam, footprint, image.pixels_per_photo_pixel);
    let mut plane = Plane::new(footprint.size[0] * BLOCK, footprint.size[1] * BLOCK);
    let mut pixel_row = [vec![0.0; plane.width], vec![0.0; plane.width]];
    for row in 0..plane.height {
        let (knot, phase) = (row / KNOT_ROWS, row % KNOT_ROWS);
        let weights = cubic_weights(phase as f32 / KNOT_ROWS as f32);
        for (axis, blended) in pixel_row.iter_mut().enumerate() {
            let [before, here, next, after] = [0, 1, 2, 3].map(|offset| knots.pixels[axis].row(knot + offset));
            for (column, value) in blended.iter_mut().enumerate() {
                *value = weights[0] * before[column]
                    + weights[1] * here[column]
                    + weights[2] * next[column]
                    + weights[3] * after[column];
            }
        }
        let nearest = if 2 * phase < KNOT_ROWS { knot + 1 } else { knot + 2 };
        let facing = &knots.facing[nearest * plane.width..(nearest + 1) * plane.width];
        let [xs, ys] = &pixel_row;
        for (((value, &x), &y), &facing) in plane.row_mut(row).iter_mut().zip(xs).zip(ys).zip(facing) {
            *value = if facing { image.sample(x, y) } else { f32::NAN };
        }
    }
    plane
}

/// Exact projections of every column, every [`KNOT_ROWS`] rows, from one knot before the window on.
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
        let rows = footprint.size[1] * BLOCK / KNOT_ROWS + 3;
        let unknown = Plane { width, height: rows, data: vec![f32::NAN; width * rows] };
        let mut knots = Self { pixels: [unknown.clone(), unknown], facing: vec![false; width * rows] };
        let centre = Point3::from(tunnel_from_cam.translation.vector);
        let cam_from_tunnel = tunnel_from_cam.inverse();
        let [column0, row0] = footprint.block0.map(|block| (block * BLOCK as i64) as f64);
        for column in 0..width {
            let s = column0 + column as f64;
            let Some(start) = grid.point(s, row0 - KNOT_ROWS as f64) else { continue };
            let open = grid.is_open(s, &centre);
            for knot in 0..rows {
                let mut point = start;
                point.position.x += (knot * KNOT_ROWS) as f64 * grid.step_m;
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
