//! One side on one set: run, measured, evaluated.

use std::fs;
use std::path::Path;
use std::process::Command;

use anyhow::{Context, Result, bail};
use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::peer::{measure as measured, python, script};
use super::sets::Set;
use super::{THREADS, program, text};

/// Runs of ours, of which the one of middle time counts: times of seconds depend on chance.
pub(super) const RUNS: usize = 5;
/// A mapper of the peer that takes longer is stopped and has placed nothing.
pub(super) const MAPPER_LIMIT_S: &str = "300";

/// Whose result.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(super) enum Who {
    /// `adit`.
    Ours,
    /// COLMAP.
    Peer,
}

impl Who {
    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Ours => "ours",
            Self::Peer => "peer",
        }
    }
}

/// What a side reached.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(super) struct Outcome {
    pub(super) set: String,
    pub(super) who: Who,
    pub(super) photos: u64,
    pub(super) accuracy: Accuracy,
    /// Wall time by stage.
    pub(super) stages_s: Vec<(String, f64)>,
    /// Wall time: of ours the whole process (median of [`RUNS`]), of the peer extraction, matching and its better mapper.
    pub(super) total_s: f64,
    /// Largest resident set of the process.
    pub(super) peak_mib: f64,
    /// Digests of set and program.
    pub(super) key: String,
    /// When the run started that measured this.
    pub(super) run: String,
}

/// Figures of `adit evaluate`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct Accuracy {
    pub(super) registered: u64,
    /// Position RMSE after the best similarity.
    pub(super) aligned_mm: Option<f64>,
    /// Position RMSE in the tunnel frame; the peer has no tunnel frame.
    pub(super) absolute_mm: Option<f64>,
    pub(super) aligned_deg: Option<f64>,
    pub(super) absolute_deg: Option<f64>,
    pub(super) drift_mm_per_m: Option<f64>,
    pub(super) scale_error_percent: Option<f64>,
}

/// Runs one side on one set.
pub(super) fn measure(set: &Set, folder: &Path, who: Who, work: &Path, key: String, run: &str) -> Result<Outcome> {
    fs::create_dir_all(work).with_context(|| format!("cannot make {}", work.display()))?;
    let side = match who {
        Who::Ours => ours(folder, work)?,
        Who::Peer => peer(folder, work)?,
    };
    let (photos, accuracy, stages_s, total_s, peak_mib) = side;
    Ok(Outcome {
        set: set.name.to_owned(),
        who,
        photos,
        accuracy,
        stages_s,
        total_s,
        peak_mib,
        key,
        run: run.to_owned(),
    })
}

/// Photos, accuracy, stages, total, peak memory.
type Side = (u64, Accuracy, Vec<(String, f64)>, f64, f64);

fn ours(folder: &Path, work: &Path) -> Result<Side> {
    let (adit, survey, out) = (program("adit"), text(folder), text(&work.join("out")));
    let command = [
        &adit,
        "reconstruct",
        &survey,
        "--out",
        &out,
        "--stop-after",
        "adjust",
        "--fresh",
        "--json",
        "--threads",
        THREADS,
    ];
    let run = |_| measured(&command, &work.join("measured.json"));
    let mut runs = (0..RUNS).map(run).collect::<Result<Vec<_>>>()?;
    runs.sort_by(|a, b| a.seconds.total_cmp(&b.seconds));
    let run = &runs[RUNS / 2];
    let summary: Value = serde_json::from_str(&run.stdout).context("adit reconstruct --json")?;
    let stage = |stage: &Value| Some((stage["stage"].as_str()?.to_owned(), stage["seconds"].as_f64()?));
    let stages_s = summary["stages"].as_array().into_iter().flatten().filter_map(stage).collect();
    let (photos, accuracy) = evaluate(folder, &work.join("out"), true)?;
    Ok((photos, accuracy, stages_s, run.seconds, run.peak_mib))
}

fn peer(folder: &Path, work: &Path) -> Result<Side> {
    let (python, script) = (python(), script("colmap.py"));
    let (survey, out) = (text(folder), text(&work.join("out")));
    let run = measured(&[&python, &script, &survey, &out, MAPPER_LIMIT_S], &work.join("measured.json"))?;
    let figures = fs::read_to_string(work.join("out/peer.json")).context("colmap.py left no peer.json")?;
    let figures: Value = serde_json::from_str(&figures).context("peer.json")?;
    let mut best: Option<(u64, Accuracy, &str)> = None;
    for mapper in ["incremental", "global"] {
        let (photos, accuracy) = evaluate(folder, &work.join("out").join(mapper), false)?;
        if best.is_none_or(|(_, best, _)| accuracy.beats(&best)) {
            best = Some((photos, accuracy, mapper));
        }
    }
    let Some((photos, accuracy, mapper)) = best else { bail!("colmap.py ran no mapper") };
    let seconds = |stage: &str| Some((stage.to_owned(), figures["seconds"][stage].as_f64()?));
    let stages_s: Vec<_> = ["extract", "match", mapper].into_iter().filter_map(seconds).collect();
    let total_s = stages_s.iter().map(|(_, seconds)| seconds).sum();
    Ok((photos, accuracy, stages_s, total_s, run.peak_mib))
}

impl Accuracy {
    /// More photos, then smaller errors.
    fn beats(&self, other: &Self) -> bool {
        let error = |accuracy: &Self| accuracy.aligned_mm.unwrap_or(f64::INFINITY);
        self.registered > other.registered || (self.registered == other.registered && error(self) < error(other))
    }
}

/// Photos of the truth, and how near a result comes to it.
fn evaluate(survey: &Path, out: &Path, in_tunnel_frame: bool) -> Result<(u64, Accuracy)> {
    let output = Command::new(program("adit"))
        .args(["evaluate", &text(survey), "--out", &text(out), "--json"])
        .output()
        .context("cannot run adit evaluate")?;
    // 1: photos are missing, which is what the figures say.
    if !matches!(output.status.code(), Some(0 | 1)) {
        bail!("adit evaluate {}: {}", out.display(), String::from_utf8_lossy(&output.stderr).trim());
    }
    let value: Value = serde_json::from_slice(&output.stdout).context("adit evaluate --json")?;
    let poses = &value["poses"];
    let absolute = |kind: &str| poses["absolute"][kind]["rmse"].as_f64().filter(|_| in_tunnel_frame);
    let accuracy = Accuracy {
        registered: poses["registered"].as_u64().unwrap_or(0),
        aligned_mm: poses["aligned"]["position_mm"]["rmse"].as_f64(),
        absolute_mm: absolute("position_mm"),
        aligned_deg: poses["aligned"]["rotation_deg"]["rmse"].as_f64(),
        absolute_deg: absolute("rotation_deg"),
        drift_mm_per_m: poses["drift_mm_per_m"].as_f64(),
        scale_error_percent: poses["aligned"]["scale_error_percent"].as_f64().filter(|_| in_tunnel_frame),
    };
    Ok((poses["photos"].as_u64().unwrap_or(0), accuracy))
}
