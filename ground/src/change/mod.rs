//! `adit compare`: two surveys of the same tunnel laid over each other, and what has changed in between.
//!
//! A first change detection: it shows where to look, in appearance and in height. Water, shadows of the vehicle and a lamp in another
//! place look like changes too, and a change smaller than a few texels of the chosen resolution does not show.

mod align;
mod difference;
mod error;
mod heights;
mod page;
mod regions;
mod rows;
mod wall;

use std::fmt;
use std::fs;
use std::path::{Path, PathBuf};

use serde::Serialize;

use crate::files::write_whole;
use align::{LEAST_CORRELATION, PATCH_M, ShiftField, common_offset, patch_shifts};
use difference::{BandChanges, CommonGrid, changes};
pub use error::ChangeError;
use error::writing;
pub use heights::ReliefComparison;
use heights::compare_heights;
use regions::regions;
pub use regions::{Change, Region, ReliefChange};
use wall::Wall;

/// Largest difference of the perimeters: sizes by ranges are known to a percent.
const SECTION_TOLERANCE: f64 = 0.05;

/// What may be chosen.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CompareOptions {
    /// Resolution of the comparison; not finer than the coarser of the two panoramas.
    pub mm_per_px: f64,
    /// Smaller changes are left out, unless they are long and thin.
    pub least_cm2: f64,
}

impl Default for CompareOptions {
    /// Changes of the size of a stamp, at the resolution at which two flights agree about edges.
    fn default() -> Self {
        Self { mm_per_px: 4.0, least_cm2: 6.0 }
    }
}

/// What was found; the content of compare.json.
#[derive(Clone, Debug, Serialize)]
pub struct ChangeReport {
    /// Version of the format.
    pub format: u32,
    /// The earlier reconstruction's folder.
    pub a: PathBuf,
    /// The later one's.
    pub b: PathBuf,
    /// Resolution of the comparison.
    pub mm_per_px: f64,
    /// What A shows at a place, B shows so much farther around (clockwise looking forward) ...
    pub offset_s_m: f64,
    /// ... and along the axis.
    pub offset_x_m: f64,
    /// Correlation by which the common place was found.
    pub offset_correlation: f64,
    /// Median length of the shifts that patches of 1 m have beyond that.
    pub local_shift_mm: f64,
    /// Patches that were found again.
    pub patches_found: usize,
    /// All patches.
    pub patches: usize,
    /// Wall that both surveys saw.
    pub compared_m2: f64,
    /// Correlation of both walls where they lie over each other, at the comparison's resolution.
    pub correlation: f64,
    /// What looks different, the largest first.
    pub changes: Vec<Change>,
    /// What has come in or gone back; absent where either survey has no measured wall.
    pub relief: Option<ReliefComparison>,
}

/// Compares the reconstructions in the folders `a` (earlier) and `b` (later): writes compare.json and compare.html into `out`.
///
/// Memory is that of a few metres of both walls; the first search holds both at 5 cm.
///
/// # Errors
/// [`ChangeError`] if a panorama is missing, no common wall is found, or `out` cannot be written.
pub fn compare(
    [a_folder, b_folder]: [&Path; 2],
    options: &CompareOptions,
    out: &Path,
    progress: &dyn Fn(usize, usize),
) -> Result<ChangeReport, ChangeError> {
    let (a, b) = (Wall::open(a_folder)?, Wall::open(b_folder)?);
    if (b.perimeter_m / a.perimeter_m - 1.0).abs() > SECTION_TOLERANCE {
        let (a_m, b_m) = (a.perimeter_m, b.perimeter_m);
        return Err(ChangeError::Sections { a: a_folder.to_owned(), a_m, b: b_folder.to_owned(), b_m });
    }
    let offset = common_offset(&a, &b)?;
    if offset.correlation < LEAST_CORRELATION {
        let (a, b, correlation) = (a_folder.to_owned(), b_folder.to_owned(), offset.correlation);
        return Err(ChangeError::NothingCommon { a, b, correlation, least: LEAST_CORRELATION });
    }
    let wanted_m = (options.mm_per_px / 1000.0).max(a.step_m(0.0)).max(b.step_m(0.0));
    let columns = (a.perimeter_m / wanted_m).round().max(8.0) as usize;
    let step_m = a.perimeter_m / columns as f64;
    // Only where both are.
    let x0_m = a.extent_m[0].max(b.extent_m[0] - offset.x_m);
    let x1_m = a.extent_m[1].min(b.extent_m[1] - offset.x_m);
    let rows = ((x1_m - x0_m) / step_m).floor().max(0.0) as usize;
    let grid = CommonGrid { columns, step_m, x0_m, perimeter_m: a.perimeter_m };
    let both = Both { a: &a, b: &b, step_m, margin_m: 0.2 };
    let bands = ((x1_m - x0_m) / PATCH_M).floor().max(1.0) as usize;
    let around = (a.perimeter_m / PATCH_M).floor().max(1.0) as usize;
    let mut found = Vec::new();
    for band in 0..bands {
        let from_m = x0_m + band as f64 * PATCH_M;
        let [in_a, in_b] = both.bands([from_m, from_m + PATCH_M], offset.x_m)?;
        found.push(patch_shifts(&in_a, &in_b, around, a.perimeter_m, from_m, &offset, step_m));
        progress(band + 1, 2 * bands);
    }
    let field = ShiftField::new(offset, x0_m, a.perimeter_m, &found);
    let (mut runs, mut compared, mut correlation) = (Vec::new(), 0, 0.0);
    for band in 0..bands {
        let edge = |band: usize| rows * band / bands;
        let wanted = edge(band)..edge(band + 1);
        let context_m = (grid.margin() + 2) as f64 * step_m;
        let at = |row: usize| x0_m + row as f64 * step_m;
        let [in_a, in_b] = both.bands([at(wanted.start) - context_m, at(wanted.end) + context_m], offset.x_m)?;
        let one: BandChanges = changes(&grid, wanted, &in_a, &in_b, &field);
        runs.extend(one.runs);
        compared += one.compared;
        correlation += one.correlation * one.compared as f64;
        progress(bands + band + 1, 2 * bands);
    }
    let heights = compare_heights([&a, &b], [x0_m, x1_m], &field)?;
    let (relief, map) = heights.map_or((None, None), |(relief, map)| (Some(relief), Some(map)));
    let changes = regions(&grid, &a.profile, &runs, options.least_cm2);
    let report = ChangeReport {
        format: 1,
        a: a_folder.to_owned(),
        b: b_folder.to_owned(),
        mm_per_px: step_m * 1000.0,
        offset_s_m: offset.s_m,
        offset_x_m: offset.x_m,
        offset_correlation: offset.correlation,
        local_shift_mm: field.spread_m() * 1000.0,
        patches_found: field.believed,
        patches: field.patches,
        compared_m2: compared as f64 * step_m * step_m,
        correlation: correlation / compared.max(1) as f64,
        changes: changes.into_iter().map(|(region, grey)| Change { region, grey }).collect(),
        relief,
    };
    let page =
        page::Page { report: &report, both: &both, grid: &grid, field: &field, runs: &runs, rows, map: map.as_ref() };
    write(&report, &page, out)?;
    Ok(report)
}

/// Both walls, read at the comparison's resolution.
struct Both<'a> {
    a: &'a Wall,
    b: &'a Wall,
    step_m: f64,
    /// What B's bands hold more, for shifts.
    margin_m: f64,
}

impl Both<'_> {
    /// The stretch `x_m` of A, and where it lies in B.
    fn bands(&self, [from_m, to_m]: [f64; 2], offset_x_m: f64) -> Result<[wall::Band; 2], ChangeError> {
        let in_b = [from_m + offset_x_m - self.margin_m, to_m + offset_x_m + self.margin_m];
        Ok([self.a.band([from_m, to_m], self.step_m)?, self.b.band(in_b, self.step_m)?])
    }
}

fn write(report: &ChangeReport, page: &page::Page<'_>, out: &Path) -> Result<(), ChangeError> {
    fs::create_dir_all(out).map_err(writing(out))?;
    let path = out.join("compare.json");
    write_whole(&path, &serde_json::to_vec_pretty(report)?).map_err(writing(&path))?;
    let path = out.join("compare.html");
    write_whole(&path, page.html()?.as_bytes()).map_err(writing(&path))
}

impl fmt::Display for ChangeReport {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (s_mm, x_mm) = (self.offset_s_m * 1000.0, self.offset_x_m * 1000.0);
        writeln!(out, "offset              {s_mm:+.0} mm around, {x_mm:+.0} mm along (B against A)")?;
        writeln!(out, "local shifts        {:.1} mm (median)", self.local_shift_mm)?;
        writeln!(out, "patches found again {} of {}", self.patches_found, self.patches)?;
        writeln!(out, "compared            {:.1} m2 at {:.1} mm", self.compared_m2, self.mm_per_px)?;
        writeln!(out, "correlation         {:.3}", self.correlation)?;
        writeln!(out, "changes             {}", self.changes.len())?;
        for Change { region, grey } in &self.changes {
            let what = if *grey < 0.0 { "darker" } else { "brighter" };
            writeln!(out, "  {region}  {grey:+4.0} grey levels ({what})")?;
        }
        if let Some(relief) = &self.relief {
            let (area_m2, sigma_mm) = (relief.compared_m2, relief.sigma_mm);
            writeln!(out, "heights compared    {area_m2:.1} m2, within {sigma_mm:.2} mm (one standard deviation)")?;
            writeln!(out, "changes of height   {}", relief.changes.len())?;
            for ReliefChange { region, height_mm } in &relief.changes {
                let what = if *height_mm < 0.0 { "gone back" } else { "come in" };
                writeln!(out, "  {region}  {height_mm:+5.1} mm in the mean ({what})")?;
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests;
