//! Matches against exact poses.

use adit_geometry::camera::Camera;
use adit_ground::adjust::Observation;
use adit_ground::matching::MatchRound;
use nalgebra::{Isometry3, Point3, Vector2};

/// Errors of a round's matches against the exact poses.
pub(crate) struct Transfer {
    /// Pixels of the original photo between a found place and the true one, sorted.
    pub(crate) errors_px: Vec<f64>,
}

impl Transfer {
    /// Compares each match with where the true poses put it: `hit` gives the wall point that the reference pixel sees, and
    /// that point is projected into the other photo.
    pub(crate) fn new(
        round: &MatchRound,
        camera: &Camera<f64>,
        truth: &[Isometry3<f64>],
        hit: impl Fn(&Isometry3<f64>, Vector2<f64>) -> Point3<f64>,
    ) -> Self {
        let mut errors_px: Vec<f64> = Vec::new();
        let pixel = |seen: &Observation| Vector2::from(seen.pixel.map(f64::from));
        for (_, seen) in round.tracks.iter() {
            let point = hit(&truth[seen[0].photo as usize], pixel(&seen[0]));
            for other in &seen[1..] {
                let in_cam = truth[other.photo as usize].inverse_transform_point(&point);
                let expected = camera.project(&in_cam.coords);
                errors_px.push(expected.map_or(f64::INFINITY, |p| (p - pixel(other)).norm()));
            }
        }
        errors_px.sort_by(f64::total_cmp);
        Self { errors_px }
    }

    /// Middle error.
    pub(crate) fn median_px(&self) -> f64 {
        self.errors_px.get(self.errors_px.len() / 2).copied().unwrap_or(f64::INFINITY)
    }

    /// Share of matches below a limit.
    pub(crate) fn share_below(&self, limit_px: f64) -> f64 {
        self.errors_px.partition_point(|&error| error < limit_px) as f64 / self.errors_px.len().max(1) as f64
    }
}
