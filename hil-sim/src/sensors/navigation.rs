//! What the vehicle's own estimator reports: attitude, odometry, speed.
//!
//! Model: roll and pitch with a slowly wandering error and white noise; yaw against the tunnel axis with a larger one;
//! distance with a scale error, a random walk and noise; speed with the same scale error and noise.

use crate::config::NavigationConfig;
use crate::plant::vehicle::VehicleState;
use crate::seed::{Random, Stream, Wander};

/// Time constant of the attitude estimate's error.
const ATTITUDE_TIME_S: f64 = 30.0;

/// The estimator.
#[derive(Clone, Debug)]
pub struct Navigation {
    config: NavigationConfig,
    attitude_error: [Wander; 3],
    scale: f64,
    walk_m: f64,
    last_x_m: f64,
    distance_m: f64,
    random: Random,
    odometer_random: Random,
}

/// One report of the estimator.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NavigationReport {
    /// Roll, pitch, yaw against the tunnel.
    pub attitude_rad: [f64; 3],
    /// Distance along the axis.
    pub odometer_m: f64,
    /// Speed along the axis.
    pub speed_mps: f64,
}

impl Navigation {
    /// An estimator that starts at `start_x_m` and calls that so.
    pub fn new(config: &NavigationConfig, start_x_m: f64, seed: u64) -> Self {
        let mut random = Random::numbered(seed, Stream::Attitude, 1000);
        let mut odometer_random = Random::new(seed, Stream::Odometer);
        let sigma = [config.tilt_sigma_rad, config.tilt_sigma_rad, config.yaw_sigma_rad];
        let attitude_error = sigma.map(|sigma| Wander::settled(sigma, ATTITUDE_TIME_S, &mut random));
        let scale = 1.0 + odometer_random.gauss(config.odometer_scale_sigma);
        Self {
            config: *config,
            attitude_error,
            scale,
            walk_m: 0.0,
            last_x_m: start_x_m,
            distance_m: start_x_m,
            random,
            odometer_random,
        }
    }

    /// Follows the vehicle for `dt_s` and reports.
    pub fn step(&mut self, state: &VehicleState, dt_s: f64) -> NavigationReport {
        let mut attitude_rad = state.attitude_rad;
        for (angle, error) in attitude_rad.iter_mut().zip(&mut self.attitude_error) {
            *angle += error.step(dt_s, &mut self.random) + self.random.gauss(self.config.attitude_noise_rad);
        }
        let moved_m = state.position_m.x - self.last_x_m;
        self.last_x_m = state.position_m.x;
        self.distance_m += moved_m * self.scale;
        self.walk_m += self.odometer_random.gauss(self.config.odometer_walk_m_per_sqrt_m * moved_m.abs().sqrt());
        let odometer_m = self.distance_m + self.walk_m + self.odometer_random.gauss(self.config.odometer_noise_m);
        let speed_mps = state.velocity_mps.x * self.scale + self.odometer_random.gauss(self.config.speed_noise_mps);
        NavigationReport { attitude_rad, odometer_m, speed_mps }
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector3;

    use super::*;

    #[test]
    fn the_odometer_errs_by_its_scale_after_a_long_way() {
        let config = NavigationConfig { odometer_scale_sigma: 0.02, ..NavigationConfig::default() };
        let errors: Vec<f64> = (0..200)
            .map(|seed| {
                let mut state = VehicleState {
                    position_m: Vector3::zeros(),
                    velocity_mps: Vector3::x(),
                    attitude_rad: [0.0; 3],
                    attitude_rate_rad_per_s: [0.0; 3],
                };
                let mut navigation = Navigation::new(&config, 0.0, seed);
                let mut last = 0.0;
                for _ in 0..100 {
                    state.position_m.x += 1.0;
                    last = navigation.step(&state, 1.0).odometer_m;
                }
                last - 100.0
            })
            .collect();
        let rms = (errors.iter().map(|error| error * error).sum::<f64>() / 200.0).sqrt();
        assert!((1.7..2.3).contains(&rms), "rms {rms} m after 100 m");
    }
}
