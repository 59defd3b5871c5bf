//! Unknowns that all photos share.

use std::slice::from_mut;

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

    pub(super) fn values(mut self) -> [f64; PARAMETERS] {
        gathered(self.parts())
    }

    /// The same camera model with other values.
    pub(super) fn with_values(mut self, values: &[f64; PARAMETERS]) -> Self {
        scatter(values, self.parts());
        self
    }

    fn parts(&mut self) -> Parts<'_> {
        let Camera { focal_px, centre_px, distortion, .. } = &mut self.camera;
        let distortion: &mut [f64] = match distortion {
            Distortion::BrownConrady(coefficients) => coefficients,
            Distortion::KannalaBrandt(coefficients) => coefficients,
        };
        [
            self.mount_rotvec.as_mut_slice(),
            from_mut(&mut self.odometer_scale),
            from_mut(&mut self.shaft_bias_rad),
            &mut self.shaft_periodic_rad,
            &mut self.lever_m,
            from_mut(&mut self.profile_size),
            from_mut(&mut self.shutter_rad_per_s),
            focal_px,
            centre_px,
            distortion,
        ]
    }
}

/// All parameters in the order of the flat form. The last, the lens's coefficients, may be fewer than there is room for.
type Parts<'a> = [&'a mut [f64]; 10];

fn gathered(parts: Parts<'_>) -> [f64; PARAMETERS] {
    let mut values = [0.0; PARAMETERS];
    for (value, part) in values.iter_mut().zip(parts.into_iter().flatten()) {
        *value = *part;
    }
    values
}

fn scatter(values: &[f64; PARAMETERS], parts: Parts<'_>) {
    for (value, part) in values.iter().zip(parts.into_iter().flatten()) {
        *part = *value;
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

    pub(super) fn values(mut self) -> [f64; PARAMETERS] {
        gathered(self.parts())
    }

    pub(super) fn from_values(values: &[f64; PARAMETERS]) -> Self {
        let mut sigmas = Self::default();
        scatter(values, sigmas.parts());
        sigmas
    }

    fn parts(&mut self) -> Parts<'_> {
        [
            &mut self.mount_rad,
            from_mut(&mut self.odometer_scale),
            from_mut(&mut self.shaft_bias_rad),
            &mut self.shaft_periodic_rad,
            &mut self.lever_m,
            from_mut(&mut self.profile_size),
            from_mut(&mut self.shutter_rad_per_s),
            &mut self.focal_px,
            &mut self.centre_px,
            &mut self.distortion,
        ]
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
