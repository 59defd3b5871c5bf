//! Prior poses without tags: from the photos' order, the photos per turn and the known section alone.
//!
//! [`survey_poses`] does it all. Order of work: [`view_graph`] matches each photo with the next and with those a turn on, and turns what it measures
//! into shaft angles; [`place`] fits all poses at once to the known wall.
//!
//! # Model
//! A pair of rays that show the same thing must meet on the wall: the first ray's point on the section, seen from the
//! second photo, lies in the second ray's direction. So there are no points among the unknowns, the section gives axis,
//! offset and scale, and the start (level vehicle on the axis, shaft angles in regular steps) is near enough. Two photos
//! alone would not do: over a step of a decimetre a tunnel wall is as good as flat, and the relative pose has a twin (see
//! [`crate::two_view`]).
//!
//! # Gauge
//! The first photo's x is 0. In a section that looks the same all around, its shaft angle is 0: the roll is not to be had
//! from photos. In any other, the starting angle whose fit is best is taken.
//!
//! # Limits
//! Photos must come in order of capture, and the shaft must turn on by regular steps; missed photos are noticed by the
//! turn between their neighbours, up to two in a row. The travel between photos must leave overlap. A photo that no other agrees with is
//! interpolated, with a sigma that says so.

mod fit;
mod graph;
mod miss;
mod survey;
#[cfg(test)]
mod tests;

use adit_geometry::profile::Profile;
use adit_geometry::rig::{Rig, nominal_rotation};
use nalgebra::{Isometry3, UnitQuaternion, Vector3};

use crate::correspond::{Strategy, View};
use crate::features::Descriptor;
use crate::prior::TagPrior;

pub use fit::place;
pub use graph::{Link, ViewGraph, view_graph};
pub use survey::{Matcher, Untagged, survey_poses};

/// Least standard deviation of a rotation that is passed on as a tag, radians: the same photos' matches made it and must not
/// count twice; it holds the frame only.
const FRAME_SIGMA_RAD: f64 = 0.035;

/// Why photos cannot be placed without tags.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum UntaggedError {
    /// Fewer than two photos.
    #[error("{photos} photo(s): poses without tags need at least two photos that overlap")]
    TooFewPhotos {
        /// How many there are.
        photos: usize,
    },
    /// No photo matches its successor with a turn of the shaft between them.
    #[error(
        "none of {pairs} successive pairs of photos shows a turn of the shaft by {step_deg} degrees \
         (survey.toml: [rig] images_per_turn): the photos are not in order of capture, or the wall has no texture"
    )]
    NoTurn {
        /// Pairs tried.
        pairs: usize,
        /// The expected turn.
        step_deg: u16,
    },
    /// The normal equations of the fit cannot be solved.
    #[error("the poses cannot be fitted to the section: the equations are singular at photo {photo}")]
    Singular {
        /// Index of the photo.
        photo: usize,
    },
}

/// Where a photo was taken, by matches and section.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlacedPhoto {
    /// Camera pose in the tunnel frame.
    pub tunnel_from_cam: Isometry3<f64>,
    /// One standard deviation of the optical centre (per axis, the worst), metres, against the photos one turn away.
    pub position_sigma_m: f64,
    /// One standard deviation of the rotation (per axis, the worst), radians, against the photos one turn away.
    pub rotation_sigma_rad: f64,
    /// Matches with other photos that agree with the pose.
    pub support: usize,
    /// Whether enough matches agree; if not, the pose is interpolated between its neighbours.
    pub placed: bool,
}

impl PlacedPhoto {
    /// Returns the tag that would give this pose: the rest of the pipeline is held by tags.
    ///
    /// The camera's viewing direction gives the shaft angle, so the roll is zero; x goes as odometer reading.
    pub fn tag(&self, rig: &Rig<f64>) -> TagPrior {
        let mount = UnitQuaternion::from_scaled_axis(Vector3::from(rig.mount_rotvec_rad));
        let tunnel_from_nominal = self.tunnel_from_cam.rotation * mount.inverse();
        let view = tunnel_from_nominal * Vector3::z();
        let shaft_rad = view.y.atan2(-view.z);
        let tunnel_from_body = tunnel_from_nominal * nominal_rotation(rig.image_up, shaft_rad).inverse();
        let (roll_rad, pitch_rad, yaw_rad) = tunnel_from_body.euler_angles();
        let body = self.tunnel_from_cam.translation.vector
            - tunnel_from_body * rig.body_from_cam(shaft_rad).translation.vector;
        TagPrior {
            shaft_rad,
            rotation_sigma_rad: [self.rotation_sigma_rad.max(FRAME_SIGMA_RAD); 3],
            attitude_rad: Some([roll_rad, pitch_rad, yaw_rad]),
            beams: Vec::new(),
            range_head_m: None,
            odometer_m: Some(body.x),
        }
    }
}

/// Finds the poses of photos in order of capture.
///
/// # Errors
/// [`UntaggedError`] if there is nothing to hold on to. A single photo without matches is no error:
/// [`PlacedPhoto::placed`].
pub fn poses<D: Descriptor>(
    views: &[View<D>],
    strategy: &dyn Strategy<D>,
    profile: &Profile<f64>,
    rig: &Rig<f64>,
) -> Result<Vec<PlacedPhoto>, UntaggedError>
where
    View<D>: Sync,
{
    let graph = view_graph(views.len(), rig, |[first, second]| {
        let (first_view, second_view) = (&views[first], &views[second]);
        let found = strategy.correspond(first_view, second_view);
        let rays = found.matches.iter().map(|&[a, b]| [first_view.rays[a as usize], second_view.rays[b as usize]]);
        Some(Link {
            photos: [first, second],
            rays: rays.collect(),
            second_from_first: found.two_view?.second_from_first.rotation,
        })
    })?;
    place(&graph, profile, rig)
}
