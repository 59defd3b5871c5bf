//! From light to 8-bit values: gain, vignetting, noise, sRGB.

use super::config::SensorConfig;
use crate::scene::noise;
use crate::scene::paint::{Rgb, srgb_of_linear};

/// Entries of the table from linear intensity to 8 bits; the steepest place moves 0.2 levels per entry.
const TONE_STEPS: usize = 16_384;

/// The part of the sensor that is the same for all photos.
pub(super) struct Sensor {
    config: SensorConfig,
    tone: Vec<u8>,
}

/// Gains of one photo.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Exposure {
    channels: Rgb,
    seed: u64,
}

impl Exposure {
    /// Red, green, blue.
    pub(super) fn gains(&self) -> [f64; 3] {
        self.channels.map(f64::from)
    }

    /// The same with each gain multiplied.
    pub(super) fn times(self, factors: [f64; 3]) -> Self {
        Self { channels: std::array::from_fn(|channel| self.channels[channel] * factors[channel] as f32), ..self }
    }
}

impl Sensor {
    pub(super) fn new(config: SensorConfig) -> Self {
        let tone = (0..=TONE_STEPS)
            .map(|step| (srgb_of_linear(step as f32 / TONE_STEPS as f32) * 255.0).round() as u8)
            .collect();
        Self { config, tone }
    }

    /// Chooses the gains of a photo whose metered mean intensity is `metered`.
    pub(super) fn expose(&self, metered: f64, photo_seed: u64) -> Exposure {
        let automatic = (self.config.target_intensity / metered.max(1e-4)).powf(self.config.auto_exposure);
        let random = |stream| f64::from(normal(noise::derive_seed(photo_seed, stream)));
        let gain = automatic.clamp(0.02, 64.0) * (self.config.exposure_drift * random(1)).exp();
        let balance = |stream| (gain * (self.config.white_balance_drift * random(stream)).exp()) as f32;
        Exposure { channels: [balance(2), gain as f32, balance(3)], seed: noise::derive_seed(photo_seed, 4) }
    }

    /// Share of the light that arrives at the squared distance `r2` from the image's middle (1 at the corner).
    pub(super) fn vignette(&self, r2: f32) -> f32 {
        1.0 - self.config.vignetting as f32 * r2 * (0.7 + 0.3 * r2)
    }

    /// The 8-bit pixel of an intensity after vignetting; `place` numbers the pixels of the photo.
    pub(super) fn quantise(&self, light: Rgb, exposure: &Exposure, place: u64) -> [u8; 3] {
        let full_well = self.config.full_well_electrons as f32;
        let read_squared = (self.config.read_noise_electrons * self.config.read_noise_electrons) as f32;
        std::array::from_fn(|channel| {
            let gain = exposure.channels[channel];
            // The exposure time is fixed by the lamp; gain is amplification, so electrons are counted before it.
            let electrons = light[channel].max(0.0) * full_well;
            let bits = noise::mix(exposure.seed ^ (place * 3 + channel as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15));
            let noisy = electrons + normal_of(bits) * (electrons + read_squared).sqrt();
            let value = (noisy * gain / full_well).clamp(0.0, 1.0);
            self.tone[(value * TONE_STEPS as f32 + 0.5) as usize]
        })
    }
}

fn normal(seed: u64) -> f32 {
    normal_of(noise::mix(seed))
}

/// Four 16-bit uniforms added: variance 1 after scaling, tails end at 3.5 standard deviations.
fn normal_of(bits: u64) -> f32 {
    let sum = (bits & 0xffff) + ((bits >> 16) & 0xffff) + ((bits >> 32) & 0xffff) + (bits >> 48);
    (sum as f32 * (1.0 / 65_536.0) - 2.0) * 1.732_050_8
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shot_noise_grows_with_the_root_of_the_light() {
        let sensor = Sensor::new(SensorConfig {
            exposure_drift: 0.0,
            white_balance_drift: 0.0,
            auto_exposure: 0.0,
            full_well_electrons: 1000.0,
            ..SensorConfig::default()
        });
        let exposure = sensor.expose(0.2, 7);
        let spread = |light: f32| {
            let values: Vec<f32> = (0..20_000)
                .map(|place| {
                    let srgb = sensor.quantise([light; 3], &exposure, place)[1];
                    crate::scene::paint::linear_of_srgb([srgb; 3])[0]
                })
                .collect();
            let mean = values.iter().sum::<f32>() / values.len() as f32;
            assert!((mean - light).abs() < 0.01, "{mean} {light}");
            (values.iter().map(|value| (value - mean).powi(2)).sum::<f32>() / values.len() as f32).sqrt()
        };
        // sqrt(0.4 * 1000 + 64) / 1000 and sqrt(0.1 * 1000 + 64) / 1000, plus quantisation.
        assert!((spread(0.4) - 0.0215).abs() < 0.001);
        assert!((spread(0.1) - 0.0128).abs() < 0.001);
    }

    #[test]
    fn automatic_exposure_evens_out_what_it_is_told_to() {
        let with = |auto_exposure| {
            let config = SensorConfig { auto_exposure, exposure_drift: 0.0, ..SensorConfig::default() };
            let sensor = Sensor::new(config);
            sensor.expose(0.05, 1).gains()[1] / sensor.expose(0.2, 2).gains()[1]
        };
        assert!((with(1.0) - 4.0).abs() < 1e-9);
        assert!((with(0.5) - 2.0).abs() < 1e-9);
        assert!((with(0.0) - 1.0).abs() < 1e-9);
    }
}
