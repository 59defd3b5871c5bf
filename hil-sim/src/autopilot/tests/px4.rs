//! Facts 3.2.

use super::*;

const BOTH: [Kind; 2] = [Kind::Px4, Kind::Px4Development];
const ACCEPTED: u8 = 0;

fn bench(kind: Kind, mode: &str) -> Bench {
    Bench::new(NamedAutopilot::new(kind), mode)
}

fn limit(bench: &mut Bench, horizontal_mps: f32) {
    let frame = bench.board.velocity_limits(TO, horizontal_mps);
    assert_eq!(bench.ask(&frame), [], "there is no answer");
}

#[test]
fn a_speed_is_accepted_in_every_mode_and_acts_in_mission_and_hold_only() {
    for kind in BOTH {
        for (_, mode) in kind.modes() {
            let acts = ["MISSION", "HOLD"].contains(mode);
            let mut bench = bench(kind, mode);
            let before_mps = bench.aim_mps();
            assert_eq!(bench.change_speed(0.4), ACCEPTED, "{mode}");
            let after_mps = bench.aim_mps();
            assert!(if acts { (after_mps - 0.4).abs() < 1e-6 } else { after_mps == before_mps }, "{mode} {after_mps}");
        }
    }
}

#[test]
fn a_speed_is_lost_with_the_mode() {
    let mut bench = bench(Kind::Px4, "MISSION");
    bench.change_speed(0.4);
    for mode in ["RETURN", "MISSION"] {
        bench.turn(mode);
        assert_eq!(bench.aim_mps(), 5.0, "{mode}");
    }
}

#[test]
fn a_speed_is_no_higher_than_the_highest() {
    let mut bench = bench(Kind::Px4, "MISSION");
    bench.change_speed(30.0);
    assert_eq!(bench.aim_mps(), 12.0);
}

#[test]
fn velocity_limits_act_in_position_slow_of_development_builds_only() {
    for kind in BOTH {
        for (_, mode) in kind.modes() {
            let acts = kind == Kind::Px4Development && *mode == "POSITION SLOW";
            let mut bench = bench(kind, mode);
            let before_mps = bench.aim_mps();
            limit(&mut bench, 0.4);
            let after_mps = bench.aim_mps();
            assert!(if acts { (after_mps - 0.4).abs() < 1e-6 } else { after_mps == before_mps }, "{mode} {after_mps}");
        }
    }
}

#[test]
fn velocity_limits_have_a_floor_and_nothing_is_no_limit() {
    let mut bench = bench(Kind::Px4Development, "POSITION SLOW");
    limit(&mut bench, 0.1);
    assert!((bench.aim_mps() - 0.3).abs() < 1e-6);
    limit(&mut bench, f32::NAN);
    assert!((bench.aim_mps() - 0.3).abs() < 1e-6, "not a number changes nothing");
}

#[test]
fn velocity_limits_stand_until_the_mode_changes() {
    let mut bench = bench(Kind::Px4Development, "POSITION SLOW");
    limit(&mut bench, 0.4);
    bench.wait(600.0);
    assert!((bench.aim_mps() - 0.4).abs() < 1e-6);
    bench.turn("POSITION");
    bench.turn("POSITION SLOW");
    assert_eq!(bench.aim_mps(), WISH_MPS);
}

#[test]
fn velocity_limits_only_reduce_below_the_stick() {
    let mut bench = bench(Kind::Px4Development, "POSITION SLOW");
    bench.set("MPC_VEL_MANUAL", Value::Real(0.5));
    limit(&mut bench, 1.2);
    assert_eq!(bench.aim_mps(), 0.5);
}

#[test]
fn the_stick_of_position_goes_as_far_as_its_parameter_below_the_declared_minimum_too() {
    let mut bench = bench(Kind::Px4, "POSITION");
    assert_eq!(bench.aim_mps(), WISH_MPS);
    assert_eq!(bench.set("MPC_VEL_MANUAL", Value::Real(0.25)).len(), 1);
    assert_eq!(bench.aim_mps(), 0.25);
    assert_eq!(bench.autopilot.aim_mps(0.0, -1.0), -0.25, "-1 is that of the way forward");
}

#[test]
fn lowering_the_highest_speed_rewrites_the_others_for_good_and_says_so() {
    let mut bench = bench(Kind::Px4, "POSITION");
    let answer = bench.set("MPC_XY_VEL_MAX", Value::Real(0.4));
    assert_eq!(answer.iter().filter(|said| matches!(said, Incoming::Text { .. })).count(), 2);
    bench.set("MPC_XY_VEL_MAX", Value::Real(12.0));
    bench.wait(1.0);
    bench.autopilot.say(bench.now_s, &Seen::default());
    bench.autopilot.reboot(bench.now_s);
    bench.wait(BOOT_S);
    for name in ["MPC_XY_CRUISE", "MPC_VEL_MANUAL"] {
        assert_eq!(bench.read(name), Some(Value::Real(0.4)), "{name}");
    }
}

#[test]
fn a_parameter_is_saved_after_a_moment() {
    for (waits_s, kept) in [(0.1, 10.0), (0.4, 0.4)] {
        let mut bench = bench(Kind::Px4, "POSITION");
        bench.set("MPC_VEL_MANUAL", Value::Real(0.4));
        bench.wait(waits_s);
        bench.autopilot.reboot(bench.now_s);
        bench.wait(BOOT_S);
        assert_eq!(bench.read("MPC_VEL_MANUAL"), Some(Value::Real(kept)));
    }
}

#[test]
fn a_value_of_another_type_is_dropped_in_silence() {
    let mut bench = bench(Kind::Px4, "POSITION");
    assert_eq!(bench.set("MPC_VEL_MANUAL", Value::Whole(1)), []);
    assert_eq!(bench.set("SYS_AUTOSTART", Value::Real(1.0)), []);
    assert_eq!(bench.read("LOIT_SPEED"), None);
}

#[test]
fn whole_numbers_lie_byte_by_byte() {
    let mut bench = bench(Kind::Px4, "POSITION");
    let frame = bench.board.parameter_read(TO, "SYS_AUTOSTART");
    assert!(matches!(bench.ask(&frame)[..], [Incoming::ParameterValue { value, .. }]
        if i32::from_le_bytes(value.bytes) == 4050));
}

#[test]
fn offboard_flies_what_the_companion_sends_and_nothing_else_limits_it() {
    let mut bench = bench(Kind::Px4, "OFFBOARD");
    bench.change_speed(0.4);
    assert_eq!(bench.aim_mps(), WISH_MPS);
    bench.ask(&velocity_frame(8, [0.7, 0.0], VELOCITY_ONLY));
    assert!((bench.aim_mps() - 0.7).abs() < 1e-6);
    bench.wait(1.1);
    assert_eq!(bench.aim_mps(), WISH_MPS);
}
