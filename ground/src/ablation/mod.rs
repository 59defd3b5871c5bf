//! `adit ablation`: what each pruning step is worth, the paper's Table 1 with judges that the paper did not have.
//!
//! The first five start from the same matches, found with the help of tags but without masks, and from the coarse round's poses:
//! - SBA is standard bundle adjustment: half the sum of squared reprojection errors over poses and free points, nothing
//!   else. No robust loss, no tags, no ranges, no soft surface, nothing shared is free (camera and mounting as given), no
//!   pruning. Only a loose hold to its start (0.5 m, 1 rad per photo) keeps the frame and the scale, which photos cannot
//!   see, where the coarse round put them.
//! - P1, P2, P1+P2 and P1+P2+P3 are SBA, these pruning steps with the product's bounds, SBA again.
//!
//! The other two start from matches that were found with masks:
//! - Masked is SBA on them: what P1 is worth where no window of the matching ever meets a masked pixel.
//! - Ours is what `adit reconstruct` does: all three steps, a robust loss, tags, ranges and the soft surface.
//!
//! The matching is guided by tags and section and verifies its matches by them: there is less left to prune than in the
//! paper, whose matches came from features anywhere in the photo.
//!
//! P3 takes away what has a large reprojection error, so the mean reprojection error cannot judge it, nor in full what P1 and
//! P2 take: fewer points are fitted better. Therefore two judges besides: the true poses where there are any, and held-out
//! matches. A tenth of the wall's cells is held out of every variant's adjustment; the points that matching with masks found
//! there are triangulated at each variant's poses. Of a point in two photos that leaves only the distance to the epipolar
//! line. Only the coarse round, the start of the adjustments, knew these cells.

mod judge;
mod table;
mod variant;

use std::path::PathBuf;

use anyhow::{Context, Result};
use serde::Serialize;

use crate::adjust::Outcome;
use crate::evaluate::Spread;
use crate::pipeline::{CoarseStage, MatchStage, PriorStage, SolveOptions, Solver, StageProgress, Verbosity};
use crate::survey::Survey;
use judge::{Judge, hold_out};
pub use variant::Variant;

/// One variant's figures; pairs are before and after its pruning.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Row {
    /// The variant.
    pub variant: Variant,
    /// Points, the held-out ones not among them.
    pub points: [usize; 2],
    /// Sightings of these points.
    pub observations: [usize; 2],
    /// Mean reprojection error over all sightings, pixels: after the first adjustment and after that of what was left.
    pub mean_error_px: [f64; 2],
    /// How the last adjustment ended.
    pub outcome: Outcome,
    /// Photos that hang together; errors against truth are theirs.
    pub registered: usize,
    /// Position errors after the best similarity transform; absent without truth.
    pub aligned_mm: Option<Spread>,
    /// Position errors in the tunnel frame; absent without truth.
    pub absolute_mm: Option<Spread>,
    /// Median reprojection error of the held-out points at this variant's poses, pixels.
    pub held_out_px: f64,
}

/// All variants of one survey.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Ablation {
    /// The survey folder.
    pub survey: PathBuf,
    /// Photos with a tag.
    pub photos: usize,
    /// Of these, photos with a mask. Without one P1 does nothing.
    pub masked_photos: usize,
    /// Points held out of every adjustment.
    pub held_out_points: usize,
    /// One row per variant.
    pub rows: Vec<Row>,
}

/// Runs all variants on a survey.
///
/// # Errors
/// If a mask or the truth cannot be read, or an adjustment cannot be solved.
pub fn ablate(survey: &Survey, verbosity: Verbosity) -> Result<Ablation> {
    let prior = Solver::new(survey, SolveOptions::default())?.prior()?;
    let masked_photos = survey.photos.iter().filter(|photo| photo.mask.is_some()).count();
    let masked = Matched::run(survey, &prior, true, verbosity)?;
    let judge = Judge::new(survey, hold_out(&masked.matches.tracks, true))?;
    let masked = masked.without_held_out();
    let unmasked = if masked_photos == 0 {
        None
    } else {
        Some(Matched::run(survey, &prior, false, verbosity)?.without_held_out())
    };
    let mut rows = Vec::new();
    for variant in Variant::ALL {
        let progress = StageProgress::start(verbosity, variant.name(), 0);
        let matched = match variant {
            Variant::Masked | Variant::Ours => &masked,
            _ => unmasked.as_ref().unwrap_or(&masked),
        };
        let row = variant.run(survey, &prior, matched, &judge).with_context(|| variant.name())?;
        progress.finish(&format!("{} points", row.points[1]));
        rows.push(row);
    }
    Ok(Ablation {
        survey: survey.folder.clone(),
        photos: survey.photos.len(),
        masked_photos,
        held_out_points: judge.held_out.len(),
        rows,
    })
}

/// A run of the matching.
struct Matched {
    coarse: CoarseStage,
    matches: MatchStage,
}

impl Matched {
    fn run(survey: &Survey, prior: &PriorStage, masks: bool, verbosity: Verbosity) -> Result<Self> {
        let name = if masks { "masked" } else { "unmasked" };
        let options = SolveOptions { prune_mask: masks, ..SolveOptions::default() };
        let solver = Solver::new(survey, options)?.with_section(prior)?;
        let progress = StageProgress::start(verbosity, name, survey.photos.len());
        let coarse = solver.coarse(prior, &progress).with_context(|| format!("{name} matching, coarse round"))?;
        progress.restart(survey.photos.len());
        let matches = solver.fine(&coarse, &progress);
        progress.finish(&format!("{} points", matches.tracks.len()));
        Ok(Self { coarse, matches })
    }

    fn without_held_out(mut self) -> Self {
        self.matches.tracks = hold_out(&self.matches.tracks, false);
        self
    }
}
