//! A simple autopilot: holds the section's centre loosely, flies forward no faster than it is told.
//!
//! Model: position in the section by a proportional-integral-derivative law on an estimate that wanders; forward speed
//! by a proportional law towards the smaller of the pilot's wish and the limit it was given. The limit arrives late and
//! is followed with the vehicle's own lag. How named autopilots take limits is another module's business.

use nalgebra::Vector3;

use crate::config::AutopilotConfig;
use crate::seed::{Random, Stream, Wander};

use super::vehicle::VehicleState;

/// Position gain, 1/s^2.
const POSITION_GAIN: f64 = 2.5;
/// Velocity gain, 1/s.
const VELOCITY_GAIN: f64 = 2.5;
/// Integral gain, 1/s^3: takes out a steady draught in a few seconds.
const INTEGRAL_GAIN: f64 = 0.6;
/// The integral part never asks for more than this.
const INTEGRAL_LIMIT_MPS2: f64 = 0.5;
/// The largest acceleration asked for across the tunnel.
const SIDE_LIMIT_MPS2: f64 = 2.0;
/// The velocity estimate's noise is filtered by the estimator; what is left.
const VELOCITY_NOISE_MPS: f64 = 0.01;

/// What the autopilot is to do.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Wish {
    /// The pilot's forward speed; zero hovers.
    pub cruise_mps: f64,
    /// The limit the board commands, if one stands.
    pub limit_mps: Option<f64>,
    /// Whether the limit is ignored, as a faulty or unsuitable autopilot mode does.
    pub ignores_limit: bool,
}

/// The autopilot.
#[derive(Clone, Debug)]
pub struct Autopilot {
    config: AutopilotConfig,
    estimate_error_m: [Wander; 2],
    integral_mps2: Vector3<f64>,
    /// Limits on their way through the link, oldest first: (arrival, limit).
    in_transit: std::collections::VecDeque<(f64, Option<f64>)>,
    limit_mps: Option<f64>,
    last_sent: Option<f64>,
    target_mps: f64,
    random: Random,
}

impl Autopilot {
    /// An autopilot that hovers and has been told no limit.
    pub fn new(config: &AutopilotConfig, seed: u64) -> Self {
        let mut random = Random::new(seed, Stream::Autopilot);
        let estimate_error_m =
            std::array::from_fn(|_| Wander::settled(config.position_sigma_m, config.position_time_s, &mut random));
        Self {
            config: *config,
            estimate_error_m,
            integral_mps2: Vector3::zeros(),
            in_transit: std::collections::VecDeque::new(),
            limit_mps: None,
            last_sent: None,
            target_mps: 0.0,
            random,
        }
    }

    /// The limit that has arrived, whether it is obeyed or not.
    pub fn limit_mps(&self) -> Option<f64> {
        self.limit_mps
    }

    /// Goes on by `dt_s`; returns the acceleration asked for in the tunnel frame.
    pub fn step(&mut self, now_s: f64, state: &VehicleState, wish: &Wish, dt_s: f64) -> Vector3<f64> {
        self.receive(now_s, wish.limit_mps);
        let forward = self.forward(state, wish, dt_s);
        let mut wanted = Vector3::new(forward, 0.0, 0.0);
        for axis in 0..2 {
            let estimate_m = state.position_m[axis + 1] + self.estimate_error_m[axis].step(dt_s, &mut self.random);
            let velocity_mps = state.velocity_mps[axis + 1] + self.random.gauss(VELOCITY_NOISE_MPS);
            let error_m = self.config.hold_m[axis] - estimate_m;
            let integral = &mut self.integral_mps2[axis + 1];
            *integral = (*integral + INTEGRAL_GAIN * error_m * dt_s).clamp(-INTEGRAL_LIMIT_MPS2, INTEGRAL_LIMIT_MPS2);
            wanted[axis + 1] = (POSITION_GAIN * error_m - VELOCITY_GAIN * velocity_mps + *integral)
                .clamp(-SIDE_LIMIT_MPS2, SIDE_LIMIT_MPS2);
        }
        wanted
    }

    fn receive(&mut self, now_s: f64, sent: Option<f64>) {
        if sent != self.last_sent {
            self.last_sent = sent;
            self.in_transit.push_back((now_s + self.config.link_delay_s, sent));
        }
        while let Some(&(arrival_s, limit)) = self.in_transit.front() {
            if arrival_s > now_s {
                break;
            }
            self.limit_mps = limit;
            self.in_transit.pop_front();
        }
    }

    /// Forward acceleration: the speed target follows the wish with a lag, the speed follows the target.
    fn forward(&mut self, state: &VehicleState, wish: &Wish, dt_s: f64) -> f64 {
        let limit_mps = if wish.ignores_limit { None } else { self.limit_mps };
        let aim_mps = limit_mps.map_or(wish.cruise_mps, |limit| wish.cruise_mps.min(limit * self.config.limit_use));
        self.target_mps += (aim_mps - self.target_mps) * (dt_s / self.config.speed_lag_s).min(1.0);
        let speed_mps = state.velocity_mps.x + self.random.gauss(VELOCITY_NOISE_MPS);
        let error_mps = self.target_mps - speed_mps;
        let integral = &mut self.integral_mps2.x;
        *integral = (*integral + INTEGRAL_GAIN * error_mps * dt_s).clamp(-INTEGRAL_LIMIT_MPS2, INTEGRAL_LIMIT_MPS2);
        let most = self.config.most_acceleration_mps2;
        (VELOCITY_GAIN * error_mps + *integral).clamp(-most, most)
    }
}
