//! What the board says.

use mavlink::MessageData;
use mavlink::dialects::common::{
    AUTOPILOT_VERSION_DATA, COMMAND_ACK_DATA, DISTANCE_SENSOR_DATA, HEARTBEAT_DATA, LOG_DATA_DATA, LOG_ENTRY_DATA,
    MavAutopilot, MavDistanceSensor, MavModeFlag, MavProtocolCapability, MavSensorOrientation, MavSeverity, MavState,
    MavType, NAMED_VALUE_FLOAT_DATA, PARAM_VALUE_DATA, STATUSTEXT_DATA, TIMESYNC_DATA,
};
use mavlink::types::CharArray;

use super::incoming::{LOG_BYTES, TUNNEL_BYTES};
use super::{CommandResult, Encoding, Mode, OutFrame, RawValue, Sender, Severity, TEXT_BYTES, Target};
use crate::beams::Beam;

/// Version 3 of the protocol's numbering: MAVLink 2 says 3 as well (`minimal.xml`).
pub(super) const MAVLINK_VERSION: u8 = 3;
/// `TUNNEL`, laid out by hand: the crate's type refuses numbers of payloads that it does not know.
const TUNNEL: u32 = 385;

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

/// What a component is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct VersionReport {
    /// Major, minor, patch.
    pub version: [u8; 3],
    /// How its parameters' values lie on the wire.
    pub encoding: Encoding,
    /// A number that no other chip has.
    pub uid: u64,
}

impl Sender {
    /// The board lives, and how.
    pub fn heartbeat(&mut self, mode: Mode) -> OutFrame {
        let system_status = match mode {
            Mode::Boot => MavState::MAV_STATE_BOOT,
            Mode::Idle | Mode::SelfTest | Mode::Ready => MavState::MAV_STATE_STANDBY,
            Mode::Scanning => MavState::MAV_STATE_ACTIVE,
            Mode::Degraded | Mode::Fault => MavState::MAV_STATE_CRITICAL,
        };
        self.frame(&HEARTBEAT_DATA {
            custom_mode: mode as u32,
            mavtype: MavType::MAV_TYPE_ONBOARD_CONTROLLER,
            autopilot: MavAutopilot::MAV_AUTOPILOT_INVALID,
            base_mode: MavModeFlag::MAV_MODE_FLAG_CUSTOM_MODE_ENABLED,
            system_status,
            mavlink_version: MAVLINK_VERSION,
        })
    }

    /// Answers a command, whatever its number, to who gave it.
    pub fn command_ack(&mut self, number: u16, result: CommandResult, to: Target) -> OutFrame {
        let ([low, high], [system, component]) = (number.to_le_bytes(), to);
        // Progress and second result stay zero.
        self.wrap(COMMAND_ACK_DATA::ID, &[low, high, result as u8, 0, 0, 0, 0, 0, system, component])
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

    /// A parameter's value; `index` of `count`.
    pub fn parameter_value(&mut self, name: &str, value: RawValue, [index, count]: [u16; 2]) -> OutFrame {
        let [b0, b1, b2, b3] = value.bytes;
        let ([c0, c1], [i0, i1]) = (count.to_le_bytes(), index.to_le_bytes());
        let mut payload = [b0, b1, b2, b3, c0, c1, i0, i1, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, value.kind];
        for (place, letter) in payload.iter_mut().skip(8).take(super::NAME_BYTES).zip(name.bytes()) {
            *place = letter;
        }
        self.wrap(PARAM_VALUE_DATA::ID, &payload)
    }

    /// What this component is, `AUTOPILOT_VERSION`.
    pub fn version(&mut self, report: &VersionReport) -> OutFrame {
        let [major, minor, patch] = report.version;
        let encoding = match report.encoding {
            Encoding::Cast => MavProtocolCapability::MAV_PROTOCOL_CAPABILITY_PARAM_ENCODE_C_CAST,
            Encoding::Bytewise => MavProtocolCapability::MAV_PROTOCOL_CAPABILITY_PARAM_ENCODE_BYTEWISE,
        };
        self.frame(&AUTOPILOT_VERSION_DATA {
            capabilities: MavProtocolCapability::MAV_PROTOCOL_CAPABILITY_MAVLINK2 | encoding,
            // The last byte is the kind: 255 is a release, 0 a development version.
            flight_sw_version: u32::from_be_bytes([major, minor, patch, 0]),
            uid: report.uid,
            ..AUTOPILOT_VERSION_DATA::DEFAULT
        })
    }

    /// Compares clocks: a question has no answer yet.
    pub fn time_sync(&mut self, answered_ns: i64, asked_ns: i64) -> OutFrame {
        self.frame(&TIMESYNC_DATA { tc1: answered_ns, ts1: asked_ns })
    }

    /// A message that only the two ends understand; what is beyond 128 bytes is cut.
    pub fn tunnel(&mut self, to: Target, kind: u16, payload: &[u8]) -> OutFrame {
        let ([k0, k1], [system, component]) = (kind.to_le_bytes(), to);
        let length = payload.len().min(TUNNEL_BYTES);
        let mut fields = [0; 5 + TUNNEL_BYTES];
        for (place, byte) in
            fields.iter_mut().zip([k0, k1, system, component, length as u8].iter().chain(payload.iter().take(length)))
        {
            *place = *byte;
        }
        self.wrap(TUNNEL, &fields)
    }

    /// A log that is there: its number and length; how many there are, and the newest of them.
    pub fn log_entry(&mut self, [id, count, last]: [u16; 3], bytes: u32) -> OutFrame {
        self.frame(&LOG_ENTRY_DATA { time_utc: 0, size: bytes, id, num_logs: count, last_log_num: last })
    }

    /// A piece of a log; what is beyond 90 bytes is cut.
    pub fn log_data(&mut self, id: u16, offset: u32, piece: &[u8]) -> OutFrame {
        let mut data = [0; LOG_BYTES];
        for (place, byte) in data.iter_mut().zip(piece) {
            *place = *byte;
        }
        self.frame(&LOG_DATA_DATA { ofs: offset, id, count: piece.len().min(LOG_BYTES) as u8, data })
    }
}
