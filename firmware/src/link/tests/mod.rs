//! Peers of the link in a few lines: an autopilot and a ground station of system 3, made of the same codec.

mod commands;
mod enforcement;
mod parameters;
mod security;
mod vehicle;

use adit_protocol::mavlink::{AUTOPILOT_COMPONENT, Incoming, OutFrame, RawFrame, Sender, Target, Value, VehicleBeat};
use adit_protocol::telemetry::Tunnelled;

use super::*;

/// `ArduPilot` in Auto.
const AUTO: VehicleBeat = VehicleBeat { autopilot: 3, base_mode: 0x81, custom_mode: 3 };
/// The board.
const BOARD: Target = [3, BOARD_COMPONENT];

fn autopilot() -> Sender {
    Sender::new(3, AUTOPILOT_COMPONENT)
}

fn ground() -> Sender {
    Sender::new(255, 190)
}

/// A link that has heard its autopilot; the axis lies to the north.
fn link() -> Link {
    link_with(&parameters(), Memory::default())
}

fn parameters() -> Parameters {
    let mut parameters = Parameters::default();
    parameters.link.axis_yaw_rad = Some(0.0);
    parameters
}

fn link_with(parameters: &Parameters, memory: Memory) -> Link {
    let mut link = Link::new(parameters, memory, 7);
    link.receive(0, Port::Autopilot, &autopilot().vehicle_heartbeat(AUTO));
    link
}

fn outputs(mode: Mode, limit_mps: Option<f32>) -> Outputs {
    Outputs { mode, speed_limit_mps: limit_mps, ..Outputs::default() }
}

fn step(link: &mut Link, now_us: u64, mode: Mode, limit_mps: Option<f32>) {
    link.note(now_us, &outputs(mode, limit_mps), [None; 4], Diagnosis::default());
}

/// Everything that is due at this moment.
fn frames(link: &mut Link, now_us: u64) -> Vec<RawFrame> {
    let sent: Vec<u8> = core::iter::from_fn(|| link.next_frame(now_us)).flat_map(|(_, frame)| frame).collect();
    decoded(&sent)
}

fn decoded(bytes: &[u8]) -> Vec<RawFrame> {
    let mut decoder = FrameDecoder::default();
    bytes.iter().filter_map(|byte| decoder.push(*byte)).collect()
}

/// What is due at this moment, as far as peers read it.
fn said(link: &mut Link, now_us: u64) -> Vec<Incoming> {
    frames(link, now_us).iter().filter_map(Incoming::read).collect()
}

fn texts(said: &[Incoming]) -> Vec<String> {
    let text = |incoming: &Incoming| match incoming {
        Incoming::Text { text, .. } => Some(text.to_string()),
        _ => None,
    };
    said.iter().filter_map(text).collect()
}

/// Results of answers to commands.
fn results(said: &[Incoming]) -> Vec<u8> {
    let result = |incoming: &Incoming| match incoming {
        Incoming::CommandAck { result, target: [255, 190], .. } => Some(*result),
        _ => None,
    };
    said.iter().filter_map(result).collect()
}

#[test]
fn a_stalled_controller_falls_silent() {
    let mut link = link();
    link.note(0, &outputs(Mode::Scanning, Some(0.3)), [Some(1.0); 4], Diagnosis::default());
    let later: Vec<RawFrame> = (0..400_u64).flat_map(|tick| frames(&mut link, 1_100_000 + tick * 5_000)).collect();
    assert!(later.iter().all(|frame| frame.message == 253), "only words that were waiting");
    assert!(later.len() < 3, "{} frames", later.len());
}

#[test]
fn a_faulty_sensors_last_reading_is_told_to_nobody_and_its_fault_at_once() {
    let ranges = |said: &[Incoming]| {
        let telemetry = said.iter().filter_map(|incoming| match incoming {
            Incoming::Tunnel { kind, payload, .. } => Tunnelled::read(*kind, payload),
            _ => None,
        });
        let boards =
            telemetry.filter_map(|told| if let Tunnelled::Telemetry(board) = told { Some(board) } else { None });
        boards.map(|board| board.ranges_m).next_back()
    };
    let mut link = link();
    let mut outputs = outputs(Mode::Scanning, Some(0.3));
    link.note(0, &outputs, [Some(1.5); 4], Diagnosis::default());
    let before: Vec<Incoming> = (0..20).flat_map(|tick| said(&mut link, tick * 5_000)).collect();
    assert_eq!(ranges(&before), Some([Some(1.5); 4]));
    outputs.display.range_faults.up = true;
    link.note(100_000, &outputs, [Some(1.5); 4], Diagnosis::default());
    let after: Vec<RawFrame> = (20..40).flat_map(|tick| frames(&mut link, tick * 5_000)).collect();
    let heard: Vec<Incoming> = after.iter().filter_map(Incoming::read).collect();
    assert_eq!(ranges(&heard), Some([None, Some(1.5), Some(1.5), Some(1.5)]));
    // DISTANCE_SENSOR: its orientation says where it looks, 24 is up.
    assert!(!after.iter().any(|frame| frame.message == 132 && frame.u8(12) == 24));
}

#[test]
fn a_minute_fits_a_radio_and_both_ports_get_it() {
    let mut link = link();
    let mut bytes = [0; 2];
    for tick in 0..12_000_u64 {
        let now_us = tick * 5_000;
        let mode = if tick % 200 < 100 { Mode::Scanning } else { Mode::Degraded };
        let limit_mps = Some((tick % 7) as f32 * 0.1);
        link.note(now_us, &outputs(mode, limit_mps), [Some(1.5); 4], Diagnosis::default());
        while let Some((ports, frame)) = link.next_frame(now_us) {
            for port in [Port::Autopilot, Port::Service].into_iter().filter(|port| ports.contains(*port)) {
                bytes[port as usize] += frame.len();
            }
        }
    }
    // 57,600 baud carry 5,760 bytes a second.
    for bytes in bytes {
        assert!((60 * 1000..60 * 4_000).contains(&bytes), "{} bytes a second", bytes / 60);
    }
}

#[test]
fn clocks_can_be_compared() {
    let mut link = link();
    step(&mut link, 2_000_000, Mode::Idle, None);
    frames(&mut link, 2_000_000);
    link.receive(2_000_000, Port::Service, &ground().time_sync(0, 77));
    let (ports, frame) = link.next_frame(2_000_000).expect("an answer");
    assert_eq!(ports, Ports::One(Port::Service));
    let answer = decoded(&frame).first().and_then(Incoming::read);
    assert_eq!(answer, Some(Incoming::TimeSync { answered_ns: 2_000_000_000, asked_ns: 77 }));
    // An answer is no question.
    link.receive(2_000_000, Port::Service, &ground().time_sync(5, 77));
    assert!(!said(&mut link, 2_000_000).iter().any(|said| matches!(said, Incoming::TimeSync { .. })));
}

#[test]
fn a_log_goes_to_who_asked_in_pieces_with_a_short_one_at_its_end() {
    let mut link = link();
    step(&mut link, 0, Mode::Idle, None);
    let log: Vec<u8> = (0..1000_u32).map(|at| at as u8).collect();
    link.receive(0, Port::Service, &ground().log_list(BOARD));
    link.receive(0, Port::Service, &ground().log_request(BOARD, 12, 100, 100_000));
    let (mut fetched, mut ended) = (Vec::new(), false);
    for tick in 0..400_u64 {
        let now_us = tick * 5_000;
        step(&mut link, now_us, Mode::Idle, None);
        if let Some(wish) = link.take_log_wish() {
            let LogWish::Read { number: 12, offset } = wish else { panic!("{wish:?}") };
            let rest = &log[(offset as usize).min(log.len())..];
            let bytes = LogBytes::from_slice(&rest[..rest.len().min(READ_BYTES)]).unwrap();
            link.hear_logs(wish, LogAnswer::Read(bytes));
        }
        for incoming in said(&mut link, now_us) {
            if let Incoming::LogData { id: 12, offset, data } = incoming {
                assert_eq!((offset as usize, ended), (100 + fetched.len(), false));
                ended = data.len() < 90;
                fetched.extend_from_slice(&data);
            }
        }
    }
    assert_eq!((fetched, ended), (log[100..].to_vec(), true));
}

#[test]
fn logs_are_listed_and_a_scan_comes_before_them() {
    let mut link = link();
    step(&mut link, 0, Mode::Idle, None);
    link.receive(0, Port::Service, &ground().log_list(BOARD));
    assert_eq!(link.take_log_wish(), Some(LogWish::List));
    assert_eq!(link.take_log_wish(), None, "one question at a time");
    let list = LogList::from_slice(&[(7, 100), (9, 200)]).unwrap();
    link.hear_logs(LogWish::List, LogAnswer::List(list));
    let entries: Vec<Incoming> =
        said(&mut link, 0).into_iter().filter(|said| matches!(said, Incoming::LogEntry { .. })).collect();
    let entry = |id, bytes| Incoming::LogEntry { id, count: 2, last: 9, bytes };
    assert_eq!(entries, [entry(7, 100), entry(9, 200)]);
    step(&mut link, 0, Mode::Scanning, None);
    link.receive(0, Port::Service, &ground().log_request(BOARD, 9, 0, 100));
    assert_eq!(link.take_log_wish(), None);
}

#[test]
fn a_card_that_failed_is_asked_again_when_somebody_asks_again() {
    let mut link = link();
    step(&mut link, 0, Mode::Idle, None);
    let read = LogWish::Read { number: 9, offset: 0 };
    let asks = [(ground().log_list(BOARD), LogWish::List), (ground().log_request(BOARD, 9, 0, 50), read)];
    for (ask, wish) in asks {
        link.receive(0, Port::Service, &ask);
        assert_eq!(link.take_log_wish(), Some(wish));
        link.hear_logs(wish, LogAnswer::Failed);
        // An end of the log, or an empty list, would be a lie.
        assert!(
            !said(&mut link, 0).iter().any(|said| matches!(said, Incoming::LogData { .. } | Incoming::LogEntry { .. }))
        );
        assert_eq!(link.take_log_wish(), None);
        link.receive(0, Port::Service, &ask);
        assert_eq!(link.take_log_wish(), Some(wish));
        link.hear_logs(wish, LogAnswer::Failed);
    }
    // The failure of what nobody wants any more changes nothing.
    link.receive(0, Port::Service, &ground().log_request(BOARD, 9, 0, 50));
    assert_eq!(link.take_log_wish(), Some(read));
    link.receive(0, Port::Service, &ground().log_request(BOARD, 12, 0, 50));
    link.hear_logs(read, LogAnswer::Failed);
    assert_eq!(link.take_log_wish(), Some(LogWish::Read { number: 12, offset: 0 }));
}
