//! Where the wall has come in or gone back: the difference of two measured reliefs.
//!
//! Both reliefs are heights over each survey's own refined section, so what a section does as a whole (its size by the
//! ranges, its ovality) is not compared here. What is left of that, and of slow errors, is a mean over a good metre, which is taken away;
//! a change is what is many times the usual difference, and several millimetres.

use std::ops::Range;

use serde::Serialize;

use super::align::ShiftField;
use super::difference::{CommonGrid, Run};
use super::error::ChangeError;
use super::regions::{ReliefChange, regions};
use super::rows::Rows;
use super::wall::Wall;
use crate::adjust::median;
use crate::surface::{SurfaceStore, SurfaceWindow};

/// Cells of the comparison: about those of the measured wall.
const CELL_M: f64 = 0.025;
/// Half the side of the window whose mean is taken away.
const WINDOW_M: f64 = 0.7;
/// Change from which on a cell has moved, in standard deviations.
const MOVED: f32 = 6.0;
/// And at least.
const LEAST_M: f32 = 0.006;
/// Regions smaller than this are left out: a palm's size, for templates are as large.
const LEAST_CM2: f64 = 60.0;

/// Rows compared at a time.
const BAND_ROWS: usize = 40;
/// B's stretch is read with so much more on either side, for shifts.
const SHIFTS_M: f64 = 0.2;

/// How the wall's height has changed.
#[derive(Clone, Debug, Serialize)]
pub struct ReliefComparison {
    /// Wall whose height both surveys know.
    pub compared_m2: f64,
    /// One standard deviation of the difference of heights where nothing has changed, the median over the tunnel.
    pub sigma_mm: f64,
    /// What has moved, the largest first.
    pub changes: Vec<ReliefChange>,
}

/// Later less earlier height on a grid, metres; NaN where not both know it.
pub(super) struct HeightMap {
    pub(super) grid: CommonGrid,
    pub(super) difference_m: Vec<f32>,
}

/// What has moved on rows of the grid.
struct BandHeights {
    runs: Vec<Run>,
    difference_m: Vec<f32>,
    sigma_m: f32,
}

/// Compares the heights of two walls over the stretch `x_m` of A; `None` where either was not measured.
pub(super) fn compare_heights(
    [a, b]: [&Wall; 2],
    x_m: [f64; 2],
    field: &ShiftField,
) -> Result<Option<(ReliefComparison, HeightMap)>, ChangeError> {
    let (Some(surface_a), Some(surface_b)) = (&a.surface, &b.surface) else { return Ok(None) };
    let columns = (a.perimeter_m / CELL_M).round().max(8.0) as usize;
    let step_m = a.perimeter_m / columns as f64;
    let grid = CommonGrid { columns, step_m, x0_m: x_m[0], perimeter_m: a.perimeter_m };
    let rows = ((x_m[1] - x_m[0]) / step_m).floor().max(0.0) as usize;
    let (mut runs, mut difference_m, mut sigmas_m) = (Vec::new(), Vec::new(), Vec::new());
    for start in (0..rows).step_by(BAND_ROWS) {
        let band = moved(&grid, start..(start + BAND_ROWS).min(rows), [surface_a, surface_b], field)?;
        runs.extend(band.runs);
        difference_m.extend(band.difference_m);
        sigmas_m.push(f64::from(band.sigma_m));
    }
    let changes = regions(&grid, &a.profile, &runs, LEAST_CM2);
    let compared = difference_m.iter().filter(|height| !height.is_nan()).count();
    let comparison = ReliefComparison {
        compared_m2: compared as f64 * step_m * step_m,
        sigma_mm: median(&sigmas_m) * 1e3,
        changes: changes.into_iter().map(|(region, height_mm)| ReliefChange { region, height_mm }).collect(),
    };
    Ok(Some((comparison, HeightMap { grid, difference_m })))
}

/// Compares rows `wanted` of the grid.
fn moved(
    grid: &CommonGrid,
    wanted: Range<usize>,
    [a, b]: [&SurfaceStore; 2],
    field: &ShiftField,
) -> Result<BandHeights, ChangeError> {
    let reach = (WINDOW_M / grid.step_m) as usize;
    let rows = wanted.start.saturating_sub(reach + 1)..wanted.end + reach + 1;
    let ends_m = [rows.start, rows.end].map(|row| grid.place(0, row)[1]);
    let in_b_m = ends_m.map(|x_m| field.place_in_b(0.0, x_m)[1]);
    let a: SurfaceWindow = a.window(ends_m)?;
    let b: SurfaceWindow = b.window([in_b_m[0] - SHIFTS_M, in_b_m[1] + SHIFTS_M])?;
    let raw = Rows::from_fn(grid.columns, rows.clone(), |column, row| {
        let [s_m, x_m] = grid.place(column, row);
        let [s_in_b_m, x_in_b_m] = field.place_in_b(s_m, x_m);
        match (a.relief_m(s_m, x_m), b.relief_m(s_in_b_m.rem_euclid(b.profile().perimeter_m()), x_in_b_m)) {
            (Some(before_m), Some(after_m)) => (after_m - before_m) as f32,
            _ => f32::NAN,
        }
    })
    .mean(1);
    let less_mean = |skipped: &[bool]| raw.map(&raw.mean_without(reach, skipped), |here, mean| here - mean);
    // What has moved must not move the mean of its surroundings: found once, left out, found again.
    let first = less_mean(&[]);
    let (has_moved, _) = judged(&first);
    let spread: Vec<f32> = has_moved.iter().map(|moved| if *moved { 1.0 } else { 0.0 }).collect();
    let spread = Rows { columns: grid.columns, data: spread }.mean(4);
    let skipped: Vec<bool> = spread.data.iter().map(|share| *share > 0.0).collect();
    let difference = less_mean(&skipped);
    let (has_moved, sigma_m) = judged(&difference);
    let own = (wanted.start - rows.start) * grid.columns..(wanted.end - rows.start) * grid.columns;
    let difference_m = difference.data[own.clone()].to_vec();
    let lines = difference_m.chunks_exact(grid.columns).zip(has_moved[own].chunks_exact(grid.columns));
    let runs =
        (wanted.start..).zip(lines).flat_map(|(row, (heights_m, moved))| runs_of(row, heights_m, moved)).collect();
    Ok(BandHeights { runs, difference_m, sigma_m })
}

/// Which cells have moved, and the usual difference.
fn judged(difference: &Rows) -> (Vec<bool>, f32) {
    let sizes: Vec<f64> =
        difference.data.iter().filter(|value| !value.is_nan()).map(|value| f64::from(value.abs())).collect();
    let sigma_m = (1.4826 * median(&sizes)) as f32;
    let least_m = (MOVED * sigma_m).max(LEAST_M);
    (difference.data.iter().map(|value| value.abs() >= least_m).collect(), sigma_m)
}

/// Runs of moved cells of one row, each of one sign.
fn runs_of(row: usize, heights_m: &[f32], moved: &[bool]) -> Vec<Run> {
    let mut runs: Vec<Run> = Vec::new();
    for (column, (&height_m, _)) in heights_m.iter().zip(moved).enumerate().filter(|(_, (_, moved))| **moved) {
        let height_mm = f64::from(height_m) * 1e3;
        match runs.last_mut().filter(|run| run.columns[1] + 1 == column && run.sum * height_mm > 0.0) {
            Some(run) => {
                run.columns[1] = column;
                run.sum += height_mm;
            }
            None => runs.push(Run { row, columns: [column, column], sum: height_mm }),
        }
    }
    runs
}
