//! From changed texels to changes: what hangs together, how large it is, and where.

use std::collections::BTreeMap;
use std::fmt;

use adit_geometry::profile::Profile;
use serde::Serialize;

use super::difference::{CommonGrid, Run};
use crate::pipeline::Groups;
use crate::texture::clock_position;

/// Texels that may lie between two parts of one change.
const GAP: usize = 3;

/// A part of the wall; places are the earlier survey's.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Region {
    /// Along the axis, from.
    pub x_from_m: f64,
    /// Along the axis, to.
    pub x_to_m: f64,
    /// Arc length from the crown, clockwise looking forward, from; to may be beyond one turn.
    pub s_from_m: f64,
    /// To.
    pub s_to_m: f64,
    /// Clock position of the first edge, clockwise.
    pub clock_from: f64,
    /// Clock position of the other edge.
    pub clock_to: f64,
    /// Area of what has changed, without what it surrounds.
    pub area_cm2: f64,
}

impl fmt::Display for Region {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            out,
            "{:7.2} to {:7.2} m, {:4.1} to {:4.1} o'clock  {:7.1} cm2",
            self.x_from_m, self.x_to_m, self.clock_from, self.clock_to, self.area_cm2
        )
    }
}

/// A part of the wall that looks different in the later survey.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Change {
    /// Where.
    #[serde(flatten)]
    pub region: Region,
    /// Mean brightness of the later survey less the earlier one's, grey levels of the earlier one's exposure.
    pub grey: f64,
}

/// A part of the wall that has come in or gone back.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct ReliefChange {
    /// Where.
    #[serde(flatten)]
    pub region: Region,
    /// Mean height of the later survey less the earlier one's, positive inwards (towards the axis).
    pub height_mm: f64,
}

/// Joins runs into regions, the largest first, each with the mean of its texels' differences; those smaller than `least_cm2`
/// are left out unless they are long and thin.
pub(super) fn regions(grid: &CommonGrid, profile: &Profile<f64>, runs: &[Run], least_cm2: f64) -> Vec<(Region, f64)> {
    let mut groups = Groups::new(runs.len());
    join(grid, runs, &mut groups);
    let mut members: BTreeMap<usize, Vec<&Run>> = BTreeMap::new();
    for (index, run) in runs.iter().enumerate() {
        members.entry(groups.root(index)).or_default().push(run);
    }
    let mut regions: Vec<(Region, f64)> = members.values().map(|runs| region(grid, profile, runs)).collect();
    let long_m = |region: &Region| (region.x_to_m - region.x_from_m).max(region.s_to_m - region.s_from_m);
    // A crack of a millimetre and a hand's length.
    regions.retain(|(region, _)| {
        region.area_cm2 >= least_cm2 || region.area_cm2 >= 0.3 * least_cm2 && long_m(region) >= 0.1
    });
    regions.sort_by(|(a, _), (b, _)| b.area_cm2.total_cmp(&a.area_cm2).then(a.x_from_m.total_cmp(&b.x_from_m)));
    regions
}

/// Runs are sorted by row, then column.
fn join(grid: &CommonGrid, runs: &[Run], groups: &mut Groups) {
    let near = |a: &Run, b: &Run| {
        // Around the seam one of both counts a turn less.
        let around = grid.columns as i64;
        let [a0, a1, b0, b1] = [a.columns[0], a.columns[1], b.columns[0], b.columns[1]].map(|column| column as i64);
        let gap = GAP as i64 + 1;
        [-around, 0, around].iter().any(|turn| a0 + turn <= b1 + gap && b0 <= a1 + turn + gap)
    };
    let mut first = 0;
    for (index, run) in runs.iter().enumerate() {
        while runs[first].row + GAP < run.row {
            first += 1;
        }
        for (other, before) in runs.iter().enumerate().take(index).skip(first) {
            if near(run, before) {
                groups.join([index, other]);
            }
        }
    }
}

fn region(grid: &CommonGrid, profile: &Profile<f64>, runs: &[&Run]) -> (Region, f64) {
    let rows = runs.iter().map(|run| run.row);
    let (low, high) = (rows.clone().min().unwrap_or(0), rows.max().unwrap_or(0));
    // Columns counted from the first run's, the short way round.
    let middle = |run: &Run| run.columns[0].midpoint(run.columns[1]) as i64;
    let (origin, around) = (runs.first().map_or(0, |run| middle(run)), grid.columns as i64);
    let unrolled =
        |column: i64, run: &Run| column - ((middle(run) - origin) as f64 / around as f64).round() as i64 * around;
    let from = runs.iter().map(|run| unrolled(run.columns[0] as i64, run)).min().unwrap_or(0);
    let to = runs.iter().map(|run| unrolled(run.columns[1] as i64, run)).max().unwrap_or(0) + 1;
    let start = from.rem_euclid(around);
    let edge_m = |column: i64| column as f64 * grid.step_m;
    let (s_from_m, s_to_m) = (edge_m(start), edge_m(start + to - from));
    let texels: usize = runs.iter().map(|run| run.columns[1] - run.columns[0] + 1).sum();
    let region = Region {
        x_from_m: grid.x0_m + low as f64 * grid.step_m,
        x_to_m: grid.x0_m + (high + 1) as f64 * grid.step_m,
        s_from_m,
        s_to_m,
        clock_from: clock_position(profile, s_from_m),
        clock_to: clock_position(profile, s_to_m.rem_euclid(grid.perimeter_m)),
        area_cm2: texels as f64 * grid.step_m * grid.step_m * 1e4,
    };
    (region, runs.iter().map(|run| run.sum).sum::<f64>() / texels.max(1) as f64)
}
