//! The camera shaft: where it shall be, where it is, and whether it is still.
//!
//! Image `i` of a scan is taken at `first + i * 2 pi / n`. The shaft counts as still when it has come within a quarter step
//! of that angle and the encoder has then stayed within the tolerance for the dwell; a constant error of the servo does not
//! matter, because the tag carries the encoder's angle. Without encoder, a turn takes its angle over the servo's speed.

use adit_geometry::angles::{shaft_step_rad, unwrap_near};
use adit_protocol::parameters::ShaftParameters;
use nalgebra::ComplexField;

use crate::time::{has_passed, micros};

/// A silent encoder is lost after this: twenty samples at 100 Hz.
const ENCODER_STALE_S: f32 = 0.2;

/// What a turn has come to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Turn {
    /// Under way.
    Turning,
    /// The shaft is still at its angle.
    Still,
    /// The time for a turn is over.
    Late,
}

/// The shaft.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Shaft {
    parameters: ShaftParameters,
    step_rad: f32,
    /// Angle of image 0.
    first_rad: f32,
    setpoint_rad: f32,
    turn_began_us: u64,
    /// When an open-loop turn ends.
    turn_ends_us: u64,
    /// Unwrapped encoder angle and when it was read.
    measured: Option<(f32, u64)>,
    /// Angle and time at which the shaft seemed to come to rest.
    rest: Option<(f32, u64)>,
}

impl Shaft {
    pub(crate) fn new(parameters: ShaftParameters, images_per_turn: u16) -> Self {
        Self {
            parameters,
            step_rad: shaft_step_rad(images_per_turn),
            first_rad: 0.0,
            setpoint_rad: 0.0,
            turn_began_us: 0,
            turn_ends_us: 0,
            measured: None,
            rest: None,
        }
    }

    /// Where the shaft shall be.
    pub(crate) fn setpoint_rad(&self) -> f32 {
        self.setpoint_rad
    }

    /// Where it is: the encoder's angle over turns, or the setpoint where there is none.
    pub(crate) fn angle_rad(&self) -> f32 {
        self.measured.map_or(self.setpoint_rad, |(angle_rad, _)| angle_rad)
    }

    /// Whether [`Self::angle_rad`] comes from the encoder.
    pub(crate) fn is_measured(&self) -> bool {
        self.measured.is_some()
    }

    /// Whether an encoder is fitted but silent.
    pub(crate) fn encoder_is_lost(&self) -> bool {
        self.parameters.encoder && self.measured.is_none()
    }

    /// Takes the encoder's reading.
    pub(crate) fn observe(&mut self, now_us: u64, encoder_rad: Option<f32>) {
        let reading = encoder_rad.filter(|angle_rad| self.parameters.encoder && angle_rad.abs() < 1e5);
        if let Some(reading_rad) = reading {
            let reference_rad = self.measured.map_or(self.setpoint_rad, |(angle_rad, _)| angle_rad);
            let angle_rad = unwrap_near(reading_rad, reference_rad);
            self.measured = Some((angle_rad, now_us));
        } else if self.measured.is_some_and(|(_, read_us)| has_passed(read_us, now_us, ENCODER_STALE_S)) {
            self.measured = None;
            self.rest = None;
        }
    }

    /// Puts image 0 at the next multiple of the step from where the shaft is, or at one just passed.
    pub(crate) fn begin_scan(&mut self, now_us: u64) {
        let steps = ComplexField::ceil(self.angle_rad() / self.step_rad - 0.25);
        self.first_rad = steps * self.step_rad;
        self.turn_to(now_us, 0);
    }

    /// Turns to the angle of image `index`.
    pub(crate) fn turn_to(&mut self, now_us: u64, index: u32) {
        let target_rad = self.first_rad + index as f32 * self.step_rad;
        let way_rad = (target_rad - self.angle_rad()).abs();
        self.setpoint_rad = target_rad;
        self.turn_began_us = now_us;
        self.turn_ends_us = now_us.saturating_add(micros(way_rad / self.parameters.slew_radps));
        self.rest = None;
    }

    /// What the turn has come to.
    pub(crate) fn turn(&mut self, now_us: u64) -> Turn {
        let parameters = &self.parameters;
        let still = match self.measured {
            Some((angle_rad, _)) => {
                let arrived = (angle_rad - self.setpoint_rad).abs() <= self.step_rad * 0.25;
                let held = self
                    .rest
                    .filter(|(rest_rad, _)| arrived && (angle_rad - rest_rad).abs() <= parameters.settle_tolerance_rad);
                self.rest = held.or(arrived.then_some((angle_rad, now_us)));
                self.rest.is_some_and(|(_, since_us)| has_passed(since_us, now_us, parameters.settle_dwell_s))
            }
            None => now_us >= self.turn_ends_us && has_passed(self.turn_ends_us, now_us, parameters.settle_dwell_s),
        };
        // A long way takes its time, which is not being late.
        let due_us = self.turn_began_us.max(self.turn_ends_us);
        if still {
            Turn::Still
        } else if has_passed(due_us, now_us, parameters.turn_timeout_s) {
            Turn::Late
        } else {
            Turn::Turning
        }
    }
}

#[cfg(test)]
mod tests {
    use core::f32::consts::TAU;

    use super::*;

    fn shaft() -> Shaft {
        Shaft::new(ShaftParameters::default(), 10)
    }

    #[test]
    fn images_lie_on_multiples_of_the_step() {
        let mut shaft = shaft();
        shaft.observe(0, Some(0.9));
        shaft.begin_scan(0);
        assert!((shaft.setpoint_rad() - TAU / 5.0).abs() < 1e-6, "the next multiple of 0.628 from 0.9");
        shaft.turn_to(0, 25);
        assert!((shaft.setpoint_rad() - 27.0 * TAU / 10.0).abs() < 1e-5);
    }

    #[test]
    fn the_shaft_is_still_only_after_the_dwell() {
        let mut shaft = shaft();
        shaft.observe(0, Some(0.0));
        shaft.begin_scan(0);
        shaft.turn_to(0, 1);
        let target_rad = TAU / 10.0;
        let mut now_us = 0;
        // 0.02 rad per 5 ms is 4 rad/s; then at rest, 1.5 degrees short of the target.
        for step in 0..29 {
            now_us = step * 5_000;
            shaft.observe(now_us, Some(step as f32 * 0.02));
            assert_eq!(shaft.turn(now_us), Turn::Turning, "after {now_us} us");
        }
        let rest_us = now_us;
        loop {
            now_us += 5_000;
            shaft.observe(now_us, Some(target_rad - 0.026));
            if shaft.turn(now_us) == Turn::Still {
                break;
            }
            assert!(now_us < rest_us + 200_000, "never still");
        }
        assert!(now_us - rest_us >= 100_000);
    }

    #[test]
    fn a_shaft_that_does_not_move_is_late() {
        let mut shaft = shaft();
        shaft.observe(0, Some(0.0));
        shaft.begin_scan(0);
        shaft.turn_to(0, 1);
        shaft.observe(900_000, Some(0.0));
        assert_eq!(shaft.turn(900_000), Turn::Turning);
        shaft.observe(1_200_000, Some(0.0));
        assert_eq!(shaft.turn(1_200_000), Turn::Late);
    }

    #[test]
    fn without_encoder_a_turn_takes_its_time() {
        let mut shaft = Shaft::new(ShaftParameters { encoder: false, ..ShaftParameters::default() }, 10);
        shaft.begin_scan(0);
        shaft.turn_to(0, 1);
        assert_eq!(shaft.turn(120_000), Turn::Turning);
        assert_eq!(shaft.turn(240_000), Turn::Still);
        assert!(!shaft.encoder_is_lost());
    }

    #[test]
    fn an_encoder_that_wraps_is_counted_over_turns() {
        let mut shaft = shaft();
        for step in 0..200 {
            let angle_rad = step as f32 * 0.1;
            shaft.observe(step * 5_000, Some(angle_rad % TAU));
            assert!((shaft.angle_rad() - angle_rad).abs() < 1e-4);
        }
    }

    #[test]
    fn a_silent_encoder_is_lost_after_a_while() {
        let mut shaft = shaft();
        shaft.observe(0, Some(0.0));
        shaft.observe(100_000, None);
        assert!(!shaft.encoder_is_lost());
        shaft.observe(200_000, Some(f32::NAN));
        assert!(shaft.encoder_is_lost());
    }
}
