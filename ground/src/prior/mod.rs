//! Prior poses: where each photo was taken according to its tag alone.

mod size;

pub use size::{SizeEstimate, estimate_size};

use std::f64::consts::TAU;

use adit_geometry::centring::general::{self as centring, Centring, Fix};
use adit_geometry::profile::Profile;
use adit_geometry::rig::{Rig, attitude};
use adit_protocol::mission::Sigma;
use adit_protocol::tag::CaptureTag;
use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector2, Vector3};
use serde::{Deserialize, Serialize};

use crate::matching::ViewPose;

/// A body-fixed range reading.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Beam {
    /// Unit direction in the tunnel frame.
    pub direction: Vector3<f64>,
    /// Measured distance.
    pub measured_m: f64,
}

/// One standard deviation of a photo's own place along the axis against its neighbours, metres: an odometer's random part over
/// a few photos.
const ALONG_SIGMA_M: f64 = 0.03;
/// The same where the place comes from the neighbours' odometer.
const ALONG_BETWEEN_SIGMA_M: f64 = 0.06;
/// One standard deviation of a position in the section that was carried over from another photo: gusts move the vehicle.
const CARRIED_SIGMA_M: f64 = 0.1;
/// One standard deviation of a shaft angle between two measured ones, as a share of the step: the servo's own repeatability.
const BETWEEN_STEP_SHARE: f64 = 0.06;

/// What a tag says about the pose of its photo, in f64 and SI.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct TagPrior {
    /// Section angle of the optical axis in the body frame.
    pub shaft_rad: f64,
    /// One standard deviation of the camera's rotation about the tunnel's axes, mounting apart; infinite where nothing is known.
    pub rotation_sigma_rad: [f64; 3],
    /// Roll, pitch, yaw where measured; level and straight otherwise.
    pub attitude_rad: Option<[f64; 3]>,
    /// Range readings up, right and left; the downward one meets water and is no help for the position.
    pub beams: Vec<Beam>,
    /// Range along the optical axis.
    pub range_head_m: Option<f64>,
    /// Distance along the axis.
    pub odometer_m: Option<f64>,
}

impl TagPrior {
    /// Reads a tag.
    pub fn from_tag(tag: &CaptureTag, sigma: &Sigma) -> Self {
        let attitude_rad = tag.attitude_rad.map(|angles| angles.map(f64::from));
        let roll_rad = sigma.shaft_rad.hypot(sigma.attitude_rad);
        let mut prior = Self {
            shaft_rad: f64::from(tag.shaft_rad),
            rotation_sigma_rad: [roll_rad, sigma.attitude_rad, sigma.attitude_rad],
            attitude_rad,
            beams: Vec::new(),
            range_head_m: tag.range_head_m.map(f64::from),
            odometer_m: tag.odometer_m.map(f64::from),
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

/// Reads the photos' tags. A photo without one gets the shaft angle that the photos around it suggest, and nothing else.
pub fn tag_priors(tags: &[Option<CaptureTag>], sigma: &Sigma, images_per_turn: u16) -> Vec<TagPrior> {
    let step_rad = TAU / f64::from(images_per_turn.max(1));
    let known: Vec<(usize, f64)> =
        tags.iter().enumerate().filter_map(|(photo, tag)| Some((photo, f64::from(tag.as_ref()?.shaft_rad)))).collect();
    // The shaft turns one way: the way that most neighbours say.
    let forward = known.windows(2).filter(|pair| pair[1].0 == pair[0].0 + 1);
    let sense: f64 = forward.map(|pair| wrapped(pair[1].1 - pair[0].1).signum()).sum();
    let step_rad = if sense < 0.0 { -step_rad } else { step_rad };
    let without = |photo: usize| {
        let (shaft_rad, sigma_rad) = shaft_between(&known, photo, step_rad);
        let roll_rad = sigma.shaft_rad.hypot(sigma.attitude_rad).hypot(sigma_rad);
        TagPrior {
            shaft_rad,
            rotation_sigma_rad: [roll_rad, sigma.attitude_rad, sigma.attitude_rad],
            attitude_rad: None,
            beams: Vec::new(),
            range_head_m: None,
            odometer_m: None,
        }
    };
    let prior = |(photo, tag): (usize, &Option<CaptureTag>)| {
        tag.as_ref().map_or_else(|| without(photo), |tag| TagPrior::from_tag(tag, sigma))
    };
    let mut priors: Vec<TagPrior> = tags.iter().enumerate().map(prior).collect();
    // Without any odometer the first photo says where x begins.
    if let Some(first) = priors.first_mut().filter(|_| tags.iter().flatten().all(|tag| tag.odometer_m.is_none())) {
        first.odometer_m = Some(0.0);
    }
    priors
}

/// The angle in -pi to pi that differs from this one by whole turns.
fn wrapped(angle_rad: f64) -> f64 {
    angle_rad - (angle_rad / TAU).round() * TAU
}

/// Shaft angle of a photo between those whose angle is known, one step per photo, and the standard deviation of that assumption.
fn shaft_between(known: &[(usize, f64)], photo: usize, step_rad: f64) -> (f64, f64) {
    let after = known.partition_point(|(other, _)| *other < photo);
    let usual_rad = BETWEEN_STEP_SHARE * step_rad.abs();
    match (after.checked_sub(1).and_then(|before| known.get(before)), known.get(after)) {
        (Some(&(i, low)), Some(&(j, high))) => {
            let steps = (j - i) as f64;
            // What is left after the expected steps is spread over them: a photo too many or too few is a whole step.
            let excess_rad = wrapped(high - low - steps * step_rad);
            let share = (photo - i) as f64 / steps;
            let shaft_rad = low + share * (steps * step_rad + excess_rad);
            let odd = excess_rad.abs() > 0.4 * step_rad.abs();
            (shaft_rad, if odd { step_rad.abs() } else { usual_rad })
        }
        (Some(&(i, angle)), None) | (None, Some(&(i, angle))) => {
            (angle + (photo as f64 - i as f64) * step_rad, usual_rad)
        }
        (None, None) => (photo as f64 * step_rad, f64::INFINITY),
    }
}

/// What turns tags into poses.
#[derive(Clone, Copy, Debug)]
pub struct PriorModel<'a> {
    /// The rig, with its mounting as far as it is known.
    pub rig: &'a Rig<f64>,
    /// The section.
    pub profile: &'a Profile<f64>,
    /// Uncertainty of the tags.
    pub sigma: &'a Sigma,
    /// True metres per odometer metre.
    pub odometer_factor: f64,
    /// Way per photo along the axis before the first and after the last odometer reading: this much, give or take as much.
    pub unknown_step_m: f64,
}

/// Returns the prior pose of every photo with its uncertainty.
///
/// Rotation from shaft angle, attitude and mounting; (y, z) from the ranges, carried over from neighbours where a photo has
/// too few; x from the odometer, interpolated where it is missing.
pub fn prior_views(tags: &[TagPrior], model: &PriorModel<'_>) -> Vec<ViewPose> {
    let mut offset = Vector2::zeros();
    let stations = stations(tags, model);
    tags.iter()
        .zip(stations)
        .map(|(tag, station)| {
            let fix = section_position(tag, model.profile, model.sigma.range_m, offset);
            let across_sigma_m = fix.as_ref().map_or([CARRIED_SIGMA_M; 2], |fix| {
                [0, 1].map(|axis| fix.covariance_m2[(axis, axis)].sqrt().clamp(model.sigma.range_m, CARRIED_SIGMA_M))
            });
            offset = fix.map_or(offset, |fix| fix.offset_m);
            let body = Vector3::new(station.x, offset.x, offset.y);
            let tunnel_from_body = Isometry3::from_parts(Translation3::from(body), tag.tunnel_from_body_rotation());
            ViewPose {
                tunnel_from_cam: tunnel_from_body * model.rig.body_from_cam(tag.shaft_rad),
                position_sigma_m: [station.sigma, across_sigma_m[0], across_sigma_m[1]],
                rotation_sigma_rad: tag.rotation_sigma_rad.map(|sigma_rad| sigma_rad.hypot(model.sigma.mount_rad)),
                drift_m: station.drift,
            }
        })
        .collect()
}

/// A photo's place along the axis, metres.
#[derive(Clone, Copy, Debug)]
struct Station {
    x: f64,
    /// The photo's own uncertainty.
    sigma: f64,
    /// See [`ViewPose::drift_m`].
    drift: f64,
}

/// Places along the axis: measured, between measured ones, beyond the last one at an even pace.
fn stations(tags: &[TagPrior], model: &PriorModel<'_>) -> Vec<Station> {
    let known: Vec<(usize, f64)> = tags
        .iter()
        .enumerate()
        .filter_map(|(photo, tag)| Some((photo, tag.odometer_m? * model.odometer_factor)))
        .collect();
    let measured = |x: f64, sigma: f64| Station { x, sigma, drift: model.sigma.odometer_m_per_m * x };
    (0..tags.len())
        .map(|photo| {
            let after = known.partition_point(|(other, _)| *other < photo);
            match (after.checked_sub(1).and_then(|before| known.get(before)), known.get(after)) {
                (_, Some(&(i, x_m))) if i == photo => measured(x_m, ALONG_SIGMA_M),
                (Some(&(i, low)), Some(&(j, high))) => {
                    let x_m = low + (high - low) * (photo - i) as f64 / (j - i) as f64;
                    measured(x_m, ALONG_BETWEEN_SIGMA_M.max(0.25 * (high - low).abs()))
                }
                (Some(&(i, x_m)), None) | (None, Some(&(i, x_m))) => {
                    let way_m = (photo as f64 - i as f64) * model.unknown_step_m;
                    let edge = measured(x_m, ALONG_SIGMA_M);
                    Station { x: x_m + way_m, drift: edge.drift + way_m, ..edge }
                }
                (None, None) => Station { x: 0.0, sigma: ALONG_SIGMA_M, drift: 0.0 },
            }
        })
        .collect()
}

/// Position `[y, z]` in the section from the ranges, nearest to `start` where two would do.
fn section_position(tag: &TagPrior, profile: &Profile<f64>, range_m: f64, start: Vector2<f64>) -> Option<Fix<f64>> {
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
            Some(fix)
        }
        Centring::Inconsistent { .. } | Centring::NotEnoughBeams { .. } => None,
    }
}
