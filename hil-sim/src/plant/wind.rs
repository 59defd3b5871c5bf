//! Gusts, as the acceleration they give the vehicle.

use nalgebra::Vector3;

use crate::config::WindConfig;
use crate::seed::{Random, Stream, Wander};

/// Turbulence along the three axes of the tunnel; draught from ventilation comes as a mean.
#[derive(Clone, Debug)]
pub struct Wind {
    axes: [Wander; 3],
    mean: Vector3<f64>,
    random: Random,
}

impl Wind {
    /// Starts in settled turbulence.
    pub fn new(config: &WindConfig, seed: u64) -> Self {
        let mut random = Random::new(seed, Stream::Wind);
        let axes = config.gust_sigma_mps2.map(|sigma| Wander::settled(sigma, config.gust_time_s, &mut random));
        Self { axes, mean: Vector3::new(config.draught_mps2, 0.0, 0.0), random }
    }

    /// Goes on by `dt_s`; returns the acceleration in the tunnel frame.
    pub fn step(&mut self, dt_s: f64) -> Vector3<f64> {
        let [x, y, z] = &mut self.axes;
        let gust = [x, y, z].map(|axis| axis.step(dt_s, &mut self.random));
        Vector3::from(gust) + self.mean
    }
}
