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
        let most_radps = self.slew_radps * speed_share;
        way_rad / most_radps + most_radps / (self.acceleration_radps2 * BRAKING_SHARE)
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
        let most_radps = self.slew_radps * self.gain.min(1.0) * aim.speed_share;
        let speed_radps = braking_radps.min(APPROACH_PER_S * away_rad).max(self.slowest_radps).min(most_radps);
        speed_radps.copysign(error_rad)
    }

    fn pulse_us(&self) -> Option<f32> {
        let asked_radps = self.speed_radps / self.gain + self.trim_radps;
        let share = if self.slew_radps > 0.0 && !self.is_stalled { asked_radps / self.slew_radps } else { 0.0 };
        let pulse_us = self.servo.neutral_us + self.servo.full_us * share.max(-1.0).min(1.0);
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
            self.gain = gain.max(1.0 - GAIN_REACH).min(1.0 + GAIN_REACH);
        }
    }
}

#[cfg(test)]
mod tests {
    use core::f32::consts::TAU;

    use super::*;

    const TICK_US: u64 = 5_000;
    const TICK_S: f32 = 0.005;
    const STEP_RAD: f32 = TAU / 10.0;

    /// A servo with its gears and an encoder on the shaft.
    #[derive(Clone, Copy, Debug, Default)]
    struct Plant {
        gain_error: f32,
        neutral_error_us: f32,
        dead_band_us: f32,
        backlash_rad: f32,
        noise_rad: f32,
        is_jammed: bool,
        motor_rad: f32,
        motor_radps: f32,
        shaft_rad: f32,
        pulse_us: f32,
        ticks: u32,
        dice: u64,
    }

    impl Plant {
        /// One tick: pulses come every 20 ms, and the motor needs time to get up to speed.
        fn turn(&mut self, pulse_us: Option<f32>) {
            if self.ticks.is_multiple_of(4) {
                self.pulse_us = pulse_us.expect("a pulse");
            }
            self.ticks += 1;
            let over_us = self.pulse_us - 1500.0 - self.neutral_error_us;
            let heard_us = if over_us.abs() <= self.dead_band_us { 0.0 } else { over_us };
            let wanted_radps = heard_us / 500.0 * 5.0 * (1.0 + self.gain_error);
            self.motor_radps += (wanted_radps - self.motor_radps).clamp(-40.0 * TICK_S, 40.0 * TICK_S);
            if !self.is_jammed {
                self.motor_rad += self.motor_radps * TICK_S;
            }
            let play_rad = 0.5 * self.backlash_rad;
            self.shaft_rad = self.shaft_rad.clamp(self.motor_rad - play_rad, self.motor_rad + play_rad);
        }

        /// The encoder's reading: the sum of twelve throws is nearly normal.
        fn read_rad(&mut self) -> f32 {
            let mut sum = -6.0;
            for _ in 0..12 {
                self.dice = self.dice.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
                sum += (self.dice >> 40) as f32 / (1_u64 << 24) as f32;
            }
            let step_rad = TAU / 4096.0;
            ((self.shaft_rad + sum * self.noise_rad) / step_rad).round() * step_rad
        }
    }

    /// Loop and plant, running.
    struct Bench {
        servo: ServoLoop,
        plant: Plant,
        now_us: u64,
        estimate_rad: f32,
        has_encoder: bool,
    }

    impl Bench {
        fn new(plant: Plant) -> Self {
            let servo = ServoLoop::new(&ShaftParameters::default(), STEP_RAD);
            Self { servo, plant, now_us: 0, estimate_rad: 0.0, has_encoder: true }
        }

        fn tick(&mut self, setpoint_rad: f32) -> f32 {
            self.now_us += TICK_US;
            self.estimate_rad += self.servo.advance(self.now_us);
            if self.has_encoder {
                self.estimate_rad = self.plant.read_rad();
            }
            let aim =
                Aim { setpoint_rad, angle_rad: self.estimate_rad, is_measured: self.has_encoder, speed_share: 1.0 };
            let pulse_us = self.servo.step(self.now_us, aim);
            self.plant.turn(pulse_us);
            pulse_us.expect("a pulse")
        }
    }

    /// What a turn was like.
    #[derive(Clone, Copy, Debug, Default)]
    struct Arrival {
        /// Until the shaft was within the tolerance for good.
        settled_s: f32,
        error_rad: f32,
        /// Changes of the direction asked for after that.
        reversals: u32,
        /// How far the shaft wandered after half a second.
        wandered_rad: f32,
    }

    /// Turns by one step and watches for 1.5 s.
    fn turned(bench: &mut Bench, setpoint_rad: f32) -> Arrival {
        bench.servo.begin_turn();
        let tolerance_rad = ShaftParameters::default().settle_tolerance_rad;
        let mut arrival = Arrival::default();
        let (mut direction, mut low_rad, mut high_rad) = (0.0, f32::MAX, f32::MIN);
        for tick in 1..=300_u16 {
            let time_s = f32::from(tick) * TICK_S;
            bench.tick(setpoint_rad);
            arrival.error_rad = bench.plant.shaft_rad - setpoint_rad;
            if arrival.error_rad.abs() > tolerance_rad {
                (arrival.settled_s, arrival.reversals, direction) = (time_s, 0, 0.0);
            }
            let speed_radps = bench.servo.speed_radps;
            if speed_radps != 0.0 {
                arrival.reversals += u32::from(speed_radps * direction < 0.0);
                direction = speed_radps;
            }
            if time_s > 0.5 {
                low_rad = low_rad.min(bench.plant.shaft_rad);
                high_rad = high_rad.max(bench.plant.shaft_rad);
            }
        }
        arrival.wandered_rad = high_rad - low_rad;
        arrival
    }

    /// A servo as its parameters say, with half a degree of play and an encoder's noise.
    fn usual() -> Plant {
        Plant { backlash_rad: 0.5_f32.to_radians(), noise_rad: 0.05_f32.to_radians(), dice: 1, ..Plant::default() }
    }

    #[test]
    fn a_servo_that_differs_from_its_parameters_still_settles_without_hunting() {
        // Gain error, neutral error, dead band, and how soon all turns have settled.
        let rows = [
            (0.0, 0.0, 0.0, 0.28),
            (0.0, 0.0, 4.0, 0.28),
            (0.0, 0.0, 10.0, 0.28),
            (0.0, -8.0, 4.0, 0.28),
            (0.0, 8.0, 4.0, 0.29),
            (-0.1, -8.0, 0.0, 0.32),
            (-0.1, 0.0, 4.0, 0.32),
            (-0.1, 8.0, 10.0, 0.32),
            (0.1, -8.0, 4.0, 0.34),
            (0.1, 0.0, 0.0, 0.34),
            (0.1, 8.0, 0.0, 0.34),
        ];
        for (gain_error, neutral_error_us, dead_band_us, settled_s) in rows {
            let row = format!("gain {gain_error}, neutral {neutral_error_us} us, dead band {dead_band_us} us");
            let mut bench = Bench::new(Plant { gain_error, neutral_error_us, dead_band_us, ..usual() });
            let mut wandered_rad = 0.0;
            for image in 1..=20_u8 {
                let arrival = turned(&mut bench, f32::from(image) * STEP_RAD);
                assert!(!bench.servo.is_stalled(), "{row}, image {image}: stalled");
                assert!(arrival.settled_s <= settled_s, "{row}, image {image}: {arrival:?}");
                assert!(arrival.error_rad.abs() < 0.5_f32.to_radians(), "{row}, image {image}: {arrival:?}");
                assert!(arrival.reversals <= 2, "{row}, image {image}: {arrival:?}");
                assert!(arrival.wandered_rad < 0.8_f32.to_radians(), "{row}, image {image}: {arrival:?}");
                // The first turns teach the neutral.
                wandered_rad += if image > 5 { arrival.wandered_rad / 15.0 } else { 0.0 };
            }
            assert!(wandered_rad < 0.3_f32.to_radians(), "{row}: wandered by {wandered_rad} rad on average");
        }
    }

    #[test]
    fn without_encoder_a_turn_ends_where_its_pulses_lead() {
        let mut bench = Bench { has_encoder: false, ..Bench::new(Plant::default()) };
        for image in 1..=10_u8 {
            turned(&mut bench, f32::from(image) * STEP_RAD);
        }
        // The motor is a little behind the pulses in starting and in stopping.
        let error_rad = bench.plant.shaft_rad - TAU;
        assert!(error_rad.abs() < 0.02 * TAU, "{error_rad} rad after a turn");
        assert!((bench.estimate_rad - TAU).abs() < 0.003, "the estimate is {} rad", bench.estimate_rad);
    }

    #[test]
    fn a_loop_that_loses_its_encoder_has_learnt_the_servos_gain() {
        for gain_error in [-0.1, 0.1] {
            let mut bench = Bench::new(Plant { gain_error, dead_band_us: 4.0, ..usual() });
            let ten_turned = |bench: &mut Bench, first: u8| {
                for image in first..first + 10 {
                    turned(bench, f32::from(image) * STEP_RAD);
                }
                bench.plant.shaft_rad
            };
            let from_rad = ten_turned(&mut bench, 1);
            bench.has_encoder = false;
            let error_rad = ten_turned(&mut bench, 11) - from_rad - TAU;
            assert!(error_rad.abs() < 0.03 * TAU, "gain error {gain_error}: {error_rad} rad after a turn");
        }
    }

    /// Turns until the loop sees a stall; returns after what time.
    fn stalled_after_s(bench: &mut Bench, setpoint_rad: f32) -> Option<f32> {
        bench.servo.begin_turn();
        (1..=300_u16).map(|tick| f32::from(tick) * TICK_S).find(|_| {
            bench.tick(setpoint_rad);
            bench.servo.is_stalled()
        })
    }

    #[test]
    fn a_jammed_shaft_is_let_be_until_the_next_turn() {
        let mut bench = Bench::new(Plant { is_jammed: true, ..usual() });
        let after_s = stalled_after_s(&mut bench, STEP_RAD).expect("no stall seen");
        assert!((0.3..0.4).contains(&after_s), "seen after {after_s} s");
        assert!((0..100).all(|_| bench.tick(STEP_RAD) == 1500.0), "the servo goes on pushing");
        bench.plant.is_jammed = false;
        let arrival = turned(&mut bench, STEP_RAD);
        assert!(arrival.error_rad.abs() < 0.01 && !bench.servo.is_stalled(), "{arrival:?}");
    }

    #[test]
    fn a_shaft_that_jams_under_way_is_seen() {
        let mut bench = Bench::new(usual());
        bench.servo.begin_turn();
        while bench.plant.shaft_rad < 2.0 {
            bench.tick(6.0);
        }
        bench.plant.is_jammed = true;
        let after_s = (1..=300_u16).map(|tick| f32::from(tick) * TICK_S).find(|_| {
            bench.tick(6.0);
            bench.servo.is_stalled()
        });
        assert!(after_s.is_some_and(|after_s| after_s < 0.7), "seen after {after_s:?} s");
    }

    #[test]
    fn a_servo_that_turns_the_other_way_round_is_a_stall() {
        let mut bench = Bench::new(Plant { gain_error: -2.0, ..usual() });
        assert!(stalled_after_s(&mut bench, STEP_RAD).is_some());
        let mut bench = Bench::new(Plant { gain_error: -2.0, ..usual() });
        bench.servo.servo.full_us = -500.0;
        let arrival = turned(&mut bench, STEP_RAD);
        assert!(arrival.error_rad.abs() < 0.01, "told so it turns the right way: {arrival:?}");
    }

    #[test]
    fn a_shaft_turned_by_hand_goes_back_whichever_way_it_was_turned() {
        let mut bench = Bench::new(usual());
        turned(&mut bench, 0.0);
        for push_rad in [0.3, -0.3] {
            let mut pulse_us = 0.0;
            for _ in 0..20 {
                bench.plant.motor_rad += push_rad / 20.0;
                pulse_us = bench.tick(0.0);
            }
            assert!((pulse_us - 1500.0) * push_rad < 0.0, "pushed by {push_rad} rad, the pulse is {pulse_us} us");
            assert!(turned(&mut bench, 0.0).error_rad.abs() < 0.01);
        }
    }

    #[test]
    fn parameters_that_are_no_numbers_give_no_pulse_or_one_that_stands() {
        let shaft = ShaftParameters { slew_radps: f32::NAN, ..ShaftParameters::default() };
        let mut bench = Bench { servo: ServoLoop::new(&shaft, STEP_RAD), ..Bench::new(usual()) };
        assert!((0..50).all(|_| bench.tick(1.0) == 1500.0));
        let servo = ServoParameters { neutral_us: f32::NAN, ..ServoParameters::default() };
        let mut servo_loop = ServoLoop::new(&ShaftParameters { servo, ..ShaftParameters::default() }, STEP_RAD);
        servo_loop.advance(5_000);
        let aim = Aim { setpoint_rad: 1.0, angle_rad: 0.0, is_measured: true, speed_share: 1.0 };
        assert_eq!(servo_loop.step(5_000, aim), None);
    }
}
