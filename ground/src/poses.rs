//! The result of the adjustment: where every photo was taken.

mod file;

use adit_geometry::camera::Camera;
use adit_geometry::profile::ProfileSpec;
use nalgebra::Isometry3;
use serde::{Deserialize, Serialize};

use crate::adjust::{PhotoQuality, Tracks};

pub use file::{PosesError, read_poses, write_poses};

/// How a pose was found.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum PoseStatus {
    /// From photo matches and tags together.
    Adjusted,
    /// From the tag alone: no photo agreed with it.
    PriorOnly,
}

/// The pose of one photo.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PhotoPose {
    /// The photo's name.
    pub photo: String,
    /// Camera pose; the translation is the optical centre in the tunnel frame, metres.
    pub tunnel_from_cam: Isometry3<f64>,
    /// One standard deviation of the optical centre `[x, y, z]`, metres.
    pub position_sigma_m: [f64; 3],
    /// One standard deviation of the rotation about the camera's axes, radians.
    pub rotation_sigma_rad: [f64; 3],
    /// How it was found.
    pub status: PoseStatus,
    /// How well its matches agree with it.
    pub quality: PhotoQuality,
}

/// Poses, points, camera and section after the adjustment.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Reconstruction {
    /// One per photo of the survey, in the same order.
    pub poses: Vec<PhotoPose>,
    /// Points that survived pruning, with the photos that saw them.
    pub tracks: Tracks,
    /// The camera, refined if the survey allowed it.
    pub camera: Camera<f64>,
    /// The section, refined from the ranges where they say so.
    pub profile: ProfileSpec<f64>,
}
