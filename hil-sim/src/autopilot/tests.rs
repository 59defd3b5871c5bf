//! Each way of an autopilot that the facts tell, seen from the other end of the line.

mod ardupilot;
mod endpoint;
mod px4;

use adit_protocol::mavlink::{FrameDecoder, Incoming, RawFrame, Sender, Value};

use super::*;

/// The autopilot.
const TO: [u8; 2] = [SYSTEM, AUTOPILOT_COMPONENT];
/// What the pilot wants, always.
const WISH_MPS: f64 = 1.5;

/// An autopilot and somebody who speaks with it.
struct Bench {
    autopilot: NamedAutopilot,
    board: Sender,
    now_s: f64,
}

impl Bench {
    fn new(autopilot: NamedAutopilot, mode: &str) -> Self {
        let mut bench = Self { autopilot, board: Sender::new(SYSTEM, 191), now_s: 0.0 };
        bench.turn(mode);
        bench
    }

    fn turn(&mut self, mode: &str) {
        let number = self.autopilot.kind().mode(mode).unwrap_or_else(|| panic!("no mode {mode}"));
        self.autopilot.set_mode(number);
    }

    /// Says a frame and returns what comes back, but for the streams.
    fn ask(&mut self, frame: &[u8]) -> Vec<Incoming> {
        self.autopilot.hear(self.now_s, frame);
        let said = self.autopilot.say(self.now_s, &Seen::default());
        let streams = [0, 30, 32, 74];
        frames(&said).iter().filter(|frame| !streams.contains(&frame.message)).filter_map(Incoming::read).collect()
    }

    /// `DO_CHANGE_SPEED`; returns the result.
    fn change_speed(&mut self, speed_mps: f32) -> u8 {
        let frame = self.board.change_speed(TO, 0, speed_mps);
        match self.ask(&frame).as_slice() {
            [Incoming::CommandAck { command: 178, result, target: [SYSTEM, 191] }] => *result,
            other => panic!("{other:?}"),
        }
    }

    /// `PARAM_SET`; returns what comes back.
    fn set(&mut self, name: &str, value: Value) -> Vec<Incoming> {
        let encoding = self.autopilot.kind.encoding();
        let frame = self.board.parameter_set(TO, name, value.write(encoding));
        self.ask(&frame)
    }

    /// `PARAM_REQUEST_READ`; the value, if there is an answer.
    fn read(&mut self, name: &str) -> Option<Value> {
        let encoding = self.autopilot.kind.encoding();
        let frame = self.board.parameter_read(TO, name);
        match self.ask(&frame).as_slice() {
            [] => None,
            [Incoming::ParameterValue { name: Some(told), value, .. }] if told == name => Value::read(*value, encoding),
            other => panic!("{other:?}"),
        }
    }

    fn wait(&mut self, duration_s: f64) {
        self.now_s += duration_s;
    }

    fn aim_mps(&mut self) -> f64 {
        self.autopilot.aim_mps(self.now_s, WISH_MPS)
    }

    /// What it steers for once that has settled.
    fn settled_mps(&mut self) -> f64 {
        self.aim_mps();
        self.wait(60.0);
        self.aim_mps()
    }
}

fn frames(bytes: &[u8]) -> Vec<RawFrame> {
    let mut decoder = FrameDecoder::default();
    bytes.iter().filter_map(|byte| decoder.push(*byte)).collect()
}

/// `SET_POSITION_TARGET_LOCAL_NED` of a velocity to north and east, or forward and right.
fn velocity_frame(frame: u8, velocity_mps: [f32; 2], mask: u16) -> Vec<u8> {
    let mut fields = vec![0; 53];
    for (offset, value) in [(16, velocity_mps[0]), (20, velocity_mps[1])] {
        fields[offset..offset + 4].copy_from_slice(&value.to_le_bytes());
    }
    fields[48..50].copy_from_slice(&mask.to_le_bytes());
    fields[50..53].copy_from_slice(&[SYSTEM, AUTOPILOT_COMPONENT, frame]);
    // The byte that stands for the layout, from common.xml.
    sealed(84, &fields, 143)
}

/// A frame of the board's, written by hand.
fn sealed(message: u8, fields: &[u8], extra: u8) -> Vec<u8> {
    let mut bytes = vec![0xFD, fields.len() as u8, 0, 0, 0, SYSTEM, 191, message, 0, 0];
    bytes.extend(fields);
    // CRC-16/MCRF4XX, bit by bit.
    let crc = bytes[1..].iter().chain([&extra]).fold(0xFFFF_u16, |crc, byte| {
        (0..8).fold(crc ^ u16::from(*byte), |crc, _| if crc & 1 == 1 { crc >> 1 ^ 0x8408 } else { crc >> 1 })
    });
    bytes.extend(crc.to_le_bytes());
    bytes
}

/// The mask that leaves nothing but the velocity.
const VELOCITY_ONLY: u16 = 0b1101_1100_0111;
