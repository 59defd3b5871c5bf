//! Cases by chance: fresh ones, and those of the corpus with something changed.

use crate::dice::Dice;
use crate::operation::{Case, Operation, Setup};
use crate::rig::{KEY, NEWEST};
use crate::speech::{SYSTEM, of_autopilot, of_ground};
use crate::wire::{From, Seal, frame_1, frame_2};

/// A wrong key.
const OTHER_KEY: [u8; 32] = [0xA5; 32];
/// Waiting takes at most so long; a case of a hundred such waits stays below what a signature's clock can tell.
const LONGEST_WAIT_US: u64 = 10 * 24 * 3600 * 1_000_000;

/// How frames of a case are signed.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Signing {
    Never,
    Rightly,
    Mixed,
}

/// The next case: in a half of all, one of the corpus is where it begins.
pub(crate) fn case(dice: &mut Dice, corpus: &[Case]) -> Case {
    if corpus.is_empty() || dice.percent(50) {
        let setup = setup(dice);
        let mut case = Case { setup, operations: Vec::new() };
        extend(&mut case, dice, 60);
        return case;
    }
    let mut case = corpus[dice.below(corpus.len())].clone();
    if dice.percent(20) {
        case.setup = setup(dice);
    }
    for _ in 0..dice.below(4) {
        change(&mut case, dice, corpus);
    }
    extend(&mut case, dice, 20);
    case
}

/// Half of all boards have a key.
fn setup(dice: &mut Dice) -> Setup {
    Setup(dice.byte())
}

/// Changes a case somewhere.
fn change(case: &mut Case, dice: &mut Dice, corpus: &[Case]) {
    if case.operations.is_empty() {
        return;
    }
    let at = dice.below(case.operations.len());
    match dice.below(6) {
        0 => {
            case.operations.remove(at);
        }
        1 => {
            let again = case.operations[dice.below(case.operations.len())].clone();
            case.operations.insert(at, again);
        }
        2 => {
            let other = &corpus[dice.below(corpus.len())].operations;
            let from = dice.below(other.len().max(1)).min(other.len());
            case.operations.truncate(at);
            case.operations.extend_from_slice(&other[from..]);
        }
        3 => {
            let operation = something(dice);
            case.operations.insert(at, operation);
        }
        _ => {
            if let Operation::Receive { port, bytes } = &mut case.operations[at] {
                *port ^= u8::from(dice.percent(20));
                damage(bytes, dice);
            }
        }
    }
}

/// Appends fewer than `end` operations.
fn extend(case: &mut Case, dice: &mut Dice, end: usize) {
    let signing = dice.pick(&[Signing::Never, Signing::Rightly, Signing::Mixed]);
    let has_service = dice.percent(50);
    let mut peers = Peers { signing, has_service, time: NEWEST + 300_000, sequence: 0, sent: Vec::new() };
    for _ in 0..dice.below(end) {
        let operation = if dice.percent(60) { peers.receive(dice) } else { something(dice) };
        case.operations.push(operation);
    }
}

/// What is no message.
fn something(dice: &mut Dice) -> Operation {
    match dice.below(20) {
        0..5 => Operation::Wait { us: wait_us(dice) },
        5..9 => {
            let real = |dice: &mut Dice, least, most| {
                (if dice.percent(5) { f32::NAN } else { dice.real(least, most) }).to_bits()
            };
            let limit = dice.percent(85).then(|| real(dice, 0.0, 1.2));
            let offset = dice.percent(50).then(|| real(dice, -0.6, 0.6));
            let mode = dice.pick(&[1, 3, 4, 4, 4, 5, 6, 0, 2]);
            Operation::Note { mode, limit, offset, captures: dice.below(3) as u32 }
        }
        9 => Operation::Entry { kind: dice.byte(), capture: dice.whole(), state: dice.byte() },
        10..13 => Operation::Drain,
        13..16 => Operation::Kept { ok: dice.percent(80) },
        16 => Operation::Logs { kind: dice.pick(&[0, 0, 0, 1, 2, 3, 4]), length: dice.whole() as u16 },
        _ => Operation::Set { index: dice.byte() % 92, whole: dice.percent(30), bits: parameter_bits(dice) },
    }
}

fn parameter_bits(dice: &mut Dice) -> u32 {
    if dice.percent(30) { dice.whole() } else { dice.real(-2.0, 50.0).round().to_bits() }
}

fn wait_us(dice: &mut Dice) -> u64 {
    let most_us = match dice.below(40) {
        0..20 => 20_000,
        20..36 => 1_000_000,
        36..39 => 10_000_000,
        _ => LONGEST_WAIT_US,
    };
    dice.word() % most_us
}

/// Those who talk to the board.
struct Peers {
    signing: Signing,
    /// Does one of them have the cable?
    has_service: bool,
    time: u64,
    sequence: u8,
    sent: Vec<Vec<u8>>,
}

impl Peers {
    fn receive(&mut self, dice: &mut Dice) -> Operation {
        let port = u8::from(self.has_service && dice.percent(30));
        let bytes = match dice.below(40) {
            0 => dice.bytes(300),
            1 if !self.sent.is_empty() => self.sent[dice.below(self.sent.len())].clone(),
            2 => Vec::new(),
            _ => {
                let mut bytes = self.frame(dice);
                if self.sent.len() < 8 {
                    self.sent.push(bytes.clone());
                }
                match dice.below(24) {
                    0 => damage(&mut bytes, dice),
                    1 => bytes.extend(self.frame(dice)),
                    _ => {}
                }
                bytes
            }
        };
        Operation::Receive { port, bytes }
    }

    /// A frame whose CRC fits.
    fn frame(&mut self, dice: &mut Dice) -> Vec<u8> {
        let from_autopilot = dice.percent(50);
        let (message, mut payload) = if from_autopilot { of_autopilot(dice) } else { of_ground(dice) };
        match dice.below(16) {
            0 => payload.truncate(dice.below(payload.len() + 1)),
            1 => payload.extend(dice.bytes(255)),
            2 if !payload.is_empty() => {
                let at = dice.below(payload.len());
                payload[at] = dice.byte();
            }
            _ => {}
        }
        self.sequence = self.sequence.wrapping_add(1);
        let mut address = if from_autopilot { [SYSTEM, 1] } else { dice.pick(&[[255, 190], [254, 190]]) };
        let seal = self.seal(dice);
        // Frames with the right signature come from three, so that none is forgotten for the number of others.
        if seal.is_none_or(|seal| seal.key != KEY) && dice.percent(8) {
            let stranger = [dice.byte(), dice.byte()];
            address = dice.pick(&[[1, 1], [4, 1], [SYSTEM, 191], stranger]);
        }
        let from = From { address, sequence: self.sequence };
        if seal.is_none() && message < 256 && dice.percent(15) {
            return frame_1(from, message, &payload);
        }
        // Zeros at the end are left out by most, and may be there.
        if dice.percent(70) {
            let length = payload.iter().rposition(|byte| *byte != 0).map_or(1, |last| last + 1);
            payload.truncate(length);
        }
        frame_2(from, message, &payload, seal)
    }

    fn seal(&mut self, dice: &mut Dice) -> Option<Seal> {
        self.time += 1 + dice.word() % 1000;
        let is_right = match self.signing {
            Signing::Never => return dice.percent(10).then(|| self.made(dice, OTHER_KEY)),
            Signing::Rightly => true,
            Signing::Mixed if dice.percent(40) => return None,
            Signing::Mixed => dice.percent(50),
        };
        Some(self.made(dice, if is_right { KEY } else { OTHER_KEY }))
    }

    fn made(&self, dice: &mut Dice, key: [u8; 32]) -> Seal {
        let time = match dice.below(20) {
            0 => self.time - dice.word() % 20_000_000,
            1 if key != KEY => (1 << 48) - 1,
            _ => self.time,
        };
        Seal { key, link: dice.below(2) as u8, time }
    }
}

/// Changes bytes as a bad line or a bad neighbour would.
fn damage(bytes: &mut Vec<u8>, dice: &mut Dice) {
    if bytes.is_empty() {
        return;
    }
    let at = dice.below(bytes.len());
    match dice.below(5) {
        0 => bytes[at] ^= 1 << dice.below(8),
        1 => bytes[at] = dice.byte(),
        2 => bytes.truncate(at),
        3 => bytes.insert(at, dice.pick(&[0xFD, 0xFE, 0, 255])),
        _ => {
            let tail = bytes[at..].to_vec();
            bytes.extend(tail);
            bytes.truncate(1000);
        }
    }
}
