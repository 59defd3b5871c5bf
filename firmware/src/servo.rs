//! The loop that turns the camera shaft: a servo that takes a speed, closed over the shaft's angle.
//!
//! One step: how far is it to the setpoint; how fast may the shaft be there and still stop (`v = sqrt(2 a e)`, and no faster
//! than [`APPROACH_PER_S`] times the way, for the servo hears of a new speed only at its next pulse); no harder than the
//! acceleration allows; as a pulse. At the setpoint the shaft rests until it has left a dead band, for a loop that chased the
//! encoder's noise would never let the camera be still.
//!
//! What no drawing tells is learnt by comparing the way asked for with the way that the encoder saw:
//! - At low speed the difference is the servo's neutral, which is off by some microseconds and wanders with its temperature,
//!   or friction: both are trimmed away.
//! - Over a turn their ratio is the servo's gain. The loop needs it only when it must go on without encoder: then the angle is
//!   what was asked for, and each per cent of gain would be a third of a degree per photo.
//! - At high speed a shaft that hardly moves is jammed: the loop then asks for nothing until the next turn, which saves servo
//!   and gears.

use adit_protocol::parameters::{ServoParameters, ShaftParameters};
use nalgebra::ComplexField;

use crate::time::{has_passed, seconds};

/// Share of the acceleration that braking counts on: the rest makes good for delays.
const BRAKING_SHARE: f32 = 0.7;
/// Speed per way left. With pulses 20 ms apart, plus as much for the servo, loop gain times delay is 0.8 at the worst: no swinging.
const APPROACH_PER_S: f32 = 20.0;
/// The shaft rests once it is within this share of the way at which it leaves its rest again.
const ARRIVAL_SHARE: f32 = 0.25;
/// How fast the trim follows the difference of asked and seen way.
const TRIM_PER_S: f32 = 5.0;
/// Slow for this long, the servo follows what it is asked for.
const SLOW_S: f32 = 0.1;
/// The trim may be so many times the slowest speed: three dead bands, beyond which the neutral is set wrongly.
const TRIM_REACH: f32 = 3.0;
/// Asked for high speed this long, a shaft must have moved.
const STALL_S: f32 = 0.3;
/// By less than this share of the way asked for: a stall.
const STALL_SHARE: f32 = 0.25;
/// A turn this long tells the gain.
const GAIN_WAY_RAD: f32 = 0.25;
/// Share by which one turn changes it.
const GAIN_SHARE: f32 = 0.2;
/// No servo's gain is farther from what its parameters say.
const GAIN_REACH: f32 = 0.3;
/// High speed is at least this many times the slowest, and this share of the highest.
const FAST: (f32, f32) = (2.0, 0.05);
/// Longest step that is believed, so that no jump of the clock becomes many turns.
const LONGEST_STEP_S: f32 = 1.0;
/// Bounds the numbers in use, far beyond any servo.
const MOST: f32 = 1e4;

/// What the shaft shall do, and where it is.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Aim {
    pub(crate) setpoint_rad: f32,
    pub(crate) angle_rad: f32,
    /// Does the angle come from the encoder?
    pub(crate) is_measured: bool,
    /// Never faster than this share of full speed.
    pub(crate) speed_share: f32,
}

/// Way asked for and way seen since a moment.
#[derive(Clone, Copy, Debug, Default)]
struct Way {
    asked_rad: f32,
    seen_rad: f32,
}

impl Way {
    fn add(&mut self, step: Self) {
        self.asked_rad += step.asked_rad;
        self.seen_rad += step.seen_rad;
    }
}

/// The loop.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ServoLoop {
    servo: ServoParameters,
    slew_radps: f32,
    acceleration_radps2: f32,
    slowest_radps: f32,
    /// The shaft leaves its rest beyond this.
    leave_rad: f32,
    /// The speed asked for.
    speed_radps: f32,
    /// Added to it, so that the servo turns at it.
    trim_radps: f32,
    /// Speed turned per speed that the parameters promise.
    gain: f32,
    is_resting: bool,
    is_stalled: bool,
    advanced_us: u64,
    /// The last interval, and the way asked for in it.
    elapsed_s: f32,
    way_rad: f32,
    /// The last measured angle.
    seen_rad: Option<f32>,
    /// The turn so far, if the encoder saw all of it.
    turn: Option<Way>,
    /// Since when the speed has been high, and the way since.
    fast: Option<(u64, Way)>,
    /// Since when it has been low.
    slow_since_us: Option<u64>,
}

impl ServoLoop {
    /// A loop for a shaft that turns in steps of `step_rad`. Numbers that make no sense count as zero.
    pub(crate) fn new(shaft: &ShaftParameters, step_rad: f32) -> Self {
        let sane = |value: f32| if value > 0.0 { value.min(MOST) } else { 0.0 };
        let slew_radps = sane(shaft.slew_radps);
        Self {
            servo: shaft.servo,
            slew_radps,
            acceleration_radps2: sane(shaft.servo.acceleration_radps2),
            slowest_radps: sane(shaft.servo.slowest_radps).min(slew_radps),
            leave_rad: sane(shaft.settle_tolerance_rad * 0.5).min(step_rad * 0.125),
            speed_radps: 0.0,
            trim_radps: 0.0,
            gain: 1.0,
            is_resting: false,
            is_stalled: false,
            advanced_us: 0,
            elapsed_s: 0.0,
            way_rad: 0.0,
            seen_rad: None,
            turn: None,
            fast: None,
            slow_since_us: None,
        }
    }

    /// Whether the shaft did not follow; holds until the next turn begins.
    pub(crate) fn is_stalled(&self) -> bool {
        self.is_stalled
    }

    /// How long a turn over `way_rad` takes at most, coming to rest aside.
    pub(crate) fn turn_time_s(&self, way_rad: f32, speed_share: f32) -> f32 {
        let most_radps = self.most_radps(speed_share);
        way_rad / most_radps + most_radps / (self.acceleration_radps2 * BRAKING_SHARE)
    }

    /// The highest speed that this servo reaches, or a share of it.
    fn most_radps(&self, speed_share: f32) -> f32 {
        self.slew_radps * self.gain.min(1.0) * speed_share
    }

    /// Begins a turn, after a stall too.
    pub(crate) fn begin_turn(&mut self) {
        if let Some(turn) = self.turn.replace(Way::default()) {
            self.learn_gain(turn);
        }
        self.is_stalled = false;
        self.fast = None;
    }

    /// Lets go of the shaft.
    pub(crate) fn release(&mut self) {
        (self.is_stalled, self.is_resting) = (false, false);
        self.speed_radps = 0.0;
        (self.turn, self.fast, self.slow_since_us) = (None, None, None);
    }

    /// The way asked for since the last call.
    pub(crate) fn advance(&mut self, now_us: u64) -> f32 {
        self.elapsed_s = seconds(self.advanced_us, now_us).min(LONGEST_STEP_S);
        self.advanced_us = now_us;
        self.way_rad = self.speed_radps * self.elapsed_s;
        self.way_rad
    }

    /// One step, after [`Self::advance`]; returns the pulse's width in microseconds.
    ///
    /// It lies between neutral and full either way; `None` where the parameters give no number.
    pub(crate) fn step(&mut self, now_us: u64, aim: Aim) -> Option<f32> {
        self.watch(now_us, aim);
        let wanted_radps = self.wanted_radps(aim);
        let most_radps = self.acceleration_radps2 * self.elapsed_s;
        let change_radps = wanted_radps - self.speed_radps;
        self.speed_radps =
            if self.is_stalled { 0.0 } else { self.speed_radps + change_radps.max(-most_radps).min(most_radps) };
        self.pulse_us()
    }

    /// The speed to have at this place.
    fn wanted_radps(&mut self, aim: Aim) -> f32 {
        let error_rad = aim.setpoint_rad - aim.angle_rad;
        let away_rad = error_rad.abs();
        let rest_rad = if self.is_resting { self.leave_rad } else { self.leave_rad * ARRIVAL_SHARE };
        self.is_resting = away_rad <= rest_rad;
        if self.is_resting || self.is_stalled || !away_rad.is_finite() {
            return 0.0;
        }
        let braking_radps = ComplexField::sqrt(2.0 * BRAKING_SHARE * self.acceleration_radps2 * away_rad);
        let most_radps = self.most_radps(aim.speed_share);
        let speed_radps = braking_radps.min(APPROACH_PER_S * away_rad).max(self.slowest_radps).min(most_radps);
        speed_radps.copysign(error_rad)
    }

    fn pulse_us(&self) -> Option<f32> {
        let asked_radps = self.speed_radps / self.gain + self.trim_radps;
        let share = if self.slew_radps > 0.0 && !self.is_stalled { asked_radps / self.slew_radps } else { 0.0 };
        let pulse_us = self.servo.neutral_us + self.servo.full_us * share.clamp(-1.0, 1.0);
        pulse_us.is_finite().then_some(pulse_us)
    }

    /// Compares the way asked for with the way that the encoder saw.
    fn watch(&mut self, now_us: u64, aim: Aim) {
        let before_rad = core::mem::replace(&mut self.seen_rad, aim.is_measured.then_some(aim.angle_rad));
        let Some(before_rad) = before_rad.filter(|_| aim.is_measured && !self.is_stalled) else {
            (self.turn, self.fast, self.slow_since_us) = (None, None, None);
            return;
        };
        let step = Way { asked_rad: self.way_rad, seen_rad: aim.angle_rad - before_rad };
        if let Some(turn) = &mut self.turn {
            turn.add(step);
        }
        let (times, share) = FAST;
        if self.speed_radps.abs() > (self.slowest_radps * times).max(self.slew_radps * share) {
            self.slow_since_us = None;
            self.watch_stall(now_us, step);
        } else {
            self.fast = None;
            let since_us = *self.slow_since_us.get_or_insert(now_us);
            if has_passed(since_us, now_us, SLOW_S) {
                self.trim(step);
            }
        }
    }

    fn watch_stall(&mut self, now_us: u64, step: Way) {
        let same_way = self.fast.filter(|(_, way)| way.asked_rad * self.speed_radps >= 0.0);
        let (since_us, mut way) = same_way.unwrap_or((now_us, Way::default()));
        way.add(step);
        self.fast = Some((since_us, way));
        if !has_passed(since_us, now_us, STALL_S) {
            return;
        }
        self.fast = None;
        let followed_rad = way.seen_rad * way.asked_rad.signum();
        if followed_rad < STALL_SHARE * way.asked_rad.abs() {
            // What friction taught is no neutral.
            (self.is_stalled, self.trim_radps) = (true, 0.0);
        }
    }

    fn trim(&mut self, step: Way) {
        let reach_radps = TRIM_REACH * self.slowest_radps;
        let trim_radps = self.trim_radps + TRIM_PER_S * (step.asked_rad - step.seen_rad);
        self.trim_radps = trim_radps.max(-reach_radps).min(reach_radps);
    }

    fn learn_gain(&mut self, turn: Way) {
        let error = turn.seen_rad / turn.asked_rad - 1.0;
        if turn.asked_rad.abs() > GAIN_WAY_RAD && error.abs() < GAIN_REACH {
            let gain = self.gain * (1.0 + GAIN_SHARE * error);
            self.gain = gain.clamp(1.0 - GAIN_REACH, 1.0 + GAIN_REACH);
        }
    }
}

#[cfg(test)]
mod tests;
