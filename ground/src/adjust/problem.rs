//! What is adjusted, and what is known beforehand.

use adit_geometry::camera::Camera;
use adit_geometry::profile::Profile;
use adit_geometry::rig::Rig;
use adit_protocol::mission::Sigma;
use nalgebra::{Isometry3, Point3, Vector2, Vector3};

use crate::prior::TagPrior;

/// One image of a point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Observation {
    /// Index of the photo.
    pub photo: usize,
    /// Pixel, (0.5, 0.5) = centre of the first pixel.
    pub pixel: Vector2<f64>,
}

/// A point and the photos that saw it.
#[derive(Clone, Debug, PartialEq)]
pub struct Point {
    /// Position in the tunnel frame.
    pub position: Point3<f64>,
    /// Its images, each photo at most once.
    pub observations: Vec<Observation>,
}

/// Unknowns that all photos share.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Shared {
    /// Rotation of the camera against its nominal mounting, rotation vector in camera axes, radians.
    pub mount_rotvec: Vector3<f64>,
    /// True distance per odometer metre, minus one.
    pub odometer_scale: f64,
}

/// How much the measurements are trusted.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Weights {
    /// One standard deviation of a match, pixels.
    pub pixel_px: f64,
    /// Geman-McClure scale of a match in standard deviations.
    pub robust: f64,
    /// One standard deviation of a point against the profile. Free points with a soft surface are the safe default: points
    /// glued to the surface are silently wrong where the wall is not the profile.
    pub surface_m: f64,
}

/// A bundle adjustment problem.
#[derive(Clone, Debug)]
pub struct Problem<'a> {
    /// The camera, fixed.
    pub camera: &'a Camera<f64>,
    /// The section, fixed: it is the metric scale, which photos cannot see.
    pub profile: &'a Profile<f64>,
    /// The rig; its mounting is the prior of [`Shared::mount_rotvec`].
    pub rig: &'a Rig<f64>,
    /// Uncertainty of the tags.
    pub sigma: Sigma,
    /// What the tags say, one per photo.
    pub tags: &'a [TagPrior],
    /// `tunnel_from_cam`, one per photo.
    pub poses: Vec<Isometry3<f64>>,
    /// The points.
    pub points: Vec<Point>,
    /// Unknowns that all photos share.
    pub shared: Shared,
}
