//! The variants, and how each adjusts.

use anyhow::Result;
use nalgebra::Isometry3;
use serde::Serialize;

use super::judge::Judge;
use super::{Matched, Row};
use crate::adjust::{
    AdjustReport, Loss, PhotoQuality, Problem, PruneCounts, Shared, SharedSigmas, Weights, adjust, median,
    triangulated_errors_px,
};
use crate::pipeline::{PriorStage, SolveOptions, Solver, registered};
use crate::poses::{PhotoPose, PoseStatus};
use crate::prior::TagPrior;
use crate::survey::Survey;

/// No surface, no robust loss. Against the loose hold on the start, which is all else there is, any pixel is exact.
const STANDARD: Weights = Weights { pixel_px: 0.3, loss: Loss::Squared, surface_m: f64::INFINITY };

/// What is pruned and how it is adjusted.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub enum Variant {
    /// Standard bundle adjustment.
    #[serde(rename = "SBA")]
    Sba,
    /// SBA with masks.
    P1,
    /// SBA without points off the section.
    P2,
    /// SBA with both.
    #[serde(rename = "P1+P2")]
    P1P2,
    /// The same without sightings of a large reprojection error.
    #[serde(rename = "P1+P2+P3")]
    P1P2P3,
    /// SBA on matches that were found with masks.
    #[serde(rename = "masked")]
    Masked,
    /// As the product does it.
    #[serde(rename = "ours")]
    Ours,
}

/// An adjusted survey.
struct Adjustment {
    poses: Vec<PhotoPose>,
    shared: Shared,
    /// Before pruning.
    first: AdjustReport,
    /// After pruning.
    last: AdjustReport,
}

impl Variant {
    /// In the table's order.
    pub const ALL: [Self; 7] = [Self::Sba, Self::P1, Self::P2, Self::P1P2, Self::P1P2P3, Self::Masked, Self::Ours];

    /// As the table names it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Sba => "SBA",
            Self::P1 => "P1",
            Self::P2 => "P2",
            Self::P1P2 => "P1+P2",
            Self::P1P2P3 => "P1+P2+P3",
            Self::Masked => "masked",
            Self::Ours => "ours",
        }
    }

    /// The pruning steps after the first adjustment.
    pub fn steps(self) -> SolveOptions {
        let (prune_mask, prune_surface, prune_reprojection) = match self {
            Self::Sba | Self::Masked => (false, false, false),
            Self::P1 => (true, false, false),
            Self::P2 => (false, true, false),
            Self::P1P2 => (true, true, false),
            Self::P1P2P3 | Self::Ours => (true, true, true),
        };
        SolveOptions { prune_mask, prune_surface, prune_reprojection, ..SolveOptions::default() }
    }

    pub(super) fn run(self, survey: &Survey, prior: &PriorStage, matched: &Matched, judge: &Judge) -> Result<Row> {
        let solver = Solver::new(survey, self.steps())?.with_section(prior)?;
        let Adjustment { poses, shared, first, last } = match self {
            Self::Ours => product(&solver, prior, matched)?,
            _ => standard(&solver, prior, matched)?,
        };
        let evaluation = judge.against_truth(&poses);
        let mut held_out = judge.held_out.clone();
        let places: Vec<Isometry3<f64>> = poses.iter().map(|pose| pose.tunnel_from_cam).collect();
        solver.put_on_wall(&mut held_out, &places);
        let problem = solver.problem(&prior.tags, &places, &held_out, shared);
        Ok(Row {
            variant: self,
            points: [first.points, last.points],
            observations: [first.observations, last.observations],
            mean_error_px: [first.mean_after_px, last.mean_after_px],
            outcome: last.outcome,
            registered: poses.iter().filter(|pose| pose.status == PoseStatus::Adjusted).count(),
            aligned_mm: evaluation.as_ref().and_then(|found| Some(found.aligned.as_ref()?.errors.position_mm)),
            absolute_mm: evaluation.as_ref().and_then(|found| Some(found.absolute.as_ref()?.position_mm)),
            held_out_px: median(&triangulated_errors_px(&problem)),
        })
    }
}

/// The product's own stage.
fn product(solver: &Solver<'_>, prior: &PriorStage, matched: &Matched) -> Result<Adjustment> {
    let stage = solver.adjust(prior, &matched.coarse, matched.matches.clone())?;
    let (poses, shared) = (stage.reconstruction.poses, stage.shared);
    Ok(Adjustment { poses, shared, first: stage.first, last: stage.last })
}

/// Standard bundle adjustment, the solver's pruning steps, and the same again if they took anything.
fn standard(solver: &Solver<'_>, prior: &PriorStage, matched: &Matched) -> Result<Adjustment> {
    let mut tracks = matched.matches.tracks.clone();
    let tags: Vec<TagPrior> = prior.tags.iter().map(silent).collect();
    let start: Vec<Isometry3<f64>> = matched.coarse.views.iter().map(|view| view.tunnel_from_cam).collect();
    let shared_sigmas = SharedSigmas::default();
    let given = solver.problem(&tags, &start, &tracks, matched.coarse.shared);
    let first = adjust(&Problem { shared_sigmas, ..given }, &STANDARD)?;
    tracks.positions_mut().copy_from_slice(&first.points);
    let last = if solver.prune(&mut tracks, &first)? == PruneCounts::default() {
        first.clone()
    } else {
        let left = solver.problem(&tags, &first.poses, &tracks, first.shared);
        adjust(&Problem { shared_sigmas, ..left }, &STANDARD)?
    };
    let registered = registered(&tracks, last.poses.len());
    let photos = solver.survey.photos.iter().zip(&last.poses).zip(registered);
    let poses = photos.map(|((photo, &tunnel_from_cam), registered)| PhotoPose {
        photo: photo.name.clone(),
        tunnel_from_cam,
        // Nobody asks for the uncertainty.
        position_sigma_m: [f64::NAN; 3],
        rotation_sigma_rad: [f64::NAN; 3],
        status: if registered { PoseStatus::Adjusted } else { PoseStatus::PriorOnly },
        quality: PhotoQuality::default(),
    });
    Ok(Adjustment { poses: poses.collect(), shared: last.shared, first: first.report, last: last.report })
}

/// A tag that says nothing.
fn silent(tag: &TagPrior) -> TagPrior {
    TagPrior {
        shaft_rad: tag.shaft_rad,
        rotation_sigma_rad: [f64::INFINITY; 3],
        attitude_rad: None,
        beams: Vec::new(),
        range_head_m: None,
        odometer_m: None,
    }
}
