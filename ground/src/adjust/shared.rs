//! Unknowns that all photos share.

use adit_geometry::camera::{Camera, Distortion};
use adit_geometry::rig::Rig;
use adit_protocol::mission::Sigma;
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

/// Number of shared parameters, free or not.
pub(super) const PARAMETERS: usize = 20;
/// Where each parameter stands in the flat form.
pub(super) const MOUNT: usize = 0;
pub(super) const ODOMETER: usize = 3;
pub(super) const SHAFT_BIAS: usize = 4;
pub(super) const SHAFT_SIN: usize = 5;
pub(super) const SHAFT_COS: usize = 6;
pub(super) const LEVER: usize = 7;
pub(super) const SIZE: usize = 9;
pub(super) const SHUTTER: usize = 10;
pub(super) const INTRINSICS: usize = 11;

/// Values of the unknowns that all photos share.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Shared {
    /// Rotation of the camera against its nominal mounting, rotation vector in camera axes, radians.
    pub mount_rotvec: Vector3<f64>,
    /// True distance per odometer metre, minus one.
    pub odometer_scale: f64,
    /// Added to every shaft angle.
    pub shaft_bias_rad: f64,
    /// Factors of the sine and cosine of the shaft angle (an encoder off its axis), added to the shaft angle.
    pub shaft_periodic_rad: [f64; 2],
    /// Optical centre ahead of the shaft axis along the viewing direction, and ahead of the body's origin along the shaft.
    pub lever_m: [f64; 2],
    /// Factor on all lengths of the profile, about the tunnel's axis.
    pub profile_size: f64,
    /// Angular speed of the shaft (clockwise looking forward) while a photo is read out, radians per second.
    pub shutter_rad_per_s: f64,
    /// Intrinsics and distortion.
    pub camera: Camera<f64>,
}

impl Shared {
    /// Values before anything was estimated.
    pub fn nominal(camera: &Camera<f64>, rig: &Rig<f64>) -> Self {
        Self {
            mount_rotvec: Vector3::from(rig.mount_rotvec_rad),
            odometer_scale: 0.0,
            shaft_bias_rad: 0.0,
            shaft_periodic_rad: [0.0; 2],
            lever_m: [rig.lever_radial_m, rig.lever_forward_m],
            profile_size: 1.0,
            shutter_rad_per_s: 0.0,
            camera: *camera,
        }
    }

    pub(super) fn values(&self) -> [f64; PARAMETERS] {
        let Self { mount_rotvec: m, lever_m: l, shaft_periodic_rad: p, camera, .. } = self;
        let ([fx, fy], [cx, cy]) = (camera.focal_px, camera.centre_px);
        let [a, b, c, d, e] = coefficients(&camera.distortion);
        let (bias, scale, size, shutter) =
            (self.shaft_bias_rad, self.odometer_scale, self.profile_size, self.shutter_rad_per_s);
        [m.x, m.y, m.z, scale, bias, p[0], p[1], l[0], l[1], size, shutter, fx, fy, cx, cy, a, b, c, d, e]
    }

    /// The same camera model with other values.
    pub(super) fn with_values(&self, values: &[f64; PARAMETERS]) -> Self {
        let [
            mx,
            my,
            mz,
            odometer_scale,
            shaft_bias_rad,
            sin,
            cos,
            radial,
            forward,
            profile_size,
            shutter_rad_per_s,
            ..,
        ] = *values;
        let [.., fx, fy, cx, cy, a, b, c, d, e] = *values;
        let distortion = match self.camera.distortion {
            Distortion::BrownConrady(_) => Distortion::BrownConrady([a, b, c, d, e]),
            Distortion::KannalaBrandt(_) => Distortion::KannalaBrandt([a, b, c, d]),
        };
        Self {
            mount_rotvec: Vector3::new(mx, my, mz),
            odometer_scale,
            shaft_bias_rad,
            shaft_periodic_rad: [sin, cos],
            lever_m: [radial, forward],
            profile_size,
            shutter_rad_per_s,
            camera: Camera { focal_px: [fx, fy], centre_px: [cx, cy], distortion, ..self.camera },
        }
    }
}

fn coefficients(distortion: &Distortion<f64>) -> [f64; 5] {
    match *distortion {
        Distortion::BrownConrady(k) => k,
        Distortion::KannalaBrandt([a, b, c, d]) => [a, b, c, d, 0.0],
    }
}

/// One standard deviation of every shared unknown: as a prior zero means fixed; after an adjustment how well it is known.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct SharedSigmas {
    /// Of [`Shared::mount_rotvec`], radians.
    pub mount_rad: [f64; 3],
    /// Of [`Shared::odometer_scale`].
    pub odometer_scale: f64,
    /// Of [`Shared::shaft_bias_rad`].
    pub shaft_bias_rad: f64,
    /// Of [`Shared::shaft_periodic_rad`].
    pub shaft_periodic_rad: [f64; 2],
    /// Of [`Shared::lever_m`].
    pub lever_m: [f64; 2],
    /// Of [`Shared::profile_size`].
    pub profile_size: f64,
    /// Of [`Shared::shutter_rad_per_s`].
    pub shutter_rad_per_s: f64,
    /// Of the focal lengths.
    pub focal_px: [f64; 2],
    /// Of the principal point.
    pub centre_px: [f64; 2],
    /// Of the distortion coefficients, in the model's order; the fifth is Brown-Conrady's.
    pub distortion: [f64; 5],
}

impl SharedSigmas {
    /// Mounting and odometer scale free, all else as built and calibrated.
    pub fn of_tags(sigma: &Sigma) -> Self {
        Self { mount_rad: [sigma.mount_rad; 3], odometer_scale: sigma.odometer_m_per_m, ..Self::default() }
    }

    pub(super) fn values(&self) -> [f64; PARAMETERS] {
        let Self { mount_rad: [mx, my, mz], lever_m: l, shaft_periodic_rad: p, .. } = *self;
        let ([fx, fy], [cx, cy], [a, b, c, d, e]) = (self.focal_px, self.centre_px, self.distortion);
        let (bias, scale, size, shutter) =
            (self.shaft_bias_rad, self.odometer_scale, self.profile_size, self.shutter_rad_per_s);
        [mx, my, mz, scale, bias, p[0], p[1], l[0], l[1], size, shutter, fx, fy, cx, cy, a, b, c, d, e]
    }

    pub(super) fn from_values(values: &[f64; PARAMETERS]) -> Self {
        let [
            mx,
            my,
            mz,
            odometer_scale,
            shaft_bias_rad,
            sin,
            cos,
            radial,
            forward,
            profile_size,
            shutter_rad_per_s,
            ..,
        ] = *values;
        let [.., fx, fy, cx, cy, a, b, c, d, e] = *values;
        Self {
            mount_rad: [mx, my, mz],
            odometer_scale,
            shaft_bias_rad,
            shaft_periodic_rad: [sin, cos],
            lever_m: [radial, forward],
            profile_size,
            shutter_rad_per_s,
            focal_px: [fx, fy],
            centre_px: [cx, cy],
            distortion: [a, b, c, d, e],
        }
    }
}

/// Which parameters are free, and where each stands among them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Free {
    pub(super) column: [Option<usize>; PARAMETERS],
    pub(super) count: usize,
}

impl Free {
    pub(super) fn new(sigmas: &SharedSigmas, camera: &Camera<f64>) -> Self {
        let known = match camera.distortion {
            Distortion::BrownConrady(_) => PARAMETERS,
            Distortion::KannalaBrandt(_) => PARAMETERS - 1,
        };
        let mut free = Self { column: [None; PARAMETERS], count: 0 };
        for (column, sigma) in free.column.iter_mut().zip(sigmas.values()).take(known) {
            if sigma > 0.0 {
                *column = Some(free.count);
                free.count += 1;
            }
        }
        free
    }
}
