//! Reading survey.toml. (Moves to `protocol::mission` with the mission file's parser.)

use adit_geometry::camera::{Camera, Distortion};
use adit_geometry::profile::ProfileSpec;
use adit_geometry::rig::{ImageUp, Rig};
use adit_protocol::mission::{CameraConfig, Sigma, SurveyConfig};
use serde::Deserialize;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Raw {
    #[serde(rename = "format")]
    _format: u32,
    tunnel: Tunnel,
    camera: RawCamera,
    rig: RawRig,
    sigma: RawSigma,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields, tag = "profile", rename_all = "lowercase")]
enum Tunnel {
    Circle { radius_m: f64 },
    Rectangle { width_m: f64, height_m: f64, axis_height_m: Option<f64> },
    Underpass { width_m: f64, wall_m: f64, rise_m: f64, axis_height_m: Option<f64> },
    Horseshoe { width_m: f64, wall_m: f64, axis_height_m: Option<f64> },
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct RawCamera {
    model: String,
    width_px: u32,
    height_px: u32,
    fx_px: f64,
    fy_px: f64,
    cx_px: f64,
    cy_px: f64,
    distortion: Vec<f64>,
    refine: bool,
    rolling_shutter_s: f64,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct RawRig {
    images_per_turn: u16,
    image_up: ImageUp,
    lever_radial_m: f64,
    lever_forward_m: f64,
    mount_rotvec_deg: [f64; 3],
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct RawSigma {
    shaft_deg: f64,
    range_m: f64,
    odometer_m_per_m: f64,
    attitude_deg: f64,
    mount_deg: f64,
}

pub(super) fn parse(text: &str) -> Result<SurveyConfig, toml::de::Error> {
    let raw: Raw = toml::from_str(text)?;
    let half = |height: f64| move || height * 0.5;
    let profile = match raw.tunnel {
        Tunnel::Circle { radius_m } => ProfileSpec::Circle { radius_m },
        Tunnel::Rectangle { width_m, height_m, axis_height_m } => {
            ProfileSpec::Rectangle { width_m, height_m, axis_height_m: axis_height_m.unwrap_or_else(half(height_m)) }
        }
        Tunnel::Underpass { width_m, wall_m, rise_m, axis_height_m } => ProfileSpec::Underpass {
            width_m,
            wall_m,
            rise_m,
            axis_height_m: axis_height_m.unwrap_or_else(half(wall_m + rise_m)),
        },
        Tunnel::Horseshoe { width_m, wall_m, axis_height_m } => ProfileSpec::Horseshoe {
            width_m,
            wall_m,
            axis_height_m: axis_height_m.unwrap_or_else(half(wall_m + width_m * 0.5)),
        },
    };
    let c = raw.camera;
    let k: [f64; 5] = std::array::from_fn(|i| c.distortion.get(i).copied().unwrap_or_default());
    let distortion = if c.model == "kannala-brandt" {
        Distortion::KannalaBrandt([k[0], k[1], k[2], k[3]])
    } else {
        Distortion::BrownConrady(k)
    };
    let camera = Camera {
        width_px: c.width_px,
        height_px: c.height_px,
        focal_px: [c.fx_px, c.fy_px],
        centre_px: [c.cx_px, c.cy_px],
        distortion,
    };
    Ok(SurveyConfig {
        profile,
        camera: CameraConfig { camera, refine: c.refine, rolling_shutter_s: c.rolling_shutter_s },
        rig: Rig {
            images_per_turn: raw.rig.images_per_turn,
            image_up: raw.rig.image_up,
            lever_radial_m: raw.rig.lever_radial_m,
            lever_forward_m: raw.rig.lever_forward_m,
            mount_rotvec_rad: raw.rig.mount_rotvec_deg.map(f64::to_radians),
        },
        sigma: Sigma {
            shaft_rad: raw.sigma.shaft_deg.to_radians(),
            range_m: raw.sigma.range_m,
            odometer_m_per_m: raw.sigma.odometer_m_per_m,
            attitude_rad: raw.sigma.attitude_deg.to_radians(),
            mount_rad: raw.sigma.mount_deg.to_radians(),
        },
    })
}
