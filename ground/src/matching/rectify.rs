//! A photo laid onto the wall grid.

use std::borrow::Cow;
use std::mem::{replace, take};

use nalgebra::{Isometry3, Point3};

use super::Pixels;
use super::filter::Plane;
use super::texels::ROUNDING;
use super::wall::{BLOCK, Footprint, WallGrid};
use crate::vectors::vectorised;

/// Rows between exact projections.
const KNOT_ROWS: usize = 16;

/// Knots per block of rows.
const KNOTS: usize = BLOCK / KNOT_ROWS;

/// Added before the logarithm, grey levels: keeps the noise of dark pixels from being blown up.
const LOG_OFFSET: f32 = 8.0;

/// Steps per grey level of a halved photo.
const LEVEL_STEPS: u16 = 16;

/// A grey level of a photo as given or halved.
trait Level: Copy + PartialEq + Default {
    /// The level and its right neighbour in one number: one read from memory, where two would be the slowest part.
    fn pair(levels: [Self; 2]) -> u32;
    /// Takes them apart again.
    fn apart(pair: u32) -> [f32; 2];
    fn widened(self) -> u16;
}

impl Level for u8 {
    #[inline]
    fn pair(levels: [Self; 2]) -> u32 {
        u32::from(u16::from_le_bytes(levels))
    }

    #[inline]
    fn apart(pair: u32) -> [f32; 2] {
        [(pair & 0xff) as f32, (pair >> 8) as f32]
    }

    fn widened(self) -> u16 {
        self.into()
    }
}

impl Level for u16 {
    #[inline]
    fn pair([left, right]: [Self; 2]) -> u32 {
        u32::from(left) | u32::from(right) << 16
    }

    #[inline]
    fn apart(pair: u32) -> [f32; 2] {
        [(pair & 0xffff) as f32, (pair >> 16) as f32]
    }

    fn widened(self) -> u16 {
        self
    }
}

/// A photo, halved until its pixels are about as large as the grid's texels.
struct Image<'a, T: Clone> {
    width: usize,
    height: usize,
    levels: Cow<'a, [T]>,
    /// Grey levels per step of `levels`.
    step: f32,
    /// Level 0 marks what the mask hides.
    masked: bool,
}

impl<'a> Image<'a, u8> {
    fn new(pixels: &'a Pixels) -> Self {
        let grey = pixels.grey();
        Self {
            width: grey.width,
            height: grey.height,
            levels: (&grey.data).into(),
            step: 1.0,
            masked: pixels.is_masked(),
        }
    }
}

impl<T: Level> Image<'_, T> {
    /// Means of two by two pixels, hidden where one of them is, in memory that there is.
    fn halved(&self, mut halved: Vec<u16>) -> Image<'static, u16> {
        let (width, height) = (self.width / 2, self.height / 2);
        // The mean of four, in steps.
        let steps = (f32::from(LEVEL_STEPS) * self.step) as u16;
        halved.clear();
        halved.reserve(width * height);
        for rows in self.levels[..2 * self.width * height].chunks_exact(2 * self.width) {
            let (upper, lower) = rows.split_at(self.width);
            let pairs = upper.as_chunks::<2>().0.iter().zip(lower.as_chunks::<2>().0);
            halved.extend(pairs.map(|(upper, lower)| {
                let [a, b, c, d] = [upper[0], upper[1], lower[0], lower[1]].map(Level::widened);
                let hidden = self.masked && a.min(b).min(c).min(d) == 0;
                if hidden { 0 } else { (steps * (a + b + c + d) + 2) >> 2 }
            }));
        }
        Image { width, height, levels: halved.into(), step: 1.0 / f32::from(LEVEL_STEPS), masked: self.masked }
    }

    /// Logarithms of the bilinear samples at positions counted from the first pixel's centre; NaN outside or beside a hidden
    /// pixel.
    #[expect(clippy::inline_always, reason = "inlined into the dispatch, else it is compiled without its vectors")]
    #[inline(always)]
    fn sample<const N: usize>(&self, xs: &[f32; N], ys: &[f32; N]) -> [f32; N] {
        let (most_x, most_y) = ((self.width - 1) as f32, (self.height - 1) as f32);
        let (mut inside, mut column, mut row, mut index) = ([false; N], [0; N], [0; N], [0; N]);
        for i in 0..N {
            // Also false for NaN.
            inside[i] = xs[i] >= 0.0 && ys[i] >= 0.0 && xs[i] < most_x && ys[i] < most_y;
            column[i] = if inside[i] { pixel_before(xs[i]) } else { 0 };
            row[i] = if inside[i] { pixel_before(ys[i]) } else { 0 };
            index[i] = row[i] * self.width as i32 + column[i];
        }
        let (mut upper, mut lower) = ([0; N], [0; N]);
        for i in 0..N {
            // One check of the bounds.
            let around = &self.levels[index[i] as usize..][..self.width + 2];
            (upper[i], lower[i]) =
                (T::pair([around[0], around[1]]), T::pair([around[self.width], around[self.width + 1]]));
        }
        let mut logarithms = [f32::NAN; N];
        for i in 0..N {
            let ([a, b], [c, d]) = (T::apart(upper[i]), T::apart(lower[i]));
            let (tx, ty) = (xs[i] - column[i] as f32, ys[i] - row[i] as f32);
            let (top, bottom) = (a + tx * (b - a), c + tx * (d - c));
            let sample = logarithm(self.step * (top + ty * (bottom - top)) + LOG_OFFSET);
            let hidden = self.masked && a.min(b).min(c).min(d) == 0.0;
            logarithms[i] = if inside[i] && !hidden { sample } else { f32::NAN };
        }
        logarithms
    }
}

/// The pixel that a position, at least 0, lies behind: its whole part; of a whole number itself or the one before it.
///
/// Rounded by an addition: compilers make no vectors of a cast, which is defined for NaN and for what is too large.
#[expect(clippy::inline_always, reason = "inlined into the dispatch, else it is compiled without its vectors")]
#[inline(always)]
fn pixel_before(position: f32) -> i32 {
    (position - 0.5 + ROUNDING).to_bits() as i32 - ROUNDING.to_bits() as i32
}

/// Natural logarithm of a positive normal number, to 2e-6: what compilers can turn into vectors.
#[expect(clippy::inline_always, reason = "inlined into the dispatch, else it is compiled without its vectors")]
#[inline(always)]
fn logarithm(value: f32) -> f32 {
    let bits = value.to_bits();
    let exponent = (bits >> 23) as i32 - 127;
    let mantissa = f32::from_bits((bits & 0x007f_ffff) | 0x3f80_0000);
    // ln m = 2 artanh((m - 1) / (m + 1)), at most 1/3.
    let t = (mantissa - 1.0) / (mantissa + 1.0);
    let tt = t * t;
    let series = 2.0 + tt * (2.0 / 3.0 + tt * (2.0 / 5.0 + tt * (2.0 / 7.0 + tt * (2.0 / 9.0))));
    exponent as f32 * std::f32::consts::LN_2 + t * series
}

/// Working memory of [`rectify`].
#[derive(Debug, Default)]
pub(super) struct Laying {
    knots: Knots,
    halved: Vec<u16>,
    quartered: Vec<u16>,
}

/// Lays the logarithm of the photo onto the footprint's window of the grid; NaN where it does not see the wall.
pub(super) fn rectify(
    grid: &WallGrid<'_>,
    tunnel_from_cam: &Isometry3<f64>,
    footprint: &Footprint,
    pixels: &Pixels,
    Laying { knots, halved, quartered }: &mut Laying,
    plane: &mut Plane,
) {
    let focal_px = 0.5 * (grid.camera.focal_px[0] + grid.camera.focal_px[1]);
    let texel_px = grid.step_m * focal_px / footprint.distance_m;
    // Halve when a texel is at least about 1.6 pixels wide.
    let halvings = (texel_px.log2() - 0.2).round().clamp(0.0, 6.0) as u32;
    knots.fill(grid, tunnel_from_cam, footprint, 0.5_f64.powi(halvings as i32));
    let image = Image::new(pixels);
    if halvings == 0 {
        return lay(&image, knots, footprint, plane);
    }
    let mut image = image.halved(take(halved));
    for _ in 1..halvings {
        let next = image.halved(take(quartered));
        *quartered = replace(&mut image, next).levels.into_owned();
    }
    lay(&image, knots, footprint, plane);
    *halved = image.levels.into_owned();
}

/// Goes block by block: a row of the wall may run along a column of the photo, and then misses the cache at every texel.
fn lay<T: Level>(image: &Image<'_, T>, knots: &Knots, footprint: &Footprint, plane: &mut Plane) {
    let [blocks_wide, blocks_high] = footprint.size;
    plane.reshape([blocks_wide, blocks_high].map(|blocks| blocks * BLOCK));
    let is_image = image.width >= 2 && image.height >= 2;
    vectorised(
        #[inline(always)]
        || {
            for (block_row, block_column) in
                (0..blocks_high).flat_map(|row| (0..blocks_wide).map(move |column| (row, column)))
            {
                let start = block_column * BLOCK;
                let is_seen = is_image && footprint.sees_around([block_column, block_row]);
                for row in block_row * BLOCK..(block_row + 1) * BLOCK {
                    if !is_seen {
                        plane.row_mut(row)[start..start + BLOCK].fill(f32::NAN);
                        continue;
                    }
                    let [xs, ys] = knots.positions(row, start);
                    let nearest = (row + KNOT_ROWS / 2) / KNOT_ROWS + 1;
                    let facing = &knots.facing[nearest * plane.width + start..][..BLOCK];
                    let samples = image.sample(&xs, &ys);
                    let target = &mut plane.row_mut(row)[start..start + BLOCK];
                    for ((value, sample), &facing) in target.iter_mut().zip(samples).zip(facing) {
                        *value = if facing { sample } else { f32::NAN };
                    }
                }
            }
        },
    );
}

/// Exact projections of every column, every [`KNOT_ROWS`] rows, from one knot before the window on. Between them pixels follow a
/// cubic, to some thousandths of a pixel.
#[derive(Debug, Default)]
struct Knots {
    /// Position along x and y in the halved image, counted from the first pixel's centre; NaN where there is none.
    pixels: [Plane; 2],
    /// The wall faces the camera there.
    facing: Vec<bool>,
    /// Of the four knots around a row.
    weights: [[f32; 4]; KNOT_ROWS],
}

impl Knots {
    fn fill(
        &mut self,
        grid: &WallGrid<'_>,
        tunnel_from_cam: &Isometry3<f64>,
        footprint: &Footprint,
        pixels_per_photo_pixel: f64,
    ) {
        let width = footprint.size[0] * BLOCK;
        let rows = footprint.size[1] * KNOTS + 3;
        self.weights = std::array::from_fn(|phase| cubic_weights(phase as f32 / KNOT_ROWS as f32));
        for plane in &mut self.pixels {
            plane.reset([width, rows], f32::NAN);
        }
        self.facing.clear();
        self.facing.resize(width * rows, false);
        let centre = Point3::from(tunnel_from_cam.translation.vector);
        let cam_from_tunnel = tunnel_from_cam.inverse();
        // Of each column of blocks, those around which something is seen and the next on both sides.
        let needed: Vec<_> = (0..footprint.size[0])
            .map(|block_column| {
                let seen = |row: &usize| footprint.sees_around([block_column, *row]);
                let first = (0..footprint.size[1]).find(seen).map_or(rows, |first| first * KNOTS);
                first..(0..footprint.size[1]).rfind(seen).map_or(rows, |last| (last + 1) * KNOTS + 3)
            })
            .collect();
        let [column0, row0] = footprint.block0.map(|block| (block * BLOCK as i64) as f64);
        for column in 0..width {
            let s = column0 + column as f64;
            let Some(start) = grid.point(s, row0 - KNOT_ROWS as f64) else { continue };
            let open = grid.is_open(s, &centre);
            for knot in needed[column / BLOCK].clone() {
                let mut point = start;
                point.position.x += (knot * KNOT_ROWS) as f64 * grid.step_m;
                let in_cam = cam_from_tunnel.transform_point(&point.position).coords;
                let Some(pixel) = grid.camera.project(&in_cam) else { continue };
                let index = knot * width + column;
                self.facing[index] = open && grid.faces(&point, &centre);
                for axis in [0, 1] {
                    self.pixels[axis].data[index] = (pixel[axis] * pixels_per_photo_pixel - 0.5) as f32;
                }
            }
        }
    }

    /// Positions along x and y, between the knots, of the texels of a row from column `start` on.
    #[expect(clippy::inline_always, reason = "inlined into the dispatch, else it is compiled without its vectors")]
    #[inline(always)]
    fn positions(&self, row: usize, start: usize) -> [[f32; BLOCK]; 2] {
        let weights = self.weights[row % KNOT_ROWS];
        self.pixels.each_ref().map(|pixels| {
            let mut positions = [0.0; BLOCK];
            for (knot, weight) in (row / KNOT_ROWS..).zip(weights) {
                for (position, value) in positions.iter_mut().zip(&pixels.row(knot)[start..start + BLOCK]) {
                    *position += weight * value;
                }
            }
            positions
        })
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

    use adit_geometry::camera::{Camera, Distortion};
    use adit_geometry::profile::ProfileSpec;
    use adit_geometry::rig::{ImageUp, nominal_rotation};
    use nalgebra::{Translation3, UnitQuaternion, Vector2};

    use super::*;
    use crate::raster::{Luma, Mask};

    #[test]
    fn a_sample_is_the_logarithm_of_the_bilinear_one_and_nan_beside_what_is_hidden_and_beyond_the_border() {
        let mut mask = Mask { width: 4, height: 2, data: vec![255; 8] };
        mask.data[3] = 0;
        let grey = Luma { width: 4, height: 2, data: vec![0, 10, 20, 30, 40, 50, 60, 70] };
        let pixels = Pixels::with_mask(grey, &mask).expect("a mask of its size");
        let image = Image::new(&pixels);
        let samples = image.sample(&[1.25, 1.0, 2.5, -0.1, 3.0, f32::NAN], &[0.5, 0.0, 0.5, 0.5, 0.5, 0.5]);
        assert!((samples[0] - (32.5_f32 + LOG_OFFSET).ln()).abs() < 1e-5);
        assert!((samples[1] - (10.0_f32 + LOG_OFFSET).ln()).abs() < 1e-5);
        assert!(samples[2..].iter().all(|sample| sample.is_nan()), "{samples:?}");
    }

    #[test]
    fn without_a_mask_black_is_a_level_like_any_other() {
        let grey = Luma { width: 2, height: 2, data: vec![0; 4] };
        let pixels = Pixels::new(grey);
        assert!((Image::new(&pixels).sample(&[0.5], &[0.5])[0] - LOG_OFFSET.ln()).abs() < 1e-5);
    }

    #[test]
    fn the_logarithm_is_that_of_the_library() {
        for step in 0..2000 {
            let value = 8.0 + 0.13 * step as f32;
            assert!((logarithm(value) - value.ln()).abs() < 4e-6, "of {value}");
        }
    }

    #[test]
    fn halving_takes_means_and_hides_what_is_partly_hidden() {
        let mask = Mask { width: 4, height: 2, data: vec![255, 255, 255, 0, 255, 255, 255, 255] };
        let grey = Luma { width: 4, height: 2, data: vec![10, 20, 1, 1, 30, 41, 1, 1] };
        let pixels = Pixels::with_mask(grey, &mask).expect("a mask of its size");
        let image = Image::new(&pixels).halved(Vec::new());
        assert_eq!((image.width, image.height, &image.levels[..]), (2, 1, &[404, 0][..]));
    }

    #[test]
    fn between_knots_pixels_are_exact_to_a_few_thousandths() {
        let profile = ProfileSpec::Circle { radius_m: 3.0 }.build().expect("a valid profile");
        let camera = Camera {
            width_px: 1000,
            height_px: 750,
            focal_px: [466.0; 2],
            centre_px: [503.0, 373.0],
            distortion: Distortion::BrownConrady([-0.04, 0.006, 0.0, 0.0, 0.0]),
        };
        let grid = WallGrid::new(&profile, &camera, 0.95 * 3.0 / 466.0, 68_f64.to_radians());
        // Off the axis, and tilted.
        let turned = UnitQuaternion::from_euler_angles(0.05, -0.04, 0.02);
        let rotation = turned * nominal_rotation(ImageUp::Forward, 0.6);
        let pose = Isometry3::from_parts(Translation3::new(0.2, 0.2, -0.3), rotation);
        let footprint = Footprint::new(&grid, &pose).expect("a wall");
        let mut knots = Knots::default();
        knots.fill(&grid, &pose, &footprint, 1.0);
        let mut worst_px = 0.0_f64;
        for row in 0..footprint.size[1] * BLOCK {
            for block in 0..footprint.size[0] {
                let [xs, ys] = knots.positions(row, block * BLOCK);
                let [column0, row0] = footprint.block0.map(|block| (block * BLOCK as i64) as f64);
                let exact = grid.pixel(&pose, column0 + (block * BLOCK) as f64, row0 + row as f64);
                let Some(exact) = exact.filter(|pixel| camera.contains(pixel, 1.0)) else { continue };
                if footprint.sees_around([block, row / BLOCK]) {
                    let difference = Vector2::new(f64::from(xs[0]), f64::from(ys[0])) + Vector2::repeat(0.5) - exact;
                    worst_px = worst_px.max(difference.norm());
                }
            }
        }
        assert!(worst_px > 0.0 && worst_px < 4e-3, "{worst_px}");
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
