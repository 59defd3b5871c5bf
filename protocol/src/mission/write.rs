//! Writes `survey.toml`.

use std::fmt::Write as _;

use adit_geometry::camera::Distortion;
use adit_geometry::profile::ProfileSpec;
use adit_geometry::rig::{ImageUp, Rig};

use super::{CameraConfig, FORMAT, SurveyConfig};

/// The text of a `survey.toml`.
pub(super) fn survey(config: &SurveyConfig) -> String {
    let mut out = String::new();
    line(&mut out, "format", &FORMAT.to_string());
    out.push_str("\n[tunnel]\n");
    tunnel(&mut out, &config.profile);
    out.push('\n');
    out.push_str(&camera(&config.camera));
    out.push('\n');
    out.push_str(&rig(&config.rig));
    out.push_str("\n[sigma]\n");
    let sigma = &config.sigma;
    line(&mut out, "shaft_deg", &number(degrees(sigma.shaft_rad)));
    line(&mut out, "range_m", &number(sigma.range_m));
    line(&mut out, "odometer_m_per_m", &number(sigma.odometer_m_per_m));
    line(&mut out, "attitude_deg", &number(degrees(sigma.attitude_rad)));
    line(&mut out, "mount_deg", &number(degrees(sigma.mount_rad)));
    out
}

/// The table `[camera]`.
pub(super) fn camera(config: &CameraConfig) -> String {
    let mut out = "[camera]\n".to_owned();
    let camera = &config.camera;
    let (model, coefficients) = match &camera.distortion {
        Distortion::BrownConrady(k) => ("brown-conrady", k.as_slice()),
        Distortion::KannalaBrandt(k) => ("kannala-brandt", k.as_slice()),
    };
    line(&mut out, "model", &quoted(model));
    line(&mut out, "width_px", &camera.width_px.to_string());
    line(&mut out, "height_px", &camera.height_px.to_string());
    let ([fx, fy], [cx, cy]) = (camera.focal_px, camera.centre_px);
    for (key, value) in [("fx_px", fx), ("fy_px", fy), ("cx_px", cx), ("cy_px", cy)] {
        line(&mut out, key, &number(value));
    }
    line(&mut out, "distortion", &list(coefficients));
    line(&mut out, "refine", &config.refine.to_string());
    line(&mut out, "rolling_shutter_s", &number(config.rolling_shutter_s));
    out
}

/// The table `[rig]`.
pub(super) fn rig(rig: &Rig<f64>) -> String {
    let mut out = "[rig]\n".to_owned();
    line(&mut out, "images_per_turn", &rig.images_per_turn.to_string());
    let up = match rig.image_up {
        ImageUp::Forward => "forward",
        ImageUp::Backward => "backward",
        ImageUp::Clockwise => "clockwise",
        ImageUp::Counterclockwise => "counterclockwise",
    };
    line(&mut out, "image_up", &quoted(up));
    line(&mut out, "lever_radial_m", &number(rig.lever_radial_m));
    line(&mut out, "lever_forward_m", &number(rig.lever_forward_m));
    line(&mut out, "mount_rotvec_deg", &list(&rig.mount_rotvec_rad.map(degrees)));
    out
}

fn tunnel(out: &mut String, profile: &ProfileSpec<f64>) {
    let (name, lengths): (&str, &[(&str, f64)]) = match profile {
        ProfileSpec::Circle { radius_m } => ("circle", &[("radius_m", *radius_m)]),
        ProfileSpec::Rectangle { width_m, height_m, axis_height_m } => {
            ("rectangle", &[("width_m", *width_m), ("height_m", *height_m), ("axis_height_m", *axis_height_m)])
        }
        ProfileSpec::Underpass { width_m, wall_m, rise_m, axis_height_m } => (
            "underpass",
            &[("width_m", *width_m), ("wall_m", *wall_m), ("rise_m", *rise_m), ("axis_height_m", *axis_height_m)],
        ),
        ProfileSpec::Horseshoe { width_m, wall_m, axis_height_m } => {
            ("horseshoe", &[("width_m", *width_m), ("wall_m", *wall_m), ("axis_height_m", *axis_height_m)])
        }
        ProfileSpec::Chain { .. } => ("chain", &[]),
    };
    line(out, "profile", &quoted(name));
    for (key, value) in lengths {
        line(out, key, &number(*value));
    }
    if let ProfileSpec::Chain { vertices } = profile {
        let points: Vec<String> = vertices.iter().map(|vertex| list(&[vertex.y_m, vertex.z_m])).collect();
        line(out, "points", &format!("[{}]", points.join(", ")));
        let bulges: Vec<f64> = vertices.iter().map(|vertex| vertex.bulge).collect();
        line(out, "bulges", &list(&bulges));
    }
}

fn line(out: &mut String, key: &str, value: &str) {
    // Writing to a String cannot fail.
    let _ = writeln!(out, "{key} = {value}");
}

fn quoted(text: &str) -> String {
    format!("\"{text}\"")
}

/// The shortest digits that read back as the same number, always with a point or an exponent.
fn number(value: f64) -> String {
    format!("{value:?}")
}

fn list(values: &[f64]) -> String {
    let items: Vec<String> = values.iter().map(|value| number(*value)).collect();
    format!("[{}]", items.join(", "))
}

/// Degrees to 12 decimals, so that 1 degree is written as 1.
fn degrees(radians: f64) -> f64 {
    (radians.to_degrees() * 1e12).round() / 1e12
}
