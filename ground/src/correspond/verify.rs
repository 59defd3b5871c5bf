//! The geometric test that ends every strategy.

use adit_geometry::camera::Camera;

use super::{Correspondences, Match, View};
use crate::two_view::{TwoViewOptions, estimate};

/// Keeps the matches that agree with one motion of the camera.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Verify {
    /// Largest distance from the epipolar line (or, where the camera only turned, from the predicted place), pixels at the
    /// photo's centre.
    pub threshold_px: f64,
    /// Starts the sampling.
    pub seed: u64,
}

impl Default for Verify {
    /// 1.5 px.
    fn default() -> Self {
        Self { threshold_px: 1.5, seed: 1 }
    }
}

impl Verify {
    /// Returns the inliers of the best motion; none, and no motion, if there is none.
    pub(super) fn check<D>(&self, first: &View<D>, second: &View<D>, matches: &[Match]) -> Correspondences {
        let rays: Vec<_> = matches.iter().map(|&[from, to]| [first.ray(from), second.ray(to)]).collect();
        let options = TwoViewOptions {
            threshold_rad: self.threshold_rad(&first.camera),
            seed: self.seed,
            ..TwoViewOptions::default()
        };
        let two_view = estimate(&rays, &options);
        let inliers = two_view.as_ref().map_or(&[][..], |two_view| &two_view.inliers);
        let kept = matches.iter().zip(inliers).filter(|(_, inlier)| **inlier).map(|(pair, _)| *pair).collect();
        Correspondences { matches: kept, tentative: matches.len(), two_view }
    }

    /// The threshold as an angle.
    pub fn threshold_rad(&self, camera: &Camera<f64>) -> f64 {
        self.threshold_px / (0.5 * (camera.focal_px[0] + camera.focal_px[1]))
    }
}
