//! The checked content of `survey.toml` and of mission files. Parsed once, in SI, into something that cannot be wrong.

use adit_geometry::camera::Camera;
use adit_geometry::profile::ProfileSpec;
use adit_geometry::rig::Rig;

/// What a survey folder's `survey.toml` says.
#[derive(Clone, Debug, PartialEq)]
pub struct SurveyConfig {
    /// The lining's nominal section.
    pub profile: ProfileSpec<f64>,
    /// The camera.
    pub camera: CameraConfig,
    /// How it sits on the shaft.
    pub rig: Rig<f64>,
    /// Uncertainty of what the tags claim.
    pub sigma: Sigma,
}

/// The camera and what the adjustment may do with it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CameraConfig {
    /// Size, intrinsics, distortion.
    pub camera: Camera<f64>,
    /// May the adjustment move the intrinsics?
    pub refine: bool,
    /// Time between the first and the last row's exposure.
    pub rolling_shutter_s: f64,
}

/// One standard deviation of what `tags.csv` claims.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sigma {
    /// Shaft angle.
    pub shaft_rad: f64,
    /// Range readings.
    pub range_m: f64,
    /// Odometer error per metre travelled.
    pub odometer_m_per_m: f64,
    /// Attitude (of the tags' attitude if present, else of "level and straight").
    pub attitude_rad: f64,
    /// Camera mounting, per axis.
    pub mount_rad: f64,
}
