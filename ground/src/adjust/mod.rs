//! Bundle adjustment: camera poses, free points and what all photos share, from matches, tags and the known section; and the
//! benchmark problems of "Bundle Adjustment in the Large" ([`bal`]) by the same solver.
//!
//! Points are free with a soft surface prior (`Weights::surface_m`). On a circle the roll about the axis is a gauge that only
//! shaft angle, attitude and mounting hold: nothing here can improve it, and the reported rotation sigma says so; a bias of the
//! shaft angle and a mounting turned about the axis cannot be told apart either. The profile's size is the metric scale: only
//! range readings see it.
//!
//! Method: Levenberg-Marquardt, points eliminated by Schur complement, envelope Cholesky on the rest (`solver`); a robust loss
//! on matches whose scale shrinks from a few times the median error to its final value (graduated non-convexity: Yang et al.,
//! "Graduated Non-Convexity for Robust Spatial Perception", 2020), because prior poses are off by tens of pixels.
//!
//! Single precision: pixels of observations, nothing else (see [`Observation::pixel`]; a test moves every pixel by half a unit in
//! the last place and finds the poses where they were, within a hundredth of their sigma).

pub mod bal;
mod covariance;
mod factors;
mod loss;
mod problem;
mod prune;
mod quality;
mod shared;
mod solver;
mod tracks;
mod tunnel;

use nalgebra::{Isometry3, Point3};
use serde::{Deserialize, Serialize};

pub use covariance::{Covariances, PoseSigma};
pub use loss::Loss;
pub use problem::{Problem, Weights};
pub use prune::{PruneCounts, Pruning, prune};
pub(crate) use quality::triangulated_errors_px;
pub use quality::{PhotoQuality, photo_qualities};
pub use shared::{Shared, SharedSigmas};
pub use solver::NotPositiveDefinite;
pub(crate) use solver::{Envelope, Factor};
use solver::{Limits, Minimised, Solver, State, Weighting};
pub use tracks::{Observation, Tracks};
use tunnel::{Estimate, TunnelModel, WITH_POINTS, points_see_shared};

/// Hardly any damping to start with: prior poses are near enough for whole steps, and what is damped first is the length and
/// the bend of a long tunnel. From 1e-4, 220 m needed some twenty iterations until they began to move.
const DAMPING: f64 = 1e-8;
/// Each wider scale of the loss: as far as the next one needs.
const WIDER: Limits = Limits { iterations: 6, decrease: 1e-2, kink: 3e-2, damping: DAMPING };
/// Final stage of an adjustment. With a tenth of this decrease (and of the other two) the RMSE of twelve sets differs by 0.02 mm at
/// most, to either side, for twice the iterations on a long set.
const LIMITS: Limits = Limits { iterations: 40, decrease: 1e-5, kink: 3e-5, damping: DAMPING };
/// Final stage of one that others follow.
const ROUGH: Limits = Limits { decrease: 1e-3, kink: 3e-3, ..LIMITS };

/// What an adjustment did.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct AdjustReport {
    /// Photos, points and observations that took part.
    pub photos: usize,
    /// Points.
    pub points: usize,
    /// Observations.
    pub observations: usize,
    /// Linear systems solved.
    pub iterations: usize,
    /// Cost at the start and at the end, at the final robust scale.
    pub cost_before: f64,
    /// See `cost_before`.
    pub cost_after: f64,
    /// Median reprojection error at the start, pixels.
    pub median_before_px: f64,
    /// Median reprojection error at the end, pixels.
    pub median_after_px: f64,
    /// Mean reprojection error at the end over all observations, outliers included, pixels.
    pub mean_after_px: f64,
    /// How it ended.
    pub outcome: Outcome,
}

/// How an adjustment ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Outcome {
    /// The cost decreases by less than a hundred-thousandth (of [`adjust_roughly`] a thousandth).
    Converged,
    /// The iterations ran out first.
    IterationLimit,
    /// No damping gave a lower cost although the gradient is not zero.
    Stuck,
}

/// An adjusted estimate.
#[derive(Clone, Debug)]
pub struct Adjusted {
    /// `tunnel_from_cam`.
    pub poses: Vec<Isometry3<f64>>,
    /// Points, in the problem's order.
    pub points: Vec<Point3<f64>>,
    /// What all photos share.
    pub shared: Shared,
    /// What happened.
    pub report: AdjustReport,
}

/// Adjusts the problem.
///
/// # Errors
/// [`NotPositiveDefinite`] if the normal equations cannot be solved (a bug or NaN in the input: priors make them positive
/// definite).
pub fn adjust(problem: &Problem<'_>, weights: &Weights) -> Result<Adjusted, NotPositiveDefinite> {
    adjust_within(problem, weights, LIMITS)
}

/// Adjusts the problem until the cost decreases by less than a thousandth: for poses that will be adjusted again.
///
/// # Errors
/// As of [`adjust`].
pub fn adjust_roughly(problem: &Problem<'_>, weights: &Weights) -> Result<Adjusted, NotPositiveDefinite> {
    adjust_within(problem, weights, ROUGH)
}

fn adjust_within(problem: &Problem<'_>, weights: &Weights, last: Limits) -> Result<Adjusted, NotPositiveDefinite> {
    if points_see_shared(problem) {
        adjust_with::<WITH_POINTS>(problem, weights, last)
    } else {
        adjust_with::<0>(problem, weights, last)
    }
}

fn adjust_with<const K: usize>(
    problem: &Problem<'_>,
    weights: &Weights,
    last_limits: Limits,
) -> Result<Adjusted, NotPositiveDefinite> {
    let model = TunnelModel::<K>::new(problem, weights.surface_m);
    let mut solver = Solver::new(&model);
    let mut state = start_of(problem);
    let last = weighting_of(weights);
    let cost_before = solver.cost(&last, &state);
    let median_before_px = median_in_place(&mut solver.errors_px(&state));
    let mut iterations = 0;
    // A first scale that keeps most matches: three times the median error, then a quarter of it each time.
    let mut scale = (3.0 * median_before_px / weights.pixel_px / weights.loss.scale()).max(1.0);
    let Minimised { outcome, cost: cost_after, .. } = loop {
        let stage = Weighting { loss: weights.loss.widened(scale), ..last };
        let limits = if scale > 1.0 { WIDER } else { last_limits };
        let minimised = solver.minimise(&stage, &mut state, limits)?;
        iterations += minimised.iterations;
        if scale <= 1.0 {
            break minimised;
        }
        scale = (scale * 0.25).max(1.0);
    };
    let mut errors_px = solver.errors_px(&state);
    let report = AdjustReport {
        photos: problem.poses.len(),
        points: problem.tracks.len(),
        observations: errors_px.len(),
        iterations,
        cost_before,
        cost_after,
        median_before_px,
        mean_after_px: errors_px.iter().map(|&error| f64::from(error)).sum::<f64>() / errors_px.len().max(1) as f64,
        median_after_px: median_in_place(&mut errors_px),
        outcome,
    };
    let State { estimate: Estimate { poses, shared, .. }, points } = state;
    Ok(Adjusted { poses, points, shared, report })
}

/// The problem's own state.
fn start_of(problem: &Problem<'_>) -> State<Estimate> {
    State {
        estimate: Estimate::new(problem.poses.to_vec(), problem.shared),
        points: problem.tracks.positions().to_vec(),
    }
}

/// Matches trusted as `weights` say.
fn weighting_of(weights: &Weights) -> Weighting {
    Weighting { pixel_px: weights.pixel_px, loss: weights.loss, information: None, curved: false }
}

/// Returns where the shared unknowns go in `iterations` steps from the problem's own state, at the final width of the loss.
///
/// A question to an adjusted problem some of whose fixed unknowns were freed: what would the photos have them be?
///
/// # Errors
/// [`NotPositiveDefinite`] as in [`adjust`].
pub fn tendency(problem: &Problem<'_>, weights: &Weights, iterations: usize) -> Result<Shared, NotPositiveDefinite> {
    let model = TunnelModel::<WITH_POINTS>::new(problem, weights.surface_m);
    let mut state = start_of(problem);
    let weighting = weighting_of(weights);
    let limits = Limits { iterations, ..LIMITS };
    Solver::new(&model).minimise(&weighting, &mut state, limits)?;
    Ok(state.estimate.shared)
}

/// The median; 0 of nothing.
pub(crate) fn median(values: &[f64]) -> f64 {
    median_in_place(&mut values.to_vec())
}

/// [`median`] of values whose order does not matter.
fn median_in_place<T: Copy + Into<f64>>(values: &mut [T]) -> f64 {
    let middle = values.len() / 2;
    if values.is_empty() {
        return 0.0;
    }
    let order = |a: &T, b: &T| (*a).into().total_cmp(&(*b).into());
    (*values.select_nth_unstable_by(middle, order).1).into()
}

#[cfg(test)]
mod tests;
