//! The messages that the board sends.

use mavlink::dialects::common::{
    COMMAND_ACK_DATA, COMMAND_LONG_DATA, DISTANCE_SENSOR_DATA, HEARTBEAT_DATA, MavAutopilot, MavCmd, MavDistanceSensor,
    MavModeFlag, MavResult, MavSensorOrientation, MavSeverity, MavState, MavType, NAMED_VALUE_FLOAT_DATA,
    STATUSTEXT_DATA,
};
use mavlink::types::CharArray;
use mavlink::{MavlinkVersion, MessageData};

use super::{AUTOPILOT_COMPONENT, BOARD_COMPONENT, CommandResult, MAX_FRAME_BYTES, Severity, TEXT_BYTES, command};
use crate::beams::Beam;
use crate::record::Mode;

/// The first byte of a frame of version 2.
const MAGIC: u8 = 0xFD;
/// Version 3 of the protocol's numbering: MAVLink 2 says 3 as well (`minimal.xml`).
const MAVLINK_VERSION: u8 = 3;

/// A frame to be sent.
pub type OutFrame = heapless::Vec<u8, MAX_FRAME_BYTES>;

/// What a heartbeat says.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Beat {
    /// The board's mode, as `custom_mode`.
    pub mode: Mode,
}

/// A range reading for the display.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RangeReport {
    /// Which sensor.
    pub beam: Beam,
    /// The reading.
    pub range_m: f32,
    /// What the sensor can measure.
    pub limits_m: [f32; 2],
}

/// Wraps messages into frames of one component.
#[derive(Clone, Debug)]
pub struct Sender {
    system: u8,
    sequence: u8,
}

impl Sender {
    /// For the vehicle with this number.
    pub fn new(system: u8) -> Self {
        Self { system, sequence: 0 }
    }

    /// Follows a vehicle that turns out to have another number.
    pub fn set_system(&mut self, system: u8) {
        self.system = system;
    }

    /// The board lives, and how.
    pub fn heartbeat(&mut self, beat: Beat) -> OutFrame {
        let system_status = match beat.mode {
            Mode::Boot => MavState::MAV_STATE_BOOT,
            Mode::Idle | Mode::SelfTest | Mode::Ready => MavState::MAV_STATE_STANDBY,
            Mode::Scanning => MavState::MAV_STATE_ACTIVE,
            Mode::Degraded | Mode::Fault => MavState::MAV_STATE_CRITICAL,
        };
        self.frame(&HEARTBEAT_DATA {
            custom_mode: beat.mode as u32,
            mavtype: MavType::MAV_TYPE_ONBOARD_CONTROLLER,
            autopilot: MavAutopilot::MAV_AUTOPILOT_INVALID,
            base_mode: MavModeFlag::MAV_MODE_FLAG_CUSTOM_MODE_ENABLED,
            system_status,
            mavlink_version: MAVLINK_VERSION,
        })
    }

    /// Asks the autopilot to fly no faster over ground than this.
    pub fn change_speed(&mut self, speed_mps: f32) -> OutFrame {
        self.frame(&COMMAND_LONG_DATA {
            // 1: ground speed.
            param1: 1.0,
            param2: speed_mps,
            // No change of throttle.
            param3: -1.0,
            command: MavCmd::MAV_CMD_DO_CHANGE_SPEED,
            target_system: self.system,
            target_component: AUTOPILOT_COMPONENT,
            ..COMMAND_LONG_DATA::DEFAULT
        })
    }

    /// Answers a command, whatever its number: the crate's type could only name those that it knows.
    pub fn command_ack(&mut self, number: u16, result: CommandResult) -> OutFrame {
        let result = match result {
            CommandResult::Accepted => MavResult::MAV_RESULT_ACCEPTED,
            CommandResult::Unsupported => MavResult::MAV_RESULT_UNSUPPORTED,
        };
        let [low, high] = number.to_le_bytes();
        self.wrap(COMMAND_ACK_DATA::ID, COMMAND_ACK_DATA::EXTRA_CRC, &[low, high, result as u8])
    }

    /// Words for the pilot.
    pub fn text(&mut self, severity: Severity, text: &heapless::String<TEXT_BYTES>) -> OutFrame {
        self.frame(&STATUSTEXT_DATA {
            severity: match severity {
                Severity::Error => MavSeverity::MAV_SEVERITY_ERROR,
                Severity::Warning => MavSeverity::MAV_SEVERITY_WARNING,
                Severity::Info => MavSeverity::MAV_SEVERITY_INFO,
            },
            text: CharArray::from(text.as_str()),
        })
    }

    /// A figure with a name of at most ten letters.
    pub fn named_value(&mut self, time_ms: u32, name: &str, value: f32) -> OutFrame {
        self.frame(&NAMED_VALUE_FLOAT_DATA { time_boot_ms: time_ms, value, name: CharArray::from(name) })
    }

    /// A range, for the displays that show obstacles.
    pub fn range(&mut self, time_ms: u32, report: &RangeReport) -> OutFrame {
        let centimetres = |length_m: f32| (length_m * 100.0 + 0.5) as u16;
        let [least_m, most_m] = report.limits_m;
        self.frame(&DISTANCE_SENSOR_DATA {
            time_boot_ms: time_ms,
            min_distance: centimetres(least_m),
            max_distance: centimetres(most_m),
            current_distance: centimetres(report.range_m),
            mavtype: MavDistanceSensor::MAV_DISTANCE_SENSOR_LASER,
            id: report.beam as u8,
            // Both autopilots count yaw clockwise: 90 degrees is right, whatever the XML's text says.
            orientation: match report.beam {
                Beam::Up => MavSensorOrientation::MAV_SENSOR_ROTATION_PITCH_90,
                Beam::Right => MavSensorOrientation::MAV_SENSOR_ROTATION_YAW_90,
                Beam::Down => MavSensorOrientation::MAV_SENSOR_ROTATION_PITCH_270,
                Beam::Left => MavSensorOrientation::MAV_SENSOR_ROTATION_YAW_270,
            },
            // Unknown.
            covariance: 255,
        })
    }

    fn frame<M: MessageData>(&mut self, message: &M) -> OutFrame {
        let mut payload = [0; 255];
        let length = message.ser(MavlinkVersion::V2, &mut payload);
        self.wrap(M::ID, M::EXTRA_CRC, payload.get(..length).unwrap_or_default())
    }

    fn wrap(&mut self, message: u32, extra: u8, payload: &[u8]) -> OutFrame {
        // Zeros at the end are left out, but for the first byte (mavlink.io, "Empty-Byte Payload Truncation").
        let length = payload.iter().rposition(|byte| *byte != 0).map_or(1, |last| last + 1);
        let [low, middle, high, _] = message.to_le_bytes();
        let header = [MAGIC, length as u8, 0, 0, self.sequence, self.system, BOARD_COMPONENT, low, middle, high];
        self.sequence = self.sequence.wrapping_add(1);
        let mut frame = OutFrame::new();
        // All fit: 10 and 255 bytes and the CRC's two, of 280.
        let _ = frame.extend_from_slice(&header);
        let _ = frame.extend_from_slice(payload.get(..length).unwrap_or_default());
        let crc = mavlink::calculate_crc(frame.get(1..).unwrap_or_default(), extra);
        let _ = frame.extend_from_slice(&crc.to_le_bytes());
        frame
    }
}

// The numbers that peers know us by are those of the crate's dialect.
const _: () = assert!(MavCmd::MAV_CMD_DO_CHANGE_SPEED as u16 == command::CHANGE_SPEED);
const _: () = assert!(MavCmd::MAV_CMD_COMPONENT_ARM_DISARM as u16 == command::ARM_DISARM);
const _: () = assert!(MavCmd::MAV_CMD_IMAGE_START_CAPTURE as u16 == command::START_CAPTURE);
const _: () = assert!(MavCmd::MAV_CMD_IMAGE_STOP_CAPTURE as u16 == command::STOP_CAPTURE);
