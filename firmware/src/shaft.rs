//! The camera shaft: where it shall be, where it is, and whether it is still.
//!
//! Image `i` of a scan is taken at `first + i * 2 pi / n`. The shaft counts as still when it has come within a quarter step
//! of that angle and has then stayed within the tolerance for the dwell; a constant error of the servo does not matter,
//! because the tag carries the encoder's angle.
//!
//! There is one estimate of the angle: it goes on at the speed that the servo is asked for, and each reading of the encoder
//! replaces it. Without encoder it is all there is, and a turn takes as long as the servo is asked to take.

use adit_geometry::angles::{shaft_step_rad, unwrap_near};
use adit_protocol::parameters::ShaftParameters;
use nalgebra::ComplexField;

use crate::servo::{Aim, ServoLoop};
use crate::time::{has_passed, micros};

/// A silent encoder is lost after this: twenty samples at 100 Hz.
const ENCODER_STALE_S: f32 = 0.2;
/// Share of full speed on the way home: nobody has seen yet whether the shaft turns freely.
const HOMING_SHARE: f32 = 1.0 / 3.0;

/// What a turn has come to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Turn {
    /// Under way.
    Turning,
    /// The shaft is still at its angle.
    Still,
    /// The time for a turn is over, or the shaft does not follow.
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
    /// The estimate, over turns.
    angle_rad: f32,
    /// When the encoder was last read; `None` if it is not heard.
    read_us: Option<u64>,
    servo: ServoLoop,
    speed_share: f32,
    /// When the turn should have arrived at the latest.
    turn_due_us: u64,
    /// Angle and time at which the shaft seemed to come to rest.
    rest: Option<(f32, u64)>,
}

impl Shaft {
    pub(crate) fn new(parameters: ShaftParameters, images_per_turn: u16) -> Self {
        let step_rad = shaft_step_rad(images_per_turn);
        Self {
            parameters,
            step_rad,
            first_rad: 0.0,
            setpoint_rad: 0.0,
            angle_rad: 0.0,
            read_us: None,
            servo: ServoLoop::new(&parameters, step_rad),
            speed_share: 1.0,
            turn_due_us: 0,
            rest: None,
        }
    }

    /// Where the shaft shall be.
    pub(crate) fn setpoint_rad(&self) -> f32 {
        self.setpoint_rad
    }

    /// Where it is: the encoder's angle over turns, or what the servo was asked for where there is none.
    pub(crate) fn angle_rad(&self) -> f32 {
        self.angle_rad
    }

    /// Whether [`Self::angle_rad`] comes from the encoder.
    pub(crate) fn is_measured(&self) -> bool {
        self.read_us.is_some()
    }

    /// Whether an encoder is fitted but silent.
    pub(crate) fn encoder_is_lost(&self) -> bool {
        self.parameters.encoder && self.read_us.is_none()
    }

    /// Takes the encoder's reading.
    pub(crate) fn observe(&mut self, now_us: u64, encoder_rad: Option<f32>) {
        self.angle_rad += self.servo.advance(now_us);
        let reading = encoder_rad.filter(|angle_rad| self.parameters.encoder && angle_rad.abs() < 1e5);
        if let Some(reading_rad) = reading {
            self.angle_rad = unwrap_near(reading_rad, self.angle_rad);
            self.read_us = Some(now_us);
        } else if self.read_us.is_some_and(|read_us| has_passed(read_us, now_us, ENCODER_STALE_S)) {
            self.read_us = None;
            self.rest = None;
        }
    }

    /// Turns to the nearest multiple of the step, from wherever the shaft was left, slowly until it is there.
    pub(crate) fn home(&mut self, now_us: u64) {
        self.first_rad = ComplexField::round(self.angle_rad / self.step_rad) * self.step_rad;
        self.speed_share = HOMING_SHARE;
        self.turn_to(now_us, 0);
    }

    /// Puts image 0 at the next multiple of the step from where the shaft is, or at one just passed.
    pub(crate) fn begin_scan(&mut self, now_us: u64) {
        let steps = ComplexField::ceil(self.angle_rad / self.step_rad - 0.25);
        self.first_rad = steps * self.step_rad;
        self.turn_to(now_us, 0);
    }

    /// Turns to the angle of image `index`.
    pub(crate) fn turn_to(&mut self, now_us: u64, index: u32) {
        let target_rad = self.first_rad + index as f32 * self.step_rad;
        let way_rad = (target_rad - self.angle_rad).abs();
        self.setpoint_rad = target_rad;
        // A long way takes its time, which is not being late.
        let turn_s = self.servo.turn_time_s(way_rad, self.speed_share);
        self.turn_due_us = now_us.saturating_add(micros(turn_s));
        self.servo.begin_turn();
        self.rest = None;
    }

    /// What the turn has come to.
    pub(crate) fn turn(&mut self, now_us: u64) -> Turn {
        let parameters = &self.parameters;
        let arrived = (self.angle_rad - self.setpoint_rad).abs() <= self.step_rad * 0.25;
        let held = self
            .rest
            .filter(|(rest_rad, _)| arrived && (self.angle_rad - rest_rad).abs() <= parameters.settle_tolerance_rad);
        self.rest = held.or(arrived.then_some((self.angle_rad, now_us)));
        if self.servo.is_stalled() {
            Turn::Late
        } else if self.rest.is_some_and(|(_, since_us)| has_passed(since_us, now_us, parameters.settle_dwell_s)) {
            self.speed_share = 1.0;
            Turn::Still
        } else if has_passed(self.turn_due_us, now_us, parameters.turn_timeout_s) {
            Turn::Late
        } else {
            Turn::Turning
        }
    }

    /// Turns the shaft towards its setpoint; returns the width of the servo's pulse. Once per step, after all else.
    pub(crate) fn drive(&mut self, now_us: u64) -> Option<f32> {
        let aim = Aim {
            setpoint_rad: self.setpoint_rad,
            angle_rad: self.angle_rad,
            is_measured: self.is_measured(),
            speed_share: self.speed_share,
        };
        self.servo.step(now_us, aim)
    }

    /// Lets go of the shaft.
    pub(crate) fn release(&mut self) {
        self.servo.release();
    }
}

#[cfg(test)]
mod tests {
    use core::f32::consts::TAU;

    use adit_geometry::angles::{wrap_half_turn, wrap_turn};

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
    fn a_shaft_that_does_not_arrive_is_late() {
        let mut shaft = shaft();
        shaft.observe(0, Some(0.0));
        shaft.begin_scan(0);
        shaft.turn_to(0, 1);
        shaft.observe(900_000, Some(0.0));
        assert_eq!(shaft.turn(900_000), Turn::Turning);
        shaft.observe(1_400_000, Some(0.0));
        assert_eq!(shaft.turn(1_400_000), Turn::Late);
    }

    #[test]
    fn without_encoder_a_turn_takes_its_time() {
        let mut shaft = Shaft::new(ShaftParameters { encoder: false, ..ShaftParameters::default() }, 10);
        shaft.begin_scan(0);
        shaft.turn_to(0, 1);
        let mut way_rad = 0.0;
        let still_us = (0..200).map(|step| step * 5_000).find(|&now_us| {
            shaft.observe(now_us, Some(1.0));
            let pulse_us = shaft.drive(now_us).expect("a pulse");
            way_rad += (pulse_us - 1500.0) / 500.0 * 5.0 * 0.005;
            shaft.turn(now_us) == Turn::Still
        });
        let still_us = still_us.expect("never still");
        assert!((300_000..600_000).contains(&still_us), "still after {still_us} us");
        assert!((way_rad - TAU / 10.0).abs() < 0.01, "pulses of {way_rad} rad");
        assert!((shaft.angle_rad() - way_rad).abs() < 1e-3, "the estimate is {} rad", shaft.angle_rad());
        assert!(!shaft.encoder_is_lost() && !shaft.is_measured());
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

    /// Drives the shaft for so long, with an encoder that turns as the pulses say, or does not turn at all.
    fn driven(shaft: &mut Shaft, now_us: &mut u64, shaft_rad: &mut f32, moves: bool) -> (Turn, f32) {
        let mut fastest_us = 0.0_f32;
        for _ in 0..400 {
            *now_us += 5_000;
            shaft.observe(*now_us, Some(wrap_turn(*shaft_rad)));
            let pulse_us = shaft.drive(*now_us).expect("a pulse") - 1500.0;
            fastest_us = fastest_us.max(pulse_us.abs());
            *shaft_rad += if moves { pulse_us / 500.0 * 5.0 * 0.005 } else { 0.0 };
            match shaft.turn(*now_us) {
                Turn::Turning => {}
                other => return (other, fastest_us),
            }
        }
        (Turn::Turning, fastest_us)
    }

    #[test]
    fn home_is_the_nearest_multiple_of_the_step_and_the_way_there_is_slow() {
        for (left_rad, home_rad) in [(0.9, TAU / 10.0), (3.4, TAU / 2.0), (6.2, 0.0), (3.2, -TAU / 2.0)] {
            let (mut shaft, mut now_us, mut shaft_rad) = (shaft(), 0, left_rad);
            shaft.observe(0, Some(left_rad));
            shaft.home(0);
            let (turn, fastest_us) = driven(&mut shaft, &mut now_us, &mut shaft_rad, true);
            assert_eq!(turn, Turn::Still);
            assert!(wrap_half_turn(shaft_rad - home_rad).abs() < 0.0175, "left at {left_rad}, home at {shaft_rad}");
            assert!(fastest_us < 167.0, "a pulse of {fastest_us} us on the way home");
            shaft.turn_to(now_us, 1);
            let (turn, fastest_us) = driven(&mut shaft, &mut now_us, &mut shaft_rad, true);
            assert!(turn == Turn::Still && fastest_us > 300.0, "{turn:?}, a pulse of {fastest_us} us");
        }
    }

    #[test]
    fn a_shaft_that_does_not_follow_is_late_at_once_and_each_turn_tries_anew() {
        let (mut shaft, mut now_us, mut shaft_rad) = (shaft(), 0, 0.0);
        shaft.observe(0, Some(0.0));
        for index in 1..3 {
            shaft.turn_to(now_us, index);
            let began_us = now_us;
            let (turn, _) = driven(&mut shaft, &mut now_us, &mut shaft_rad, false);
            assert_eq!(turn, Turn::Late);
            assert!(now_us - began_us < 400_000, "late after {} us", now_us - began_us);
        }
        shaft.turn_to(now_us, 3);
        assert_eq!(driven(&mut shaft, &mut now_us, &mut shaft_rad, true).0, Turn::Still);
    }

    #[test]
    fn an_encoder_that_comes_back_corrects_the_estimate_by_less_than_a_turn() {
        let (mut shaft, mut shaft_rad) = (shaft(), 0.0_f32);
        shaft.observe(0, Some(0.0));
        for step in 1..2000 {
            let now_us = step * 5_000;
            if step % 200 == 0 {
                shaft.turn_to(now_us, step as u32 / 200);
            }
            // Silent from two seconds to eight, while the servo is a little too fast.
            let heard = !(400..1600).contains(&step);
            shaft.observe(now_us, heard.then(|| wrap_turn(shaft_rad)));
            shaft_rad += (shaft.drive(now_us).expect("a pulse") - 1500.0) / 500.0 * 5.2 * 0.005;
        }
        assert!(shaft.is_measured());
        assert!((shaft.angle_rad() - shaft_rad).abs() < 0.02, "{} for {shaft_rad}", shaft.angle_rad());
        assert!((shaft_rad - 9.0 * TAU / 10.0).abs() < 0.0175, "at {shaft_rad} rad");
    }
}
