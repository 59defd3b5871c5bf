//! What the later wall shows that the earlier one does not.
//!
//! Both are made comparable first: less the mean of 0.5 m around, over the deviation there, so that lamp, exposure and
//! white balance do not count. Their difference is compared with what it usually is (noise, by its median) and with what a
//! misfit of a third of a texel would make of the edges there; only what exceeds both many times is a change. Larger,
//! fainter ones (a damp patch) are looked for in the same way in averages of some centimetres.

use rayon::prelude::*;

use super::align::ShiftField;
use super::rows::Rows;
use super::wall::Band;
use crate::adjust::median;

/// Half the side of the window of mean and deviation.
const WINDOW_M: f64 = 0.25;
/// Places are judged where both walls show at least this share of that window: beside what either did not see mean and deviation
/// are one-sided, and photos are at their worst.
const LEAST_SEEN: f32 = 0.7;
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
    /// Sum over its texels of B less A: grey levels of A's exposure, or millimetres of height.
    pub(super) sum: f64,
}

/// The grid on which walls are compared: A's, at one resolution.
#[derive(Clone, Copy, Debug)]
pub(super) struct CommonGrid {
    pub(super) columns: usize,
    /// Side of a texel, around and along.
    pub(super) step_m: f64,
    pub(super) x0_m: f64,
    pub(super) perimeter_m: f64,
}

impl CommonGrid {
    pub(super) fn place(&self, column: usize, row: usize) -> [f64; 2] {
        [(column as f64 + 0.5) * self.step_m, self.x0_m + (row as f64 + 0.5) * self.step_m]
    }

    /// Rows of context that [`changes`] needs on either side.
    pub(super) fn margin(&self) -> usize {
        (WINDOW_M / self.step_m).ceil() as usize + FAINT_WINDOW
    }
}

/// A wall with its lamp and exposure taken out.
struct Evened {
    value: Rows,
    /// Grey levels per unit of `value`.
    deviation: Rows,
}

impl Evened {
    fn new(grey: &Rows, reach: usize, skipped: &[bool]) -> Self {
        let mean = grey.mean_without(reach, skipped);
        let centred = grey.map(&mean, |grey, mean| grey - mean);
        let squares = centred.map(&centred, |a, b| a * b).mean_without(reach, skipped);
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
    let grey_a = Rows::from_fn(grid.columns, rows.clone(), |column, row| {
        let [s_m, x_m] = grid.place(column, row);
        a.sample(s_m, x_m)
    });
    let grey_b = Rows::from_fn(grid.columns, rows.clone(), |column, row| {
        let [s_m, x_m] = grid.place(column, row);
        let [s_m, x_m] = field.place_in_b(s_m, x_m);
        b.sample(s_m, x_m)
    });
    // Only what both saw: a window that is half unseen in one has another mean.
    let both = grey_a.map(&grey_b, |a, b| if b.is_nan() { f32::NAN } else { a });
    let grey_b = grey_b.map(&grey_a, |b, a| if a.is_nan() { f32::NAN } else { b });
    let reach = (WINDOW_M / grid.step_m).round() as usize;
    // What has changed, or is no more than a photo's edge, must not darken the means of its surroundings: found once, left out,
    // found again.
    let first = Compared::new([&both, &grey_b], None, reach, &[]);
    let compared = Compared::new([&both, &grey_b], Some(&both.seen_share(reach)), reach, &first.changed());
    compared.rows_of(wanted.start - rows.start..wanted.end - rows.start, wanted.start)
}

/// Both walls, evened, and how much they differ.
struct Compared {
    walls: [Evened; 2],
    difference: Rows,
    /// In standard deviations.
    fine: Vec<f32>,
    smooth: Rows,
    /// Of `smooth`, in standard deviations.
    faint: Vec<f32>,
}

impl Compared {
    /// Places are judged where enough is seen around by `seen`, [`Rows::seen_share`] of either wall (both show the same places);
    /// all are without it.
    fn new(walls: [&Rows; 2], seen: Option<&Rows>, reach: usize, skipped: &[bool]) -> Self {
        let walls = walls.map(|grey| Evened::new(grey, reach, skipped));
        let mut difference = walls[1].value.map(&walls[0].value, |b, a| b - a);
        if let Some(seen) = seen {
            difference = difference.map(seen, |value, seen| if seen < LEAST_SEEN { f32::NAN } else { value });
        }
        let fine = significance(&difference.mean(1), &gradient(&walls[0].value));
        let smooth = difference.mean(FAINT_WINDOW);
        let faint = significance(&smooth, &gradient(&walls[0].value.mean(FAINT_WINDOW)));
        Self { walls, difference, fine, smooth, faint }
    }

    fn is_changed(&self, index: usize) -> bool {
        let (here, smooth) = (self.difference.data[index], self.smooth.data[index]);
        let clear = self.fine[index].abs() >= CHANGED && here.abs() >= LEAST_CONTRAST;
        // An average reaches beyond the change's edge; the texel itself must say something too.
        let faint = self.faint[index].abs() >= CHANGED && smooth.abs() >= 0.5 * LEAST_CONTRAST;
        clear || faint && here * smooth > 0.0 && here.abs() >= 0.3 * LEAST_CONTRAST
    }

    /// Changed texels and those beside them.
    fn changed(&self) -> Vec<bool> {
        let columns = self.difference.columns;
        let here: Vec<f32> =
            (0..self.fine.len()).into_par_iter().map(|index| if self.is_changed(index) { 1.0 } else { 0.0 }).collect();
        let spread = Rows { columns, data: here }.mean(FAINT_WINDOW);
        spread.data.iter().map(|&share| share > 0.02).collect()
    }

    /// Runs of some rows, the first of which has number `first` on the grid.
    fn rows_of(&self, rows: std::ops::Range<usize>, first: usize) -> BandChanges {
        let columns = self.difference.columns;
        let mut found = BandChanges { runs: Vec::new(), compared: 0, correlation: 0.0 };
        let mut sums = [0.0_f64; 3];
        for (row, line) in (first..).zip(rows) {
            let mut open: Option<Run> = None;
            for column in 0..columns {
                let index = line * columns + column;
                let here = self.difference.data[index];
                if !here.is_nan() {
                    found.compared += 1;
                    let [a, b] = [0, 1].map(|wall| f64::from(self.walls[wall].value.data[index]));
                    for (sum, term) in sums.iter_mut().zip([a * b, a * a, b * b]) {
                        *sum += term;
                    }
                }
                if self.is_changed(index) {
                    let run = open.get_or_insert(Run { row, columns: [column, column], sum: 0.0 });
                    run.columns[1] = column;
                    run.sum += f64::from(here * self.walls[0].deviation.data[index]);
                } else {
                    found.runs.extend(open.take());
                }
            }
            found.runs.extend(open);
        }
        found.correlation = sums[0] / (sums[1] * sums[2]).sqrt().max(1e-9);
        found
    }
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
