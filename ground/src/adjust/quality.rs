//! How well each photo agrees with the others.

use serde::{Deserialize, Serialize};

use super::problem::{Problem, Weights};
use super::solver::Model;
use super::tunnel::{Estimate, TunnelModel};

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
