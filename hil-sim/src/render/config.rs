//! What the mission file's `[simulation.render]` says.

use serde::{Deserialize, Serialize};

use crate::scene::PhotoTextureError;

/// How photos are taken and written. The camera itself (size, lens) is the survey's own.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct RenderConfig {
    /// Samples per pixel and axis.
    pub supersampling: u8,
    /// Quality of the JPEG files, 1 to 100.
    pub jpeg_quality: u8,
    /// Scale of `truth/texture.jpg`.
    pub truth_mm_per_px: f64,
    /// The lamp.
    pub light: LightConfig,
    /// Exposure and noise.
    pub sensor: SensorConfig,
    /// Parts of the vehicle that the camera sees.
    pub vehicle_parts: Vec<VehiclePartConfig>,
}

impl Default for RenderConfig {
    /// A GoPro-like camera with a good LED panel beside it.
    fn default() -> Self {
        Self {
            supersampling: 2,
            jpeg_quality: 92,
            truth_mm_per_px: 2.0,
            light: LightConfig::default(),
            sensor: SensorConfig::default(),
            vehicle_parts: Vec::new(),
        }
    }
}

/// What the lamp is fixed to.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum LightMount {
    /// Turns with the camera: every photo is lit alike.
    #[default]
    Camera,
    /// Fixed to the vehicle: the light on a wall changes with every turn of the head, as in the paper.
    Body,
}

/// The lamp.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct LightConfig {
    /// What it is fixed to; position and direction are in that frame (`cam` or `body`).
    pub mount: LightMount,
    /// Position.
    pub position_m: [f64; 3],
    /// Direction of the beam's axis, any length.
    pub direction: [f64; 3],
    /// Angle from the axis at which half the intensity is left.
    pub half_intensity_deg: f64,
    /// Even light from everywhere, as a share of the lamp's on a wall at the section's typical distance.
    pub ambient: f64,
}

impl Default for LightConfig {
    /// An LED panel just above the lens.
    fn default() -> Self {
        Self {
            mount: LightMount::Camera,
            position_m: [0.0, -0.07, 0.0],
            direction: [0.0, 0.0, 1.0],
            half_intensity_deg: 60.0,
            ambient: 0.05,
        }
    }
}

/// Exposure, vignetting and noise.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct SensorConfig {
    /// Exposure time; with a moving camera it blurs.
    pub exposure_s: f64,
    /// 0: the gain is the same for all photos; 1: every photo gets the same mean brightness.
    pub auto_exposure: f64,
    /// Mean linear intensity that automatic exposure aims at.
    pub target_intensity: f64,
    /// Relative standard deviation of a photo's gain on top of that.
    pub exposure_drift: f64,
    /// Relative standard deviation of a photo's red and blue gains.
    pub white_balance_drift: f64,
    /// Share of the light that is lost in the image's corners.
    pub vignetting: f64,
    /// Electrons at full scale and unit gain; shot noise is their square root.
    pub full_well_electrons: f64,
    /// Read noise.
    pub read_noise_electrons: f64,
}

impl Default for SensorConfig {
    /// Full well and read noise as of a 1/2.3 inch CMOS sensor with 1.55 micrometre pixels, binned two by two.
    fn default() -> Self {
        Self {
            exposure_s: 1.0 / 240.0,
            auto_exposure: 0.7,
            target_intensity: 0.19,
            exposure_drift: 0.06,
            white_balance_drift: 0.01,
            vignetting: 0.35,
            full_well_electrons: 12_000.0,
            read_noise_electrons: 8.0,
        }
    }
}

/// A rod with round ends, fixed in the body frame: a leg, a propeller guard, an arm.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct VehiclePartConfig {
    /// One end of its axis, in the body frame.
    pub from_m: [f64; 3],
    /// The other end.
    pub to_m: [f64; 3],
    /// Its radius.
    pub radius_mm: f64,
}

/// Why photos cannot be rendered or written.
#[derive(Debug, thiserror::Error)]
pub enum RenderError {
    /// A number out of its range.
    #[error("simulation.render.{key} is {value}; expected {expected}")]
    OutOfRange {
        /// The key.
        key: &'static str,
        /// What was given.
        value: f64,
        /// What is accepted.
        expected: &'static str,
    },
    /// The wall's picture.
    #[error(transparent)]
    Texture(#[from] PhotoTextureError),
    /// An image is larger than JPEG allows.
    #[error("{width_px} x {height_px} pixels do not fit into a JPEG file (65535 at most); choose a coarser scale")]
    TooLarge {
        /// Columns.
        width_px: usize,
        /// Rows.
        height_px: usize,
    },
    /// JPEG encoding failed.
    #[error("cannot encode a JPEG: {0}")]
    Jpeg(#[from] jpeg_encoder::EncodingError),
    /// PNG encoding failed.
    #[error("cannot encode a PNG: {0}")]
    Png(#[from] png::EncodingError),
    /// A file cannot be written.
    #[error("{}: {source}", file.display())]
    Write {
        /// The file.
        file: std::path::PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
}

impl RenderConfig {
    /// Checks that every number is in its range.
    ///
    /// # Errors
    /// [`RenderError::OutOfRange`] for the first that is not.
    pub fn check(&self) -> Result<(), RenderError> {
        let sensor = &self.sensor;
        let light = &self.light;
        let direction_norm = light.direction.iter().map(|part| part * part).sum::<f64>();
        let within = |key, value: f64, low: f64, high: f64, expected| {
            // Written so that NaN fails.
            if value >= low && value <= high { Ok(()) } else { Err(RenderError::OutOfRange { key, value, expected }) }
        };
        within("supersampling", f64::from(self.supersampling), 1.0, 8.0, "1 to 8")?;
        within("jpeg_quality", f64::from(self.jpeg_quality), 1.0, 100.0, "1 to 100")?;
        within("truth_mm_per_px", self.truth_mm_per_px, 0.05, 1000.0, "0.05 to 1000")?;
        within("light.direction", direction_norm, 1e-6, 1e6, "a direction that is not zero")?;
        within("light.half_intensity_deg", light.half_intensity_deg, 5.0, 89.0, "5 to 89")?;
        within("light.ambient", light.ambient, 0.0, 10.0, "0 to 10")?;
        within("sensor.exposure_s", sensor.exposure_s, 0.0, 1.0, "0 to 1")?;
        within("sensor.auto_exposure", sensor.auto_exposure, 0.0, 1.0, "0 to 1")?;
        within("sensor.target_intensity", sensor.target_intensity, 0.01, 1.0, "0.01 to 1")?;
        within("sensor.exposure_drift", sensor.exposure_drift, 0.0, 1.0, "0 to 1")?;
        within("sensor.white_balance_drift", sensor.white_balance_drift, 0.0, 0.5, "0 to 0.5")?;
        within("sensor.vignetting", sensor.vignetting, 0.0, 0.95, "0 to 0.95")?;
        within("sensor.full_well_electrons", sensor.full_well_electrons, 100.0, 1e9, "100 to 1e9")?;
        within("sensor.read_noise_electrons", sensor.read_noise_electrons, 0.0, 1e4, "0 to 1e4")?;
        for part in &self.vehicle_parts {
            within("vehicle_parts.radius_mm", part.radius_mm, 0.1, 1e4, "0.1 to 10000")?;
        }
        Ok(())
    }
}
