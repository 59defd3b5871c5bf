//! The line between board and autopilot, with what goes wrong on lines.
//!
//! Whole frames go in and come out, later, or not at all; bytes that are no frame get lost on the way.

use std::collections::{BTreeMap, VecDeque};

use adit_protocol::mavlink::{AUTOPILOT_COMPONENT, CommandResult, FrameDecoder, Incoming, RawFrame, Sender};

use super::SYSTEM;

/// `PARAM_VALUE`.
pub const PARAM_VALUE: u32 = 22;
/// `PARAM_SET`.
const PARAM_SET: u32 = 23;
/// `COMMAND_ACK`.
pub const COMMAND_ACK: u32 = 77;
/// `STATUSTEXT`.
pub const STATUSTEXT: u32 = 253;
/// `SET_VELOCITY_LIMITS`.
const SET_VELOCITY_LIMITS: u32 = 354;
/// `MAV_CMD_DO_CHANGE_SPEED`.
const CHANGE_SPEED: u16 = 178;

/// What is wrong with a line.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum WireFault {
    /// Nothing comes through, either way.
    Cut {
        /// From then on.
        from_s: f64,
        /// For so long.
        for_s: f64,
    },
    /// A kind of message gets lost, whoever sends it.
    Lost {
        /// Its number.
        message: u32,
        /// So many of them, from the first on.
        count: u32,
    },
    /// The autopilot accepts what limits its speed and does nothing: the line answers commands in its name.
    Ignored {
        /// So many requests, from the first on.
        count: u32,
    },
}

/// One direction.
#[derive(Clone, Debug, Default)]
struct Lane {
    decoder: FrameDecoder,
    /// Frames with their time of arrival, the earliest first.
    under_way: VecDeque<(f64, Vec<u8>)>,
}

impl Lane {
    fn frames(&mut self, bytes: &[u8]) -> Vec<RawFrame> {
        bytes.iter().filter_map(|byte| self.decoder.push(*byte)).collect()
    }

    fn arrived(&mut self, now_s: f64) -> Vec<u8> {
        let mut bytes = Vec::new();
        while let Some((_, frame)) = self.under_way.pop_front_if(|(arrives_s, _)| *arrives_s <= now_s) {
            bytes.extend(frame);
        }
        bytes
    }
}

/// The line.
#[derive(Clone, Debug)]
pub struct Wire {
    delay_s: f64,
    faults: Vec<WireFault>,
    to_board: Lane,
    to_autopilot: Lane,
    /// Speaks in the autopilot's name.
    sender: Sender,
    lost: BTreeMap<u32, u32>,
    ignored: u32,
}

impl Wire {
    /// A line on which a frame takes so long.
    pub fn new(delay_s: f64, faults: &[WireFault]) -> Self {
        Self {
            delay_s,
            faults: faults.to_vec(),
            to_board: Lane::default(),
            to_autopilot: Lane::default(),
            sender: Sender::new(SYSTEM, AUTOPILOT_COMPONENT),
            lost: BTreeMap::new(),
            ignored: 0,
        }
    }

    /// Does nothing come through?
    pub fn is_cut(&self, now_s: f64) -> bool {
        self.faults.iter().any(
            |fault| matches!(fault, WireFault::Cut { from_s, for_s } if (*from_s..from_s + for_s).contains(&now_s)),
        )
    }

    /// The autopilot speaks.
    pub fn from_autopilot(&mut self, now_s: f64, bytes: &[u8]) {
        for frame in self.to_board.frames(bytes) {
            if self.is_cut(now_s) || self.loses(frame.message) {
                continue;
            }
            self.to_board.under_way.push_back((now_s + self.delay_s, frame.wire().to_vec()));
        }
    }

    /// The board speaks.
    pub fn from_board(&mut self, now_s: f64, bytes: &[u8]) {
        for frame in self.to_autopilot.frames(bytes) {
            if self.is_cut(now_s) || self.loses(frame.message) {
                continue;
            }
            if self.ignores(now_s, &frame) {
                continue;
            }
            self.to_autopilot.under_way.push_back((now_s + self.delay_s, frame.wire().to_vec()));
        }
    }

    /// What arrives at the board.
    pub fn at_board(&mut self, now_s: f64) -> Vec<u8> {
        self.to_board.arrived(now_s)
    }

    /// What arrives at the autopilot.
    pub fn at_autopilot(&mut self, now_s: f64) -> Vec<u8> {
        self.to_autopilot.arrived(now_s)
    }

    fn loses(&mut self, message: u32) -> bool {
        let most = self.faults.iter().find_map(|fault| match fault {
            WireFault::Lost { message: lost, count } if *lost == message => Some(*count),
            _ => None,
        });
        let so_far = self.lost.entry(message).or_default();
        let loses = most.is_some_and(|most| *so_far < most);
        *so_far += u32::from(loses);
        loses
    }

    fn ignores(&mut self, now_s: f64, frame: &RawFrame) -> bool {
        let command = match Incoming::read(frame) {
            Some(Incoming::Command { command, .. }) => Some(command),
            _ => None,
        };
        let limits = command == Some(CHANGE_SPEED) || matches!(frame.message, PARAM_SET | SET_VELOCITY_LIMITS);
        let most = self.faults.iter().find_map(|fault| match fault {
            WireFault::Ignored { count } => Some(*count),
            _ => None,
        });
        if !limits || most.is_none_or(|most| self.ignored >= most) {
            return false;
        }
        self.ignored += 1;
        if let Some(command) = command {
            let to = [frame.system, frame.component];
            let ack = self.sender.command_ack(command, CommandResult::Accepted, to);
            // There and back.
            self.to_board.under_way.push_back((now_s + 2.0 * self.delay_s, ack.to_vec()));
        }
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TO: [u8; 2] = [SYSTEM, AUTOPILOT_COMPONENT];

    fn board() -> Sender {
        Sender::new(SYSTEM, 191)
    }

    fn vehicle() -> Sender {
        Sender::new(SYSTEM, AUTOPILOT_COMPONENT)
    }

    #[test]
    fn a_frame_arrives_whole_and_late() {
        let mut wire = Wire::new(0.02, &[]);
        let frame = board().change_speed(TO, 0, 0.4);
        let (start, end) = frame.split_at(7);
        wire.from_board(1.0, start);
        wire.from_board(1.0, end);
        assert!(wire.at_autopilot(1.015).is_empty());
        assert_eq!(wire.at_autopilot(1.02), *frame);
        assert!(wire.at_autopilot(2.0).is_empty());
    }

    #[test]
    fn a_cut_line_carries_nothing_either_way() {
        let mut wire = Wire::new(0.0, &[WireFault::Cut { from_s: 1.0, for_s: 2.0 }]);
        for now_s in [0.9, 1.0, 2.9, 3.0] {
            wire.from_board(now_s, &board().ground_heartbeat());
            wire.from_autopilot(now_s, &vehicle().ground_heartbeat());
            let comes = !wire.at_board(now_s).is_empty();
            assert_eq!((comes, !wire.at_autopilot(now_s).is_empty()), (!wire.is_cut(now_s), comes), "{now_s}");
            assert_eq!(comes, !(1.0..3.0).contains(&now_s));
        }
    }

    #[test]
    fn only_the_kind_of_message_that_is_to_be_lost_is_lost_and_only_so_often() {
        let mut wire = Wire::new(0.0, &[WireFault::Lost { message: COMMAND_ACK, count: 2 }]);
        let mut sender = vehicle();
        let mut came = Vec::new();
        for _ in 0..3 {
            wire.from_autopilot(0.0, &sender.command_ack(178, CommandResult::Failed, [SYSTEM, 191]));
            wire.from_autopilot(0.0, &sender.head_up(1.0));
            let mut decoder = FrameDecoder::default();
            came.extend(
                wire.at_board(0.0).into_iter().filter_map(|byte| decoder.push(byte)).map(|frame| frame.message),
            );
        }
        assert_eq!(came, [74, 74, COMMAND_ACK, 74]);
    }

    #[test]
    fn an_ignored_command_is_accepted_and_has_no_effect() {
        let mut wire = Wire::new(0.0, &[WireFault::Ignored { count: 1 }]);
        wire.from_board(0.0, &board().change_speed(TO, 0, 0.4));
        assert!(wire.at_autopilot(0.0).is_empty());
        let mut decoder = FrameDecoder::default();
        let answer =
            wire.at_board(0.0).into_iter().find_map(|byte| decoder.push(byte)).map(|frame| Incoming::read(&frame));
        assert_eq!(answer, Some(Some(Incoming::CommandAck { command: 178, result: 0, target: [SYSTEM, 191] })));
        wire.from_board(0.0, &board().change_speed(TO, 0, 0.4));
        assert!(!wire.at_autopilot(0.0).is_empty());
    }
}
