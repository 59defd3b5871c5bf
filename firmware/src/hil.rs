//! A simulator flies a real board: its inputs come over a serial line, its outputs go back, one answer for each question.
//!
//! A message is `COBS(postcard fields, CRC-32) 0x00`: zero occurs nowhere but at the ends, so both sides find their way back
//! after any damage. The board steps when it is asked and with the time that it is given; so a flight over a slow line is
//! the same flight as over a fast one.

use adit_protocol::parameters::Parameters;
use crc::{CRC_32_ISO_HDLC, Crc};
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

use crate::io::{Inputs, Outputs};

/// Baud rate of TELEM2 in the `hil` build.
pub const BAUD: u32 = 921_600;
/// The longest message on the wire: a step's outputs with eight tags, or parameters with a chain of 24 vertices.
pub const MAX_BYTES: usize = 1536;

const CRC: Crc<u32> = Crc::<u32>::new(&CRC_32_ISO_HDLC);
const CRC_BYTES: usize = 4;

/// What the simulator says.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[expect(clippy::large_enum_variant, reason = "no allocation on the board, which holds one at a time")]
pub enum Question {
    /// Begin anew, with these parameters.
    Begin(Parameters),
    /// One step.
    Step {
        /// Since the board's start, in the simulator's time.
        now_us: u64,
        /// What the board sees.
        inputs: Inputs,
    },
}

/// What the board answers.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[expect(clippy::large_enum_variant, reason = "no allocation on the board, which holds one at a time")]
pub enum Answer {
    /// The controller is set up.
    Ready {
        /// Hash of the parameters as the board has them, [`adit_protocol::log::parameters_hash`].
        parameters_hash: u64,
    },
    /// The step is done.
    Done {
        /// The time that the question gave.
        now_us: u64,
        /// What the board wants.
        outputs: Outputs,
    },
}

/// Encodes a message; `None` if it does not fit, which no question and no answer does.
pub fn encode(message: &impl Serialize) -> Option<heapless::Vec<u8, MAX_BYTES>> {
    let mut content = [0; MAX_BYTES];
    let length = postcard::to_slice(message, &mut content).ok()?.len();
    let crc = CRC.checksum(content.get(..length)?);
    content.get_mut(length..length + CRC_BYTES)?.copy_from_slice(&crc.to_le_bytes());
    let mut wire = heapless::Vec::new();
    wire.resize(MAX_BYTES, 0).ok()?;
    // One byte is kept for the end.
    let stuffed = cobs::try_encode(content.get(..length + CRC_BYTES)?, wire.get_mut(..MAX_BYTES - 1)?).ok()?;
    wire.truncate(stuffed + 1);
    *wire.last_mut()? = 0;
    Some(wire)
}

/// Collects bytes into messages.
#[derive(Debug, Default)]
pub struct Decoder {
    bytes: heapless::Vec<u8, MAX_BYTES>,
    overlong: bool,
}

impl Decoder {
    /// Takes a byte; returns the message that it completes. Damaged messages are dropped.
    pub fn push<M: DeserializeOwned>(&mut self, byte: u8) -> Option<M> {
        if byte != 0 {
            self.overlong |= self.bytes.push(byte).is_err();
            return None;
        }
        let message = if self.overlong { None } else { decode(&mut self.bytes) };
        self.bytes.clear();
        self.overlong = false;
        message
    }
}

fn decode<M: DeserializeOwned>(frame: &mut [u8]) -> Option<M> {
    let length = cobs::decode_in_place(frame).ok()?;
    let (fields, crc) = frame.get(..length)?.split_last_chunk::<CRC_BYTES>()?;
    (CRC.checksum(fields) == u32::from_le_bytes(*crc)).then(|| postcard::from_bytes(fields).ok()).flatten()
}

#[cfg(test)]
mod tests {
    use adit_protocol::record::{Entry, TagUpdate};
    use adit_protocol::tag::CaptureState;
    use proptest::prelude::*;

    use super::*;
    use crate::io::{MAX_ENTRIES, RangeReading, RangeSample};

    fn question() -> Question {
        let mut inputs = Inputs { shaft_encoder_rad: Some(1.5), ..Inputs::default() };
        inputs.ranges.left = RangeSample { reading: RangeReading::Measured(2.5), count: 7 };
        Question::Step { now_us: 5_000, inputs }
    }

    #[test]
    fn messages_come_out_as_they_went_in() {
        let update = TagUpdate { capture: 3, state: CaptureState::Busy, time_us: 0 };
        let entries = heapless::Vec::from_array([Entry::TagUpdate(update); MAX_ENTRIES]);
        let answer = Answer::Done { now_us: 5_000, outputs: Outputs { entries, ..Outputs::default() } };
        let mut decoder = Decoder::default();
        let read = encode(&answer).unwrap().into_iter().filter_map(|byte| decoder.push::<Answer>(byte)).last();
        assert_eq!(read, Some(answer));
        let begin = Question::Begin(Parameters::default());
        let read = encode(&begin).unwrap().into_iter().filter_map(|byte| decoder.push::<Question>(byte)).last();
        assert_eq!(read, Some(begin));
    }

    proptest! {
        #[test]
        fn a_message_after_any_garbage_is_found(garbage in proptest::collection::vec(any::<u8>(), 0..4000)) {
            let mut decoder = Decoder::default();
            let wire = encode(&question()).unwrap();
            let bytes = garbage.into_iter().chain([0]).chain(wire);
            let read: Vec<Question> = bytes.filter_map(|byte| decoder.push(byte)).collect();
            prop_assert_eq!(read.last(), Some(&question()));
        }
    }
}
