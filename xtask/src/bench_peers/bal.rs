//! Bundle adjustment in the large: our solver and Ceres on the same problem.

use std::process::Command;

use anyhow::{Context, Result};
use serde_json::{Value, json};

use super::peer::{python, script};
use super::sets::sample_path;
use super::{Bench, THREADS, program, text};

/// The name that chooses it on the command line.
pub(super) const NAME: &str = "bal";
/// The problem, below `shared/samples`.
const PROBLEM: &str = "bal/ladybug-49-1800.txt";
/// Its optimum (`formats.md`, section 3).
pub(super) const OPTIMUM: f64 = 3001.359;

/// Figures of both solvers as `ours` and `peer`; a side that cannot run is null. `None` where the problem is not here.
pub(super) fn compare(bench: &Bench) -> Result<Option<Value>> {
    let Some(problem) = sample_path(PROBLEM).map(|path| text(&path)) else {
        eprintln!("xtask: {NAME}: skipped, no shared/samples/{PROBLEM} beside or above the checkout");
        return Ok(None);
    };
    let ours = figures(&program("adit"), &["adjust", "--bal", &problem, "--json", "--threads", THREADS])?;
    let peer = figures(&python(), &[&script("ceres.py"), &problem])?;
    Ok(Some(json!({ "run": bench.run, "ours": ours, "peer": peer })))
}

/// What a program prints as JSON; null, and its complaint on standard error, if it fails.
fn figures(name: &str, arguments: &[&str]) -> Result<Value> {
    eprintln!("xtask: {name} {}", arguments.join(" "));
    let output = Command::new(name).args(arguments).output().with_context(|| format!("cannot run {name}"))?;
    if !output.status.success() {
        eprintln!("xtask: {}", String::from_utf8_lossy(&output.stderr).trim());
        return Ok(Value::Null);
    }
    serde_json::from_slice(&output.stdout).with_context(|| format!("{name} prints no JSON"))
}
