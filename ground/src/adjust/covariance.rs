//! How well poses and shared unknowns are known.

use nalgebra::Matrix6;

use super::problem::{Problem, Weights};
use super::shared::{Free, PARAMETERS, SharedSigmas};
use super::solver::{NotPositiveDefinite, Solver};
use super::tunnel::{TunnelModel, WITH_POINTS, points_see_shared};
use super::{start_of, weighting_of};

/// One standard deviation of a pose.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PoseSigma {
    /// About the camera's axes.
    pub rotation_rad: [f64; 3],
    /// Of the optical centre in the tunnel frame.
    pub position_m: [f64; 3],
}

/// Covariances at an estimate.
///
/// First order, with the robust losses' own information (`Loss::information`): right if matches that are not wrong have
/// the noise that `Weights::pixel_px` says.
#[derive(Clone, Debug)]
pub struct Covariances {
    /// Of each pose: rotation about the camera's axes (radians), then optical centre in the tunnel frame (metres).
    pub poses: Vec<Matrix6<f64>>,
    /// Of the shared unknowns; zero for what was fixed.
    pub shared: SharedSigmas,
}

impl Covariances {
    /// Computes them at the problem's poses, points and shared unknowns, which must be adjusted ones.
    ///
    /// Time and memory grow linearly with the tunnel.
    ///
    /// # Errors
    /// [`NotPositiveDefinite`] if something is not determined.
    pub fn at(problem: &Problem<'_>, weights: &Weights) -> Result<Self, NotPositiveDefinite> {
        if points_see_shared(problem) {
            at_with::<WITH_POINTS>(problem, weights)
        } else {
            at_with::<0>(problem, weights)
        }
    }

    /// Square roots of the diagonals.
    pub fn pose_sigmas(&self) -> Vec<PoseSigma> {
        let sigmas = self.poses.iter().map(|covariance| {
            let [a, b, c, d, e, f] = covariance.diagonal().map(f64::sqrt).into();
            PoseSigma { rotation_rad: [a, b, c], position_m: [d, e, f] }
        });
        sigmas.collect()
    }
}

fn at_with<const K: usize>(problem: &Problem<'_>, weights: &Weights) -> Result<Covariances, NotPositiveDefinite> {
    let model = TunnelModel::<K>::new(problem, weights.surface_m);
    let state = start_of(problem);
    let weighting = weighting_of(weights);
    let found = Solver::new(&model).covariances(&weighting, &state)?;
    let free = Free::new(&problem.shared_sigmas, problem.camera);
    let sigma = |parameter: usize| free.column[parameter].map_or(0.0, |column| found.shared[column].sqrt());
    let shared: [f64; PARAMETERS] = std::array::from_fn(sigma);
    Ok(Covariances { poses: found.cameras, shared: SharedSigmas::from_values(&shared) })
}
