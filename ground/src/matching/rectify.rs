//! A photo laid onto the wall grid.

use nalgebra::{Isometry3, Point3};

use super::Pixels;
use super::filter::Plane;
use super::wall::{BLOCK, Footprint, WallGrid};

/// Added before the logarithm, grey levels: keeps the noise of dark pixels from being blown up.
const LOG_OFFSET: f32 = 8.0;

/// Steps per grey level.
const LEVEL_STEPS: u16 = 16;

/// A photo, halved until its pixels are about as large as the grid's texels.
///
/// The logarithm is taken where a pixel is read: the photo itself stays small enough for the cache.
struct Image {
    width: usize,
    height: usize,
    /// In steps; 0 where the mask hides the photo, at least 1 elsewhere.
    levels: Vec<u16>,
    /// Logarithm by level; NaN for a hidden pixel.
    logarithms: Box<[f32; 256 * LEVEL_STEPS as usize]>,
}

impl Image {
    fn new(pixels: &Pixels<'_>, halvings: u32) -> Self {
        let grey = &*pixels.grey;
        let level = |&level: &u8| (u16::from(level) * LEVEL_STEPS).max(1);
        let levels = match pixels.mask.as_deref() {
            Some(mask) => {
                let shown = grey.data.iter().zip(&mask.data);
                shown.map(|(grey, &mask)| if mask < 128 { 0 } else { level(grey) }).collect()
            }
            None => grey.data.iter().map(level).collect(),
        };
        let logarithm = |level: usize| {
            if level == 0 { f32::NAN } else { (level as f32 / f32::from(LEVEL_STEPS) + LOG_OFFSET).ln() }
        };
        let logarithms = Box::new(std::array::from_fn(logarithm));
        let mut image = Self { width: grey.width, height: grey.height, levels, logarithms };
        for _ in 0..halvings {
            image.halve();
        }
        image
    }

    /// Takes the means of two by two pixels, hidden where one of them is.
    fn halve(&mut self) {
        let (width, height) = (self.width / 2, self.height / 2);
        let mut halved = Vec::with_capacity(width * height);
        for rows in self.levels[..2 * self.width * height].chunks_exact(2 * self.width) {
            let (upper, lower) = rows.split_at(self.width);
            let pairs = upper.as_chunks::<2>().0.iter().zip(lower.as_chunks::<2>().0);
            halved.extend(pairs.map(|(&[a, b], &[c, d])| {
                let hidden = a.min(b).min(c).min(d) == 0;
                if hidden { 0 } else { (a + b + c + d + 2) >> 2 }
            }));
        }
        (self.width, self.height, self.levels) = (width, height, halved);
    }

    /// Bilinear sample of the logarithm at a position counted from the first pixel's centre; NaN outside or beside a hidden
    /// pixel.
    #[inline]
    fn sample(&self, x: f32, y: f32) -> f32 {
        let (width, height) = (self.width, self.height);
        // Also false for NaN.
        if !(x >= 0.0 && y >= 0.0 && x < (width - 1) as f32 && y < (height - 1) as f32) {
            return f32::NAN;
        }
        // Positions are small and not negative: through i32 the conversions are one instruction each.
        let (column, row) = (x as i32, y as i32);
        let (tx, ty) = (x - column as f32, y - row as f32);
        let index = row as usize * width + column as usize;
        let log = |level: u16| self.logarithms[usize::from(level) % self.logarithms.len()];
        let [top, bottom] = [index, index + width].map(|left| {
            let pair = &self.levels[left..left + 2];
            let (left, right) = (log(pair[0]), log(pair[1]));
            left + tx * (right - left)
        });
        top + ty * (bottom - top)
    }
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
    let image = Image::new(pixels, halvings);
    let knots = Knots::new(grid, tunnel_from_cam, footprint, 0.5_f64.powi(halvings as i32));
    let weights: [[f32; 4]; BLOCK] = std::array::from_fn(|phase| cubic_weights(phase as f32 / BLOCK as f32));
    let [blocks_wide, blocks_high] = footprint.size;
    let (width, height) = (blocks_wide * BLOCK, blocks_high * BLOCK);
    let mut plane = Plane { width, height, data: vec![f32::NAN; width * height] };
    for (block_row, block_column) in (0..blocks_high).flat_map(|row| (0..blocks_wide).map(move |column| (row, column)))
    {
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
                    *value = image.sample(x, y);
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
        // Of each column of blocks, those around which something is seen and the next on both sides.
        let needed: Vec<_> = (0..footprint.size[0])
            .map(|block_column| {
                let seen = |row: &usize| footprint.sees_around([block_column, *row]);
                let first = (0..footprint.size[1]).find(seen).unwrap_or(rows);
                first..(0..footprint.size[1]).rfind(seen).map_or(rows, |last| last + 4)
            })
            .collect();
        let [column0, row0] = footprint.block0.map(|block| (block * BLOCK as i64) as f64);
        for column in 0..width {
            let s = column0 + column as f64;
            let Some(start) = grid.point(s, row0 - BLOCK as f64) else { continue };
            let open = grid.is_open(s, &centre);
            for knot in needed[column / BLOCK].clone() {
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
    use std::borrow::Cow;

    use super::*;
    use crate::raster::{Luma, Mask};

    #[test]
    fn a_sample_is_bilinear_in_the_logarithm_and_nan_beside_what_is_hidden_and_beyond_the_border() {
        let mut mask = Mask { width: 4, height: 2, data: vec![255; 8] };
        mask.data[3] = 0;
        let grey = Luma { width: 4, height: 2, data: vec![0, 10, 20, 30, 40, 50, 60, 70] };
        let pixels = Pixels { grey: Cow::Owned(grey), mask: Some(Cow::Owned(mask)) };
        let image = Image::new(&pixels, 0);
        let log = |level: f32| (level + LOG_OFFSET).ln();
        let upper = log(10.0) + 0.25 * (log(20.0) - log(10.0));
        let lower = log(50.0) + 0.25 * (log(60.0) - log(50.0));
        assert!((image.sample(1.25, 0.5) - 0.5 * (upper + lower)).abs() < 1e-6);
        assert!((image.sample(1.0, 0.0) - log(10.0)).abs() < 1e-6);
        for x in [2.5, -0.1, 3.0, f32::NAN] {
            assert!(image.sample(x, 0.5).is_nan(), "at {x}");
        }
    }

    #[test]
    fn halving_takes_means_and_hides_what_is_partly_hidden() {
        let mask = Mask { width: 4, height: 2, data: vec![255, 255, 255, 0, 255, 255, 255, 255] };
        let grey = Luma { width: 4, height: 2, data: vec![10, 20, 1, 1, 30, 41, 1, 1] };
        let image = Image::new(&Pixels { grey: Cow::Owned(grey), mask: Some(Cow::Owned(mask)) }, 1);
        assert_eq!((image.width, image.height, &image.levels[..]), (2, 1, &[404, 0][..]));
    }

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
