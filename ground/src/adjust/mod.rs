//! Bundle adjustment of a tunnel survey: camera poses, free points, camera mounting and odometer scale from matches, tags and
//! the known section.
//!
//! Points are free with a soft surface prior (`Weights::surface_m`); the profile is fixed, for its size is the metric scale
//! and photos cannot see it. On a circle the roll about the axis is a gauge that only shaft angle, attitude and mounting
//! hold: nothing here can improve it, and the reported rotation sigma says so.
//!
//! Method: Levenberg-Marquardt with Nielsen's damping, points eliminated by Schur complement, envelope Cholesky on the rest;
//! Geman-McClure loss on matches whose scale shrinks from a few times the median error to its final value (graduated
//! non-convexity), because prior poses are off by tens of pixels.

mod envelope;
mod factors;
mod problem;
mod prune;
mod system;
pub mod tracks;

use nalgebra::{Isometry3, Point3, UnitQuaternion, Vector3};
use serde::{Deserialize, Serialize};

pub use envelope::NotPositiveDefinite;
pub use problem::{Observation, Point, Problem, Shared, Weights};
pub use prune::{PruneCounts, Pruning, prune};
use system::{State, System};

/// Final relative decrease of the cost at which the iteration stops.
const CONVERGED: f64 = 1e-6;
const MAX_ITERATIONS: usize = 40;
/// Damping beyond which no descent is to be had.
const LAMBDA_MAX: f64 = 1e12;

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
    /// The cost decreases by less than a millionth.
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
    /// Mounting and odometer scale.
    pub shared: Shared,
    /// What happened.
    pub report: AdjustReport,
}

/// One standard deviation of a pose.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PoseSigma {
    /// About the camera's axes.
    pub rotation_rad: [f64; 3],
    /// Of the optical centre in the tunnel frame.
    pub position_m: [f64; 3],
}

/// Adjusts the problem.
///
/// # Errors
/// [`NotPositiveDefinite`] if the normal equations cannot be solved (a bug or NaN in the input: the tags' priors make them
/// positive definite).
pub fn adjust(problem: &Problem<'_>, weights: &Weights) -> Result<Adjusted, NotPositiveDefinite> {
    let mut state = State {
        poses: problem.poses.clone(),
        points: problem.points.iter().map(|point| point.position).collect(),
        shared: problem.shared,
    };
    let cost_before = system::cost(problem, weights, &state);
    let errors = observation_errors_px(problem, &state);
    let median_before_px = median(&errors);
    let mut iterations = 0;
    // A first scale that keeps most matches: three times the median error, then half of it each time.
    let mut scale = (3.0 * median_before_px / weights.pixel_px / weights.robust).max(1.0);
    let outcome = loop {
        let stage = Weights { robust: weights.robust * scale, ..*weights };
        let (outcome, used) = minimise(problem, &stage, &mut state, if scale > 1.0 { 6 } else { MAX_ITERATIONS })?;
        iterations += used;
        if scale <= 1.0 {
            break outcome;
        }
        scale = (scale * 0.5).max(1.0);
    };
    let errors = observation_errors_px(problem, &state);
    let report = AdjustReport {
        photos: state.poses.len(),
        points: state.points.len(),
        observations: errors.len(),
        iterations,
        cost_before,
        cost_after: system::cost(problem, weights, &state),
        median_before_px,
        median_after_px: median(&errors),
        mean_after_px: errors.iter().sum::<f64>() / errors.len().max(1) as f64,
        outcome,
    };
    Ok(Adjusted { poses: state.poses, points: state.points, shared: state.shared, report })
}

/// Returns the standard deviation of every pose at an adjusted estimate.
///
/// # Errors
/// [`NotPositiveDefinite`] if a pose is not determined.
pub fn pose_sigmas(
    problem: &Problem<'_>,
    weights: &Weights,
    adjusted: &Adjusted,
) -> Result<Vec<PoseSigma>, NotPositiveDefinite> {
    use rayon::prelude::*;
    let state = State { poses: adjusted.poses.clone(), points: adjusted.points.clone(), shared: adjusted.shared };
    let factor = system::linearise(problem, weights, &state).information()?;
    Ok((0..state.poses.len())
        .into_par_iter()
        .map(|photo| {
            let sigmas = factor.sigmas(photo * 6, 6);
            PoseSigma { rotation_rad: [sigmas[0], sigmas[1], sigmas[2]], position_m: [sigmas[3], sigmas[4], sigmas[5]] }
        })
        .collect())
}

/// Levenberg-Marquardt at a fixed robust scale.
fn minimise(
    problem: &Problem<'_>,
    weights: &Weights,
    state: &mut State,
    most: usize,
) -> Result<(Outcome, usize), NotPositiveDefinite> {
    let mut lambda = 1e-4;
    let mut growth = 2.0;
    let mut system: System = system::linearise(problem, weights, state);
    for iteration in 0..most {
        loop {
            let step = system.step(lambda)?;
            let candidate = stepped(state, &step);
            let cost = system::cost(problem, weights, &candidate);
            let decrease = system.cost - cost;
            let gain = decrease / step.predicted;
            if decrease > 0.0 && gain > 1e-3 {
                *state = candidate;
                lambda = (lambda * (1.0 - (2.0 * gain - 1.0).powi(3)).max(1.0 / 3.0)).max(1e-9);
                growth = 2.0;
                if decrease <= CONVERGED * system.cost {
                    return Ok((Outcome::Converged, iteration + 1));
                }
                system = system::linearise(problem, weights, state);
                break;
            }
            // At the optimum rounding decides the sign of the decrease.
            if step.predicted <= CONVERGED * system.cost {
                return Ok((Outcome::Converged, iteration + 1));
            }
            lambda *= growth;
            growth *= 2.0;
            if lambda > LAMBDA_MAX {
                let settled = system.gradient_max() <= 1e-6 * (1.0 + system.cost);
                return Ok((if settled { Outcome::Converged } else { Outcome::Stuck }, iteration + 1));
            }
        }
    }
    Ok((Outcome::IterationLimit, most))
}

fn stepped(state: &State, step: &system::Step) -> State {
    let mut next = state.clone();
    for (photo, pose) in next.poses.iter_mut().enumerate() {
        let at = |offset: usize| step.cameras[photo * 6 + offset];
        pose.rotation *= UnitQuaternion::from_scaled_axis(Vector3::new(at(0), at(1), at(2)));
        pose.rotation.renormalize_fast();
        pose.translation.vector += Vector3::new(at(3), at(4), at(5));
    }
    let shared = next.poses.len() * 6;
    for axis in 0..3 {
        next.shared.mount_rotvec[axis] += step.cameras[shared + axis];
    }
    next.shared.odometer_scale += step.cameras[shared + 3];
    for (point, shift) in next.points.iter_mut().zip(&step.points) {
        *point += shift;
    }
    next
}

/// Reprojection error of every observation that projects, pixels.
fn observation_errors_px(problem: &Problem<'_>, state: &State) -> Vec<f64> {
    let of_point = |(point, position): (&Point, &Point3<f64>)| {
        let errors = point.observations.iter().filter_map(|observation| {
            let in_cam = state.poses[observation.photo].inverse_transform_point(position).coords;
            Some((problem.camera.project(&in_cam)? - observation.pixel).norm())
        });
        errors.collect::<Vec<f64>>()
    };
    problem.points.iter().zip(&state.points).flat_map(of_point).collect()
}

/// The median; 0 of nothing.
pub(crate) fn median(values: &[f64]) -> f64 {
    let mut sorted = values.to_vec();
    let middle = sorted.len() / 2;
    if sorted.is_empty() {
        return 0.0;
    }
    *sorted.select_nth_unstable_by(middle, f64::total_cmp).1
}

#[cfg(test)]
mod tests;
