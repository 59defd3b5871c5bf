//! What the later wall shows that the earlier one does not.
//!
//! Both are made comparable first: less the mean of 0.5 m around, over the deviation there, so that lamp, exposure and
//! white balance do not count. Their difference is compared with what it usually is (noise, by its median) and with what a
//! misfit of a third of a texel would make of the edges there; only what exceeds both many times is a change. Larger,
//! fainter ones (a damp patch) are looked for in the same way in averages of some centimetres.

use rayon::prelude::*;

use super::align::ShiftField;
use super::wall::Band;
use crate::adjust::median;

/// Half the side of the window of mean and deviation.
const WINDOW_M: f64 = 0.25;
/// Deviation, grey levels, below which a wall counts as plain.
const PLAIN: f32 = 4.0;
/// Misfit that must not look like a change, texels.
const MISFIT_PX: f32 = 0.35;
/// Difference from which on a texel has changed, in standard deviations.
const CHANGED: f32 = 6.0;
/// And in units of the local deviation.
const LEAST_CONTRAST: f32 = 0.6;
/// Half the side of the averages in which faint changes are looked for, texels.
const FAINT_WINDOW: usize = 5;

/// A stretch of a row whose texels have changed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Run {
    /// Row of the common grid, from A's first.
    pub(super) row: usize,
    pub(super) columns: [usize; 2],
    /// Sum over its texels of B less A in grey levels of A's exposure.
    pub(super) grey_sum: f64,
}

/// The grid on which walls are compared: A's, at one resolution.
#[derive(Clone, Copy, Debug)]
pub(super) struct CommonGrid {
    pub(super) columns: usize,
    pub(super) step_s_m: f64,
    pub(super) step_x_m: f64,
    pub(super) x0_m: f64,
    pub(super) perimeter_m: f64,
}

impl CommonGrid {
    pub(super) fn place(&self, column: usize, row: usize) -> [f64; 2] {
        [(column as f64 + 0.5) * self.step_s_m, self.x0_m + (row as f64 + 0.5) * self.step_x_m]
    }

    /// Rows of context that [`changes`] needs on either side.
    pub(super) fn margin(&self) -> usize {
        (WINDOW_M / self.step_x_m).ceil() as usize + FAINT_WINDOW
    }
}

/// Values on rows of the common grid, once around; NaN where not seen.
struct Rows {
    columns: usize,
    data: Vec<f32>,
}

impl Rows {
    fn from_fn(grid: &CommonGrid, rows: std::ops::Range<usize>, value: impl Fn(usize, usize) -> f32 + Sync) -> Self {
        let data = rows
            .into_par_iter()
            .flat_map_iter(|row| {
                let value = &value;
                (0..grid.columns).map(move |column| value(column, row))
            })
            .collect();
        Self { columns: grid.columns, data }
    }

    fn rows(&self) -> usize {
        self.data.len() / self.columns
    }

    fn map(&self, other: &Self, f: impl Fn(f32, f32) -> f32 + Sync) -> Self {
        let data = self.data.par_iter().zip(&other.data).map(|(a, b)| f(*a, *b)).collect();
        Self { columns: self.columns, data }
    }

    /// Mean of the seen values within `reach` texels, around the wall; NaN where the middle is not seen.
    fn mean(&self, reach: usize) -> Self {
        let (columns, rows) = (self.columns, self.rows());
        let along: Vec<[f32; 2]> = (0..rows)
            .into_par_iter()
            .flat_map_iter(|row| {
                let line = &self.data[row * columns..(row + 1) * columns];
                let term = |column: usize| {
                    let value = line[column % columns];
                    if value.is_nan() { [0.0, 0.0] } else { [value, 1.0] }
                };
                let reach = reach.min((columns - 1) / 2);
                let mut sum = (0..2 * reach).map(|offset| term(columns + offset - reach)).fold([0.0; 2], add);
                (0..columns).map(move |column| {
                    sum = add(sum, term(column + reach));
                    let here = sum;
                    let gone = term(column + columns - reach);
                    sum = [sum[0] - gone[0], sum[1] - gone[1]];
                    here
                })
            })
            .collect();
        let column_mean = |index: usize| {
            let (row, column) = (index / columns, index % columns);
            if self.data[index].is_nan() {
                return f32::NAN;
            }
            let near = row.saturating_sub(reach)..(row + reach + 1).min(rows);
            let [sum, count] = near.map(|row| along[row * columns + column]).fold([0.0; 2], add);
            sum / count
        };
        let data = (0..self.data.len()).into_par_iter().map(column_mean).collect();
        Self { columns, data }
    }
}

fn add(a: [f32; 2], b: [f32; 2]) -> [f32; 2] {
    [a[0] + b[0], a[1] + b[1]]
}

/// A wall with its lamp and exposure taken out.
struct Evened {
    value: Rows,
    /// Grey levels per unit of `value`.
    deviation: Rows,
}

impl Evened {
    fn new(grey: &Rows, reach: usize) -> Self {
        let mean = grey.mean(reach);
        let centred = grey.map(&mean, |grey, mean| grey - mean);
        let squares = centred.map(&centred, |a, b| a * b).mean(reach);
        let deviation = squares.map(&squares, |square, _| square.sqrt().max(PLAIN));
        Self { value: centred.map(&deviation, |value, deviation| value / deviation), deviation }
    }
}

/// Share of the wall that both surveys saw, and what has changed of it, for rows `wanted` of the grid.
pub(super) struct BandChanges {
    pub(super) runs: Vec<Run>,
    pub(super) compared: usize,
    /// Correlation of the evened walls.
    pub(super) correlation: f64,
}

/// Compares rows of the grid; `a` and `b` must hold [`CommonGrid::margin`] rows more on either side, where there are any.
pub(super) fn changes(
    grid: &CommonGrid,
    wanted: std::ops::Range<usize>,
    a: &Band,
    b: &Band,
    field: &ShiftField,
) -> BandChanges {
    let margin = grid.margin();
    let rows = wanted.start.saturating_sub(margin)..wanted.end + margin;
    let grey_a = Rows::from_fn(grid, rows.clone(), |column, row| {
        let [s_m, x_m] = grid.place(column, row);
        a.sample(s_m, x_m)
    });
    let grey_b = Rows::from_fn(grid, rows.clone(), |column, row| {
        let [s_m, x_m] = grid.place(column, row);
        let [s_m, x_m] = field.place_in_b(s_m, x_m);
        b.sample(s_m, x_m)
    });
    let reach = (WINDOW_M / grid.step_x_m).round() as usize;
    // Only what both saw: a window that is half unseen in one has another mean.
    let both = grey_a.map(&grey_b, |a, b| if b.is_nan() { f32::NAN } else { a });
    let (first, second) = (Evened::new(&both, reach), Evened::new(&grey_b.map(&grey_a, |b, a| b + 0.0 * a), reach));
    let difference = second.value.map(&first.value, |b, a| b - a);
    let fine = significance(&difference.mean(1), &gradient(&first.value));
    let smooth = difference.mean(FAINT_WINDOW);
    let faint = significance(&smooth, &gradient(&first.value.mean(FAINT_WINDOW)));
    let skipped = wanted.start - rows.start;
    let mut found = BandChanges { runs: Vec::new(), compared: 0, correlation: 0.0 };
    let mut sums = [0.0_f64; 3];
    for row in wanted {
        let line = (row - rows.start) * grid.columns;
        debug_assert!(row - rows.start >= skipped);
        let mut open: Option<Run> = None;
        for column in 0..grid.columns {
            let index = line + column;
            let here = difference.data[index];
            if !here.is_nan() {
                found.compared += 1;
                let (a, b) = (f64::from(first.value.data[index]), f64::from(second.value.data[index]));
                for (sum, term) in sums.iter_mut().zip([a * b, a * a, b * b]) {
                    *sum += term;
                }
            }
            let changed = fine[index].abs() >= CHANGED && here.abs() >= LEAST_CONTRAST
                || faint[index].abs() >= CHANGED && smooth.data[index].abs() >= 0.5 * LEAST_CONTRAST;
            if changed {
                let grey = f64::from(here * first.deviation.data[index]);
                let run = open.get_or_insert(Run { row, columns: [column, column], grey_sum: 0.0 });
                run.columns[1] = column;
                run.grey_sum += grey;
            } else {
                found.runs.extend(open.take());
            }
        }
        found.runs.extend(open);
    }
    found.correlation = sums[0] / (sums[1] * sums[2]).sqrt().max(1e-9);
    found
}

/// Length of the gradient per texel.
fn gradient(value: &Rows) -> Rows {
    let (columns, rows) = (value.columns, value.rows());
    let slope = |index: usize| {
        let (row, column) = (index / columns, index % columns);
        let at = |row: usize, column: usize| value.data[row * columns + column % columns];
        let along_s = 0.5 * (at(row, column + 1) - at(row, column + columns - 1));
        let along_x = 0.5 * (at((row + 1).min(rows - 1), column) - at(row.saturating_sub(1), column));
        let length = along_s.hypot(along_x);
        if length.is_nan() { 0.0 } else { length }
    };
    Rows { columns, data: (0..value.data.len()).into_par_iter().map(slope).collect() }
}

/// Difference over its standard deviation: noise as usual in these rows, and misfit where there are edges.
fn significance(difference: &Rows, gradient: &Rows) -> Vec<f32> {
    const SAMPLES: usize = 20_000;
    let stride = (difference.data.len() / SAMPLES).max(1);
    let sample = difference.data.iter().step_by(stride).filter(|value| !value.is_nan());
    let lengths: Vec<f64> = sample.map(|value| f64::from(value.abs())).collect();
    // The median of a normal distribution's absolute value is 0.6745 of its standard deviation.
    let noise = (median(&lengths) / 0.6745).max(1e-3) as f32;
    let sigma = |gradient: f32| noise.hypot(MISFIT_PX * gradient);
    let of =
        |(difference, gradient): (&f32, &f32)| if difference.is_nan() { 0.0 } else { difference / sigma(*gradient) };
    difference.data.par_iter().zip(&gradient.data).map(of).collect()
}
