//! Randomness: one seed, one independent stream per subsystem.
//!
//! A draw added in one subsystem must not shift what another one sees, or every small change of the model would make a
//! different flight. Each subsystem therefore owns a `ChaCha8` stream of its own, chosen by [`Stream`].

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;

/// Who draws. The numbers are part of what a seed means: never reuse or renumber them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u64)]
pub enum Stream {
    /// Gusts.
    Wind = 1,
    /// The autopilot's own estimates.
    Autopilot = 2,
    /// Attitude of the vehicle and its measurement.
    Attitude = 3,
    /// Odometry.
    Odometer = 4,
    /// The four range sensors (one stream each, from here upwards: up, right, down, left, head).
    Range = 10,
    /// The servo.
    Servo = 20,
    /// The shaft encoder.
    Encoder = 21,
    /// Trigger latency, missed and surplus shots, the camera's clock.
    Camera = 22,
    /// Which faults happen when.
    Faults = 30,
    /// What differs from one vehicle to the next: biases, offsets, mounting.
    Build = 31,
    /// The wall's bulges in a survey set.
    Wall = 40,
    /// Exposure and white balance of a survey set's photos.
    Exposure = 41,
    /// The camera and the poses of a set of photos of a board (one stream each for camera, poses and noise).
    Board = 50,
}

/// A stream of random numbers.
#[derive(Clone, Debug)]
pub struct Random(ChaCha8Rng);

impl Random {
    /// Opens the stream of one subsystem.
    pub fn new(seed: u64, stream: Stream) -> Self {
        Self::numbered(seed, stream, 0)
    }

    /// Opens the stream of the `index`-th of several alike.
    pub fn numbered(seed: u64, stream: Stream, index: u64) -> Self {
        let mut generator = ChaCha8Rng::seed_from_u64(seed);
        generator.set_stream(stream as u64 + index);
        Self(generator)
    }

    /// Draws from the normal distribution with the given standard deviation.
    pub fn gauss(&mut self, sigma: f64) -> f64 {
        let unit: f64 = self.0.sample(StandardNormal);
        unit * sigma
    }

    /// Draws uniformly from `[low, high)`; `low` where the interval is empty.
    pub fn uniform(&mut self, low: f64, high: f64) -> f64 {
        let unit: f64 = self.0.random();
        low + unit * (high - low).max(0.0)
    }

    /// Draws true with the given probability.
    pub fn chance(&mut self, probability: f64) -> bool {
        self.uniform(0.0, 1.0) < probability
    }

    /// Draws an index below `count` (0 where `count` is 0).
    pub fn index(&mut self, count: usize) -> usize {
        (self.uniform(0.0, count as f64) as usize).min(count.saturating_sub(1))
    }
}

/// A value that wanders around zero (an Ornstein-Uhlenbeck process, discretised exactly).
///
/// # Method
/// `v' = a v + sigma sqrt(1 - a^2) n` with `a = exp(-dt / time)`: its standard deviation is `sigma` for any step.
#[derive(Clone, Debug)]
pub struct Wander {
    sigma: f64,
    time_s: f64,
    value: f64,
}

impl Wander {
    /// Starts at zero.
    pub fn new(sigma: f64, time_s: f64) -> Self {
        Self { sigma, time_s, value: 0.0 }
    }

    /// Starts at a value drawn from where the process settles.
    pub fn settled(sigma: f64, time_s: f64, random: &mut Random) -> Self {
        Self { sigma, time_s, value: random.gauss(sigma) }
    }

    /// Goes on by `dt_s` and returns the new value.
    pub fn step(&mut self, dt_s: f64, random: &mut Random) -> f64 {
        let keep = (-dt_s / self.time_s).exp();
        self.value = keep * self.value + self.sigma * (1.0 - keep * keep).sqrt() * random.gauss(1.0);
        self.value
    }

    /// The value now.
    pub fn value(&self) -> f64 {
        self.value
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_same_seed_and_stream_give_the_same_numbers() {
        let draw = |seed, stream| {
            let mut random = Random::new(seed, stream);
            (0..5).map(|_| random.gauss(1.0).to_bits()).collect::<Vec<_>>()
        };
        assert_eq!(draw(7, Stream::Wind), draw(7, Stream::Wind));
        assert_ne!(draw(7, Stream::Wind), draw(7, Stream::Camera));
        assert_ne!(draw(7, Stream::Wind), draw(8, Stream::Wind));
    }

    #[test]
    fn a_wandering_value_keeps_its_standard_deviation_for_any_step() {
        for dt_s in [0.005, 0.5] {
            let mut random = Random::new(3, Stream::Wind);
            let mut wander = Wander::settled(2.0, 0.4, &mut random);
            let count = 200_000;
            let power: f64 = (0..count).map(|_| wander.step(dt_s, &mut random).powi(2)).sum();
            let sigma = (power / f64::from(count)).sqrt();
            assert!((sigma - 2.0).abs() < 0.15, "sigma {sigma} at a step of {dt_s} s");
        }
    }
}
