//! What peers command and ask.

use adit_protocol::record::Failure;
use adit_protocol::tag::{CaptureState, CaptureTag, Ranges, TagFlags};

use super::*;

const ACCEPTED: u8 = 0;
const LATER: u8 = 1;
const DENIED: u8 = 2;
const UNSUPPORTED: u8 = 3;

/// Gives a command to one of our components; returns the answers' results.
fn give(link: &mut Link, to: Target, number: u16, first: [f32; 3], confirmation: u8) -> Vec<u8> {
    let parameters = [first[0], first[1], first[2], 0.0, 0.0, 0.0, 0.0];
    link.receive(0, Port::Autopilot, &ground().command(to, number, confirmation, &parameters));
    results(&said(link, 0))
}

#[test]
fn commands_are_answered_each_time_and_given_once() {
    let mut link = link();
    step(&mut link, 0, Mode::Ready, None);
    for confirmation in 0..3 {
        assert_eq!(give(&mut link, BOARD, 2000, [0.0; 3], confirmation), [ACCEPTED]);
    }
    assert_eq!(link.take_command(), Some(Command::Start));
    assert_eq!(link.take_command(), None);
    // For everybody, for another component, for another vehicle, and one that nobody knows.
    for target in [[3, 0], [3, 1], [4, 191]] {
        assert_eq!(give(&mut link, target, 400, [1.0, 0.0, 0.0], 0), []);
    }
    assert_eq!(give(&mut link, BOARD, 31_000, [1.0, 0.0, 0.0], 0), [UNSUPPORTED]);
    assert_eq!(link.take_command(), None);
}

#[test]
fn what_cannot_be_done_now_is_rejected_and_not_done() {
    let arm = (400, [1.0, 0.0, 0.0]);
    let start = (2000, [0.0; 3]);
    let restart = (246, [0.0, 1.0, 0.0]);
    let rows = [
        (Mode::Idle, arm, ACCEPTED),
        (Mode::Scanning, arm, LATER),
        (Mode::Ready, start, ACCEPTED),
        (Mode::Idle, start, LATER),
        (Mode::Scanning, restart, LATER),
        (Mode::Idle, restart, ACCEPTED),
        (Mode::Idle, (246, [1.0, 0.0, 0.0]), DENIED),
        (Mode::Idle, (400, [2.0, 0.0, 0.0]), DENIED),
    ];
    for (mode, (number, first), result) in rows {
        let mut link = link();
        step(&mut link, 0, mode, None);
        assert_eq!(give(&mut link, BOARD, number, first, 0), [result], "{number} in {mode:?}");
        let done = link.take_command().is_some() || link.take_restart();
        assert_eq!(done, result == ACCEPTED, "{number} in {mode:?}");
    }
}

#[test]
fn a_sensor_gets_its_address_only_while_the_board_is_idle() {
    let mut link = link();
    step(&mut link, 0, Mode::Scanning, None);
    assert_eq!(give(&mut link, BOARD, 31_010, [49.0, 50.0, 0.0], 0), [LATER]);
    assert_eq!(link.take_readdressing(), None);
    step(&mut link, 0, Mode::Idle, None);
    for nonsense in [[49.5, 50.0, 0.0], [49.0, 300.0, 0.0], [49.0, f32::NAN, 0.0], [0.0, 50.0, 0.0]] {
        assert_eq!(give(&mut link, BOARD, 31_010, nonsense, 0), [DENIED]);
        assert_eq!(link.take_readdressing(), None, "{nonsense:?}");
    }
    assert_eq!(give(&mut link, BOARD, 31_010, [49.0, 50.0, 0.0], 0), [ACCEPTED]);
    assert_eq!(link.take_readdressing(), Some(Readdressing { from: 49, to: 50 }));
    assert_eq!(link.take_readdressing(), None);
}

#[test]
fn components_say_what_they_are() {
    let mut link = link();
    step(&mut link, 0, Mode::Idle, None);
    let mut ask = |component, message: f32| {
        let parameters = [message, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0];
        link.receive(0, Port::Service, &ground().command([3, component], 512, 0, &parameters));
        frames(&mut link, 0).iter().map(|frame| (frame.component, frame.message)).collect::<Vec<_>>()
    };
    for (component, message) in [(191, 148), (100, 259), (100, 260), (100, 261), (100, 262)] {
        let answers = ask(component, message as f32);
        assert!(answers.contains(&(component, 77)) && answers.contains(&(component, message)), "{answers:?}");
    }
    assert_eq!(ask(191, 12_345.0).last(), Some(&(191, 77)));
}

fn tag(capture: u32, state: CaptureState) -> CaptureTag {
    CaptureTag {
        capture,
        state,
        time_us: 1_000_000,
        shaft_rad: 0.0,
        ranges: Ranges::default(),
        range_head_m: None,
        odometer_m: None,
        attitude_rad: None,
        offset_m: None,
        speed_mps: None,
        speed_limit_mps: None,
        flags: TagFlags::default(),
    }
}

fn captured(said: &[Incoming]) -> Vec<i32> {
    let index = |incoming: &Incoming| match incoming {
        Incoming::ImageCaptured { index, result: 1, .. } => Some(*index),
        _ => None,
    };
    said.iter().filter_map(index).collect()
}

#[test]
fn captures_are_told_when_their_fate_is_known_and_again_for_who_missed_them() {
    let mut parameters = parameters();
    parameters.shutter.wiring = adit_protocol::parameters::CaptureWiring::Confirm;
    let mut link = link_with(&parameters, Memory::default());
    step(&mut link, 0, Mode::Scanning, None);
    link.note_entry(&Entry::Tag(tag(1, CaptureState::Busy)));
    assert_eq!(captured(&said(&mut link, 0)), []);
    let confirmed = adit_protocol::record::TagUpdate { capture: 1, state: CaptureState::Confirmed, time_us: 0 };
    link.note_entry(&Entry::TagUpdate(confirmed));
    assert_eq!(captured(&said(&mut link, 0)), [0]);
    for (index, expected) in [(0.0, vec![0]), (5.0, vec![])] {
        link.receive(0, Port::Autopilot, &ground().command([3, 100], 512, 0, &[263.0, index, 0.0, 0.0, 0.0, 0.0, 0.0]));
        assert_eq!(captured(&said(&mut link, 0)), expected);
    }
}

#[test]
fn the_shutter_is_told_at_its_command_and_the_tag_goes_through_the_tunnel() {
    let mut link = link();
    step(&mut link, 0, Mode::Scanning, None);
    frames(&mut link, 0);
    let mut commanded = outputs(Mode::Scanning, None);
    commanded.display.captures = 1;
    link.note(5_000, &commanded, [None; 4], Diagnosis::default());
    link.note_entry(&Entry::Tag(tag(1, CaptureState::Commanded)));
    let sent = frames(&mut link, 5_000);
    // CAMERA_TRIGGER: time, number from 0.
    let trigger = sent.iter().find(|frame| frame.message == 112).expect("a trigger");
    assert_eq!((trigger.component, trigger.u64(0), trigger.u32(8)), (100, 5_000, 0));
    let tunnelled = sent.iter().filter_map(Incoming::read).find_map(|said| match said {
        Incoming::Tunnel { kind, payload, .. } => adit_protocol::telemetry::Tunnelled::read(kind, &payload),
        _ => None,
    });
    let expected = adit_protocol::telemetry::Tunnelled::Tag(tag(1, CaptureState::Commanded));
    assert_eq!(tunnelled, Some(expected));
}

#[test]
fn the_pilot_is_told_what_failed() {
    let mut link = link();
    step(&mut link, 0, Mode::SelfTest, None);
    for failure in Failure::ALL {
        said(&mut link, 0);
        link.note_entry(&Entry::Event(Event { time_us: 0, kind: EventKind::Failed(failure) }));
        assert_eq!(texts(&said(&mut link, 0)), [format!("failed: {}", failure.word())]);
    }
}
