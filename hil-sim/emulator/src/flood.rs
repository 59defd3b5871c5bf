//! A peer behind the autopilot that wants to do harm: whole frames at the line's full rate, beside what the vehicle says.
//!
//! In turn: orders to stop and to change parameters without a signature and with a forged one, an owner's order sent again, and
//! questions whose answers are long.

use adit_protocol::mavlink::{BOARD_COMPONENT, Encoding, Key, Sender, Signer, Value, command};

/// The forger's key.
const FORGED: Key = Key([0xEE; 32]);
/// A system that is nobody.
const ATTACKER: [u8; 2] = [254, 190];
/// The board.
const BOARD: [u8; 2] = [1, BOARD_COMPONENT];
/// Disarms, by its first parameter.
const DISARM: [f32; 7] = [0.0; 7];

/// The flood.
#[derive(Debug)]
pub(crate) struct Flood {
    unsigned: Sender,
    forger: Sender,
    turn: usize,
}

impl Flood {
    pub(crate) fn new() -> Self {
        let [system, component] = ATTACKER;
        let mut forger = Sender::new(system, component);
        // A time that no clock has reached.
        forger.signer = Some(Signer { key: FORGED, link: 0, time: 1 << 46 });
        Self { unsigned: Sender::new(system, component), forger, turn: 0 }
    }

    /// Frames of at least so many bytes; `overheard` is what the owner said once.
    pub(crate) fn say(&mut self, bytes: usize, overheard: &[u8]) -> Vec<u8> {
        let mut said = Vec::new();
        let value = Value::Real(0.01).write(Encoding::Cast);
        while said.len() < bytes {
            self.turn += 1;
            match self.turn % 6 {
                0 => said.extend(self.unsigned.command(BOARD, command::ARM_DISARM, 0, &DISARM)),
                1 => said.extend(self.unsigned.parameter_set(BOARD, "SPD_MARGIN", value)),
                2 => said.extend(self.forger.command(BOARD, command::ARM_DISARM, 0, &DISARM)),
                3 => said.extend(self.forger.parameter_set(BOARD, "SPD_MARGIN", value)),
                4 => said.extend(overheard),
                _ => said.extend(self.unsigned.parameter_list(BOARD)),
            }
        }
        said
    }
}
