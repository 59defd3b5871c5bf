//! Where a place of the earlier survey lies in the later one.
//!
//! Two flights have neither the odometer's zero nor, on a circle, the roll about the axis in common. First one offset for
//! all: the normalised correlation of the whole walls at 5 cm, at every offset, in the frequency domain (around the wall it
//! is circular, along the axis padded; holes weigh nothing: Padfield, "Masked Object Registration in the Fourier Domain",
//! 2012). Then a field of small shifts on top of it, a patch of 1 m at a time, because odometers drift and sections differ.

use rayon::prelude::*;
use rustfft::num_complex::Complex;
use rustfft::{Fft, FftPlanner};

use super::error::ChangeError;
use super::rows::Rows;
use super::wall::{Band, Wall};
use crate::adjust::median;
use crate::evaluate::Patch;

/// Texel of the first search.
const COARSE_M: f64 = 0.05;
/// Window of the local mean and deviation there, texels to either side.
const COARSE_WINDOW: usize = 8;
/// Share of the shorter wall that must overlap.
const LEAST_OVERLAP: f64 = 0.2;
/// Correlation from which on a place is believed; unrelated walls reach 0.1 over a metre.
pub(super) const LEAST_CORRELATION: f64 = 0.2;
/// Side of a patch.
pub(super) const PATCH_M: f64 = 1.0;
/// Shifts that a patch may have on top of the common one.
const SEARCH_M: f64 = 0.12;
/// A patch that is shifted farther than this from its neighbours' median has matched something else.
const STRAY_M: f64 = 0.015;

/// Offset of the later wall: what A shows at `(s, x)`, B shows at `(around * s + s_m, x + x_m)`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Offset {
    /// B's perimeter over A's.
    pub(super) around: f64,
    pub(super) s_m: f64,
    pub(super) x_m: f64,
    pub(super) correlation: f64,
}

impl Offset {
    fn of(&self, s_m: f64, x_m: f64) -> [f64; 2] {
        [self.around * s_m + self.s_m, x_m + self.x_m]
    }
}

/// Finds one offset for the whole wall; the best there is, however bad.
pub(super) fn common_offset(a: &Wall, b: &Wall) -> Result<Offset, ChangeError> {
    let columns = (a.perimeter_m / COARSE_M).round().max(8.0) as usize;
    let planes = [Normalised::new(a, columns)?, Normalised::new(b, columns)?];
    let rows = planes[0].rows + planes[1].rows;
    let transform = Transform::new(columns, rows);
    let [first, second] = planes.each_ref().map(|plane| {
        let squares: Vec<f32> = plane.value.iter().map(|value| value * value).collect();
        [&plane.value, &squares, &plane.weight].map(|values| transform.forward(values, plane.rows))
    });
    let product = transform.correlation(&first[0], &second[0]);
    let energy_a = transform.correlation(&first[1], &second[2]);
    let energy_b = transform.correlation(&first[2], &second[1]);
    let overlap = transform.correlation(&first[2], &second[2]);
    let least = LEAST_OVERLAP * planes.iter().map(Normalised::covered).fold(f64::INFINITY, f64::min);
    let correlation = |index: usize| {
        let energy = f64::from(energy_a[index]).max(0.0) * f64::from(energy_b[index]).max(0.0);
        if f64::from(overlap[index]) < least || energy <= 0.0 { 0.0 } else { f64::from(product[index]) / energy.sqrt() }
    };
    // Chance makes correlations of one over the root of the overlap.
    let significance = |index: usize| correlation(index) * f64::from(overlap[index]).max(0.0).sqrt();
    let best = (0..columns * rows)
        .into_par_iter()
        .map(|index| (significance(index), index))
        .max_by(|x, y| x.0.total_cmp(&y.0).then(y.1.cmp(&x.1)));
    let index = best.map_or(0, |(_, index)| index);
    let (column, row) = (index % columns, index / columns);
    // Beyond the middle offsets are negative.
    let signed =
        |value: usize, count: usize| if 2 * value > count { value as f64 - count as f64 } else { value as f64 };
    let last_row = planes[1].rows;
    let row = if row <= last_row { row as f64 } else { row as f64 - rows as f64 };
    Ok(Offset {
        around: b.perimeter_m / a.perimeter_m,
        s_m: signed(column, columns) * b.perimeter_m / columns as f64,
        x_m: row * COARSE_M + b.extent_m[0] - a.extent_m[0],
        correlation: correlation(index),
    })
}

/// A wall at [`COARSE_M`], less its local mean, over its local deviation; 0 with weight 0 where not seen.
struct Normalised {
    rows: usize,
    value: Vec<f32>,
    weight: Vec<f32>,
}

impl Normalised {
    fn new(wall: &Wall, columns: usize) -> Result<Self, ChangeError> {
        let band = wall.band(wall.extent_m, COARSE_M)?;
        let rows = ((wall.extent_m[1] - wall.extent_m[0]) / COARSE_M).floor().max(1.0) as usize;
        let step_s_m = wall.perimeter_m / columns as f64;
        let place = |index: usize, count: f64| (index as f64 + 0.5) * count;
        let grey = Rows::from_fn(columns, 0..rows, |column, row| {
            band.sample(place(column, step_s_m), wall.extent_m[0] + place(row, COARSE_M))
        });
        let weight = grey.data.iter().map(|grey| if grey.is_nan() { 0.0 } else { 1.0 }).collect();
        let mean = grey.mean(COARSE_WINDOW);
        let centred = grey.map(&mean, |grey, mean| grey - mean);
        let squares = centred.map(&centred, |a, b| a * b).mean(COARSE_WINDOW);
        let evened = centred.map(&squares, |value, square| value / (square.sqrt() + 1.0));
        let value = evened.data.into_iter().map(|value| if value.is_nan() { 0.0 } else { value }).collect();
        Ok(Self { rows, value, weight })
    }

    fn covered(&self) -> f64 {
        self.weight.iter().map(|&weight| f64::from(weight)).sum()
    }
}

/// Fourier transforms of planes of one size, padded with zeros along the axis.
struct Transform {
    columns: usize,
    rows: usize,
    along_s: [std::sync::Arc<dyn Fft<f32>>; 2],
    along_x: [std::sync::Arc<dyn Fft<f32>>; 2],
}

impl Transform {
    fn new(columns: usize, rows: usize) -> Self {
        let mut planner = FftPlanner::new();
        let along_s = [planner.plan_fft_forward(columns), planner.plan_fft_inverse(columns)];
        let along_x = [planner.plan_fft_forward(rows), planner.plan_fft_inverse(rows)];
        Self { columns, rows, along_s, along_x }
    }

    fn forward(&self, values: &[f32], rows: usize) -> Vec<Complex<f32>> {
        let mut plane = vec![Complex::default(); self.columns * self.rows];
        for (target, &value) in plane.iter_mut().zip(&values[..rows * self.columns]) {
            target.re = value;
        }
        self.both_ways(plane, 0)
    }

    /// Sum over all places of `a(place) * b(place + offset)`, for every offset; negative offsets count from the end.
    fn correlation(&self, a: &[Complex<f32>], b: &[Complex<f32>]) -> Vec<f32> {
        let product = a.iter().zip(b).map(|(a, b)| a.conj() * b).collect();
        let scale = 1.0 / (self.columns * self.rows) as f32;
        self.both_ways(product, 1).into_iter().map(|value| value.re * scale).collect()
    }

    /// Rows, then columns; `direction` 0 is forward.
    fn both_ways(&self, mut plane: Vec<Complex<f32>>, direction: usize) -> Vec<Complex<f32>> {
        plane.par_chunks_mut(self.columns).for_each(|row| self.along_s[direction].process(row));
        let mut turned: Vec<Complex<f32>> = (0..plane.len())
            .into_par_iter()
            .map(|index| plane[index % self.rows * self.columns + index / self.rows])
            .collect();
        turned.par_chunks_mut(self.rows).for_each(|column| self.along_x[direction].process(column));
        (0..plane.len())
            .into_par_iter()
            .map(|index| turned[index % self.columns * self.rows + index / self.columns])
            .collect()
    }
}

/// Shifts of a row of patches around the wall, beyond the common offset; `None` where a patch was not found.
pub(super) fn patch_shifts(
    a: &Band,
    b: &Band,
    around: usize,
    perimeter_m: f64,
    x0_m: f64,
    offset: &Offset,
    step_m: f64,
) -> Vec<Option<[f64; 2]>> {
    let side_m = perimeter_m / around as f64;
    let side_px = (side_m.min(PATCH_M) / step_m).round() as usize;
    let at = |px: f64| (px + 0.5) * step_m;
    let shift = |patch: usize| {
        let s0_m = patch as f64 * side_m;
        let seen = |value: f32| (!value.is_nan()).then_some(value);
        let found = Patch::new(
            side_px,
            (SEARCH_M / step_m) as usize,
            |column, row| seen(a.sample(s0_m + at(column as f64), x0_m + at(row as f64))),
            |column, row| {
                let [s_m, x_m] = offset.of(s0_m + at(column as f64), x0_m + at(row as f64));
                seen(b.sample(s_m, x_m))
            },
        );
        // The patch is A's, so that it lies at minus B's shift.
        found?.find_shift().map(|px| px.map(|px| -px * step_m))
    };
    (0..around).into_par_iter().map(shift).collect()
}

/// Shifts all over the wall, patch by patch.
pub(super) struct ShiftField {
    offset: Offset,
    x0_m: f64,
    perimeter_m: f64,
    /// Rows of patches along the axis, each once around.
    rows: Vec<Vec<[f64; 2]>>,
    /// Patches that were found and believed.
    pub(super) believed: usize,
    pub(super) patches: usize,
}

impl ShiftField {
    /// Believes patches that move with the median of their surroundings; fills in the others.
    pub(super) fn new(offset: Offset, x0_m: f64, perimeter_m: f64, found: &[Vec<Option<[f64; 2]>>]) -> Self {
        let middle =
            |values: &[[f64; 2]]| [0, 1].map(|axis| median(&values.iter().map(|v| v[axis]).collect::<Vec<_>>()));
        let all: Vec<[f64; 2]> = found.iter().flatten().flatten().copied().collect();
        let common = middle(&all);
        let (mut believed, mut rows) = (0, Vec::new());
        for (index, row) in found.iter().enumerate() {
            let near = found[index.saturating_sub(1)..(index + 2).min(found.len())].iter();
            let near: Vec<[f64; 2]> = near.flatten().flatten().copied().collect();
            let usual =
                if near.len() >= 3 { middle(&near) } else { rows.last().map_or(common, |row: &Vec<_>| middle(row)) };
            let shift = |one: &Option<[f64; 2]>| {
                let close = |shift: &[f64; 2]| (shift[0] - usual[0]).hypot(shift[1] - usual[1]) <= STRAY_M;
                one.filter(close).inspect(|_| believed += 1).unwrap_or(usual)
            };
            rows.push(row.iter().map(shift).collect());
        }
        Self { offset, x0_m, perimeter_m, rows, believed, patches: found.iter().map(Vec::len).sum() }
    }

    /// Where B shows what A shows at a place, `[s, x]` metres.
    pub(super) fn place_in_b(&self, s_m: f64, x_m: f64) -> [f64; 2] {
        let Some(around) = self.rows.first().map(Vec::len).filter(|&around| around > 0) else {
            return self.offset.of(s_m, x_m);
        };
        let column = s_m.rem_euclid(self.perimeter_m) / self.perimeter_m * around as f64 - 0.5;
        let row = ((x_m - self.x0_m) / PATCH_M - 0.5).clamp(0.0, (self.rows.len() - 1) as f64);
        let (left, above) = (column.floor(), row.floor());
        let wrap = |column: f64| (column.rem_euclid(around as f64) as usize).min(around - 1);
        let (upper, lower) = (&self.rows[above as usize], &self.rows[(above as usize + 1).min(self.rows.len() - 1)]);
        let (right_share, lower_share) = (column - left, row - above);
        let line = |row: &[[f64; 2]], axis: usize| {
            row[wrap(left)][axis] * (1.0 - right_share) + row[wrap(left + 1.0)][axis] * right_share
        };
        let shift = [0, 1].map(|axis| line(upper, axis) * (1.0 - lower_share) + line(lower, axis) * lower_share);
        let [s_in_b_m, x_in_b_m] = self.offset.of(s_m, x_m);
        [s_in_b_m + shift[0], x_in_b_m + shift[1]]
    }

    /// Median length of the shifts beyond the common offset, metres.
    pub(super) fn spread_m(&self) -> f64 {
        let lengths: Vec<f64> = self.rows.iter().flatten().map(|shift| shift[0].hypot(shift[1])).collect();
        median(&lengths)
    }
}
