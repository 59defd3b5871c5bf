//! `adit compare`.

use std::path::{Path, PathBuf};

use adit_ground::change::{CompareOptions, compare};
use adit_ground::pipeline::{StageProgress, Verbosity};
use anyhow::Result;
use clap::Args;

use super::{Answer, Common, positive, print};

/// Compare two surveys of the same tunnel: what has changed in looks and in height.
///
/// Lays the later panorama over the earlier one (odometers start elsewhere, rolls differ, sections differ a little), takes
/// lamp and exposure out of both, and lists every part of the wall that differs by more than noise and misfit explain:
/// distance, clock position, area, darker or brighter. Writes compare.json and compare.html (a map and the largest
/// changes side by side).
///
/// Where both surveys measured the wall, it lists what has come in or gone back by more than their noise as well (6 mm at
/// least, a palm's size); what a section does as a whole is not compared.
///
/// Water, dirt and shadows look like changes too; look at the pictures. Within 10 cm of wall that either did not see no looks are
/// judged.
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  adit compare 2025-05/survey 2026-05/survey\n  \
    adit compare old new --mm-per-px 2 --least-cm2 2 --out changes")]
pub(super) struct Arguments {
    /// The earlier survey folder, reconstructed (or its out/ folder)
    #[arg(value_name = "SURVEY_A")]
    a: PathBuf,
    /// The later one
    #[arg(value_name = "SURVEY_B")]
    b: PathBuf,
    /// Where compare.json and compare.html go [default: compare/ in the later one's out/]
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Resolution of the comparison
    #[arg(long, value_name = "MM", value_parser = positive, default_value_t = CompareOptions::default().mm_per_px)]
    mm_per_px: f64,
    /// Smallest change that is listed, but for long thin ones
    #[arg(long, value_name = "CM2", value_parser = positive, default_value_t = CompareOptions::default().least_cm2)]
    least_cm2: f64,
}

pub(super) fn run(arguments: &Arguments, common: &Common) -> Result<Answer> {
    let [a, b] = [&arguments.a, &arguments.b].map(|folder| reconstruction(folder));
    let out = arguments.out.clone().unwrap_or_else(|| b.join("compare"));
    let options = CompareOptions { mm_per_px: arguments.mm_per_px, least_cm2: arguments.least_cm2 };
    let progress = StageProgress::start(Verbosity::Talk, "compare", 0);
    let report = compare([&a, &b], &options, &out, &|done, total| {
        progress.restart(total);
        progress.set(done);
    })?;
    progress.finish(&format!("{} changes, pictures in {}", report.changes.len(), out.join("compare.html").display()));
    print(&report, common)?;
    Ok(Answer::Yes)
}

/// A survey's results are in its folder out/.
fn reconstruction(folder: &Path) -> PathBuf {
    let inner = folder.join("out");
    if inner.join("panorama/panorama.json").is_file() { inner } else { folder.to_owned() }
}
