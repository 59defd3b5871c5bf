//! Facts 3.1.

use super::*;

const BOTH: [Kind; 2] = [Kind::ArduPilot46, Kind::ArduPilot47];
const ACCEPTED: u8 = 0;
const DENIED: u8 = 2;
const FAILED: u8 = 4;

fn bench(kind: Kind, mode: &str) -> Bench {
    Bench::new(NamedAutopilot::new(kind), mode)
}

#[test]
fn a_speed_is_taken_in_auto_guided_and_rtl_and_fails_in_every_other_mode() {
    for kind in BOTH {
        for (_, mode) in kind.modes() {
            let takes = ["AUTO", "GUIDED", "RTL"].contains(mode);
            let mut bench = bench(kind, mode);
            let before_mps = bench.settled_mps();
            assert_eq!(bench.change_speed(0.4), if takes { ACCEPTED } else { FAILED }, "{} {mode}", kind.name());
            let after_mps = bench.settled_mps();
            assert!(if takes { (after_mps - 0.4).abs() < 1e-6 } else { after_mps == before_mps }, "{mode} {after_mps}");
        }
    }
}

#[test]
fn no_speed_and_a_negative_one_fail_in_4_6_and_are_denied_in_4_7() {
    for (kind, result) in BOTH.into_iter().zip([FAILED, DENIED]) {
        for mode in ["AUTO", "GUIDED", "LOITER"] {
            let mut bench = bench(kind, mode);
            assert_eq!([0.0, -1.0].map(|speed_mps| bench.change_speed(speed_mps)), [result; 2], "{mode}");
        }
    }
}

#[test]
fn a_speed_below_the_minimum_is_accepted_and_ignored() {
    for (kind, below_mps, above_mps) in [(Kind::ArduPilot46, 0.09, 0.11), (Kind::ArduPilot47, 0.009, 0.09)] {
        for mode in ["AUTO", "RTL"] {
            let mut bench = bench(kind, mode);
            assert_eq!((bench.change_speed(below_mps), bench.aim_mps()), (ACCEPTED, 10.0), "{mode}");
            assert_eq!(bench.change_speed(above_mps), ACCEPTED);
            assert!((bench.aim_mps() - f64::from(above_mps)).abs() < 1e-6);
        }
    }
}

#[test]
fn a_speed_is_lost_with_the_mode_and_does_not_come_back_with_it() {
    let mut bench = bench(Kind::ArduPilot46, "AUTO");
    bench.change_speed(0.4);
    bench.turn("LOITER");
    bench.turn("AUTO");
    assert_eq!(bench.aim_mps(), 10.0);
}

#[test]
fn a_speed_of_climbing_is_accepted_and_is_none_over_ground() {
    let mut bench = bench(Kind::ArduPilot46, "AUTO");
    let frame = bench.board.command(TO, 178, 0, &[2.0, 0.4, -1.0, 0.0, 0.0, 0.0, 0.0]);
    assert!(matches!(bench.ask(&frame)[..], [Incoming::CommandAck { result: ACCEPTED, .. }]));
    assert_eq!(bench.aim_mps(), 10.0);
}

#[test]
fn nothing_clips_a_commanded_speed_upwards() {
    let mut bench = bench(Kind::ArduPilot46, "AUTO");
    bench.change_speed(30.0);
    assert_eq!(bench.aim_mps(), 30.0);
}

#[test]
fn the_waypoint_speed_acts_at_once_unless_a_commanded_one_stands() {
    let mut bench = bench(Kind::ArduPilot46, "AUTO");
    bench.set("WPNAV_SPEED", Value::Real(70.0));
    assert!((bench.aim_mps() - 0.7).abs() < 1e-6);
    bench.change_speed(0.4);
    bench.set("WPNAV_SPEED", Value::Real(90.0));
    assert!((bench.aim_mps() - 0.4).abs() < 1e-6);
}

#[test]
fn another_target_in_guided_forgets_the_commanded_speed() {
    let mut bench = bench(Kind::ArduPilot46, "GUIDED");
    bench.change_speed(0.4);
    assert!((bench.aim_mps() - 0.4).abs() < 1e-6);
    bench.ask(&velocity_frame(1, [0.0, 0.0], 0b1101_1111_1000));
    assert_eq!(bench.aim_mps(), 10.0);
}

#[test]
fn a_commanded_velocity_in_guided_is_not_clipped_and_expires() {
    let mut bench = bench(Kind::ArduPilot46, "GUIDED");
    bench.change_speed(0.4);
    bench.ask(&velocity_frame(8, [2.5, 0.0], VELOCITY_ONLY));
    bench.change_speed(0.4);
    assert_eq!(bench.aim_mps(), 2.5);
    bench.wait(2.9);
    assert_eq!(bench.aim_mps(), 2.5);
    bench.wait(0.2);
    assert_eq!(bench.aim_mps(), 0.0);
}

#[test]
fn a_velocity_to_north_and_east_is_taken_along_the_axis() {
    let mut bench = bench(Kind::ArduPilot46, "GUIDED");
    bench.autopilot.say(0.0, &Seen { axis_yaw_rad: 1.0, ..Seen::default() });
    let (sin, cos) = 1.0_f32.sin_cos();
    bench.ask(&velocity_frame(1, [0.5 * cos, 0.5 * sin], VELOCITY_ONLY));
    assert!((bench.aim_mps() - 0.5).abs() < 1e-6);
}

#[test]
fn a_velocity_outside_guided_is_dropped_in_silence() {
    let mut bench = bench(Kind::ArduPilot46, "AUTO");
    assert_eq!(bench.ask(&velocity_frame(8, [2.5, 0.0], VELOCITY_ONLY)), []);
    assert_eq!(bench.aim_mps(), 10.0);
    bench.turn("GUIDED");
    assert_eq!(bench.aim_mps(), 10.0);
}

#[test]
fn a_frame_that_nobody_knows_and_not_a_number_stop_the_vehicle() {
    for nonsense in [velocity_frame(3, [0.5, 0.0], VELOCITY_ONLY), velocity_frame(8, [f32::NAN, 0.0], VELOCITY_ONLY)] {
        let mut bench = bench(Kind::ArduPilot46, "GUIDED");
        bench.ask(&nonsense);
        assert_eq!(bench.aim_mps(), 0.0);
    }
}

#[test]
fn the_stick_of_loiter_goes_as_far_as_its_parameter_and_no_lower_than_its_floor() {
    for (kind, name, unit) in [(Kind::ArduPilot46, "LOIT_SPEED", 100.0), (Kind::ArduPilot47, "LOIT_SPEED_MS", 1.0)] {
        let mut bench = bench(kind, "LOITER");
        assert_eq!(bench.settled_mps(), WISH_MPS);
        for (speed_mps, settles_mps) in [(0.5, 0.5), (0.3, 0.3), (0.1, 0.2)] {
            bench.set(name, Value::Real(speed_mps * unit));
            assert!((bench.settled_mps() - settles_mps).abs() < 1e-3, "{speed_mps}: {}", bench.settled_mps());
        }
    }
}

#[test]
fn loiter_overshoots_its_parameter_for_some_seconds() {
    let mut bench = bench(Kind::ArduPilot46, "LOITER");
    bench.set("LOIT_SPEED", Value::Real(50.0));
    let excess = |bench: &mut Bench| bench.aim_mps() / 0.5 - 1.0;
    assert!((excess(&mut bench) - 0.3).abs() < 1e-6);
    bench.wait(3.0);
    assert!((0.1..0.12).contains(&excess(&mut bench)), "{}", excess(&mut bench));
    bench.wait(12.0);
    assert!(excess(&mut bench) < 0.01);
}

#[test]
fn the_other_editions_names_are_unknown_and_get_no_answer() {
    let (mut old, mut new) = (bench(Kind::ArduPilot46, "LOITER"), bench(Kind::ArduPilot47, "LOITER"));
    assert_eq!((old.read("LOIT_SPEED"), old.read("LOIT_SPEED_MS")), (Some(Value::Real(1250.0)), None));
    assert_eq!((new.read("LOIT_SPEED"), new.read("LOIT_SPEED_MS")), (None, Some(Value::Real(12.5))));
    assert_eq!((old.read("WP_SPD"), new.read("WPNAV_SPEED")), (None, None));
    assert_eq!(old.set("LOIT_SPEED_MS", Value::Real(0.4)), []);
}

#[test]
fn not_a_number_and_infinity_are_dropped_in_silence_and_read_only_is_told() {
    let mut bench = bench(Kind::ArduPilot46, "LOITER");
    for value in [f32::NAN, f32::INFINITY] {
        assert_eq!(bench.set("LOIT_SPEED", Value::Real(value)), []);
    }
    let answer = bench.set("FORMAT_VERSION", Value::Whole(1));
    assert!(matches!(&answer[..], [Incoming::Text { text, .. }, Incoming::ParameterValue { .. }]
        if text.starts_with("Param write denied")));
    assert_eq!((bench.read("FORMAT_VERSION"), bench.autopilot.saves()), (Some(Value::Whole(120)), 0));
}

#[test]
fn a_parameter_is_saved_at_once_and_every_change_wears() {
    let mut bench = bench(Kind::ArduPilot46, "LOITER");
    for speed in [40.0, 40.0, 30.0] {
        bench.set("LOIT_SPEED", Value::Real(speed));
    }
    bench.autopilot.reboot(bench.now_s);
    bench.wait(BOOT_S);
    assert_eq!((bench.read("LOIT_SPEED"), bench.autopilot.saves()), (Some(Value::Real(30.0)), 2));
}

#[test]
fn whole_numbers_lie_in_a_single() {
    let mut bench = bench(Kind::ArduPilot46, "LOITER");
    let frame = bench.board.parameter_read(TO, "LOG_BITMASK");
    assert!(matches!(bench.ask(&frame)[..], [Incoming::ParameterValue { value, .. }]
        if f32::from_le_bytes(value.bytes) == 180_222.0));
}
