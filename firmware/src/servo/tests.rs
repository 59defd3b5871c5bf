//! The loop on a servo of a few lines, with the errors that real ones have.

use core::f32::consts::TAU;

use adit_geometry::angles::wrap_turn;

use super::*;
use crate::shaft::{Shaft, Turn};

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
        let aim = Aim { setpoint_rad, angle_rad: self.estimate_rad, is_measured: self.has_encoder, speed_share: 1.0 };
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

#[test]
fn the_shaft_is_still_within_half_a_second_of_the_command() {
    for gain_error in [-0.1, 0.0, 0.1] {
        for neutral_error_us in [-8.0, 0.0, 8.0] {
            let mut plant = Plant { gain_error, neutral_error_us, dead_band_us: 4.0, ..usual() };
            let mut shaft = Shaft::new(ShaftParameters::default(), 10);
            let mut now_us = 0;
            for image in 1..=10 {
                shaft.turn_to(now_us, image);
                let began_us = now_us;
                let mut still_us = None;
                while now_us < began_us + 1_500_000 {
                    now_us += TICK_US;
                    shaft.observe(now_us, Some(wrap_turn(plant.read_rad())));
                    plant.turn(shaft.drive(now_us));
                    if still_us.is_none() && shaft.turn(now_us) == Turn::Still {
                        still_us = Some(now_us - began_us);
                    }
                }
                let still_us = still_us.expect("never still");
                assert!(
                    (250_000..=500_000).contains(&still_us),
                    "gain error {gain_error}, image {image}: {still_us} us"
                );
            }
        }
    }
}
