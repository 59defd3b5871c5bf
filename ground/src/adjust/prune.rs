//! Three-step pruning (the paper's section "Bundle Adjustment"): P1 by mask, P2 by distance to the known geometry, P3 by
//! reprojection error. Each step can be switched off.

use adit_geometry::camera::Camera;
use adit_geometry::profile::Profile;
use nalgebra::{Isometry3, Vector2};
use serde::{Deserialize, Serialize};

use super::tracks::Tracks;

/// Which steps are taken, and their bounds.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Pruning {
    /// P1: drop sightings on masked pixels.
    pub mask: bool,
    /// P2: drop points farther than this from the profile, metres.
    pub off_surface_m: Option<f64>,
    /// P3: drop sightings with a larger reprojection error, pixels.
    pub reprojection_px: Option<f64>,
}

/// How many sightings and points each step took away.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct PruneCounts {
    /// Sightings on masked pixels.
    pub masked_sightings: usize,
    /// Points off the profile.
    pub off_surface_points: usize,
    /// Sightings with a large reprojection error.
    pub large_error_sightings: usize,
    /// Points that were left with fewer than two sightings.
    pub orphaned_points: usize,
}

/// Removes what violates the bounds from `tracks`, at the given poses and the points' positions. `masked` tells for every
/// observation, in order, whether its photo's mask hides it (what is not told is not hidden).
pub fn prune(
    tracks: &mut Tracks,
    poses: &[Isometry3<f64>],
    camera: &Camera<f64>,
    profile: &Profile<f64>,
    masked: &[bool],
    pruning: &Pruning,
) -> PruneCounts {
    let mut counts = PruneCounts::default();
    let mut first = 0;
    tracks.retain(|position, seen| {
        let flags = masked.get(first..first + seen.len()).unwrap_or_default();
        first += seen.len();
        if pruning.mask {
            let before = seen.len();
            let mut flags = flags.iter();
            seen.retain(|_| !flags.next().copied().unwrap_or(false));
            counts.masked_sightings += before - seen.len();
        }
        if let Some(most_m) = pruning.off_surface_m {
            let clearance_m = profile.nearest(position.yz().coords).map_or(f64::INFINITY, |near| near.clearance_m);
            if !(clearance_m.abs() <= most_m) {
                counts.off_surface_points += 1;
                return false;
            }
        }
        if let Some(most_px) = pruning.reprojection_px {
            let before = seen.len();
            seen.retain(|sighting| {
                let in_cam = poses[sighting.photo as usize].inverse_transform_point(position).coords;
                let pixel = Vector2::from(sighting.pixel.map(f64::from));
                camera.project(&in_cam).is_some_and(|projected| (projected - pixel).norm() <= most_px)
            });
            counts.large_error_sightings += before - seen.len();
        }
        let kept = seen.len() >= 2;
        counts.orphaned_points += usize::from(!kept);
        kept
    });
    counts
}
