//! The simulated autopilot's side of TELEM1: MAVLink 2 out of what the world says, and the board's answers back.
//!
//! Ids and layouts: `common.xml` of MAVLink. The little codec at the end knows just these messages.

use adit_firmware::io::{Command, Inputs};
use adit_protocol::record::Mode;
use crc::{CRC_16_MCRF4XX, Crc};
use sha2::{Digest, Sha256};

/// `MAV_CMD_COMPONENT_ARM_DISARM`.
const ARM_DISARM: u16 = 400;
/// `MAV_CMD_IMAGE_START_CAPTURE`.
const START_CAPTURE: u16 = 2000;
/// `MAV_CMD_IMAGE_STOP_CAPTURE`.
const STOP_CAPTURE: u16 = 2001;
/// `MAV_CMD_DO_CHANGE_SPEED`.
const CHANGE_SPEED: u16 = 178;
/// `MAV_CMD_REQUEST_MESSAGE`; the board only asks for the version.
const REQUEST_MESSAGE: u16 = 512;
/// The vehicle: system 1, component `MAV_COMP_ID_AUTOPILOT1`.
const VEHICLE: (u8, u8) = (1, 1);
/// The board: the same system, `MAV_COMP_ID_ONBOARD_COMPUTER`.
const BOARD: (u8, u8) = (1, 191);
/// Messages of state come this far apart: 50 a second.
const STATE_PERIOD_US: u64 = 20_000;
const HEARTBEAT_PERIOD_US: u64 = 1_000_000;
const MODES: [Mode; 7] =
    [Mode::Boot, Mode::Idle, Mode::SelfTest, Mode::Ready, Mode::Scanning, Mode::Degraded, Mode::Fault];

/// What the board has said of itself.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Heard {
    pub(crate) mode: Mode,
    speed_limit_mps: Option<f32>,
    offset_m: [Option<f32>; 2],
}

impl Heard {
    /// The speed limit in force: outside a scan the board makes no claim.
    pub(crate) fn speed_limit_mps(&self) -> Option<f32> {
        let claimed = matches!(self.mode, Mode::Scanning | Mode::Degraded | Mode::Fault);
        self.speed_limit_mps.filter(|_| claimed)
    }

    /// Where the board believes the vehicle to be in the section.
    pub(crate) fn offset_m(&self) -> Option<[f32; 2]> {
        Some([self.offset_m[0]?, self.offset_m[1]?])
    }
}

/// The link.
#[derive(Clone, Debug)]
pub(crate) struct VehicleLink {
    axis_yaw_rad: f32,
    state_due_us: u64,
    heartbeat_due_us: u64,
    owes_answer: bool,
    owes_version: bool,
    /// Signs the pilot's commands, if he has a key.
    key: Option<[u8; 32]>,
    commanded: Vec<u8>,
    codec: Codec,
    pub(crate) heard: Heard,
}

impl VehicleLink {
    /// The link of a vehicle in a tunnel whose axis the autopilot sees at this yaw.
    /// With a key the pilot's commands are signed.
    pub(crate) fn new(axis_yaw_rad: f32, key: Option<[u8; 32]>) -> Self {
        let codec = Codec::default();
        Self {
            axis_yaw_rad,
            state_due_us: 0,
            heartbeat_due_us: 0,
            owes_answer: false,
            owes_version: false,
            key,
            commanded: Vec::new(),
            codec,
            heard: Heard::default(),
        }
    }

    /// What the vehicle says now.
    pub(crate) fn say(&mut self, now_us: u64, inputs: &Inputs) -> Vec<u8> {
        let mut bytes = Vec::new();
        if inputs.autopilot_alive && now_us >= self.heartbeat_due_us {
            self.heartbeat_due_us = now_us + HEARTBEAT_PERIOD_US;
            // A quadrotor under ArduPilot, in Auto, armed, active, MAVLink version 3.
            bytes.extend(self.codec.frame(Message::HEARTBEAT, &[3, 0, 0, 0, 2, 3, 0x81, 4, 3]));
        }
        if now_us >= self.state_due_us {
            self.state_due_us = now_us + STATE_PERIOD_US;
            bytes.extend(self.state(now_us, inputs));
        }
        if std::mem::take(&mut self.owes_answer) {
            let [low, high] = CHANGE_SPEED.to_le_bytes();
            bytes.extend(self.codec.frame(Message::COMMAND_ACK, &[low, high, 0, 0, 0, 0, 0, 0, BOARD.0, BOARD.1]));
        }
        if std::mem::take(&mut self.owes_version) {
            // Capabilities and number stay zero; major, minor, patch, kind.
            let mut payload = vec![0; 60];
            payload[16..20].copy_from_slice(&[255, 0, 7, 4]);
            bytes.extend(self.codec.frame(Message::AUTOPILOT_VERSION, &payload));
        }
        if let Some(command) = inputs.command {
            let (id, first) = match command {
                Command::Arm => (ARM_DISARM, 1.0),
                Command::Disarm => (ARM_DISARM, 0.0),
                Command::Start => (START_CAPTURE, 0.0),
                Command::Stop => (STOP_CAPTURE, 0.0),
            };
            let mut payload = floats(&[first, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
            payload.extend(id.to_le_bytes());
            payload.extend([BOARD.0, BOARD.1, 0]);
            let frame = self.codec.frame(Message::COMMAND_LONG, &payload);
            self.commanded = match &self.key {
                Some(key) => signed(frame, key, SIGNING_START + now_us / 10),
                None => frame,
            };
            bytes.extend(&self.commanded);
        }
        bytes
    }

    /// The last command, as it went over the line.
    pub(crate) fn commanded(&self) -> &[u8] {
        &self.commanded
    }

    fn state(&mut self, now_us: u64, inputs: &Inputs) -> Vec<u8> {
        let boot_ms = ((now_us / 1000) as u32).to_le_bytes();
        let mut bytes = Vec::new();
        if let Some([roll, pitch, yaw]) = inputs.attitude_rad {
            let mut payload = boot_ms.to_vec();
            payload.extend(floats(&[roll, pitch, yaw + self.axis_yaw_rad, 0.0, 0.0, 0.0]));
            bytes.extend(self.codec.frame(Message::ATTITUDE, &payload));
        }
        if let (Some(along_m), Some(speed_mps)) = (inputs.odometer_m, inputs.speed_mps) {
            let (sin, cos) = self.axis_yaw_rad.sin_cos();
            let mut payload = boot_ms.to_vec();
            payload.extend(floats(&[along_m * cos, along_m * sin, 0.0, speed_mps * cos, speed_mps * sin, 0.0]));
            bytes.extend(self.codec.frame(Message::LOCAL_POSITION_NED, &payload));
        }
        bytes
    }

    /// Hears what the board says.
    pub(crate) fn hear(&mut self, bytes: &[u8]) {
        for (sender, message, payload) in self.codec.decode(bytes) {
            if sender != BOARD {
                continue;
            }
            match message {
                Message::HEARTBEAT => {
                    let mode = MODES.get(word(&payload, 0) as usize);
                    self.heard.mode = mode.copied().unwrap_or(self.heard.mode);
                }
                Message::COMMAND_LONG if payload[28..30] == CHANGE_SPEED.to_le_bytes() => {
                    self.heard.speed_limit_mps = Some(f32::from_bits(word(&payload, 4)));
                    self.owes_answer = true;
                }
                Message::COMMAND_LONG if payload[28..30] == REQUEST_MESSAGE.to_le_bytes() => self.owes_version = true,
                Message::NAMED_VALUE_FLOAT => {
                    let value = f32::from_bits(word(&payload, 4));
                    match payload[8..18].split(|letter| *letter == 0).next() {
                        Some(b"off_y") => self.heard.offset_m[0] = Some(value),
                        Some(b"off_z") => self.heard.offset_m[1] = Some(value),
                        _ => {}
                    }
                }
                _ => {}
            }
        }
    }

    /// The board has lost its power: what it said is void.
    pub(crate) fn forget(&mut self) {
        self.heard = Heard::default();
        self.codec.pending.clear();
    }
}

fn floats(values: &[f32]) -> Vec<u8> {
    values.iter().flat_map(|value| value.to_le_bytes()).collect()
}

fn word(payload: &[u8], at: usize) -> u32 {
    u32::from_le_bytes([payload[at], payload[at + 1], payload[at + 2], payload[at + 3]])
}

/// A message: its number, the seed of its checksum, its whole length.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Message {
    id: u32,
    seed: u8,
    length: usize,
}

impl Message {
    const HEARTBEAT: Self = Self { id: 0, seed: 50, length: 9 };
    const ATTITUDE: Self = Self { id: 30, seed: 39, length: 28 };
    const LOCAL_POSITION_NED: Self = Self { id: 32, seed: 185, length: 28 };
    const COMMAND_LONG: Self = Self { id: 76, seed: 152, length: 33 };
    const COMMAND_ACK: Self = Self { id: 77, seed: 143, length: 10 };
    const AUTOPILOT_VERSION: Self = Self { id: 148, seed: 178, length: 60 };
    const NAMED_VALUE_FLOAT: Self = Self { id: 251, seed: 170, length: 18 };
    const ALL: [Self; 7] = [
        Self::HEARTBEAT,
        Self::ATTITUDE,
        Self::LOCAL_POSITION_NED,
        Self::COMMAND_LONG,
        Self::COMMAND_ACK,
        Self::AUTOPILOT_VERSION,
        Self::NAMED_VALUE_FLOAT,
    ];
}

const START_OF_FRAME: u8 = 0xFD;
const HEADER_BYTES: usize = 10;
const SIGNATURE_BYTES: usize = 13;
/// A day in 2026, in units of 10 us since 2015.
const SIGNING_START: u64 = 37_000_000_000_000;
const X25: Crc<u16> = Crc::<u16>::new(&CRC_16_MCRF4XX);

fn checksum(frame: &[u8], seed: u8) -> [u8; 2] {
    let mut digest = X25.digest();
    digest.update(&frame[1..]);
    digest.update(&[seed]);
    digest.finalize().to_le_bytes()
}

/// A frame with a signature: link, time, and the first bytes of SHA-256 over key, frame, link and time.
fn signed(mut frame: Vec<u8>, key: &[u8; 32], time: u64) -> Vec<u8> {
    let id = u32::from_le_bytes([frame[7], frame[8], frame[9], 0]);
    let seed = Message::ALL.into_iter().find(|message| message.id == id).map_or(0, |message| message.seed);
    frame[2] |= 1;
    frame.truncate(frame.len() - 2);
    let sum = checksum(&frame, seed);
    frame.extend(sum);
    frame.push(0);
    frame.extend(&time.to_le_bytes()[..6]);
    let hash = Sha256::new().chain_update(key).chain_update(&frame).finalize();
    frame.extend(&hash[..6]);
    frame
}

/// Frames out of messages and messages out of bytes.
#[derive(Clone, Debug, Default)]
struct Codec {
    sequence: u8,
    pending: Vec<u8>,
}

impl Codec {
    fn frame(&mut self, message: Message, payload: &[u8]) -> Vec<u8> {
        let used = payload.iter().rposition(|byte| *byte != 0).map_or(1, |last| last + 1);
        let [low, middle, high, _] = message.id.to_le_bytes();
        let mut frame = vec![START_OF_FRAME, used as u8, 0, 0, self.sequence, VEHICLE.0, VEHICLE.1, low, middle, high];
        frame.extend(&payload[..used]);
        frame.extend(checksum(&frame, message.seed));
        self.sequence = self.sequence.wrapping_add(1);
        frame
    }

    /// Complete messages among the bytes so far, payloads padded to their whole length.
    fn decode(&mut self, bytes: &[u8]) -> Vec<((u8, u8), Message, Vec<u8>)> {
        self.pending.extend(bytes);
        let mut messages = Vec::new();
        let mut at = 0;
        while let Some(frame) = self.pending.get(at..).filter(|rest| rest.len() >= HEADER_BYTES + 2) {
            if frame[0] != START_OF_FRAME {
                at += 1;
                continue;
            }
            let body = HEADER_BYTES + usize::from(frame[1]);
            let whole = body + 2 + if frame[2] & 1 == 1 { SIGNATURE_BYTES } else { 0 };
            if frame.len() < whole {
                break;
            }
            let id = u32::from_le_bytes([frame[7], frame[8], frame[9], 0]);
            let ours = Message::ALL.into_iter().find(|message| message.id == id);
            // Frames of other messages cannot be checked, so their length is not believed either.
            let whole_one = ours.filter(|message| frame[body..body + 2] == checksum(&frame[..body], message.seed));
            let Some(message) = whole_one else {
                at += 1;
                continue;
            };
            let mut payload = frame[HEADER_BYTES..body].to_vec();
            payload.resize(message.length, 0);
            messages.push(((frame[5], frame[6]), message, payload));
            at += whole;
        }
        self.pending.drain(..at);
        messages
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A frame as the board would send it.
    fn from_board(message: Message, payload: &[u8]) -> Vec<u8> {
        let mut frame = Codec::default().frame(message, payload);
        frame.truncate(frame.len() - 2);
        (frame[5], frame[6]) = BOARD;
        let sum = checksum(&frame, message.seed);
        frame.extend(sum);
        frame
    }

    #[test]
    fn a_heartbeat_has_the_bytes_that_another_implementation_makes() {
        // rust-mavlink, `mavlink/tests/test_shared/mod.rs`, `HEARTBEAT_V2`.
        let expected = [0xFD, 9, 0, 0, 0xEF, 1, 1, 0, 0, 0, 5, 0, 0, 0, 2, 3, 0x59, 3, 3, 0x10, 0xF0];
        let mut codec = Codec { sequence: 0xEF, ..Codec::default() };
        assert_eq!(codec.frame(Message::HEARTBEAT, &[5, 0, 0, 0, 2, 3, 0x59, 3, 3]), expected);
    }

    #[test]
    fn what_the_vehicle_says_follows_its_inputs() {
        let mut link = VehicleLink::new(0.0, None);
        let inputs = Inputs {
            attitude_rad: Some([0.1, -0.2, 0.3]),
            odometer_m: Some(2.0),
            speed_mps: Some(0.5),
            command: Some(Command::Arm),
            autopilot_alive: true,
            ..Inputs::default()
        };
        let said = Codec::default().decode(&link.say(0, &inputs));
        let ids: Vec<u32> = said.iter().map(|(_, message, _)| message.id).collect();
        assert_eq!(ids, [0, 30, 32, 76]);
        assert_eq!(f32::from_bits(word(&said[1].2, 8)), -0.2);
        assert_eq!([4, 16].map(|at| f32::from_bits(word(&said[2].2, at))), [2.0, 0.5]);
        assert_eq!((f32::from_bits(word(&said[3].2, 0)), &said[3].2[28..32]), (1.0, &[0x90, 0x01, 1, 191][..]));
        let silent = Inputs { autopilot_alive: false, ..Inputs::default() };
        assert!(link.say(2_000_000, &silent).is_empty());
    }

    #[test]
    fn mode_limit_and_estimate_are_heard_through_noise() {
        let mut link = VehicleLink::new(0.0, None);
        let mut bytes = vec![0xFD, 0x02, 0x00, 0x55];
        bytes.extend(from_board(Message::HEARTBEAT, &[4, 0, 0, 0, 18, 8, 0, 4, 3]));
        let mut limit = floats(&[0.0, 0.25, 0.0, 0.0, 0.0, 0.0, 0.0]);
        limit.extend(CHANGE_SPEED.to_le_bytes());
        limit.extend([1, 1, 0]);
        bytes.extend(from_board(Message::COMMAND_LONG, &limit));
        for (name, value) in [(b"off_y", 0.1_f32), (b"off_z", -0.2)] {
            let mut payload = vec![0; 4];
            payload.extend(value.to_le_bytes());
            payload.extend(name);
            payload.extend([0; 5]);
            bytes.extend(from_board(Message::NAMED_VALUE_FLOAT, &payload));
        }
        for byte in bytes {
            link.hear(&[byte]);
        }
        assert_eq!(link.heard.mode, Mode::Scanning);
        assert_eq!(link.heard.speed_limit_mps(), Some(0.25));
        assert_eq!(link.heard.offset_m(), Some([0.1, -0.2]));
    }

    #[test]
    fn outside_a_scan_there_is_no_limit() {
        let heard = Heard { mode: Mode::Ready, speed_limit_mps: Some(0.25), ..Heard::default() };
        assert_eq!(heard.speed_limit_mps(), None);
        assert_eq!(Heard { mode: Mode::Fault, ..heard }.speed_limit_mps(), Some(0.25));
    }
}
