//! What is adjusted, and what is known beforehand.

use adit_geometry::camera::Camera;
use adit_geometry::profile::Profile;
use adit_geometry::rig::Rig;
use adit_protocol::mission::Sigma;
use nalgebra::Isometry3;

use super::loss::Loss;
use super::shared::{Shared, SharedSigmas};
use super::tracks::Tracks;
use crate::prior::TagPrior;

/// How much the measurements are trusted.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Weights {
    /// One standard deviation of a match, pixels.
    pub pixel_px: f64,
    /// Loss of a match.
    pub loss: Loss,
    /// One standard deviation of a point against the profile. Free points with a soft surface are the safe default: points
    /// glued to the surface are silently wrong where the wall is not the profile.
    pub surface_m: f64,
}

/// A bundle adjustment problem of a tunnel.
#[derive(Clone, Copy, Debug)]
pub struct Problem<'a> {
    /// The camera as it was calibrated: the prior of [`Shared::camera`].
    pub camera: &'a Camera<f64>,
    /// The section as it was built. Its size is the metric scale, which photos cannot see: [`Shared::profile_size`] is for
    /// ranges to find.
    pub profile: &'a Profile<f64>,
    /// The rig: the prior of mounting and lever arm.
    pub rig: &'a Rig<f64>,
    /// Uncertainty of the tags.
    pub sigma: Sigma,
    /// What the tags say, one per photo.
    pub tags: &'a [TagPrior],
    /// `tunnel_from_cam` to start from, one per photo.
    pub poses: &'a [Isometry3<f64>],
    /// The points.
    pub tracks: &'a Tracks,
    /// Unknowns that all photos share, to start from.
    pub shared: Shared,
    /// Which of them are free, and how well they are known beforehand.
    pub shared_sigmas: SharedSigmas,
    /// Time from the first row's exposure to the last one's, seconds; 0 for a global shutter.
    pub readout_s: f64,
}
