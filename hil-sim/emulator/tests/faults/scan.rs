//! Faults that the scan survives, or ends by in good order.

use adit_emulator::BoardFaultKind;
use adit_hil_sim::faults::{BeamName, FaultKind};
use adit_hil_sim::flight::Outcome;
use adit_hil_sim::sensors::range::RangeDefect;
use adit_protocol::beams::Beam;
use adit_protocol::parameters::RangeBus;
use adit_protocol::record::{EventKind, Failure, Mode, RangeFault};
use adit_protocol::tag::TagFlags;

use crate::common::{Case, Flown, board, fly, fly_with, is_log, parameters, world};

const BEAMS: [(Beam, BeamName); 4] = [
    (Beam::Up, BeamName::Up),
    (Beam::Right, BeamName::Right),
    (Beam::Down, BeamName::Down),
    (Beam::Left, BeamName::Left),
];

/// Fails unless sensors and shaft were served as if nothing had happened.
fn expect_undisturbed(flown: &Flown) {
    let disturbed = |kind: &EventKind| {
        matches!(kind, EventKind::RangeFault { .. } | EventKind::EncoderLost | EventKind::ShaftLate { .. })
            || matches!(kind, EventKind::LogLost | EventKind::Missed { .. })
    };
    let events: Vec<_> = flown.events().filter(|event| disturbed(&event.kind)).collect();
    assert!(events.is_empty(), "{events:?}");
    assert_eq!(flown.report.restarts, []);
    assert_eq!(flown.flight.presses_s.len(), flown.captures().len());
}

/// Breaks one sensor after the other, each for `for_s`, and expects the fault to be named within `within_s`.
fn each_sensor(defect: RangeDefect, fault: RangeFault, for_s: f64, within_s: f64) {
    // A recovery takes ten good samples: 0.2 s.
    let from_s = |index: usize| 4.0 + index as f64 * (for_s + 1.0);
    let faults = BEAMS.iter().enumerate().map(|(index, (_, beam))| {
        world(FaultKind::Range { beam: *beam, defect }, from_s(index), from_s(index) + for_s)
    });
    let flown = fly(&Case { world: faults.collect(), most_s: from_s(4) + 0.5, ..Case::default() });
    for (index, (beam, _)) in BEAMS.into_iter().enumerate() {
        let began_s = from_s(index);
        flown.expect(EventKind::RangeFault { beam, fault }, began_s, began_s + within_s);
        let recovered = flown.events().any(|event| {
            let at_s = event.time_us as f64 * 1e-6;
            event.kind == EventKind::RangeRecovered(beam) && at_s > began_s && at_s < began_s + for_s + 1.0
        });
        assert!(recovered, "{beam:?} did not recover");
    }
    assert_eq!(flown.report.restarts, []);
    // A photo a second, a little slower where the position is less sure.
    flown.expect_captures((4.0 * (for_s + 1.0) * 0.6) as usize);
}

#[test]
fn an_unplugged_range_sensor_is_named_and_comes_back() {
    // The bus answers nothing: silent after half a second.
    each_sensor(RangeDefect::Dead, RangeFault::Silent, 1.5, 1.2);
}

#[test]
fn a_range_sensor_stuck_at_zero_is_named_and_comes_back() {
    // Fifty zeros at 50 samples a second.
    each_sensor(RangeDefect::Zeros, RangeFault::Zeros, 2.0, 1.3);
}

#[test]
fn a_frozen_range_sensor_is_named_and_comes_back() {
    each_sensor(RangeDefect::Frozen, RangeFault::Frozen, 3.0, 2.3);
}

#[test]
fn a_bus_that_was_held_is_made_anew_and_everything_comes_back() {
    let case = Case { board: vec![board(BoardFaultKind::BusHeld, 5.0, 6.0)], most_s: 10.0, ..Case::default() };
    let flown = fly(&case);
    flown.expect(EventKind::EncoderLost, 5.0, 5.5);
    flown.expect(EventKind::EncoderRegained, 6.0, 6.5);
    for beam in Beam::ALL {
        flown.expect(EventKind::RangeFault { beam, fault: RangeFault::Silent }, 5.0, 5.8);
        flown.expect(EventKind::RangeRecovered(beam), 6.0, 7.0);
    }
    assert_eq!(flown.report.restarts, []);
    flown.expect_captures(5);
}

#[test]
fn a_silent_encoder_degrades_the_scan_and_marks_the_tags() {
    let flown = fly(&Case { world: vec![world(FaultKind::EncoderSilent, 4.0, 8.0)], most_s: 12.0, ..Case::default() });
    flown.expect(EventKind::EncoderLost, 4.0, 4.5);
    flown.expect(EventKind::Mode { from: Mode::Scanning, to: Mode::Degraded }, 4.0, 4.5);
    flown.expect(EventKind::EncoderRegained, 8.0, 8.5);
    flown.expect_captures(7);
    for tag in flown.log.tags() {
        let at_s = tag.time_us as f64 * 1e-6;
        if (4.3..8.0).contains(&at_s) || at_s > 8.3 {
            let commanded = tag.flags.contains(TagFlags::ANGLE_COMMANDED);
            assert_eq!(commanded, at_s < 8.0, "capture {} at {at_s} s", tag.capture);
        }
    }
}

#[test]
fn the_safety_switch_takes_servo_and_shutter_away_whatever_the_mode() {
    let flown =
        fly(&Case { board: vec![board(BoardFaultKind::SafetySwitch, 6.0, 7.0)], most_s: 8.0, ..Case::default() });
    let driven = |from_s: f64, to_s: f64| {
        let between = flown.pins.iter().filter(move |(at_s, _)| (from_s..to_s).contains(at_s));
        between.filter(|(_, pins)| pins.servo_pulse_us.is_some() || pins.shutter).count()
    };
    assert!(driven(5.0, 6.0) > 0, "it was not scanning");
    assert_eq!(driven(6.05, 7.0), 0);
    assert!(driven(7.05, 8.0) > 0, "not given back");
}

#[test]
fn a_stalled_servo_ends_in_fault_without_pulse_and_without_photos() {
    let flown = fly(&Case { world: vec![world(FaultKind::ServoStall, 5.0, 60.0)], most_s: 18.0, ..Case::default() });
    let failed_s = flown.when(EventKind::Failed(Failure::Shaft));
    assert!(failed_s < 16.0, "only after {failed_s} s");
    let after = flown.pins.iter().filter(|(at_s, _)| *at_s > failed_s + 0.05 && *at_s < failed_s + 1.5);
    for (at_s, pins) in after {
        assert!(pins.servo_pulse_us.is_none() && !pins.shutter, "{pins:?} at {at_s} s");
    }
}

#[test]
fn a_deaf_camera_stops_the_vehicle_and_ends_in_fault() {
    let flown = fly(&Case { world: vec![world(FaultKind::CameraDeaf, 5.0, 60.0)], most_s: 20.0, ..Case::default() });
    let failed_s = flown.when(EventKind::Failed(Failure::Camera));
    let at = |at_s: f64| flown.flight.moments.iter().find(|moment| moment.time_s >= at_s).expect("a moment");
    // From the last good photo on, the way that is left runs out.
    let way_m = at(failed_s).vehicle.position_m.x - at(5.0).vehicle.position_m.x;
    assert!(way_m < 0.25, "flew {way_m} m blind");
    assert_eq!(at(failed_s + 1.2).mode, Mode::Fault);
}

#[test]
fn tags_carry_the_boards_own_attitude_when_the_autopilots_is_missing() {
    let faults = vec![world(FaultKind::NavigationSilent, 6.0, 60.0)];
    let flown = fly(&Case { world: faults, most_s: 12.0, on_ground_until_s: 4.0, ..Case::default() });
    let late: Vec<_> = flown.log.tags().filter(|tag| tag.time_us > 7_500_000).collect();
    assert!(late.len() >= 3, "{} tags", late.len());
    for tag in late {
        let [roll, pitch, _] = tag.attitude_rad.expect("an attitude of our own");
        let time_s = tag.time_us as f64 * 1e-6;
        let moment = flown.flight.moments.iter().find(|moment| moment.time_s >= time_s).expect("a moment");
        let truth = moment.vehicle.attitude_rad;
        let error_rad = (f64::from(roll) - truth[0]).abs().max((f64::from(pitch) - truth[1]).abs());
        assert!(error_rad < 5_f64.to_radians(), "capture {}: {} degrees off", tag.capture, error_rad.to_degrees());
        assert_eq!((tag.odometer_m, tag.speed_mps), (None, None));
    }
}

#[test]
fn a_full_card_is_told_and_refused_by_the_self_test() {
    let case = Case { board: vec![board(BoardFaultKind::CardFull, 0.0, 60.0)], most_s: 10.0, ..Case::default() };
    let flown = fly(&case);
    flown.expect_text("log lost: the card is full");
    let modes: Vec<Mode> = flown.flight.moments.iter().map(|moment| moment.mode).collect();
    assert!(modes.contains(&Mode::Fault) && !modes.contains(&Mode::Scanning));
    assert_eq!(flown.flight.presses_s.len(), 0);
}

#[test]
fn a_card_that_was_pulled_and_put_back_loses_no_tag() {
    let case = Case { board: vec![board(BoardFaultKind::CardPulled, 5.0, 9.0)], most_s: 14.0, ..Case::default() };
    let flown = fly(&case);
    flown.expect_text("log lost");
    flown.expect_text("rotator: scanning, degraded");
    flown.expect(EventKind::LogLost, 5.0, 6.5);
    flown.expect(EventKind::LogRegained, 9.0, 11.0);
    let files = flown.report.files().expect("a volume");
    assert_eq!(files.keys().filter(|name| is_log(name)).count(), 2, "{:?}", files.keys());
    // The one that was being written when the card went may be in both files.
    let mut captures = flown.captures();
    captures.dedup();
    let numbers: Vec<u32> = (1..=captures.len() as u32).collect();
    assert_eq!(captures, numbers);
    assert!(captures.len() >= 10, "{} captures", captures.len());
    assert_eq!(flown.report.restarts, []);
}

#[test]
fn a_corrupt_fram_gives_defaults_and_says_so() {
    let case = Case { board: vec![board(BoardFaultKind::FramCorrupt, 0.0, 60.0)], most_s: 4.0, ..Case::default() };
    fly(&case).expect_text("default parameters: ");
}

#[test]
fn garbage_on_the_link_at_its_full_rate_costs_no_capture() {
    let garbage = vec![board(BoardFaultKind::TelemetryGarbage, 5.0, 9.0)];
    // Undisturbed it takes 29.6 s and 24 photos, and seconds more where the limit happens to be lower.
    let flown = fly(&Case { board: garbage, most_s: 33.0, ..Case::default() });
    assert_eq!(flown.flight.outcome, Outcome::Completed, "commands are obeyed again");
    expect_undisturbed(&flown);
    flown.expect_captures(23);
    // Two and a half seconds after the last heartbeat that came through.
    flown.expect(EventKind::AutopilotLost, 6.0, 8.0);
    let regained = flown.events().filter(|event| event.kind == EventKind::AutopilotRegained).nth(1);
    let regained_s = regained.map(|event| event.time_us as f64 * 1e-6);
    assert!(regained_s.is_some_and(|at_s| (9.0..10.2).contains(&at_s)), "heard again at {regained_s:?}");
}

#[test]
fn a_hostile_peer_at_the_links_full_rate_costs_no_capture_and_changes_nothing() {
    let flood = vec![board(BoardFaultKind::TelemetryFlood, 2.0, 60.0)];
    let case = Case { board: flood, key: Some([0x5A; 32]), most_s: 60.0, ..Case::default() };
    let flown = fly(&case);
    // Arm, start and stop came through the flood, signed; nobody else's orders did.
    assert_eq!(flown.flight.outcome, Outcome::Completed);
    expect_undisturbed(&flown);
    flown.expect_captures(24);
    assert!(!flown.events().any(|event| event.kind == EventKind::AutopilotLost), "the vehicle is heard through it");
    let kept = adit_emulator::parameters_in(&flown.report.fram).expect("a FRAM").expect("parameters");
    assert_eq!(kept.speed.margin, parameters().speed.margin);
    flown.expect_text("refused request of 254/190: ");
}

#[test]
fn without_a_key_a_hostile_peer_needs_none_which_is_why_there_are_keys() {
    let flood = vec![board(BoardFaultKind::TelemetryFlood, 5.0, 6.0)];
    let flown = fly(&Case { board: flood, most_s: 8.0, ..Case::default() });
    flown.expect(EventKind::Mode { from: Mode::Scanning, to: Mode::Idle }, 4.0, 5.5);
}

#[test]
fn range_sensors_on_a_hub_fly_the_scan_too() {
    let mut parameters = parameters();
    parameters.ranges.bus = RangeBus::Hub;
    parameters.ranges.port = adit_protocol::beams::Beams { up: 0, right: 1, down: 2, left: 3 };
    let flown = fly_with(&Case { most_s: 10.0, ..Case::default() }, &parameters);
    flown.expect_captures(6);
    assert!(flown.log.tags().all(|tag| tag.offset_m.is_some()));
    assert_eq!(flown.report.restarts, []);
}
