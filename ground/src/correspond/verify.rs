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
    /// Fewer matches than this prove nothing: five fit any motion, and some more always happen to agree.
    pub least: usize,
    /// Starts the sampling.
    pub seed: u64,
}

impl Default for Verify {
    /// 1.5 px; 15 matches.
    fn default() -> Self {
        Self { threshold_px: 1.5, least: 15, seed: 1 }
    }
}

impl Verify {
    /// Returns the inliers of the best motion; none, and no motion, if they are too few.
    pub(super) fn check<D>(&self, first: &View<D>, second: &View<D>, matches: &[Match]) -> Correspondences {
        let rays: Vec<_> = matches.iter().map(|&[from, to]| [first.ray(from), second.ray(to)]).collect();
        let options = TwoViewOptions {
            threshold_rad: self.threshold_rad(&first.camera),
            seed: self.seed,
            ..TwoViewOptions::default()
        };
        let mut found = Correspondences { tentative: matches.len(), ..Correspondences::default() };
        let Some(two_view) = estimate(&rays, &options) else { return found };
        let kept = matches.iter().zip(&two_view.inliers).filter(|(_, inlier)| **inlier).map(|(pair, _)| *pair);
        found.matches = kept.collect();
        if found.matches.len() < self.least {
            found.matches.clear();
        } else {
            found.two_view = Some(two_view);
        }
        found
    }

    /// The threshold as an angle.
    pub(super) fn threshold_rad(&self, camera: &Camera<f64>) -> f64 {
        self.threshold_px / (0.5 * (camera.focal_px[0] + camera.focal_px[1]))
    }
}
