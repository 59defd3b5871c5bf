//! The magnetic shaft encoder: offset, eccentricity, noise, quantisation.
//!
//! Model: an AS5600 has 4096 steps per turn and knows of no other turn; a magnet off its centre adds an error of one period
//! per turn; mounting adds an offset.

use std::f64::consts::TAU;

use crate::config::EncoderConfig;
use crate::seed::{Random, Stream};

/// Steps per turn of the AS5600 (datasheet, 12 bit).
const STEPS: f64 = 4096.0;

/// The encoder.
#[derive(Clone, Debug)]
pub struct Encoder {
    config: EncoderConfig,
    offset_rad: f64,
    eccentric_phase_rad: f64,
    random: Random,
}

impl Encoder {
    /// An encoder with the offset that its mounting happens to have.
    pub fn new(config: &EncoderConfig, seed: u64) -> Self {
        let mut build = Random::numbered(seed, Stream::Build, 0);
        let offset_rad = build.gauss(config.offset_sigma_rad);
        let eccentric_phase_rad = build.uniform(0.0, TAU);
        Self { config: *config, offset_rad, eccentric_phase_rad, random: Random::new(seed, Stream::Encoder) }
    }

    /// Reads the shaft's angle, in `[0, 2 pi)`.
    pub fn read(&mut self, shaft_rad: f64) -> f64 {
        let eccentric = self.config.eccentricity_rad * (shaft_rad + self.eccentric_phase_rad).sin();
        let noisy = shaft_rad + self.offset_rad + eccentric + self.random.gauss(self.config.noise_sigma_rad);
        (noisy / TAU * STEPS).round().rem_euclid(STEPS) / STEPS * TAU
    }
}

#[cfg(test)]
mod tests {
    use adit_geometry::angles::wrap_half_turn;

    use super::*;

    #[test]
    fn a_perfect_encoder_errs_by_half_a_step_at_most_and_knows_one_turn_only() {
        let config = EncoderConfig { offset_sigma_rad: 0.0, eccentricity_rad: 0.0, noise_sigma_rad: 0.0 };
        let mut encoder = Encoder::new(&config, 1);
        for degrees in [-400.0_f64, 0.0, 33.3, 719.99, 3600.0] {
            let angle = degrees.to_radians();
            let read = encoder.read(angle);
            assert!((0.0..TAU).contains(&read) && (read as f32) < std::f32::consts::TAU, "{read} rad");
            assert!(wrap_half_turn(read - angle).abs() <= 0.5001 * TAU / STEPS);
        }
    }
}
