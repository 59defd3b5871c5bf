//! Our frames against the crate's own reader, and the crate's frames, garbage around them, against our decoder.

use mavlink::dialects::common::{
    ATTITUDE_DATA, COMMAND_LONG_DATA, HEARTBEAT_DATA, LOCAL_POSITION_NED_DATA, MavCmd, MavMessage, MavSensorOrientation,
};
use mavlink::error::ParserError;
use mavlink::{MAVLinkV1MessageRaw, MAVLinkV2MessageRaw, MavHeader, MavlinkVersion, Message, MessageData};
use proptest::prelude::*;

use super::*;

const BASE_MODE: u8 = HEARTBEAT_DATA::DEFAULT.base_mode.bits();
use crate::beams::Beam;
use crate::record::Mode;

/// A frame as the crate writes it.
fn written(version: MavlinkVersion, message: &MavMessage) -> Vec<u8> {
    let header = MavHeader { system_id: 1, component_id: 1, sequence: 9 };
    if version == MavlinkVersion::V1 {
        let mut raw = MAVLinkV1MessageRaw::new();
        raw.serialize_message(header, message);
        return raw.raw_bytes().to_vec();
    }
    let mut raw = MAVLinkV2MessageRaw::new();
    raw.serialize_message(header, message);
    raw.raw_bytes().to_vec()
}

/// What the crate reads, header apart.
fn parsed(frame: &[u8]) -> (MAVLinkV2MessageRaw, Result<MavMessage, ParserError>) {
    let mut bytes = MAVLinkV2MessageRaw::new().into_inner();
    bytes[..frame.len()].copy_from_slice(frame);
    let raw = MAVLinkV2MessageRaw::from_bytes_unparsed(bytes);
    assert!(raw.has_valid_crc::<MavMessage>());
    let message = MavMessage::parse(MavlinkVersion::V2, raw.message_id(), raw.payload());
    (raw, message)
}

fn read(frame: &[u8]) -> MavMessage {
    parsed(frame).1.unwrap()
}

fn decoded(bytes: &[u8]) -> Vec<RawFrame> {
    let mut decoder = FrameDecoder::default();
    bytes.iter().filter_map(|byte| decoder.push(*byte)).collect()
}

fn attitude() -> MavMessage {
    MavMessage::ATTITUDE(ATTITUDE_DATA { roll: 0.1, pitch: -0.2, yaw: 3.0, ..ATTITUDE_DATA::DEFAULT })
}

#[test]
fn both_versions_of_what_peers_send_are_read() {
    let position = LOCAL_POSITION_NED_DATA { x: 1.5, y: -2.0, vx: 0.25, vz: -0.5, ..LOCAL_POSITION_NED_DATA::DEFAULT };
    let command = COMMAND_LONG_DATA {
        param1: 1.0,
        command: MavCmd::MAV_CMD_COMPONENT_ARM_DISARM,
        target_system: 1,
        target_component: 191,
        confirmation: 2,
        ..COMMAND_LONG_DATA::DEFAULT
    };
    let heartbeat = HEARTBEAT_DATA { custom_mode: 5, ..HEARTBEAT_DATA::DEFAULT };
    let messages = [
        (
            MavMessage::HEARTBEAT(heartbeat),
            Incoming::Heartbeat { kind: 0, autopilot: 0, base_mode: BASE_MODE, custom_mode: 5 },
        ),
        (attitude(), Incoming::Attitude { angles_rad: [0.1, -0.2, 3.0] }),
        (
            MavMessage::LOCAL_POSITION_NED(position),
            Incoming::LocalPosition { boot_ms: 0, position_m: [1.5, -2.0, 0.0], velocity_mps: [0.25, 0.0, -0.5] },
        ),
        (
            MavMessage::COMMAND_LONG(command),
            Incoming::Command {
                target: [1, 191],
                command: command::ARM_DISARM,
                confirmation: 2,
                parameters: [1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
            },
        ),
    ];
    for version in [MavlinkVersion::V1, MavlinkVersion::V2] {
        for (message, expected) in &messages {
            let frames = decoded(&written(version, message));
            let [frame] = &frames[..] else { panic!("{} frames", frames.len()) };
            assert_eq!((frame.system, frame.component, frame.sequence), (1, 1, 9));
            assert_eq!(Incoming::read(frame), Some(expected.clone()), "{version:?}");
        }
    }
}

#[test]
fn an_unknown_value_of_an_enum_costs_nothing() {
    let mut bytes = written(MavlinkVersion::V2, &MavMessage::HEARTBEAT(HEARTBEAT_DATA::DEFAULT));
    // An autopilot of next year.
    bytes[10 + 5] = 200;
    let end = bytes.len() - 2;
    let crc = mavlink::calculate_crc(&bytes[1..end], HEARTBEAT_DATA::EXTRA_CRC);
    bytes[end..].copy_from_slice(&crc.to_le_bytes());
    assert!(parsed(&bytes).1.is_err());
    let frames = decoded(&bytes);
    assert_eq!(
        Incoming::read(&frames[0])
            .map(|said| matches!(said, Incoming::Heartbeat { autopilot: 200, custom_mode: 0, .. })),
        Some(true)
    );
}

#[test]
fn peers_read_what_the_board_sends() {
    let mut sender = Sender::new(7, BOARD_COMPONENT);
    let text = heapless::String::try_from("log lost: the card is full").unwrap();
    let frames = [
        sender.heartbeat(Mode::Scanning),
        sender.change_speed([7, 1], 0, 0.25),
        sender.named_value(1234, "off_y", -0.1),
        sender.text(Severity::Warning, &text),
        sender.range(5, &RangeReport { beam: Beam::Left, range_m: 1.5, limits_m: [0.5, 15.0] }),
        sender.command_ack(command::ARM_DISARM, CommandResult::Accepted, [255, 190]),
    ];
    for (sequence, frame) in frames.iter().enumerate() {
        let (header, _) = parsed(frame);
        assert_eq!((header.system_id(), header.component_id(), usize::from(header.sequence())), (7, 191, sequence));
    }
    let MavMessage::HEARTBEAT(beat) = read(&frames[0]) else { panic!("no heartbeat") };
    assert_eq!(beat.custom_mode, 4);
    let MavMessage::COMMAND_LONG(speed) = read(&frames[1]) else { panic!("no command") };
    assert_eq!((speed.command, speed.param2, speed.target_system), (MavCmd::MAV_CMD_DO_CHANGE_SPEED, 0.25, 7));
    let MavMessage::STATUSTEXT(said) = read(&frames[3]) else { panic!("no text") };
    assert_eq!(said.text.to_str().unwrap(), "log lost: the card is full");
    let MavMessage::DISTANCE_SENSOR(range) = read(&frames[4]) else { panic!("no range") };
    assert_eq!((range.current_distance, range.orientation), (150, MavSensorOrientation::MAV_SENSOR_ROTATION_YAW_270));
    let MavMessage::COMMAND_ACK(ack) = read(&frames[5]) else { panic!("no answer") };
    assert_eq!(ack.command, MavCmd::MAV_CMD_COMPONENT_ARM_DISARM);
}

#[test]
fn a_message_that_no_dialect_here_has_is_laid_out_as_mavgen_does() {
    // pymavlink 2.4.50, `mavgen` over MAVLink's `development.xml`: SET_VELOCITY_LIMITS of 0.3 m/s, the others NaN.
    let expected = [
        0xFD, 0x0E, 0x00, 0x00, 0x00, 0x01, 0xBF, 0x62, 0x01, 0x00, 0x9A, 0x99, 0x99, 0x3E, 0x00, 0x00, 0xC0, 0x7F,
        0x00, 0x00, 0xC0, 0x7F, 0x01, 0x01, 0xBC, 0x6B,
    ];
    let frame = Sender::new(1, BOARD_COMPONENT).velocity_limits([1, 1], 0.3);
    assert_eq!(frame.as_slice(), expected);
    assert_eq!(decoded(&frame).len(), 1);
}

proptest! {
    #[test]
    fn every_sound_frame_in_any_garbage_is_found(
        pieces in proptest::collection::vec(proptest::collection::vec(any::<u8>(), 0..300), 1..6),
    ) {
        let frame = written(MavlinkVersion::V2, &attitude());
        let mut bytes = Vec::new();
        for piece in &pieces {
            bytes.extend_from_slice(piece);
            bytes.extend_from_slice(&frame);
        }
        // What looked like the start of a long frame is judged when that many bytes have come.
        bytes.extend_from_slice(&[0; MAX_FRAME_BYTES]);
        // One stretch of garbage in 65,536 has a CRC that fits, and may swallow a frame.
        let (found, lucky): (Vec<_>, Vec<_>) =
            decoded(&bytes).into_iter().partition(|frame| frame.message == ATTITUDE_DATA::ID);
        prop_assert!(found.len() == pieces.len() || !lucky.is_empty(), "{} of {}", found.len(), pieces.len());
    }

    #[test]
    fn a_cut_frame_does_not_cost_the_next(cut in 1_usize..30) {
        let frame = written(MavlinkVersion::V2, &attitude());
        let mut bytes = frame[..cut.min(frame.len() - 1)].to_vec();
        bytes.extend_from_slice(&frame);
        bytes.extend_from_slice(&[0; MAX_FRAME_BYTES]);
        prop_assert_eq!(decoded(&bytes).len(), 1);
    }
}
