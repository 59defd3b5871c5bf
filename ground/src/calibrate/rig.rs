//! How the camera sits on its shaft, from a first turn or more in any textured place: mounting rotation, lever arm, shaft zero.
//!
//! The survey's own way to poses, and in its last adjustment the rig is free: the photos know how they stand to each other and
//! to the section, the tags say what the shaft's encoder read, and what is the same in all photos is the rig.
//!
//! What no photo can tell is not made up. A turn of the mounting about the shaft and an encoder's zero are one and the same, so
//! the mounting is given without it and the zero apart; both are folded into the table `[rig]`, which has no key for a zero.
//! On a circle nothing but the tags themselves sees that angle at all. Where the origin of x is arbitrary, as in every survey,
//! so is the lever along the shaft.

use std::fmt;

use adit_geometry::profile::ProfileSpec;
use adit_geometry::rig::{ImageUp, Rig};
use adit_protocol::mission::rig_to_toml;
use anyhow::{Result, bail};
use nalgebra::{UnitQuaternion, Vector3};
use serde::Serialize;

use crate::adjust::SharedSigmas;
use crate::pipeline::{SolveOptions, Solver, StageProgress, Verbosity};
use crate::survey::Survey;

/// Freedom of the mounting about each axis, at least: more than a bracket bends.
const MOUNT_SIGMA_RAD: f64 = 0.06;
/// Freedom of the encoder's zero: it may have been set by eye.
const SHAFT_SIGMA_RAD: f64 = 0.06;
/// Freedom of the radial lever: a ruler's reading to the lens, whose optical centre nobody sees.
const LEVER_SIGMA_M: f64 = 0.05;
/// What is known after the adjustment to no less than this share of its freedom before was not told by the survey.
const TOLD_SHARE: f64 = 0.5;
/// Turns below this leave walls unseen.
const LEAST_TURNS: f64 = 0.9;

/// A number and its standard deviation.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Estimated {
    /// The value.
    pub value: f64,
    /// One standard deviation.
    pub sigma: f64,
}

/// Something that the survey does not tell.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Untold {
    /// The roll about the axis of a circle.
    #[error(
        "the section is a circle, so the shaft's zero rests on the tags' own shaft angles and attitudes: an error that all of them \
         share cannot be seen; a turn in a rectangular room or an underpass tells it"
    )]
    RollOnCircle,
    /// The lever along the shaft.
    #[error(
        "the lever along the shaft is as stated: where x begins is arbitrary, so no photo tells it; measure it with a ruler"
    )]
    LeverForward,
    /// The radial lever.
    #[error("the radial lever is hardly told: take more photos, with range readings of the walls")]
    LeverRadial,
    /// The mounting.
    #[error("the mounting is hardly told: take more photos of a textured wall, all around")]
    Mount,
    /// Less than a turn.
    #[error("the photos show less than a turn of the shaft: take a whole one")]
    LessThanATurn,
}

/// A calibrated rig.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct RigCalibration {
    /// Photos of the survey.
    pub photos: usize,
    /// Photos that hang together by their matches.
    pub registered: usize,
    /// Median reprojection error.
    pub median_px: f64,
    /// Rotation of the camera against its nominal mounting, its part about the shaft as stated: rotation vector in camera axes.
    pub mount_rotvec_deg: [Estimated; 3],
    /// What is to be added to the encoder's angles.
    pub shaft_zero_deg: Estimated,
    /// Optical centre ahead of the shaft's axis.
    pub lever_radial_m: Estimated,
    /// What the survey does not tell.
    #[serde(serialize_with = "as_texts")]
    pub untold: Vec<Untold>,
    /// The table `[rig]`, the shaft's zero folded into the mounting.
    pub rig_toml: String,
}

fn as_texts<S: serde::Serializer>(untold: &[Untold], serializer: S) -> Result<S::Ok, S::Error> {
    serializer.collect_seq(untold.iter().map(ToString::to_string))
}

/// Calibrates the rig of a survey.
///
/// # Errors
/// If no photo has a tag, the photos do not hang together, or the section or the adjustment fails.
pub fn calibrate_rig(survey: &Survey, verbosity: Verbosity) -> Result<RigCalibration> {
    if survey.photos.iter().all(|photo| photo.tag.is_none()) {
        bail!("{}: no photo has a tag, and the rig is known by the shaft angles in them only", survey.folder.display());
    }
    let solver = Solver::new(survey, SolveOptions::default())?;
    let prior = solver.prior()?;
    let solver = solver.with_section(&prior)?;
    let progress = StageProgress::start(verbosity, "coarse", survey.photos.len());
    let coarse = solver.coarse(&prior, &progress)?;
    progress.finish("photos found within the tags' uncertainty");
    let progress = StageProgress::start(verbosity, "match", survey.photos.len());
    let matches = solver.fine(&coarse, &progress);
    progress.finish(&format!("{} matches", matches.round.matches));
    let rig = &survey.config.rig;
    let progress = StageProgress::start(verbosity, "adjust", 1);
    let settled = solver.settle(&prior, &coarse, matches.tracks, freed(survey))?;
    let registered = settled.registered.iter().filter(|registered| **registered).count();
    progress.finish(&format!("{registered} of {} photos hang together", survey.photos.len()));
    if 2 * registered < survey.photos.len() {
        bail!(
            "{}: only {registered} of {} photos hang together by their matches; a textured place and a whole turn are needed",
            survey.folder.display(),
            survey.photos.len()
        );
    }
    let (shared, sigmas) = (&settled.last.shared, &settled.covariances.shared);
    let degrees = |value: f64, sigma: f64| Estimated { value: value.to_degrees(), sigma: sigma.to_degrees() };
    let mut calibrated = RigCalibration {
        photos: survey.photos.len(),
        registered,
        median_px: settled.last.report.median_after_px,
        mount_rotvec_deg: [0, 1, 2].map(|axis| degrees(shared.mount_rotvec[axis], sigmas.mount_rad[axis])),
        shaft_zero_deg: degrees(shared.shaft_bias_rad, sigmas.shaft_bias_rad),
        lever_radial_m: Estimated { value: shared.lever_m[0], sigma: sigmas.lever_m[0] },
        untold: Vec::new(),
        rig_toml: rig_to_toml(&Rig {
            lever_radial_m: (shared.lever_m[0] * 1e5).round() / 1e5,
            mount_rotvec_rad: folded(rig.image_up, shared.shaft_bias_rad, shared.mount_rotvec),
            ..*rig
        }),
    };
    calibrated.untold = untold(survey, &calibrated);
    Ok(calibrated)
}

/// The rig free, but for the mounting's part about the shaft: that is the shaft's zero.
fn freed(survey: &Survey) -> SharedSigmas {
    let sigma = &survey.config.sigma;
    let (axis, _) = shaft_in_cam(survey.config.rig.image_up);
    let mut mount_rad = [MOUNT_SIGMA_RAD.max(sigma.mount_rad); 3];
    mount_rad[axis] = 0.0;
    SharedSigmas {
        mount_rad,
        shaft_bias_rad: SHAFT_SIGMA_RAD.max(sigma.mount_rad),
        lever_m: [LEVER_SIGMA_M, 0.0],
        ..SharedSigmas::of_tags(sigma)
    }
}

/// The shaft's axis in the nominal camera: which axis, and its sense (the shaft turns clockwise looking along it).
fn shaft_in_cam(image_up: ImageUp) -> (usize, f64) {
    match image_up {
        ImageUp::Forward => (1, -1.0),
        ImageUp::Backward => (1, 1.0),
        ImageUp::Clockwise => (0, 1.0),
        ImageUp::Counterclockwise => (0, -1.0),
    }
}

/// The mounting that has the same effect with an encoder whose zero is right: `exp(zero about the shaft) exp(mount)`.
fn folded(image_up: ImageUp, zero_rad: f64, mount_rotvec: Vector3<f64>) -> [f64; 3] {
    let (axis, sense) = shaft_in_cam(image_up);
    let mut shaft = Vector3::zeros();
    shaft[axis] = sense * zero_rad;
    let mount = UnitQuaternion::from_scaled_axis(shaft) * UnitQuaternion::from_scaled_axis(mount_rotvec);
    // To a ten thousandth of a degree.
    let round = |angle: f64| (angle.to_degrees() * 1e4).round() / 1e4;
    mount.scaled_axis().map(|angle| round(angle).to_radians()).into()
}

fn untold(survey: &Survey, found: &RigCalibration) -> Vec<Untold> {
    let free = freed(survey);
    let mut untold = Vec::new();
    let shafts = survey.photos.iter().filter_map(|photo| Some(f64::from(photo.tag?.shaft_rad)));
    let (low, high) = shafts.fold((f64::MAX, f64::MIN), |(low, high), shaft| (low.min(shaft), high.max(shaft)));
    let step = 1.0 / f64::from(survey.config.rig.images_per_turn);
    if (high - low) / std::f64::consts::TAU + step < LEAST_TURNS {
        untold.push(Untold::LessThanATurn);
    }
    if found
        .mount_rotvec_deg
        .iter()
        .zip(free.mount_rad)
        .any(|(mount, free)| mount.sigma.to_radians() > TOLD_SHARE * free)
    {
        untold.push(Untold::Mount);
    }
    if matches!(survey.config.profile, ProfileSpec::Circle { .. }) {
        untold.push(Untold::RollOnCircle);
    }
    if found.lever_radial_m.sigma > TOLD_SHARE * free.lever_m[0] {
        untold.push(Untold::LeverRadial);
    }
    untold.push(Untold::LeverForward);
    untold
}

impl fmt::Display for RigCalibration {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(out, "photos         {} of {} hang together", self.registered, self.photos)?;
        writeln!(out, "error          {:.3} px (median)", self.median_px)?;
        for (axis, mount) in ["x", "y", "z"].iter().zip(&self.mount_rotvec_deg) {
            writeln!(out, "mounting {axis}     {:>8.3} deg +- {:.3}", mount.value, mount.sigma)?;
        }
        writeln!(out, "shaft zero     {:>8.3} deg +- {:.3}", self.shaft_zero_deg.value, self.shaft_zero_deg.sigma)?;
        let lever = &self.lever_radial_m;
        writeln!(out, "radial lever   {:>8.4} m   +- {:.4}", lever.value, lever.sigma)?;
        for untold in &self.untold {
            writeln!(out, "not told: {untold}")?;
        }
        write!(out, "\n{}", self.rig_toml)
    }
}

#[cfg(test)]
mod tests {
    use adit_geometry::rig::nominal_rotation;

    use super::*;

    #[test]
    fn a_zero_folded_into_the_mounting_turns_the_camera_as_the_shaft_would() {
        for up in [ImageUp::Forward, ImageUp::Backward, ImageUp::Clockwise, ImageUp::Counterclockwise] {
            let mount = Vector3::new(0.02, -0.01, 0.03);
            let apart = nominal_rotation(up, 1.2 + 0.05) * UnitQuaternion::from_scaled_axis(mount);
            let folded = nominal_rotation(up, 1.2) * UnitQuaternion::from_scaled_axis(folded(up, 0.05, mount).into());
            assert!(apart.angle_to(&folded) < 3e-6, "{up:?}: {}", apart.angle_to(&folded));
        }
    }
}
