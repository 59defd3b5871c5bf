//! Prior poses: where each photo was taken according to its tag alone.

mod size;

pub use size::{SizeEstimate, estimate_size};

use adit_geometry::centring::general::{self as centring, Centring};
use adit_geometry::profile::Profile;
use adit_geometry::rig::{Rig, attitude};
use adit_protocol::mission::Sigma;
use adit_protocol::tag::CaptureTag;
use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector2, Vector3};

/// A body-fixed range reading.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Beam {
    /// Unit direction in the tunnel frame.
    pub direction: Vector3<f64>,
    /// Measured distance.
    pub measured_m: f64,
}

/// What a tag says about the pose of its photo, in f64 and SI.
#[derive(Clone, Debug, PartialEq)]
pub struct TagPrior {
    /// Section angle of the optical axis in the body frame.
    pub shaft_rad: f64,
    /// Roll, pitch, yaw where measured; level and straight otherwise.
    pub attitude_rad: Option<[f64; 3]>,
    /// Range readings up, right and left; the downward one meets water and is no help for the position.
    pub beams: Vec<Beam>,
    /// Range along the optical axis.
    pub range_head_m: Option<f64>,
    /// Distance along the axis.
    pub odometer_m: Option<f64>,
    /// One standard deviation of the rotation that shaft angle and attitude predict: roll, pitch, yaw about the tunnel's axes;
    /// infinite where nothing is known.
    pub rotation_sigma_rad: [f64; 3],
}

impl TagPrior {
    /// Reads a tag of a survey with the given uncertainties.
    pub fn from_tag(tag: &CaptureTag, sigma: &Sigma) -> Self {
        let attitude_rad = tag.attitude_rad.map(|angles| angles.map(f64::from));
        let mut prior = Self {
            shaft_rad: f64::from(tag.shaft_rad),
            attitude_rad,
            beams: Vec::new(),
            range_head_m: tag.range_head_m.map(f64::from),
            odometer_m: tag.odometer_m.map(f64::from),
            rotation_sigma_rad: [sigma.shaft_rad.hypot(sigma.attitude_rad), sigma.attitude_rad, sigma.attitude_rad],
        };
        let tunnel_from_body = prior.tunnel_from_body_rotation();
        let readings =
            [(tag.ranges.up_m, -Vector3::z()), (tag.ranges.right_m, Vector3::y()), (tag.ranges.left_m, -Vector3::y())];
        prior.beams = readings
            .into_iter()
            .filter_map(|(reading, direction)| {
                Some(Beam { direction: tunnel_from_body * direction, measured_m: f64::from(reading?) })
            })
            .collect();
        prior
    }

    /// Rotation `tunnel_from_body`: the measured attitude, or none.
    pub fn tunnel_from_body_rotation(&self) -> UnitQuaternion<f64> {
        let [roll, pitch, yaw] = self.attitude_rad.unwrap_or_default();
        attitude(roll, pitch, yaw)
    }
}

/// Returns the prior pose of every photo, `tunnel_from_cam`.
///
/// Rotation from shaft angle, attitude and mounting; (y, z) from the ranges, carried over from neighbours where a photo has
/// too few; x from the odometer, interpolated where it is missing.
pub fn prior_poses(tags: &[TagPrior], rig: &Rig<f64>, profile: &Profile<f64>, range_m: f64) -> Vec<Isometry3<f64>> {
    let mut offset = Vector2::zeros();
    let xs = interpolated(&tags.iter().map(|tag| tag.odometer_m).collect::<Vec<_>>());
    tags.iter()
        .zip(xs)
        .map(|(tag, x_m)| {
            offset = section_position(tag, profile, range_m, offset).unwrap_or(offset);
            let body = Vector3::new(x_m, offset.x, offset.y);
            let tunnel_from_body = Isometry3::from_parts(Translation3::from(body), tag.tunnel_from_body_rotation());
            tunnel_from_body * rig.body_from_cam(tag.shaft_rad)
        })
        .collect()
}

/// Fills gaps linearly, ends with the nearest value; all zero if nothing was measured.
fn interpolated(values: &[Option<f64>]) -> Vec<f64> {
    let known: Vec<(usize, f64)> = values.iter().enumerate().filter_map(|(i, value)| Some((i, (*value)?))).collect();
    (0..values.len())
        .map(|index| {
            let after = known.partition_point(|(i, _)| *i < index);
            match (after.checked_sub(1).and_then(|before| known.get(before)), known.get(after)) {
                (_, Some((i, value))) if *i == index => *value,
                (Some((i, low)), Some((j, high))) => low + (high - low) * (index - i) as f64 / (j - i) as f64,
                (Some((_, value)), None) | (None, Some((_, value))) => *value,
                (None, None) => 0.0,
            }
        })
        .collect()
}

/// Position `[y, z]` in the section from the ranges, nearest to `start` where two would do.
fn section_position(tag: &TagPrior, profile: &Profile<f64>, range_m: f64, start: Vector2<f64>) -> Option<Vector2<f64>> {
    let beams: Vec<centring::Beam<f64>> = tag
        .beams
        .iter()
        .map(|beam| centring::Beam {
            origin_in_body_m: Vector3::zeros(),
            direction_in_body: beam.direction,
            range_m: Some(beam.measured_m),
            sigma_m: range_m,
        })
        .collect();
    // Directions are in the tunnel frame already.
    match centring::locate(profile, &beams, &UnitQuaternion::identity(), Some(start)) {
        Centring::Solved(fix) | Centring::Undetermined { fix, .. } | Centring::Ambiguous { fixes: [fix, _] } => {
            Some(fix.offset_m)
        }
        Centring::Inconsistent { .. } | Centring::NotEnoughBeams { .. } => None,
    }
}
