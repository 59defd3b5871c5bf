//! What both autopilots do alike.

use super::*;

fn streams_of(autopilot: &mut NamedAutopilot, seen: &Seen, from_s: f64) -> Vec<RawFrame> {
    (0..200).flat_map(|step| frames(&autopilot.say(from_s + f64::from(step) * 0.005, seen))).collect()
}

#[test]
fn a_second_of_streams_has_each_as_often_as_it_should() {
    for kind in Kind::ALL {
        let mut autopilot = NamedAutopilot::new(kind);
        let frames = streams_of(&mut autopilot, &Seen::default(), 0.0);
        let count = |message| frames.iter().filter(|frame| frame.message == message).count();
        assert_eq!([0, 30, 32, 74].map(count), [1, 50, 20, 5], "{}", kind.name());
    }
}

#[test]
fn the_vehicle_is_told_in_the_frame_of_the_earth() {
    let mut autopilot = NamedAutopilot::new(Kind::Px4);
    let seen = Seen { attitude_rad: [0.01, 0.02, 0.1], place_m: 2.0, speed_mps: 0.5, axis_yaw_rad: 1.0 };
    let told: Vec<Incoming> = frames(&autopilot.say(0.0, &seen)).iter().filter_map(Incoming::read).collect();
    let near = |told: &[f32], expected: &[f32]| told.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-6);
    let (sin, cos) = 1.0_f32.sin_cos();
    assert!(matches!(told[0], Incoming::Heartbeat { autopilot: 12, base_mode: 129, custom_mode: 0x30000, .. }));
    assert!(matches!(told[1], Incoming::Attitude { angles_rad } if near(&angles_rad, &[0.01, 0.02, 1.1])));
    assert!(matches!(told[2], Incoming::LocalPosition { position_m, velocity_mps, .. }
        if near(&position_m, &[2.0 * cos, 2.0 * sin]) && near(&velocity_mps, &[0.5 * cos, 0.5 * sin])));
    assert!(matches!(told[3], Incoming::HeadUp { ground_speed_mps: 0.5 }));
}

#[test]
fn after_a_reset_it_is_silent_and_deaf_and_then_begins_anew_in_the_mode_of_its_switch() {
    let mut bench = Bench::new(NamedAutopilot::new(Kind::ArduPilot46), "AUTO");
    bench.change_speed(0.4);
    bench.autopilot.reboot(10.0);
    assert!(streams_of(&mut bench.autopilot, &Seen::default(), 10.0).is_empty());
    bench.now_s = 12.0;
    let command = bench.board.change_speed(TO, 0, 0.4);
    assert_eq!((bench.ask(&command), bench.aim_mps()), (vec![], 0.0));
    bench.now_s = 13.0;
    let told = bench.autopilot.say(13.0, &Seen::default());
    let first =
        frames(&told).iter().filter_map(Incoming::read).find(|said| matches!(said, Incoming::LocalPosition { .. }));
    assert!(matches!(first, Some(Incoming::LocalPosition { boot_ms: 3000, .. })));
    assert_eq!((bench.aim_mps(), bench.autopilot.mode()), (10.0, 3));
}

#[test]
fn all_parameters_come_when_they_are_listed() {
    for kind in Kind::ALL {
        let mut autopilot = NamedAutopilot::new(kind);
        autopilot.hear(0.0, &Sender::new(255, 190).parameter_list([SYSTEM, 0]));
        let names: Vec<String> = streams_of(&mut autopilot, &Seen::default(), 0.0)
            .iter()
            .filter_map(|frame| match Incoming::read(frame) {
                Some(Incoming::ParameterValue { name: Some(name), .. }) => Some(name.to_string()),
                _ => None,
            })
            .collect();
        assert_eq!(names.len(), autopilot.parameters().len());
        assert!(autopilot.parameters().keys().all(|name| names.iter().any(|told| told == name)), "{names:?}");
    }
}

#[test]
fn what_is_for_another_is_not_heard() {
    let mut bench = Bench::new(NamedAutopilot::new(Kind::ArduPilot46), "AUTO");
    for target in [[SYSTEM, 191], [2, 1], [0, 100]] {
        let frame = bench.board.change_speed(target, 0, 0.4);
        assert_eq!(bench.ask(&frame), [], "{target:?}");
    }
    let frame = bench.board.change_speed([SYSTEM, 0], 0, 0.4);
    assert_eq!(bench.ask(&frame).len(), 1);
}

#[test]
fn modes_are_set_from_the_ground_by_either_message() {
    let mut bench = Bench::new(NamedAutopilot::new(Kind::ArduPilot46), "LOITER");
    let frame = bench.board.command(TO, 176, 0, &[1.0, 3.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
    assert!(matches!(bench.ask(&frame)[..], [Incoming::CommandAck { result: 0, .. }]));
    assert_eq!(bench.autopilot.mode(), 3);
    bench.ask(&sealed(11, &[6, 0, 0, 0, SYSTEM, 1], 89));
    assert_eq!(bench.autopilot.mode(), 6);
    let frame = bench.board.command(TO, 176, 0, &[1.0, 99.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
    assert!(matches!(bench.ask(&frame)[..], [Incoming::CommandAck { result: 4, .. }]));
    let mut bench = Bench::new(NamedAutopilot::new(Kind::Px4), "POSITION");
    let frame = bench.board.command(TO, 176, 0, &[1.0, 4.0, 4.0, 0.0, 0.0, 0.0, 0.0]);
    bench.ask(&frame);
    assert_eq!(bench.autopilot.mode(), 4 << 16 | 4 << 24);
}

#[test]
fn zero_is_a_hover_in_every_mode() {
    for kind in Kind::ALL {
        for (number, mode) in kind.modes() {
            let mut autopilot = NamedAutopilot::new(kind);
            autopilot.set_mode(*number);
            assert_eq!(autopilot.aim_mps(0.0, 0.0), 0.0, "{} {mode}", kind.name());
        }
    }
}

#[test]
fn any_bytes_leave_it_speaking() {
    for kind in Kind::ALL {
        let mut autopilot = NamedAutopilot::new(kind);
        let garbage: Vec<u8> = (0..5000_u32).map(|index| (index.wrapping_mul(2_654_435_761) >> 24) as u8).collect();
        autopilot.hear(0.0, &garbage);
        assert!(!autopilot.say(0.0, &Seen::default()).is_empty());
    }
}
