//! A vehicle in one dimension: its speed follows the autopilot's aim with a lag, no harder than it can, in gusts.

use adit_hil_sim::autopilot::Seen;
use adit_hil_sim::seed::{Random, Stream, Wander};

/// The speed follows the aim so fast, 1/s.
const FOLLOWS_PER_S: f64 = 2.5;
/// And no harder than this: a vehicle with a camera on its nose.
const MOST_MPS2: f64 = 1.0;
/// Gusts, one standard deviation, and how long they last: what `[simulation.wind]` has by default.
const GUST_MPS2: f64 = 0.08;
const GUST_S: f64 = 0.8;
/// Noise of the autopilot's estimate.
const NOISE_MPS: f64 = 0.01;
/// Where the tunnel goes, from north.
pub(crate) const AXIS_YAW_RAD: f64 = 0.7;

/// The vehicle.
pub(crate) struct Vehicle {
    place_m: f64,
    pub(crate) speed_mps: f64,
    gust: Wander,
    air: Random,
    estimator: Random,
}

impl Vehicle {
    /// At rest.
    pub(crate) fn new(seed: u64) -> Self {
        Self {
            place_m: 0.0,
            speed_mps: 0.0,
            gust: Wander::new(GUST_MPS2, GUST_S),
            air: Random::new(seed, Stream::Wind),
            estimator: Random::new(seed, Stream::Autopilot),
        }
    }

    /// Goes on by `dt_s`, steered for `aim_mps`.
    pub(crate) fn step(&mut self, aim_mps: f64, dt_s: f64) {
        let steered_mps2 = (FOLLOWS_PER_S * (aim_mps - self.speed_mps)).clamp(-MOST_MPS2, MOST_MPS2);
        self.speed_mps += (steered_mps2 + self.gust.step(dt_s, &mut self.air)) * dt_s;
        self.place_m += self.speed_mps * dt_s;
    }

    /// As the autopilot sees it.
    pub(crate) fn seen(&mut self) -> Seen {
        let speed_mps = self.speed_mps + self.estimator.gauss(NOISE_MPS);
        Seen { attitude_rad: [0.0; 3], place_m: self.place_m, speed_mps, axis_yaw_rad: AXIS_YAW_RAD }
    }
}
