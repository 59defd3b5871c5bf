//! `adit adjust`.

use std::fmt;
use std::path::{Path, PathBuf};
use std::time::Instant;

use adit_ground::adjust::bal::{BalReport, read_bal, write_bal};
use anyhow::{Context, Result, bail};
use clap::Args;
use serde::Serialize;

use super::{Answer, Common, print};

/// Adjust a benchmark problem of "Bundle Adjustment in the Large".
///
/// The same solver that `adit reconstruct` uses: all nine parameters of every camera are free, no robust loss. Costs are half
/// the sum of squared residuals in pixels; the time is that of the adjustment alone, without reading and writing.
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  adit adjust --bal problem-49-7776-pre.txt\n  \
    adit adjust --bal problem.txt --iterations 20 --out adjusted.txt --json")]
pub(super) struct Arguments {
    /// The problem, as text
    #[arg(long, value_name = "FILE")]
    bal: PathBuf,
    /// Most linear systems to solve
    #[arg(long, value_name = "N", default_value_t = 50)]
    iterations: usize,
    /// Where to write the adjusted problem
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
}

#[derive(Serialize)]
struct Figures {
    cameras: usize,
    points: usize,
    observations: usize,
    #[serde(flatten)]
    report: BalReport,
    seconds: f64,
    seconds_per_iteration: f64,
}

impl fmt::Display for Figures {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { cameras, points, observations, report, seconds, seconds_per_iteration } = self;
        let root_mean_square_px = |cost: f64| (2.0 * cost / (*observations).max(1) as f64).sqrt();
        writeln!(out, "problem       {cameras} cameras, {points} points, {observations} observations")?;
        for (when, cost) in [("initial", report.initial_cost), ("final", report.final_cost)] {
            writeln!(out, "{when:<8} cost {cost:.6} ({:.4} px)", root_mean_square_px(cost))?;
        }
        writeln!(out, "iterations    {} in {seconds:.3} s, {seconds_per_iteration:.4} s each", report.iterations)
    }
}

pub(super) fn run(arguments: &Arguments, common: &Common) -> Result<Answer> {
    let Arguments { bal, iterations, out } = arguments;
    if let Some(out) = out
        && is_same_file(bal, out)
    {
        bail!("{}: is the problem itself; give --out another file", out.display());
    }
    let mut problem = read_bal(bal).with_context(|| format!("{}: not a BAL problem", bal.display()))?;
    let start = Instant::now();
    let report = problem.adjust(*iterations).with_context(|| format!("{}: cannot be adjusted", bal.display()))?;
    let seconds = start.elapsed().as_secs_f64();
    if let Some(out) = out {
        write_bal(out, &problem)?;
    }
    let figures = Figures {
        cameras: problem.cameras.len(),
        points: problem.tracks.len(),
        observations: problem.tracks.observations().len(),
        report,
        seconds,
        seconds_per_iteration: seconds / report.iterations.max(1) as f64,
    };
    print(&figures, common)?;
    Ok(Answer::Yes)
}

/// Whether two paths lead to one file, by another name or a link too.
fn is_same_file(one: &Path, other: &Path) -> bool {
    let [one, other] = [one, other].map(std::fs::canonicalize);
    matches!((one, other), (Ok(one), Ok(other)) if one == other)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_problem_itself_is_never_written_over() {
        let folder = tempfile::tempdir().unwrap();
        let bal = folder.path().join("problem.txt");
        std::fs::write(&bal, "0 0 0\n").unwrap();
        let again = folder.path().join(".").join("problem.txt");
        assert!(is_same_file(&bal, &again));
        assert!(!is_same_file(&bal, &folder.path().join("other.txt")));
        let arguments = Arguments { bal: bal.clone(), iterations: 1, out: Some(again) };
        let common = Common { threads: None, json: true, verbose: 0 };
        assert!(run(&arguments, &common).unwrap_err().to_string().contains("--out another file"));
        assert_eq!(std::fs::read_to_string(&bal).unwrap(), "0 0 0\n");
    }
}
