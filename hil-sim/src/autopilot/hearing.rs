//! What an autopilot makes of what it hears: commands, parameters, setpoints.

use adit_protocol::mavlink::{AUTOPILOT_COMPONENT, CommandResult, Incoming, RawFrame, Target, VersionReport};

use super::table::Change;
use super::ways::SpeedChange;
use super::{Kind, NamedAutopilot, SYSTEM, setpoint};

/// `SET_MODE`: custom mode, target system, base mode.
const SET_MODE: u32 = 11;
/// `SET_VELOCITY_LIMITS` of the development dialect: horizontal, vertical, yaw rate, target.
const SET_VELOCITY_LIMITS: u32 = 354;
/// `MAV_CMD_DO_SET_MODE`.
const DO_SET_MODE: u16 = 176;
/// `MAV_CMD_DO_CHANGE_SPEED`.
const DO_CHANGE_SPEED: u16 = 178;
/// `MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN`.
const REBOOT: u16 = 246;
/// `MAV_CMD_COMPONENT_ARM_DISARM`.
const ARM_DISARM: u16 = 400;
/// `MAV_CMD_SET_MESSAGE_INTERVAL`.
const SET_MESSAGE_INTERVAL: u16 = 511;
/// `MAV_CMD_REQUEST_MESSAGE`.
const REQUEST_MESSAGE: u16 = 512;
/// `AUTOPILOT_VERSION`.
const VERSION: f32 = 148.0;
/// Released versions that the facts are from.
const ARDUPILOT_46: [u8; 3] = [4, 6, 3];
const ARDUPILOT_47: [u8; 3] = [4, 7, 0];
const PX4_VERSION: [u8; 3] = [1, 17, 0];

impl NamedAutopilot {
    /// Hears what somebody says.
    pub fn hear(&mut self, now_s: f64, bytes: &[u8]) {
        if !self.is_up(now_s) {
            return;
        }
        for byte in bytes {
            if let Some(frame) = self.decoder.push(*byte) {
                self.take(now_s, &frame);
            }
        }
    }

    fn take(&mut self, now_s: f64, frame: &RawFrame) {
        match frame.message {
            SET_MODE if frame.u8(4) == SYSTEM => self.set_mode(frame.u32(0)),
            // There is no check of its target (PX4's receiver).
            SET_VELOCITY_LIMITS => self.ways.limit_velocity(self.mode, frame.f32(0)),
            setpoint::MESSAGE if is_for_us(setpoint::target(frame)) => {
                let point = setpoint::read(frame, self.axis_yaw_rad);
                self.ways.set_point(now_s, self.mode, point);
            }
            _ => self.answer(now_s, frame),
        }
    }

    fn answer(&mut self, now_s: f64, frame: &RawFrame) {
        match Incoming::read(frame) {
            Some(Incoming::Command { target, command, parameters, .. }) if is_for_us(target) => {
                let result = self.obey(command, &parameters);
                let ack = self.sender.command_ack(command, result, [frame.system, frame.component]);
                self.outbox.extend(ack);
                if command == REQUEST_MESSAGE && result == CommandResult::Accepted {
                    self.tell_version();
                }
            }
            Some(Incoming::ParameterRead { target, index, name }) if is_for_us(target) => {
                // An unknown name gets no answer.
                if let Some(index) = self.table.asked(index, name.as_deref()) {
                    self.tell(index);
                }
            }
            Some(Incoming::ParameterList { target }) if is_for_us(target) => self.listed = 0..self.table.len(),
            Some(Incoming::ParameterSet { target, name: Some(name), value }) if is_for_us(target) => {
                match self.table.set(now_s, &name, value, self.kind.encoding()) {
                    Change::Dropped => {}
                    Change::Denied(index) => {
                        self.text(&format!("Param write denied ({name})"));
                        self.tell(index);
                    }
                    Change::Taken(index) => {
                        self.tell(index);
                        for words in self.ways.changed(now_s, &name, &mut self.table) {
                            self.text(words);
                        }
                    }
                }
            }
            _ => {}
        }
    }

    fn tell(&mut self, index: usize) {
        let frame = self.table.tell(&mut self.sender, index, self.kind.encoding());
        self.outbox.extend(frame);
    }

    fn obey(&mut self, command: u16, parameters: &[f32; 7]) -> CommandResult {
        let [first, second, third, ..] = *parameters;
        match command {
            DO_CHANGE_SPEED => self.ways.change_speed(self.mode, SpeedChange { kind: first, speed_mps: second }),
            DO_SET_MODE => self.obey_mode(second, third),
            ARM_DISARM => {
                self.armed = first == 1.0;
                CommandResult::Accepted
            }
            REBOOT if first == 1.0 => {
                self.wants_reboot = true;
                CommandResult::Accepted
            }
            SET_MESSAGE_INTERVAL if self.streams.set_interval(first, second) => CommandResult::Accepted,
            SET_MESSAGE_INTERVAL => CommandResult::Failed,
            REQUEST_MESSAGE if first == VERSION => CommandResult::Accepted,
            _ => CommandResult::Unsupported,
        }
    }

    /// `DO_SET_MODE`: `ArduPilot` has the number in one parameter, PX4 main and sub in two.
    fn obey_mode(&mut self, second: f32, third: f32) -> CommandResult {
        let mode = if self.kind.is_ardupilot() { second as u32 } else { (second as u32) << 16 | (third as u32) << 24 };
        self.set_mode(mode);
        if self.mode == mode { CommandResult::Accepted } else { CommandResult::Failed }
    }

    fn tell_version(&mut self) {
        let version = match self.kind {
            Kind::ArduPilot46 => ARDUPILOT_46,
            Kind::ArduPilot47 => ARDUPILOT_47,
            Kind::Px4 | Kind::Px4Development => PX4_VERSION,
        };
        let report = VersionReport { version, encoding: self.kind.encoding(), uid: 0x5EED };
        let frame = self.sender.version(&report);
        self.outbox.extend(frame);
    }
}

/// Zero is everybody.
fn is_for_us([system, component]: Target) -> bool {
    matches!(system, 0 | SYSTEM) && matches!(component, 0 | AUTOPILOT_COMPONENT)
}
