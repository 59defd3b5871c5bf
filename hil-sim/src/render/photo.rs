//! The photo renderer: what is the same for all photos of a flight, and what a photo is made from.

use std::sync::Arc;

use adit_geometry::camera::Camera;
use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use rayon::prelude::*;

use super::config::{RenderConfig, RenderError};
use super::rays::CornerRays;
use super::sensor::Sensor;
use super::view::View;
use crate::scene::paint::{Fittings, Paint};
use crate::scene::{Wall, noise};

/// Rows that one task renders; the corner rows between tasks are cast twice.
const BAND_ROWS: usize = 8 * super::view::BLOCK;

/// An 8-bit sRGB image, row by row.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RgbImage {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// `width * height * 3` values.
    pub data: Vec<u8>,
}

/// Where the camera is at one exposure and how it moves.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Shot {
    /// Number of the photo within the flight; selects its noise and exposure.
    pub index: u32,
    /// Camera pose at the middle of the exposure of the middle row.
    pub tunnel_from_cam: Isometry3<f64>,
    /// Vehicle pose at the same time.
    pub tunnel_from_body: Isometry3<f64>,
    /// Velocity of the optical centre in the tunnel frame.
    pub velocity_mps: Vector3<f64>,
    /// Angular velocity of the camera in the tunnel frame.
    pub angular_velocity_rad_per_s: Vector3<f64>,
    /// Brightness of the lamp, 0 to 1.
    pub light_level: f64,
    /// Factors on the red, green and blue gains that the exposure control chooses.
    pub gain_factors: [f64; 3],
}

impl Shot {
    /// A camera at rest with its lamp on.
    pub fn still(index: u32, tunnel_from_cam: Isometry3<f64>, tunnel_from_body: Isometry3<f64>) -> Self {
        Self {
            index,
            tunnel_from_cam,
            tunnel_from_body,
            velocity_mps: Vector3::zeros(),
            angular_velocity_rad_per_s: Vector3::zeros(),
            light_level: 1.0,
            gain_factors: [1.0; 3],
        }
    }

    /// Camera pose `time_s` after the middle of the exposure.
    pub(super) fn tunnel_from_cam_at(&self, time_s: f64) -> Isometry3<f64> {
        if time_s == 0.0 {
            return self.tunnel_from_cam;
        }
        let turned = UnitQuaternion::from_scaled_axis(self.angular_velocity_rad_per_s * time_s);
        let Isometry3 { rotation, translation } = self.tunnel_from_cam;
        Isometry3::from_parts(Translation3::from(translation.vector + self.velocity_mps * time_s), turned * rotation)
    }

    pub(super) fn is_still(&self) -> bool {
        self.velocity_mps == Vector3::zeros() && self.angular_velocity_rad_per_s == Vector3::zeros()
    }
}

/// A finished photo.
#[derive(Clone, Debug, PartialEq)]
pub struct RenderedPhoto {
    /// The picture.
    pub image: RgbImage,
    /// 0 where a part of the vehicle hides the wall, 255 elsewhere; `None` where the vehicle is not in view.
    pub mask: Option<Vec<u8>>,
    /// Red, green and blue gains on the light, before the sRGB curve.
    pub gains: [f64; 3],
}

/// Renders photos of one tunnel with one camera.
pub struct PhotoRenderer {
    pub(super) camera: Camera<f64>,
    pub(super) readout_s: f64,
    pub(super) wall: Arc<Wall>,
    pub(super) paint: Arc<dyn Paint>,
    pub(super) fittings: Fittings,
    pub(super) rays: CornerRays,
    pub(super) sensor: Sensor,
    pub(super) config: RenderConfig,
    pub(super) lamp_reference_m: f64,
    pub(super) seed: u64,
}

impl PhotoRenderer {
    /// Prepares the camera; `readout_s` is the time between the first and the last row's exposure.
    ///
    /// # Errors
    /// [`RenderError::OutOfRange`] for a number out of its range.
    pub fn new(
        camera: Camera<f64>,
        readout_s: f64,
        wall: Arc<Wall>,
        paint: Arc<dyn Paint>,
        config: &RenderConfig,
        seed: u64,
    ) -> Result<Self, RenderError> {
        config.check()?;
        let perimeter_m = wall.profile().perimeter_m();
        Ok(Self {
            camera,
            readout_s,
            paint,
            fittings: Fittings::new(perimeter_m, noise::derive_seed(seed, 0x30)),
            rays: CornerRays::new(&camera),
            sensor: Sensor::new(config.sensor),
            config: config.clone(),
            // Unit irradiance at the distance of the wall of a circle with the same perimeter.
            lamp_reference_m: perimeter_m / std::f64::consts::TAU,
            wall,
            seed: noise::derive_seed(seed, 0x31),
        })
    }

    /// Renders a photo on the current thread pool.
    pub fn render(&self, shot: &Shot) -> RenderedPhoto {
        let (width, height) = (self.camera.width_px as usize, self.camera.height_px as usize);
        let view = View::new(self, shot);
        let mut data = vec![0; width * height * 3];
        let mut mask = vec![255; width * height];
        data.par_chunks_mut(width * 3 * BAND_ROWS)
            .zip(mask.par_chunks_mut(width * BAND_ROWS))
            .enumerate()
            .for_each(|(band, (pixels, mask))| view.render_band(band * BAND_ROWS, pixels, mask));
        let masked = mask.contains(&0);
        RenderedPhoto {
            image: RgbImage { width, height, data },
            mask: masked.then_some(mask),
            gains: view.exposure.gains(),
        }
    }
}

#[cfg(test)]
mod tests;
