//! What a peer asks of another: commands, parameters, logs, a new key.

use mavlink::MessageData;
use mavlink::dialects::common::{
    COMMAND_LONG_DATA, HEARTBEAT_DATA, LOG_REQUEST_DATA_DATA, LOG_REQUEST_END_DATA, LOG_REQUEST_LIST_DATA,
    MavAutopilot, MavCmd, MavFrame, MavModeFlag, MavState, MavType, PARAM_REQUEST_LIST_DATA, PARAM_REQUEST_READ_DATA,
    PARAM_SET_DATA, PositionTargetTypemask, SET_POSITION_TARGET_LOCAL_NED_DATA, SETUP_SIGNING_DATA,
};
use mavlink::types::CharArray;

use super::board::MAVLINK_VERSION;
use super::frame::SET_VELOCITY_LIMITS;
use super::{Key, NAME_BYTES, OutFrame, RawValue, Sender, Target, command};

/// Fields of a `COMMAND_LONG`.
const COMMAND_BYTES: usize = 33;

impl Sender {
    /// A ground station lives.
    pub fn ground_heartbeat(&mut self) -> OutFrame {
        self.frame(&HEARTBEAT_DATA {
            custom_mode: 0,
            mavtype: MavType::MAV_TYPE_GCS,
            autopilot: MavAutopilot::MAV_AUTOPILOT_INVALID,
            base_mode: MavModeFlag::empty(),
            system_status: MavState::MAV_STATE_ACTIVE,
            mavlink_version: MAVLINK_VERSION,
        })
    }

    /// A command, whatever its number: the crate's type could only name those that it knows.
    pub fn command(&mut self, to: Target, number: u16, confirmation: u8, parameters: &[f32; 7]) -> OutFrame {
        let ([low, high], [system, component]) = (number.to_le_bytes(), to);
        let floats = parameters.iter().flat_map(|parameter| parameter.to_le_bytes());
        let rest = [low, high, system, component, confirmation];
        let mut payload = [0; COMMAND_BYTES];
        for (place, byte) in payload.iter_mut().zip(floats.chain(rest)) {
            *place = byte;
        }
        self.wrap(COMMAND_LONG_DATA::ID, &payload)
    }

    /// Asks the autopilot of the own system to fly no faster over ground than this.
    pub fn change_speed(&mut self, to: Target, confirmation: u8, speed_mps: f32) -> OutFrame {
        // 1: ground speed; -1: no change of throttle.
        self.command(to, command::CHANGE_SPEED, confirmation, &[1.0, speed_mps, -1.0, 0.0, 0.0, 0.0, 0.0])
    }

    /// Asks PX4 to keep below a horizontal speed while in its mode Position Slow, `SET_VELOCITY_LIMITS`.
    pub fn velocity_limits(&mut self, [system, component]: Target, horizontal_mps: f32) -> OutFrame {
        let mut payload = [0; 14];
        let floats = [horizontal_mps, f32::NAN, f32::NAN];
        let bytes = floats.iter().flat_map(|limit| limit.to_le_bytes()).chain([system, component]);
        for (place, byte) in payload.iter_mut().zip(bytes) {
            *place = byte;
        }
        self.wrap(SET_VELOCITY_LIMITS, &payload)
    }

    /// Wants the vehicle to fly a velocity: north, east, down. It keeps its yaw.
    pub fn velocity_setpoint(
        &mut self,
        [target_system, target_component]: Target,
        time_ms: u32,
        [vx, vy, vz]: [f32; 3],
    ) -> OutFrame {
        // Everything but the velocity is left to the autopilot.
        let type_mask = PositionTargetTypemask::all()
            - PositionTargetTypemask::POSITION_TARGET_TYPEMASK_VX_IGNORE
            - PositionTargetTypemask::POSITION_TARGET_TYPEMASK_VY_IGNORE
            - PositionTargetTypemask::POSITION_TARGET_TYPEMASK_VZ_IGNORE
            - PositionTargetTypemask::POSITION_TARGET_TYPEMASK_FORCE_SET;
        self.frame(&SET_POSITION_TARGET_LOCAL_NED_DATA {
            time_boot_ms: time_ms,
            vx,
            vy,
            vz,
            type_mask,
            target_system,
            target_component,
            coordinate_frame: MavFrame::MAV_FRAME_LOCAL_NED,
            ..SET_POSITION_TARGET_LOCAL_NED_DATA::DEFAULT
        })
    }

    /// Asks for a parameter by its name.
    pub fn parameter_read(&mut self, [target_system, target_component]: Target, name: &str) -> OutFrame {
        let param_id = CharArray::from(name);
        self.frame(&PARAM_REQUEST_READ_DATA { param_index: -1, target_system, target_component, param_id })
    }

    /// Asks for a parameter by its place.
    pub fn parameter_read_at(&mut self, [target_system, target_component]: Target, index: u16) -> OutFrame {
        let param_index = i16::try_from(index).unwrap_or(i16::MAX);
        self.frame(&PARAM_REQUEST_READ_DATA {
            param_index,
            target_system,
            target_component,
            ..PARAM_REQUEST_READ_DATA::DEFAULT
        })
    }

    /// Asks for all parameters.
    pub fn parameter_list(&mut self, [target_system, target_component]: Target) -> OutFrame {
        self.frame(&PARAM_REQUEST_LIST_DATA { target_system, target_component })
    }

    /// Wants a parameter changed.
    pub fn parameter_set(&mut self, [system, component]: Target, name: &str, value: RawValue) -> OutFrame {
        let [b0, b1, b2, b3] = value.bytes;
        let mut payload =
            [b0, b1, b2, b3, system, component, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, value.kind];
        for (place, letter) in payload.iter_mut().skip(6).take(NAME_BYTES).zip(name.bytes()) {
            *place = letter;
        }
        self.wrap(PARAM_SET_DATA::ID, &payload)
    }

    /// Gives a key; zeros take it away.
    pub fn setup_signing(&mut self, [target_system, target_component]: Target, key: &Key, time: u64) -> OutFrame {
        self.frame(&SETUP_SIGNING_DATA { initial_timestamp: time, target_system, target_component, secret_key: key.0 })
    }

    /// Asks what logs there are.
    pub fn log_list(&mut self, [target_system, target_component]: Target) -> OutFrame {
        self.frame(&LOG_REQUEST_LIST_DATA { start: 0, end: u16::MAX, target_system, target_component })
    }

    /// Asks for a stretch of a log.
    pub fn log_request(
        &mut self,
        [target_system, target_component]: Target,
        id: u16,
        offset: u32,
        count: u32,
    ) -> OutFrame {
        self.frame(&LOG_REQUEST_DATA_DATA { ofs: offset, count, id, target_system, target_component })
    }

    /// Wants no more of logs.
    pub fn log_end(&mut self, [target_system, target_component]: Target) -> OutFrame {
        self.frame(&LOG_REQUEST_END_DATA { target_system, target_component })
    }
}

// The numbers that peers know us by are those of the crate's dialect.
const _: () = assert!(MavCmd::MAV_CMD_DO_CHANGE_SPEED as u16 == command::CHANGE_SPEED);
const _: () = assert!(MavCmd::MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN as u16 == command::REBOOT);
const _: () = assert!(MavCmd::MAV_CMD_COMPONENT_ARM_DISARM as u16 == command::ARM_DISARM);
const _: () = assert!(MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL as u16 == command::SET_MESSAGE_INTERVAL);
const _: () = assert!(MavCmd::MAV_CMD_REQUEST_MESSAGE as u16 == command::REQUEST_MESSAGE);
const _: () = assert!(MavCmd::MAV_CMD_IMAGE_START_CAPTURE as u16 == command::START_CAPTURE);
const _: () = assert!(MavCmd::MAV_CMD_IMAGE_STOP_CAPTURE as u16 == command::STOP_CAPTURE);
