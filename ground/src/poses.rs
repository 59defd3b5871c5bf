//! The result of the adjustment: where every photo was taken.

mod file;

use adit_geometry::camera::Camera;
use adit_geometry::profile::ProfileSpec;
use nalgebra::{Isometry3, Point3};
use serde::{Deserialize, Serialize};

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
}

/// One image of a point.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Sighting {
    /// Index of the photo in [`Reconstruction::poses`].
    pub photo: u32,
    /// Pixel, (0.5, 0.5) = centre of the first pixel.
    pub pixel: [f64; 2],
}

/// A point that several photos saw.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Track {
    /// Position in the tunnel frame.
    pub position: Point3<f64>,
    /// Where it was seen.
    pub sightings: Vec<Sighting>,
    /// Root mean square of the reprojection errors.
    pub error_px: f64,
}

/// Poses, points, camera and section after the adjustment.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Reconstruction {
    /// One per photo of the survey, in the same order.
    pub poses: Vec<PhotoPose>,
    /// Points that survived pruning.
    pub tracks: Vec<Track>,
    /// The camera, refined if the survey allowed it.
    pub camera: Camera<f64>,
    /// The section, refined from the ranges where they say so.
    pub profile: ProfileSpec<f64>,
}
