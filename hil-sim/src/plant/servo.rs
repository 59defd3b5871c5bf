//! The servo that turns the camera shaft: slew rate, acceleration, backlash, stall.
//!
//! Model: the motor follows the commanded angle with limited speed and acceleration (it brakes in time, as a servo's
//! own position loop does); gears between motor and shaft have play, and the shaft lags by half of it on either side,
//! kept there by friction. A stalled servo does not move; it does not tell.

use crate::config::ServoConfig;
use crate::seed::{Random, Stream, Wander};

/// Time constant of the shaft's trembling in its play.
const TREMBLE_TIME_S: f64 = 0.05;

/// The servo and the shaft.
#[derive(Clone, Debug)]
pub struct Servo {
    config: ServoConfig,
    motor_rad: f64,
    motor_rad_per_s: f64,
    shaft_rad: f64,
    shaft_rad_per_s: f64,
    tremble: Wander,
    random: Random,
    last_output_rad: f64,
}

impl Servo {
    /// A shaft at rest at `shaft_rad` in the body frame.
    pub fn new(shaft_rad: f64, config: &ServoConfig, seed: u64) -> Self {
        Self {
            config: *config,
            motor_rad: shaft_rad,
            motor_rad_per_s: 0.0,
            shaft_rad,
            shaft_rad_per_s: 0.0,
            tremble: Wander::new(config.tremble_sigma_rad, TREMBLE_TIME_S),
            random: Random::new(seed, Stream::Servo),
            last_output_rad: shaft_rad,
        }
    }

    /// The shaft's true angle in the body frame: 0 up, growing clockwise looking forward, over turns.
    pub fn angle_rad(&self) -> f64 {
        self.last_output_rad
    }

    /// The shaft's true angular velocity.
    pub fn velocity_rad_per_s(&self) -> f64 {
        self.shaft_rad_per_s
    }

    /// Goes on by `dt_s` towards `target_rad`; `None` lets go (the motor brakes), `stalled` holds it fast.
    pub fn step(&mut self, target_rad: Option<f64>, stalled: bool, dt_s: f64) {
        let wanted = match target_rad {
            Some(target) if !stalled => self.approach(target, dt_s),
            _ => 0.0,
        };
        let most = self.config.acceleration_rad_per_s2 * dt_s;
        self.motor_rad_per_s =
            if stalled { 0.0 } else { self.motor_rad_per_s + (wanted - self.motor_rad_per_s).clamp(-most, most) };
        self.motor_rad += self.motor_rad_per_s * dt_s;

        let play = 0.5 * self.config.backlash_rad;
        self.shaft_rad = self.shaft_rad.clamp(self.motor_rad - play, self.motor_rad + play);
        // The shaft trembles within its play only while free of load; the stalled one does not.
        let tremble = self.tremble.step(dt_s, &mut self.random);
        let output_rad = self.shaft_rad + if stalled { 0.0 } else { tremble };
        self.shaft_rad_per_s = (output_rad - self.last_output_rad) / dt_s;
        self.last_output_rad = output_rad;
    }

    /// The speed from which the motor still stops at the target.
    fn approach(&self, target_rad: f64, dt_s: f64) -> f64 {
        let error = target_rad - self.motor_rad;
        let braking = (2.0 * 0.8 * self.config.acceleration_rad_per_s2 * error.abs()).sqrt();
        let arriving = error.abs() / (4.0 * dt_s);
        error.signum() * braking.min(arriving).min(self.config.slew_rad_per_s)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_servo_arrives_without_going_past_and_no_faster_than_its_slew_rate() {
        let config = ServoConfig { backlash_rad: 0.0, tremble_sigma_rad: 0.0, ..ServoConfig::default() };
        let mut servo = Servo::new(0.0, &config, 1);
        let target = 36_f64.to_radians();
        let mut still_at = None;
        for step in 0..400 {
            servo.step(Some(target), false, 0.005);
            assert!(servo.angle_rad() <= target + 0.002, "past the target: {}", servo.angle_rad());
            assert!(servo.velocity_rad_per_s() <= config.slew_rad_per_s + 1e-9);
            if still_at.is_none() && (servo.angle_rad() - target).abs() < 0.003 {
                still_at = Some(f64::from(step) * 0.005);
            }
        }
        let took_s = still_at.expect("never arrived");
        assert!(took_s > target / config.slew_rad_per_s && took_s < 0.6, "took {took_s} s");
    }

    #[test]
    fn backlash_leaves_the_shaft_behind_on_either_side() {
        let config = ServoConfig { backlash_rad: 0.02, tremble_sigma_rad: 0.0, ..ServoConfig::default() };
        let mut servo = Servo::new(0.0, &config, 1);
        let settle = |servo: &mut Servo, target: f64| {
            for _ in 0..600 {
                servo.step(Some(target), false, 0.005);
            }
            servo.angle_rad()
        };
        assert!((settle(&mut servo, 1.0) - 0.99).abs() < 1e-4);
        assert!((settle(&mut servo, 0.5) - 0.51).abs() < 1e-4);
    }

    #[test]
    fn a_stalled_servo_does_not_move() {
        let mut servo = Servo::new(0.3, &ServoConfig::default(), 1);
        for _ in 0..200 {
            servo.step(Some(2.0), true, 0.005);
        }
        assert_eq!(servo.angle_rad(), 0.3);
    }
}
