//! The servo that turns the camera shaft: a servo for continuous rotation, whose pulse commands a speed.
//!
//! Model: a pulse comes every [`PULSE_PERIOD_S`]; its distance from the servo's own neutral commands a speed, but for a dead
//! band; the motor follows with limited acceleration. Neutral and gain are not quite what the board was told. Gears between
//! motor and shaft have play, and the shaft lags by half of it on either side, kept there by friction. Without pulses the
//! motor brakes. A stalled servo does not move; it does not tell.

use adit_protocol::parameters::ServoParameters;

use crate::config::ServoConfig;
use crate::seed::{Random, Stream, Wander};

/// Time constant of the shaft's trembling in its play.
const TREMBLE_TIME_S: f64 = 0.05;
/// Time from pulse to pulse: what every servo takes.
const PULSE_PERIOD_S: f64 = 0.02;

/// The servo and the shaft.
#[derive(Clone, Debug)]
pub struct Servo {
    config: ServoConfig,
    /// Its own neutral.
    neutral_us: f64,
    /// Speed per microsecond beside it.
    gain_rad_per_s_us: f64,
    /// The pulse it heard last.
    pulse_us: Option<f64>,
    next_pulse_s: f64,
    motor_rad: f64,
    motor_rad_per_s: f64,
    shaft_rad: f64,
    shaft_rad_per_s: f64,
    tremble: Wander,
    random: Random,
    last_output_rad: f64,
}

impl Servo {
    /// A shaft at rest at `shaft_rad` in the body frame, on a servo that is nearly as the board was `told`.
    pub fn new(shaft_rad: f64, told: &ServoParameters, config: &ServoConfig, seed: u64) -> Self {
        let mut build = Random::numbered(seed, Stream::Build, 2);
        let neutral_us = f64::from(told.neutral_us) + build.gauss(config.neutral_sigma_us);
        let gain = 1.0 + build.gauss(config.gain_sigma);
        Self {
            config: *config,
            neutral_us,
            gain_rad_per_s_us: gain * config.slew_rad_per_s / f64::from(told.full_us),
            pulse_us: None,
            next_pulse_s: 0.0,
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

    /// Goes on by `dt_s` under pulses of this width; `None` lets go (the motor brakes), `stalled` holds it fast.
    pub fn step(&mut self, pulse_us: Option<f64>, stalled: bool, dt_s: f64) {
        // Half a step of slack, for sums of steps are not exact.
        if self.next_pulse_s < 0.5 * dt_s {
            self.pulse_us = pulse_us;
            self.next_pulse_s += PULSE_PERIOD_S;
        }
        self.next_pulse_s -= dt_s;
        let wanted = self.pulse_us.map_or(0.0, |pulse_us| self.commanded_rad_per_s(pulse_us));
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

    /// The speed that a pulse commands.
    fn commanded_rad_per_s(&self, pulse_us: f64) -> f64 {
        let over_us = pulse_us - self.neutral_us;
        if over_us.abs() <= self.config.dead_band_us {
            return 0.0;
        }
        let most = self.config.slew_rad_per_s;
        (over_us * self.gain_rad_per_s_us).clamp(-most, most)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A servo that is just as the board was told, without play.
    fn exact() -> ServoConfig {
        ServoConfig {
            neutral_sigma_us: 0.0,
            gain_sigma: 0.0,
            backlash_rad: 0.0,
            tremble_sigma_rad: 0.0,
            ..ServoConfig::default()
        }
    }

    fn servo(config: &ServoConfig, seed: u64) -> Servo {
        Servo::new(0.0, &ServoParameters::default(), config, seed)
    }

    fn run(servo: &mut Servo, pulse_us: Option<f64>, duration_s: f64) {
        for _ in 0..(duration_s / 0.005).round() as u32 {
            servo.step(pulse_us, false, 0.005);
        }
    }

    #[test]
    fn the_pulse_commands_a_speed_either_way() {
        let config = exact();
        for (pulse_us, share) in
            [(1500.0, 0.0), (1503.0, 0.0), (1510.0, 0.02), (1250.0, -0.5), (2000.0, 1.0), (2400.0, 1.0)]
        {
            let mut servo = servo(&config, 1);
            run(&mut servo, Some(pulse_us), 0.5);
            let speed = servo.velocity_rad_per_s();
            assert!((speed - share * config.slew_rad_per_s).abs() < 1e-9, "{speed} rad/s at {pulse_us} us");
        }
    }

    #[test]
    fn a_negative_full_pulse_turns_the_other_way() {
        let told = ServoParameters { full_us: -500.0, ..ServoParameters::default() };
        let mut servo = Servo::new(0.0, &told, &exact(), 1);
        run(&mut servo, Some(1250.0), 0.5);
        assert!(servo.velocity_rad_per_s() > 2.0);
    }

    #[test]
    fn the_motor_gets_up_to_speed_as_fast_as_it_can_and_brakes_when_the_pulses_end() {
        let config = exact();
        let mut servo = servo(&config, 1);
        run(&mut servo, Some(2000.0), 0.04);
        assert!((servo.velocity_rad_per_s() - 0.04 * config.acceleration_rad_per_s2).abs() < 1e-9);
        run(&mut servo, Some(2000.0), 0.5);
        run(&mut servo, None, 0.3);
        assert_eq!(servo.velocity_rad_per_s(), 0.0);
    }

    #[test]
    fn servos_differ_in_neutral_and_gain() {
        let config = ServoConfig { neutral_sigma_us: 3.0, gain_sigma: 0.03, ..exact() };
        let speeds: Vec<f64> = (0..200)
            .map(|seed| {
                let mut servo = servo(&config, seed);
                run(&mut servo, Some(1750.0), 0.5);
                servo.velocity_rad_per_s() / (0.5 * config.slew_rad_per_s) - 1.0
            })
            .collect();
        let sigma = (speeds.iter().map(|error| error * error).sum::<f64>() / 200.0).sqrt();
        // 3 of 250 microseconds are 1.2 per cent.
        assert!((0.025..0.040).contains(&sigma), "sigma {sigma}");
    }

    #[test]
    fn backlash_leaves_the_shaft_behind_on_either_side() {
        let mut servo = servo(&ServoConfig { backlash_rad: 0.02, ..exact() }, 1);
        for (pulse_us, side) in [(1600.0, -1.0), (1400.0, 1.0)] {
            run(&mut servo, Some(pulse_us), 0.5);
            run(&mut servo, None, 0.3);
            assert!((servo.angle_rad() - servo.motor_rad - side * 0.01).abs() < 1e-9);
        }
    }

    #[test]
    fn a_stalled_servo_does_not_move() {
        let mut servo = Servo::new(0.3, &ServoParameters::default(), &ServoConfig::default(), 1);
        for _ in 0..200 {
            servo.step(Some(2000.0), true, 0.005);
        }
        assert_eq!(servo.angle_rad(), 0.3);
    }
}
