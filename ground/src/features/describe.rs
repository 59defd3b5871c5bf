//! Directions and descriptors from the gradients around a keypoint.
//!
//! "Anatomy of the SIFT Method" (IPOL 2014), algorithms 11 and 12, with the "`RootSIFT`" normalisation.

use std::f32::consts::{PI, TAU};

use super::sift::Level;
use super::{Keypoint, Orientation, SiftDescriptor};
use crate::vectors::vectorised;

/// Standard deviation of the window from which a direction is taken, in the keypoint's scale (`lambda_ori`).
const DIRECTION_WINDOW: f32 = 1.5;

/// Bins of the histogram of directions (`n_bins`).
const DIRECTION_BINS: usize = 36;

/// A direction counts if it reaches this part of the strongest (`t`).
const SECOND_DIRECTION: f32 = 0.8;

/// Cells of the descriptor per axis (`n_hist`).
const CELLS: usize = 4;

/// Bins of direction in each cell (`n_ori`).
const BINS: usize = 8;

/// Side of a cell, in the keypoint's scale (`2 lambda_descr / n_hist`).
const CELL: f32 = 3.0;

/// No component may exceed this part of the descriptor's length: one strong edge shall not decide alone.
const LARGEST_COMPONENT: f32 = 0.2;

/// Half the side of the upright square that holds all pixels a keypoint's descriptor depends on, pixels.
pub(super) fn support_px(scale_px: f32, orientation: Orientation) -> f32 {
    // Interpolation reaches half a cell beyond the outer ones, differences a sample further.
    let half = 0.5 * (CELLS + 1) as f32 * CELL * scale_px;
    let turned = if orientation == Orientation::Free { std::f32::consts::SQRT_2 } else { 1.0 };
    turned * half + 1.5
}

/// Magnitude (weighted by a round Gaussian window) and direction of the gradients in a square around a keypoint.
struct Gradients {
    /// First sample, `[column, row]`.
    corner: [usize; 2],
    /// Samples per side, `[columns, rows]`.
    size: [usize; 2],
    magnitude: Vec<f32>,
    angle_rad: Vec<f32>,
}

impl Gradients {
    /// Takes the square of half-side `half` around `middle` (samples), under a window of `sigma` samples.
    fn new(level: &Level<'_>, middle: [f32; 2], half: f32, sigma: f32) -> Self {
        let limits = [level.image.width, level.image.height];
        let first = |axis: usize| (middle[axis] - half).ceil().max(1.0) as usize;
        let end = |axis: usize| ((middle[axis] + half).floor() as usize + 1).min(limits[axis] - 1);
        let corner = [first(0), first(1)];
        let size = [end(0).saturating_sub(corner[0]), end(1).saturating_sub(corner[1])];
        let window = |axis: usize| -> Vec<f32> {
            let weight = |i: usize| (-0.5 * (((corner[axis] + i) as f32 - middle[axis]) / sigma).powi(2)).exp();
            (0..size[axis]).map(weight).collect()
        };
        let (across, down) = (window(0), window(1));
        let samples = size[0] * size[1];
        let mut gradients = Self { corner, size, magnitude: vec![0.0; samples], angle_rad: vec![0.0; samples] };
        if samples > 0 {
            vectorised(
                #[inline(always)]
                || gradients.fill(level, &across, &down),
            );
        }
        gradients
    }

    #[expect(clippy::inline_always, reason = "inlined into the dispatch, else it is compiled without its vectors")]
    #[inline(always)]
    fn fill(&mut self, level: &Level<'_>, across: &[f32], down: &[f32]) {
        let [columns, _] = self.size;
        let stride = level.image.width;
        let lines = self.magnitude.chunks_exact_mut(columns).zip(self.angle_rad.chunks_exact_mut(columns));
        for (row, ((magnitudes, angles), weight)) in lines.zip(down).enumerate() {
            let start = (self.corner[1] + row) * stride + self.corner[0];
            let (left, right) = (&level.image.data[start - 1..][..columns], &level.image.data[start + 1..][..columns]);
            let above = &level.image.data[start - stride..][..columns];
            let below = &level.image.data[start + stride..][..columns];
            for i in 0..columns {
                let (dx, dy) = (right[i] - left[i], below[i] - above[i]);
                magnitudes[i] = (dx * dx + dy * dy).sqrt() * across[i] * weight;
                angles[i] = atan2(dy, dx);
            }
        }
    }
}

/// Arc tangent of y / x in the right quadrant, to 0.0003 rad; without branches, so that it runs in vectors.
#[expect(clippy::inline_always, reason = "inlined into the dispatch, else it is compiled without its vectors")]
#[inline(always)]
fn atan2(y: f32, x: f32) -> f32 {
    let (wide, high) = (x.abs(), y.abs());
    let ratio = wide.min(high) / (wide.max(high) + f32::MIN_POSITIVE);
    let square = ratio * ratio;
    // Minimax polynomial of the arc tangent on [0, 1].
    let octant = ratio * (0.99978784 + square * (-0.3258084 + square * (0.15557865 - square * 0.04432655)));
    let quadrant = if high > wide { 0.5 * PI - octant } else { octant };
    let half = if x < 0.0 { PI - quadrant } else { quadrant };
    if y < 0.0 { -half } else { half }
}

fn middle_of(level: &Level<'_>, keypoint: &Keypoint) -> [f32; 2] {
    keypoint.pixel.map(|at| ((at - 0.5) / f64::from(level.step_px)) as f32)
}

/// Returns the one or few dominant gradient directions around a keypoint, radians.
pub(super) fn orientations(level: &Level<'_>, keypoint: &Keypoint) -> Vec<f32> {
    let sigma = DIRECTION_WINDOW * keypoint.scale_px / level.step_px;
    let gradients = Gradients::new(level, middle_of(level, keypoint), 3.0 * sigma, sigma);
    let mut histogram = [0.0_f32; DIRECTION_BINS];
    for (magnitude, angle_rad) in gradients.magnitude.iter().zip(&gradients.angle_rad) {
        let bin = (angle_rad / TAU * DIRECTION_BINS as f32).round() as i64;
        histogram[bin.rem_euclid(DIRECTION_BINS as i64) as usize] += magnitude;
    }
    let neighbours = |bin: usize| [(bin + DIRECTION_BINS - 1) % DIRECTION_BINS, (bin + 1) % DIRECTION_BINS];
    for _ in 0..6 {
        let sharp = histogram;
        for (bin, value) in histogram.iter_mut().enumerate() {
            let [before, after] = neighbours(bin);
            *value = (sharp[before] + sharp[bin] + sharp[after]) / 3.0;
        }
    }
    let strongest = histogram.iter().copied().fold(0.0, f32::max);
    let peak = |bin: usize| {
        let value = histogram[bin];
        let [before, after] = neighbours(bin).map(|near| histogram[near]);
        let is_peak = value > before && value >= after && value >= SECOND_DIRECTION * strongest;
        let offset = 0.5 * (before - after) / (before - 2.0 * value + after);
        is_peak.then(|| (bin as f32 + offset) / DIRECTION_BINS as f32 * TAU)
    };
    (0..DIRECTION_BINS).filter_map(peak).collect()
}

/// Returns the descriptor of a keypoint: 4 x 4 cells of 8 directions.
pub(super) fn describe(level: &Level<'_>, keypoint: &Keypoint, orientation: Orientation) -> SiftDescriptor {
    let scale = keypoint.scale_px / level.step_px;
    let middle = middle_of(level, keypoint);
    let turned = if orientation == Orientation::Free { std::f32::consts::SQRT_2 } else { 1.0 };
    let half = 0.5 * (CELLS + 1) as f32 * CELL * scale * turned;
    let gradients = Gradients::new(level, middle, half, 0.5 * CELLS as f32 * CELL * scale);
    let (sin, cos) = keypoint.angle_rad.sin_cos();
    let cell = 1.0 / (CELL * scale);
    // One cell of margin on each side and two bins more, so that interpolation needs no tests; folded up at the end.
    let mut histogram = [[[0.0_f32; BINS + 2]; CELLS + 2]; CELLS + 2];
    let [columns, _] = gradients.size;
    for (row, (magnitudes, angles)) in gradients
        .magnitude
        .chunks_exact(columns.max(1))
        .zip(gradients.angle_rad.chunks_exact(columns.max(1)))
        .enumerate()
    {
        let dy = (gradients.corner[1] + row) as f32 - middle[1];
        for (column, (magnitude, angle_rad)) in magnitudes.iter().zip(angles).enumerate() {
            let dx = (gradients.corner[0] + column) as f32 - middle[0];
            // Place in cells from the middle of the margin cell.
            let u = (cos * dx + sin * dy) * cell + 0.5 * (CELLS + 1) as f32;
            let v = (cos * dy - sin * dx) * cell + 0.5 * (CELLS + 1) as f32;
            let reach = (CELLS + 1) as f32;
            if u <= 0.0 || v <= 0.0 || u >= reach || v >= reach {
                continue;
            }
            let turn = (angle_rad - keypoint.angle_rad) / TAU;
            let bin = ((turn - turn.floor()) * BINS as f32).min(BINS as f32);
            add(&mut histogram, [v, u, bin], *magnitude);
        }
    }
    normalised(&folded(&histogram))
}

/// Shares a gradient among the cells and bins between whose middles it lies.
fn add(histogram: &mut [[[f32; BINS + 2]; CELLS + 2]; CELLS + 2], place: [f32; 3], magnitude: f32) {
    let [row, column, bin] = place.map(|at| at as usize);
    let [down, across, on] = place.map(|at| at - at.floor());
    for (rows, by_row) in histogram[row..row + 2].iter_mut().zip([magnitude * (1.0 - down), magnitude * down]) {
        for (bins, by_cell) in rows[column..column + 2].iter_mut().zip([by_row * (1.0 - across), by_row * across]) {
            bins[bin] += by_cell * (1.0 - on);
            bins[bin + 1] += by_cell * on;
        }
    }
}

/// Drops the margin and brings the directions of a full turn back to the beginning.
fn folded(histogram: &[[[f32; BINS + 2]; CELLS + 2]; CELLS + 2]) -> [f32; 128] {
    let mut values = [0.0; 128];
    for (index, value) in values.iter_mut().enumerate() {
        let (cell, bin) = (index / BINS, index % BINS);
        let bins = &histogram[cell / CELLS + 1][cell % CELLS + 1];
        *value = bins[bin] + if bin < 2 { bins[bin + BINS] } else { 0.0 };
    }
    values
}

fn normalised(values: &[f32; 128]) -> SiftDescriptor {
    let length = values.iter().map(|value| value * value).sum::<f32>().sqrt();
    let clipped = values.map(|value| value.min(LARGEST_COMPONENT * length));
    let sum = clipped.iter().sum::<f32>().max(f32::MIN_POSITIVE);
    clipped.map(|value| (512.0 * (value / sum).sqrt()).round().min(255.0) as u8)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_fast_arc_tangent_agrees_with_the_exact_one_all_around() {
        for step in 0..3600 {
            let angle = (step as f32 * 0.1 - 180.0).to_radians();
            let (sin, cos) = angle.sin_cos();
            let error = (atan2(3.0 * sin, 3.0 * cos) - angle).rem_euclid(TAU);
            assert!(error.min(TAU - error) < 3e-4, "{angle}: {error}");
        }
        assert_eq!(atan2(0.0, 0.0), 0.0);
    }

    #[test]
    fn a_gradient_of_a_full_turn_falls_into_the_first_bin() {
        let mut histogram = [[[0.0; BINS + 2]; CELLS + 2]; CELLS + 2];
        add(&mut histogram, [1.0, 1.0, BINS as f32], 1.0);
        assert_eq!(folded(&histogram)[0], 1.0);
    }
}
