//! Who is believed: with a key, who signed with it.
//!
//! Each sender is held to its own times. A board without a calendar lags behind an autopilot with one until it has heard a
//! signed command, and would be refused if both were measured by one clock.

use std::collections::BTreeMap;

use adit_protocol::mavlink::{Key, RawFrame, SignatureError, Streams};
use serde::{Deserialize, Serialize};

/// What a frame's signature is worth.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Trust {
    /// Nobody looked: there is no key.
    Unchecked,
    /// It was made with the key, and the frame was not heard before.
    Verified,
    /// It is not believed.
    Refused(SignatureError),
}

impl Trust {
    /// Whether to act on the frame.
    pub fn is_believed(self) -> bool {
        !matches!(self, Self::Refused(_))
    }
}

/// Judges frames.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Verifier {
    senders: BTreeMap<u16, Streams>,
}

impl Verifier {
    /// Judges a frame by the key.
    pub fn judge(&mut self, key: Option<&Key>, frame: &RawFrame) -> Trust {
        let Some(key) = key else { return Trust::Unchecked };
        let sender = u16::from_be_bytes([frame.system, frame.component]);
        // A stranger without the key is not remembered.
        let mut streams = self.senders.get(&sender).cloned().unwrap_or_default();
        match streams.accept(key, frame) {
            Ok(()) => {
                self.senders.insert(sender, streams);
                Trust::Verified
            }
            Err(error) => Trust::Refused(error),
        }
    }
}

#[cfg(test)]
mod tests {
    use adit_protocol::mavlink::{FrameDecoder, Sender, Signer};
    use adit_protocol::record::Mode;

    use super::*;

    const KEY: Key = Key([3; 32]);

    fn frame(component: u8, time: Option<u64>) -> RawFrame {
        let mut sender = Sender::new(1, component);
        sender.signer = time.map(|time| Signer { key: KEY, link: 0, time });
        let mut decoder = FrameDecoder::default();
        sender.heartbeat(Mode::Idle).iter().find_map(|byte| decoder.push(*byte)).unwrap()
    }

    #[test]
    fn a_board_without_a_calendar_is_believed_beside_an_autopilot_with_one() {
        let mut verifier = Verifier::default();
        assert_eq!(verifier.judge(Some(&KEY), &frame(1, Some(1 << 40))), Trust::Verified);
        assert_eq!(verifier.judge(Some(&KEY), &frame(191, Some(5))), Trust::Verified);
        assert_eq!(verifier.judge(Some(&KEY), &frame(191, Some(5))), Trust::Refused(SignatureError::Replayed));
    }

    #[test]
    fn without_a_key_nobody_looks_and_with_one_unsigned_frames_are_refused() {
        let mut verifier = Verifier::default();
        assert_eq!(verifier.judge(None, &frame(191, None)), Trust::Unchecked);
        assert_eq!(verifier.judge(Some(&KEY), &frame(191, None)), Trust::Refused(SignatureError::Unsigned));
        assert_eq!(verifier, Verifier::default());
    }
}
