//! The controller flown through a world of a few lines: named scenarios, and properties for any inputs.

mod toy;

use std::collections::BTreeMap;

use adit_firmware::controller::Controller;
use adit_firmware::io::{CameraStatus, Command, Inputs, Outputs, RangeReading, RangeSample};
use adit_geometry::coverage::{Footprint, Scene, max_step};
use adit_protocol::beams::Beams;
use adit_protocol::parameters::{CaptureWiring, Parameters, SpeedBound};
use adit_protocol::record::{Entry, EventKind, Failure, MissReason, Mode};
use adit_protocol::tag::{CaptureState, TagFlags};
use proptest::prelude::*;
use toy::{Dice, Faults, TICK_US, Toy, parameters};

/// The exact bound on the step, in double precision, by the test's own call.
fn exact_step_m(parameters: &Parameters, radius_m: f64, offset_m: [f32; 2], views: u8) -> f64 {
    let camera = &parameters.camera;
    let camera = adit_geometry::camera::Camera {
        width_px: camera.width_px,
        height_px: camera.height_px,
        focal_px: camera.focal_px.map(f64::from),
        centre_px: camera.centre_px.map(f64::from),
        distortion: adit_geometry::camera::Distortion::BrownConrady([0.0; 5]),
    };
    let rig = adit_geometry::rig::Rig {
        images_per_turn: parameters.rig.images_per_turn,
        image_up: parameters.rig.image_up,
        lever_radial_m: f64::from(parameters.rig.lever_radial_m),
        lever_forward_m: 0.0,
        mount_rotvec_rad: [0.0; 3],
    };
    let profile = adit_geometry::profile::ProfileSpec::Circle { radius_m }.build().unwrap();
    let footprint = Footprint::of_camera(&camera, &rig, 0.0).unwrap();
    let scene = Scene::new(&profile, &footprint, &rig, offset_m.map(f64::from).into(), 0.0).unwrap();
    max_step(&scene, views).unwrap().per_image_m
}

/// Each capture has one tag and one only, and the numbers are 1, 2, 3, ...
fn assert_tags_are_complete(toy: &Toy) {
    let mut count: BTreeMap<u32, u32> = BTreeMap::new();
    for tag in toy.tags() {
        *count.entry(tag.capture).or_default() += 1;
    }
    let numbers: Vec<u32> = count.keys().copied().collect();
    let expected: Vec<u32> = (1..=toy.presses_us.len() as u32).collect();
    // The last one may still be on its way to its exposure.
    assert!(
        numbers == expected || numbers == expected[..expected.len().saturating_sub(1)],
        "{numbers:?} of {expected:?}"
    );
    assert!(count.values().all(|count| *count == 1));
}

#[test]
fn a_quiet_flight_goes_through_its_modes_and_photographs_every_angle() {
    let mut toy = Toy::new(parameters(SpeedBound::TwoViews), 1);
    toy.fly(60.0);
    let modes: Vec<Mode> = toy
        .events()
        .iter()
        .filter_map(|event| if let EventKind::Mode { to, .. } = event { Some(*to) } else { None })
        .collect();
    assert_eq!(modes, [Mode::Idle, Mode::SelfTest, Mode::Ready, Mode::Scanning]);
    assert_tags_are_complete(&toy);
    let tags = toy.tags();
    assert!(tags.len() > 30, "only {} photos in a minute", tags.len());
    for (earlier, later) in tags.iter().zip(tags.iter().skip(1)) {
        let step_rad = later.shaft_rad - earlier.shaft_rad;
        assert!((step_rad - core::f32::consts::TAU / 10.0).abs() < 0.02, "a step of {step_rad} rad");
        assert!(later.time_us > earlier.time_us);
    }
    for (tag, (x_m, shaft_rad)) in tags.iter().zip(&toy.photos) {
        assert!((tag.shaft_rad - shaft_rad).abs() < 0.02);
        assert!((tag.odometer_m.unwrap() - x_m).abs() < 0.02);
        assert_eq!(tag.flags, TagFlags::default());
        let [y_m, z_m] = tag.offset_m.unwrap();
        assert!((y_m - 0.05).abs() < 0.03 && (z_m + 0.03).abs() < 0.03);
    }
}

#[test]
fn no_two_photos_are_farther_apart_than_the_exact_bound() {
    for (bound, views) in [(SpeedBound::OneView, 1), (SpeedBound::TwoViews, 2)] {
        let parameters = parameters(bound);
        let exact_m = exact_step_m(&parameters, 1.5, [0.05, -0.03], views);
        let mut toy = Toy::new(parameters, 2);
        toy.fly(60.0);
        let steps_m: Vec<f64> =
            toy.photos.iter().zip(toy.photos.iter().skip(1)).map(|(a, b)| f64::from(b.0 - a.0)).collect();
        let largest_m = steps_m.iter().copied().fold(0.0, f64::max);
        assert!(largest_m <= exact_m, "{views} views: a step of {largest_m} m, the bound is {exact_m} m");
        // It would be easy to stay below by not flying.
        assert!(largest_m > 0.4 * exact_m, "{views} views: {largest_m} m of {exact_m} m");
    }
}

#[test]
fn a_missed_photo_is_repeated_at_its_angle_and_slows_the_flight() {
    for wiring in [CaptureWiring::Busy, CaptureWiring::Confirm] {
        let mut parameters = parameters(SpeedBound::TwoViews);
        parameters.shutter.wiring = wiring;
        // Enough that none is given up.
        parameters.shutter.retries = 6;
        let exact_m = exact_step_m(&parameters, 1.5, [0.05, -0.03], 2);
        let mut toy = Toy::new(parameters, 3);
        toy.faults = Faults {
            missed: 0.1,
            unstored: if wiring == CaptureWiring::Confirm { 0.1 } else { 0.0 },
            ..Faults::default()
        };
        toy.fly(200.0);
        assert_tags_are_complete(&toy);
        let missed = toy.events().iter().filter(|event| matches!(event, EventKind::Missed { retry: true, .. })).count();
        assert!(missed > 3, "{wiring:?}: {missed} missed");
        assert!(toy.tags().iter().any(|tag| tag.flags.contains(TagFlags::RETRY)));
        for (earlier, later) in toy.photos.iter().zip(toy.photos.iter().skip(1)) {
            assert!((later.1 - earlier.1 - core::f32::consts::TAU / 10.0).abs() < 0.02, "an angle was left out");
            assert!(f64::from(later.0 - earlier.0) <= exact_m, "{wiring:?}: a step of {} m", later.0 - earlier.0);
        }
    }
}

#[test]
fn states_move_on_as_far_as_the_camera_is_wired() {
    for wiring in [CaptureWiring::None, CaptureWiring::Busy, CaptureWiring::Confirm] {
        let mut parameters = parameters(SpeedBound::OneView);
        parameters.shutter.wiring = wiring;
        let mut toy = Toy::new(parameters, 4);
        toy.fly(30.0);
        let mut states: BTreeMap<u32, CaptureState> = BTreeMap::new();
        for entry in &toy.entries {
            match entry {
                Entry::Tag(tag) => drop(states.insert(tag.capture, tag.state)),
                Entry::TagUpdate(update) => drop(states.insert(update.capture, update.state)),
                _ => {}
            }
        }
        let expected = match wiring {
            CaptureWiring::None => CaptureState::Commanded,
            CaptureWiring::Busy => CaptureState::Busy,
            CaptureWiring::Confirm => CaptureState::Confirmed,
        };
        let last = states.keys().last().copied().unwrap();
        states.remove(&last);
        assert!(states.len() > 10);
        assert!(states.values().all(|state| *state == expected), "{wiring:?}: {states:?}");
    }
}

#[test]
fn a_dead_camera_ends_in_fault_with_the_vehicle_stopped() {
    let mut parameters = parameters(SpeedBound::OneView);
    parameters.shutter.wiring = CaptureWiring::Busy;
    let mut toy = Toy::new(parameters, 5);
    toy.faults.missed = 1.0;
    toy.fly(60.0);
    assert_eq!(toy.outputs.mode, Mode::Fault);
    assert_eq!(toy.outputs.speed_limit_mps, Some(0.0));
    assert!(toy.events().contains(&EventKind::Failed(Failure::Camera)));
    assert!(!toy.outputs.shutter && toy.outputs.light_level == 0.0);
    assert_tags_are_complete(&toy);
}

#[test]
fn a_jammed_shaft_is_found_by_the_self_test_or_in_flight() {
    let mut toy = Toy::new(parameters(SpeedBound::OneView), 6);
    toy.faults.jammed = true;
    toy.fly(20.0);
    assert_eq!(toy.outputs.mode, Mode::Fault);
    assert!(toy.events().contains(&EventKind::Failed(Failure::Shaft)));
    let mut toy = Toy::new(parameters(SpeedBound::OneView), 6);
    toy.fly(20.0);
    toy.faults.jammed = true;
    toy.fly(20.0);
    assert_eq!(toy.outputs.mode, Mode::Fault);
    assert!(toy.tags().iter().any(|tag| tag.flags.contains(TagFlags::SHAFT_MOVING)));
}

#[test]
fn without_position_the_flight_goes_on_at_the_worst_places_limit() {
    let parameters = parameters(SpeedBound::OneView);
    let corner_m = exact_step_m(&parameters, 1.5, [0.3, 0.3], 1);
    let mut toy = Toy::new(parameters, 7);
    toy.fly(20.0);
    let before_mps = toy.outputs.speed_limit_mps.unwrap();
    toy.faults.blind_after_s = Some(20.0);
    toy.fly(20.0);
    assert_eq!(toy.outputs.mode, Mode::Degraded);
    assert!(toy.events().contains(&EventKind::CentringLost));
    let tags = toy.tags();
    assert!(tags.last().unwrap().flags.contains(TagFlags::CENTRING_LOST));
    let photos = &toy.photos[toy.photos.len() - 5..];
    for (earlier, later) in photos.iter().zip(&photos[1..]) {
        assert!(f64::from(later.0 - earlier.0) <= corner_m);
    }
    assert!(toy.outputs.speed_limit_mps.unwrap() < before_mps);
}

#[test]
fn flying_too_fast_is_told_once_and_a_gust_is_not_told_at_all() {
    let mut toy = Toy::new(parameters(SpeedBound::TwoViews), 12);
    toy.fly(10.0);
    toy.faults.push_mps = 0.2;
    toy.fly(0.3);
    toy.faults.push_mps = 0.0;
    toy.fly(5.0);
    assert!(!toy.events().contains(&EventKind::OverspeedBegan));
    toy.faults.push_mps = 0.2;
    toy.fly(5.0);
    assert!(toy.outputs.display.overspeed);
    assert!(toy.tags().last().unwrap().flags.contains(TagFlags::OVERSPEED));
    toy.faults.push_mps = 0.0;
    toy.fly(10.0);
    let count = |kind| toy.events().iter().filter(|event| **event == kind).count();
    assert_eq!((count(EventKind::OverspeedBegan), count(EventKind::OverspeedEnded)), (1, 1));
}

#[test]
fn a_photo_that_was_not_stored_is_noticed_when_the_camera_falls_idle() {
    let mut parameters = parameters(SpeedBound::TwoViews);
    parameters.shutter.wiring = CaptureWiring::Confirm;
    let mut toy = Toy::new(parameters, 13);
    toy.faults.unstored = 1.0;
    while !toy.events().iter().any(|event| matches!(event, EventKind::Missed { .. })) {
        assert!(toy.now_us < 20_000_000, "never noticed");
        let inputs = toy.inputs();
        toy.give(&inputs);
    }
    let waited_us = toy.now_us - toy.presses_us[0];
    assert!(
        (1_100_000..1_400_000).contains(&waited_us),
        "busy for 0.7 s and 0.5 s of grace, noticed after {waited_us} us"
    );
    assert!(
        toy.events().iter().any(|event| matches!(event, EventKind::Missed { reason: MissReason::NeverConfirmed, .. }))
    );
}

#[test]
fn stopping_within_an_exposure_still_writes_its_tag() {
    let mut toy = Toy::new(parameters(SpeedBound::OneView), 8);
    while toy.presses_us.len() < 3 {
        let inputs = toy.inputs();
        toy.give(&inputs);
    }
    let inputs = Inputs { command: Some(Command::Stop), ..toy.inputs() };
    toy.give(&inputs);
    assert_eq!(toy.outputs.mode, Mode::Ready);
    assert!(!toy.outputs.shutter && toy.outputs.speed_limit_mps.is_none());
    assert_eq!(toy.tags().last().unwrap().capture, 3);
    // The next scan goes on counting.
    toy.fly(10.0);
    assert_tags_are_complete(&toy);
    assert!(toy.presses_us.len() > 5);
}

#[test]
fn a_photo_abandoned_by_a_stop_is_named() {
    let mut parameters = parameters(SpeedBound::OneView);
    parameters.shutter.wiring = CaptureWiring::Busy;
    let mut toy = Toy::new(parameters, 9);
    toy.fly(10.0);
    toy.faults.missed = 1.0;
    let presses = toy.presses_us.len();
    while toy.presses_us.len() == presses {
        let inputs = toy.inputs();
        toy.give(&inputs);
    }
    let inputs = Inputs { command: Some(Command::Disarm), ..toy.inputs() };
    toy.give(&inputs);
    for _ in 0..200 {
        let inputs = Inputs { command: None, ..toy.inputs() };
        toy.give(&inputs);
    }
    let abandoned =
        |event: &EventKind| matches!(event, EventKind::Missed { reason: MissReason::Abandoned, retry: false, .. });
    assert_eq!(toy.events().iter().filter(|event| abandoned(event)).count(), 1);
}

#[test]
fn numbers_continue_after_a_restart() {
    let mut toy = Toy::new(parameters(SpeedBound::OneView), 10);
    toy.controller = Controller::new(parameters(SpeedBound::OneView)).continuing_after(41);
    toy.fly(10.0);
    assert_eq!(toy.tags()[0].capture, 42);
}

#[test]
fn parameters_that_allow_no_scan_end_in_fault() {
    for spoil in [
        (|p| p.rig.images_per_turn = 0) as fn(&mut Parameters),
        |p| p.profile = adit_geometry::profile::ProfileSpec::Circle { radius_m: f32::NAN },
        |p| p.camera.focal_px = [f32::NAN; 2],
        |p| p.speed.offset_max_m = f32::NAN,
    ] {
        let mut parameters = parameters(SpeedBound::TwoViews);
        spoil(&mut parameters);
        let mut toy = Toy::new(parameters, 11);
        toy.fly(5.0);
        assert_eq!(toy.outputs.mode, Mode::Fault);
        assert_eq!(toy.outputs.speed_limit_mps, Some(0.0));
    }
}

/// A number as a broken sensor or link may deliver it.
fn wild(dice: &mut Dice) -> f32 {
    let odd = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, f32::MAX, f32::MIN, f32::MIN_POSITIVE, 0.0, -0.0, -1.0, 1e9];
    let index = (dice.share() * 16.0) as usize;
    odd.get(index).copied().unwrap_or_else(|| dice.share() * 10.0 - 5.0)
}

/// Spoils each part of the inputs with this chance.
fn spoil(inputs: &mut Inputs, dice: &mut Dice, share: f32) {
    let mut sample = |sample: RangeSample| {
        if !dice.chance(share) {
            return sample;
        }
        let reading = match (dice.share() * 5.0) as u8 {
            0 => RangeReading::TooClose,
            1 => RangeReading::TooFar,
            2 => RangeReading::CannotMeasure,
            3 => RangeReading::Disconnected,
            _ => RangeReading::Measured(wild(dice)),
        };
        RangeSample { reading, count: sample.count.wrapping_add((dice.share() * 3.0) as u32) }
    };
    let ranges = inputs.ranges;
    inputs.ranges = Beams {
        up: sample(ranges.up),
        right: sample(ranges.right),
        down: sample(ranges.down),
        left: sample(ranges.left),
    };
    inputs.head = sample(inputs.head);
    if dice.chance(share) {
        inputs.shaft_encoder_rad = dice.chance(0.5).then(|| wild(dice));
    }
    if dice.chance(share) {
        inputs.attitude_rad = Some([wild(dice), wild(dice), wild(dice)]);
    }
    if dice.chance(share) {
        inputs.odometer_m = Some(wild(dice));
    }
    if dice.chance(share) {
        inputs.speed_mps = dice.chance(0.5).then(|| wild(dice));
    }
    if dice.chance(share) {
        inputs.camera = CameraStatus { busy: dice.chance(0.5), photos_stored: (dice.share() * 1e9) as u32 };
    }
    if dice.chance(share * 0.1) {
        let commands = [Command::Arm, Command::Start, Command::Stop, Command::Disarm];
        inputs.command = commands.get((dice.share() * 5.0) as usize).copied();
    }
    if dice.chance(share) {
        inputs.autopilot_alive = !inputs.autopilot_alive;
    }
}

fn assert_servo_pulse_is_within_limits(outputs: &Outputs, parameters: &Parameters) {
    let driven = matches!(outputs.mode, Mode::SelfTest | Mode::Ready | Mode::Scanning | Mode::Degraded);
    let servo = &parameters.shaft.servo;
    if let Some(pulse_us) = outputs.servo_pulse_us {
        assert!(driven, "a pulse in mode {:?}", outputs.mode);
        assert!((pulse_us - servo.neutral_us).abs() <= servo.full_us.abs() * 1.0001, "{pulse_us} us");
    } else {
        let is_number = (servo.neutral_us.abs() + servo.full_us.abs()).is_finite();
        assert!(!driven || !is_number, "no pulse in mode {:?}", outputs.mode);
    }
}

fn assert_outputs_are_within_limits(outputs: &Outputs, parameters: &Parameters, best_step_m: f64) {
    assert!((0.0..=1.0).contains(&outputs.light_level));
    assert!(outputs.shaft_setpoint_rad.is_finite());
    assert_servo_pulse_is_within_limits(outputs, parameters);
    if let Some(limit_mps) = outputs.speed_limit_mps {
        assert!(limit_mps >= 0.0 && limit_mps <= parameters.speed.max_speed_mps);
        // No image comes faster than the shortest interval that the camera allows.
        let bound_mps = best_step_m / f64::from(parameters.shutter.min_interval_s);
        assert!(f64::from(limit_mps) <= bound_mps, "{limit_mps} m/s, bound {bound_mps} m/s");
    }
    assert_eq!(
        outputs.speed_limit_mps.is_some(),
        matches!(outputs.mode, Mode::Scanning | Mode::Degraded | Mode::Fault)
    );
    assert!(!outputs.shutter || matches!(outputs.mode, Mode::Scanning | Mode::Degraded));
    if let Some(centring) = outputs.centring {
        assert!(centring.offset_m.iter().chain(&centring.sigma_m).all(|value| value.is_finite()));
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(32))]

    #[test]
    fn any_inputs_give_outputs_within_limits(seed in any::<u64>(), share in 0f32..0.3, wiring in 0usize..3, jump in any::<bool>()) {
        let mut parameters = parameters(SpeedBound::OneView);
        parameters.shutter.wiring = [CaptureWiring::None, CaptureWiring::Busy, CaptureWiring::Confirm][wiring];
        let best_step_m = exact_step_m(&parameters, 1.5, [0.0; 2], 1) * 1.02;
        let mut toy = Toy::new(parameters.clone(), seed);
        toy.faults = Faults { missed: share * 0.3, unstored: share * 0.3, ..Faults::default() };
        let mut dice = Dice(seed ^ 0x5555);
        for _ in 0..4000 {
            let mut inputs = toy.inputs();
            spoil(&mut inputs, &mut dice, share * share);
            if jump && dice.chance(0.001) {
                toy.now_us = if dice.chance(0.5) { toy.now_us / 2 } else { toy.now_us + 3_000_000 };
            }
            toy.give(&inputs);
            assert_outputs_are_within_limits(&toy.outputs, &parameters, best_step_m);
        }
        // Whatever is queued comes out.
        for _ in 0..20 {
            toy.give(&Inputs { command: Some(Command::Disarm), ..Inputs::default() });
        }
        let mut tags: Vec<u32> = toy.tags().iter().map(|tag| tag.capture).collect();
        tags.sort_unstable();
        let expected: Vec<u32> = (1..=toy.outputs.display.captures).collect();
        prop_assert_eq!(tags, expected, "one tag per capture, none twice");
    }

    #[test]
    fn any_numbers_as_parameters_give_outputs_within_limits(seed in any::<u64>()) {
        let mut dice = Dice(seed);
        let mut parameters = parameters(SpeedBound::TwoViews);
        let p = &mut parameters;
        let numbers = [
            &mut p.speed.margin, &mut p.speed.latency_s, &mut p.speed.max_speed_mps, &mut p.speed.offset_max_m,
            &mut p.speed.image_period_s, &mut p.shaft.slew_radps, &mut p.shaft.settle_tolerance_rad,
            &mut p.shaft.settle_dwell_s, &mut p.shaft.turn_timeout_s, &mut p.shutter.trigger_latency_s,
            &mut p.shutter.trigger_latency_max_s, &mut p.shutter.exposure_s, &mut p.shutter.pulse_s,
            &mut p.shutter.busy_timeout_s, &mut p.shutter.confirm_timeout_s, &mut p.shutter.light_level,
            &mut p.shutter.light_lead_s, &mut p.shutter.min_interval_s, &mut p.ranges.sigma_m, &mut p.ranges.min_m,
            &mut p.ranges.max_m, &mut p.ranges.stale_s, &mut p.ranges.jump_m, &mut p.log.sample_period_s,
            &mut p.rig.lever_radial_m, &mut p.camera.focal_px[0], &mut p.camera.centre_px[1],
            &mut p.shaft.servo.neutral_us, &mut p.shaft.servo.full_us, &mut p.shaft.servo.acceleration_radps2,
            &mut p.shaft.servo.slowest_radps,
        ];
        for number in numbers {
            if dice.chance(0.15) {
                *number = wild(&mut dice);
            }
        }
        let mut toy = Toy::new(parameters.clone(), seed);
        for _ in 0..1500 {
            let inputs = toy.inputs();
            toy.give(&inputs);
            prop_assert!((0.0..=1.0).contains(&toy.outputs.light_level));
            prop_assert!(toy.outputs.speed_limit_mps.is_none_or(|limit_mps| limit_mps >= 0.0));
            prop_assert!(toy.outputs.shaft_setpoint_rad.is_finite());
            assert_servo_pulse_is_within_limits(&toy.outputs, &parameters);
        }
        prop_assert!(toy.now_us == 1500 * TICK_US);
    }
}
