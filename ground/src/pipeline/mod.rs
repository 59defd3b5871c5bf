//! From a survey folder to `out/`: stages in a row, each stored, so that a killed run goes on where it was.

mod checkpoint;
mod photos;
mod progress;
mod solve;

use std::path::PathBuf;

use anyhow::{Context, Result, bail};
use serde::{Deserialize, Serialize};

pub use checkpoint::{Checkpoints, Key, write_whole};
pub use progress::{StageProgress, Verbosity};
pub use solve::{AdjustStage, CoarseStage, MatchStage, PriorStage, RoundSummary, SolveOptions, Solver};

use crate::survey::{self, Loss, Survey};

/// The stages in order.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "lowercase")]
pub enum Stage {
    /// Poses from the tags alone.
    Prior,
    /// First matches within the tags' uncertainty, first adjustment.
    Coarse,
    /// Matches at the photos' own resolution.
    Match,
    /// Adjustment with pruning.
    Adjust,
    /// Panorama, sheets, coverage.
    Texture,
    /// GLB, OBJ, PLY, COLMAP.
    Model,
    /// report.html and report.json.
    Report,
}

/// What `adit reconstruct` was asked to do.
#[derive(Clone, Debug)]
pub struct ReconstructOptions {
    /// The survey folder.
    pub survey: PathBuf,
    /// Where results go.
    pub out: PathBuf,
    /// Panorama resolution; the photos' own if `None`.
    pub mm_per_px: Option<f64>,
    /// Last stage to run.
    pub stop_after: Option<Stage>,
    /// Forget earlier results.
    pub fresh: bool,
    /// What the pose stages may do.
    pub solve: SolveOptions,
    /// Bars and lines on standard error.
    pub verbosity: Verbosity,
}
