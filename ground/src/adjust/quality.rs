//! How well each photo agrees with the others.

use nalgebra::{Matrix3, Point3, Vector3};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::problem::{Problem, Weights};
use super::solver::{Model, Sight};
use super::tracks::Observation;
use super::tunnel::{CAMERA, Estimate, TunnelModel};

/// Steps of a triangulation.
const TRIANGULATION_STEPS: usize = 20;

/// Agreement of one photo's observations with the adjusted points.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct PhotoQuality {
    /// Observations in the photo.
    pub observations: usize,
    /// Root mean square reprojection error of those that project, pixels.
    pub rms_px: f64,
    /// Share of the observations that the robust loss gives less than half a weight, 0 to 1: wrong matches, or a wrong pose.
    pub doubted_share: f64,
}

/// Returns the quality of every photo at the problem's poses and points, which should be adjusted ones.
pub fn photo_qualities(problem: &Problem<'_>, weights: &Weights) -> Vec<PhotoQuality> {
    let model = TunnelModel::<0>::new(problem, weights.surface_m);
    let estimate = Estimate::new(problem.poses.to_vec(), problem.shared);
    // Sums first: squares, projected, doubted.
    let mut sums = vec![(PhotoQuality::default(), 0usize); problem.poses.len()];
    for (position, seen) in problem.tracks.iter() {
        for observation in seen {
            let (quality, projected) = &mut sums[observation.photo as usize];
            quality.observations += 1;
            let residual = model.residual(&estimate, position, observation);
            let weight = residual.map_or(0.0, |residual| {
                *projected += 1;
                quality.rms_px += residual.norm_squared();
                weights.loss.at(residual.norm_squared() / weights.pixel_px.powi(2)).1
            });
            quality.doubted_share += f64::from(u8::from(weight < 0.5));
        }
    }
    let finished = sums.into_iter().map(|(quality, projected)| PhotoQuality {
        rms_px: (quality.rms_px / projected.max(1) as f64).sqrt(),
        doubted_share: quality.doubted_share / quality.observations.max(1) as f64,
        ..quality
    });
    finished.collect()
}

/// Returns the reprojection error of every observation, pixels, with each point where its own observations have the least sum
/// of squares at the problem's poses; infinite where it does not project. Points start from their positions.
pub(crate) fn triangulated_errors_px(problem: &Problem<'_>) -> Vec<f64> {
    let model = TunnelModel::<0>::new(problem, f64::INFINITY);
    let estimate = Estimate::new(problem.poses.to_vec(), problem.shared);
    let errors = |point: usize| {
        let seen = problem.tracks.of(point);
        let position = triangulate(&model, &estimate, problem.tracks.positions()[point], seen);
        let error = |seen| model.residual(&estimate, &position, seen).map_or(f64::INFINITY, |residual| residual.norm());
        seen.iter().map(error).collect::<Vec<f64>>()
    };
    (0..problem.tracks.len()).into_par_iter().flat_map_iter(errors).collect()
}

/// Levenberg-Marquardt over one point. A step that does not lower the cost, or makes a sighting impossible, is not taken.
fn triangulate(
    model: &TunnelModel<'_, 0>,
    estimate: &Estimate,
    start: Point3<f64>,
    seen: &[Observation],
) -> Point3<f64> {
    let sights = |point: &Point3<f64>| -> Option<Vec<Sight<CAMERA, 0>>> {
        seen.iter().map(|seen| model.sight(estimate, point, seen)).collect()
    };
    let cost = |sights: &[Sight<CAMERA, 0>]| sights.iter().map(|sight| sight.residual.norm_squared()).sum::<f64>();
    let (mut point, mut lambda) = (start, 1e-3);
    let Some(mut known) = sights(&point) else { return start };
    for _ in 0..TRIANGULATION_STEPS {
        let normal: Matrix3<f64> = known.iter().map(|sight| sight.by_point.transpose() * sight.by_point).sum();
        let gradient: Vector3<f64> = known.iter().map(|sight| sight.by_point.transpose() * sight.residual).sum();
        let damped = normal + Matrix3::from_diagonal(&(normal.diagonal() * lambda));
        let Some(factor) = damped.cholesky() else { break };
        let moved = point - factor.solve(&gradient);
        match sights(&moved) {
            Some(better) if cost(&better) < cost(&known) => {
                (point, known) = (moved, better);
                lambda *= 0.1;
            }
            _ => lambda *= 10.0,
        }
    }
    point
}
