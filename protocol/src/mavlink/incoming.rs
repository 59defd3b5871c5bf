//! What peers say, read field by field at its offset on the wire.
//!
//! Fields lie on the wire by falling size (mavlink.io, "Field Reordering"); offsets below follow from `common.xml`. An
//! unknown value of an enumeration is a number like any other.

use super::value::{NAME_BYTES, Name, RawValue, name};
use super::{Key, RawFrame};

/// Bytes of a piece of a log file, `LOG_DATA`.
pub const LOG_BYTES: usize = 90;
/// Bytes that a tunnelled message carries at most, `TUNNEL`.
pub const TUNNEL_BYTES: usize = 128;

/// Whom a message is for: system and component, 0 is everybody.
pub type Target = [u8; 2];

/// What a peer says.
#[derive(Clone, Debug, PartialEq)]
pub enum Incoming {
    /// Somebody lives.
    Heartbeat {
        /// `MAV_TYPE`.
        kind: u8,
        /// `MAV_AUTOPILOT`; [`super::NO_AUTOPILOT`] for what is none.
        autopilot: u8,
        /// `MAV_MODE_FLAG`; bit 7 is armed.
        base_mode: u8,
        /// The sender's own number of its mode.
        custom_mode: u32,
    },
    /// Attitude of the vehicle.
    Attitude {
        /// Roll, pitch, yaw.
        angles_rad: [f32; 3],
    },
    /// Place and velocity of the vehicle against its start.
    LocalPosition {
        /// Since the sender's start.
        boot_ms: u32,
        /// North, east, down.
        position_m: [f32; 3],
        /// North, east, down.
        velocity_mps: [f32; 3],
    },
    /// Place and velocity with what they are worth.
    Odometry {
        /// `MAV_FRAME` of the place.
        frame: u8,
        /// `MAV_FRAME` of the velocity.
        child_frame: u8,
        /// In that frame.
        position_m: [f32; 3],
        /// Of the body against the frame of the place, w first.
        rotation: [f32; 4],
        /// In the child frame.
        velocity_mps: [f32; 3],
        /// Counts jumps of the estimate.
        resets: u8,
        /// Per cent; 0 is unknown, negative is failed.
        quality: i8,
    },
    /// The head-up display's figures, as far as they matter here.
    HeadUp {
        /// Over ground, without a direction.
        ground_speed_mps: f32,
    },
    /// Somebody wants a parameter.
    ParameterRead {
        /// Whom it is for.
        target: Target,
        /// Which, if not by its name.
        index: i16,
        /// Which, if the index is -1.
        name: Option<Name>,
    },
    /// Somebody wants all parameters.
    ParameterList {
        /// Whom it is for.
        target: Target,
    },
    /// Somebody wants a parameter changed.
    ParameterSet {
        /// Whom it is for.
        target: Target,
        /// Which.
        name: Option<Name>,
        /// To what.
        value: RawValue,
    },
    /// A parameter's value.
    ParameterValue {
        /// Which.
        name: Option<Name>,
        /// What it is.
        value: RawValue,
        /// How many the sender has.
        count: u16,
        /// Which of them this is.
        index: u16,
    },
    /// Somebody wants something.
    Command {
        /// Whom it is for.
        target: Target,
        /// What, as a plain number.
        command: u16,
        /// How often it was repeated.
        confirmation: u8,
        /// The seven parameters.
        parameters: [f32; 7],
    },
    /// The answer to a command.
    CommandAck {
        /// Which.
        command: u16,
        /// `MAV_RESULT`, as a plain number.
        result: u8,
        /// Who had asked; zeros if the sender does not tell.
        target: Target,
    },
    /// Clocks are compared.
    TimeSync {
        /// The answering clock, 0 in a question.
        answered_ns: i64,
        /// The asking clock.
        asked_ns: i64,
    },
    /// Words for people.
    Text {
        /// `MAV_SEVERITY`: 0 is an emergency, 7 is for developers.
        severity: u8,
        /// The words.
        text: heapless::String<50>,
    },
    /// A figure with a name.
    NamedValue {
        /// Which.
        name: heapless::String<10>,
        /// What it is.
        value: f32,
    },
    /// A new key.
    SetupSigning {
        /// Whom it is for.
        target: Target,
        /// The key; zeros for none.
        key: Key,
        /// The asker's time.
        time: u64,
    },
    /// A message that only the two ends understand.
    Tunnel {
        /// Whom it is for.
        target: Target,
        /// What it is.
        kind: u16,
        /// It.
        payload: heapless::Vec<u8, TUNNEL_BYTES>,
    },
    /// What logs are there?
    LogList {
        /// Whom it is for.
        target: Target,
        /// First that is wanted.
        first: u16,
        /// Last that is wanted.
        last: u16,
    },
    /// A log that is there.
    LogEntry {
        /// Its number.
        id: u16,
        /// How many there are.
        count: u16,
        /// The newest.
        last: u16,
        /// Its length.
        bytes: u32,
    },
    /// A stretch of a log is wanted.
    LogRequest {
        /// Whom it is for.
        target: Target,
        /// Which log.
        id: u16,
        /// From where.
        offset: u32,
        /// How much.
        count: u32,
    },
    /// A piece of a log.
    LogData {
        /// Which log.
        id: u16,
        /// From where.
        offset: u32,
        /// The piece; empty beyond the end.
        data: heapless::Vec<u8, LOG_BYTES>,
    },
    /// No more of a log.
    LogEnd {
        /// Whom it is for.
        target: Target,
    },
    /// What a component is.
    Version {
        /// `MAV_PROTOCOL_CAPABILITY`.
        capabilities: u64,
        /// Its number among all chips.
        uid: u64,
        /// Major, minor, patch, kind.
        version: [u8; 4],
    },
    /// A photo was taken, or not.
    ImageCaptured {
        /// Counts from 0.
        index: i32,
        /// Since the sender's start.
        boot_ms: u32,
        /// 1 if there is a photo.
        result: u8,
    },
}

impl Incoming {
    /// Reads a frame; `None` if nobody here has a use for its message.
    pub fn read(frame: &RawFrame) -> Option<Self> {
        vehicle(frame).or_else(|| parameters(frame)).or_else(|| services(frame))
    }
}

fn three(frame: &RawFrame, offset: usize) -> [f32; 3] {
    [frame.f32(offset), frame.f32(offset + 4), frame.f32(offset + 8)]
}

/// What a vehicle says of itself.
fn vehicle(frame: &RawFrame) -> Option<Incoming> {
    Some(match frame.message {
        // HEARTBEAT: custom_mode, type, autopilot, base_mode, ...
        0 => Incoming::Heartbeat {
            custom_mode: frame.u32(0),
            kind: frame.u8(4),
            autopilot: frame.u8(5),
            base_mode: frame.u8(6),
        },
        // ATTITUDE: time, roll, pitch, yaw, ...
        30 => Incoming::Attitude { angles_rad: three(frame, 4) },
        // LOCAL_POSITION_NED: time, x, y, z, vx, vy, vz.
        32 => Incoming::LocalPosition {
            boot_ms: frame.u32(0),
            position_m: three(frame, 4),
            velocity_mps: three(frame, 16),
        },
        // VFR_HUD: airspeed, groundspeed, ...
        74 => Incoming::HeadUp { ground_speed_mps: frame.f32(4) },
        // ODOMETRY: time, place, q, velocity, rates, two covariances, frame, child frame, resets, estimator, quality.
        331 => Incoming::Odometry {
            position_m: three(frame, 8),
            rotation: [frame.f32(20), frame.f32(24), frame.f32(28), frame.f32(32)],
            velocity_mps: three(frame, 36),
            frame: frame.u8(228),
            child_frame: frame.u8(229),
            resets: frame.u8(230),
            quality: frame.u8(232).cast_signed(),
        },
        // STATUSTEXT: severity, text, ...
        253 => Incoming::Text { severity: frame.u8(0), text: words(&frame.bytes::<50>(1)) },
        // NAMED_VALUE_FLOAT: time, value, name.
        251 => Incoming::NamedValue { value: frame.f32(4), name: words(&frame.bytes::<10>(8)) },
        _ => return None,
    })
}

fn parameters(frame: &RawFrame) -> Option<Incoming> {
    let name_at = |offset| name(frame.bytes::<NAME_BYTES>(offset));
    Some(match frame.message {
        // PARAM_REQUEST_READ: index, target, name.
        20 => Incoming::ParameterRead { index: frame.u16(0).cast_signed(), target: frame.bytes(2), name: name_at(4) },
        // PARAM_REQUEST_LIST: target.
        21 => Incoming::ParameterList { target: frame.bytes(0) },
        // PARAM_VALUE: value, count, index, name, type.
        22 => Incoming::ParameterValue {
            value: RawValue { bytes: frame.bytes(0), kind: frame.u8(24) },
            count: frame.u16(4),
            index: frame.u16(6),
            name: name_at(8),
        },
        // PARAM_SET: value, target, name, type.
        23 => Incoming::ParameterSet {
            value: RawValue { bytes: frame.bytes(0), kind: frame.u8(22) },
            target: frame.bytes(4),
            name: name_at(6),
        },
        _ => return None,
    })
}

fn services(frame: &RawFrame) -> Option<Incoming> {
    Some(match frame.message {
        // COMMAND_LONG: seven parameters, command, target, confirmation.
        76 => Incoming::Command {
            parameters: core::array::from_fn(|index| frame.f32(index * 4)),
            command: frame.u16(28),
            target: frame.bytes(30),
            confirmation: frame.u8(32),
        },
        // COMMAND_ACK: command, result, progress, result_param2, target.
        77 => Incoming::CommandAck { command: frame.u16(0), result: frame.u8(2), target: frame.bytes(8) },
        // TIMESYNC: tc1, ts1.
        111 => Incoming::TimeSync { answered_ns: frame.u64(0).cast_signed(), asked_ns: frame.u64(8).cast_signed() },
        // LOG_REQUEST_LIST: start, end, target.
        117 => Incoming::LogList { first: frame.u16(0), last: frame.u16(2), target: frame.bytes(4) },
        // LOG_ENTRY: time, size, id, number of logs, last number.
        118 => Incoming::LogEntry { bytes: frame.u32(4), id: frame.u16(8), count: frame.u16(10), last: frame.u16(12) },
        // LOG_REQUEST_DATA: offset, count, id, target.
        119 => Incoming::LogRequest {
            offset: frame.u32(0),
            count: frame.u32(4),
            id: frame.u16(8),
            target: frame.bytes(10),
        },
        // LOG_DATA: offset, id, count, data.
        120 => Incoming::LogData {
            offset: frame.u32(0),
            id: frame.u16(4),
            data: stretch(&frame.bytes::<LOG_BYTES>(7), frame.u8(6)),
        },
        // LOG_REQUEST_END: target.
        122 => Incoming::LogEnd { target: frame.bytes(0) },
        // AUTOPILOT_VERSION: capabilities, uid, version, ...
        148 => {
            Incoming::Version { capabilities: frame.u64(0), uid: frame.u64(8), version: frame.u32(16).to_be_bytes() }
        }
        // SETUP_SIGNING: time, target, key.
        256 => Incoming::SetupSigning { time: frame.u64(0), target: frame.bytes(8), key: Key(frame.bytes(10)) },
        // CAMERA_IMAGE_CAPTURED: utc, boot time, place, attitude, index, camera, result, address.
        263 => {
            Incoming::ImageCaptured { boot_ms: frame.u32(8), index: frame.u32(44).cast_signed(), result: frame.u8(49) }
        }
        // TUNNEL: type, target, length, payload.
        385 => Incoming::Tunnel {
            kind: frame.u16(0),
            target: frame.bytes(2),
            payload: stretch(&frame.bytes::<TUNNEL_BYTES>(5), frame.u8(4)),
        },
        _ => return None,
    })
}

/// The bytes up to a length that the sender gives, which is not believed beyond the field.
fn stretch<const N: usize>(field: &[u8; N], length: u8) -> heapless::Vec<u8, N> {
    field.iter().copied().take(usize::from(length)).collect()
}

/// The letters up to a zero; what is no ASCII becomes a question mark.
fn words<const N: usize>(field: &[u8; N]) -> heapless::String<N> {
    let letters = field.iter().take_while(|byte| **byte != 0);
    letters.map(|byte| if byte.is_ascii() && !byte.is_ascii_control() { char::from(*byte) } else { '?' }).collect()
}
