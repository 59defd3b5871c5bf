//! From messages to frames of one component, signed if there is a key.

use mavlink::{MavlinkVersion, MessageData};

use super::MAX_FRAME_BYTES;
use super::frame::{MAGIC_2, extra_crc};
use super::signing::Signer;

/// A frame to be sent.
pub type OutFrame = heapless::Vec<u8, MAX_FRAME_BYTES>;

/// Wraps messages into frames of one component.
#[derive(Clone, Debug)]
pub struct Sender {
    /// The vehicle's number, or a ground station's.
    pub system: u8,
    /// Which part of it.
    pub component: u8,
    /// Signs every frame, if there is one.
    pub signer: Option<Signer>,
    sequence: u8,
}

impl Sender {
    /// For this component; unsigned.
    pub fn new(system: u8, component: u8) -> Self {
        Self { system, component, signer: None, sequence: 0 }
    }

    /// A message of the crate.
    pub(super) fn frame<M: MessageData>(&mut self, message: &M) -> OutFrame {
        let mut payload = [0; 255];
        let length = message.ser(MavlinkVersion::V2, &mut payload);
        self.wrap(M::ID, payload.get(..length).unwrap_or_default())
    }

    /// A message whose fields lie as on the wire.
    pub(super) fn wrap(&mut self, message: u32, payload: &[u8]) -> OutFrame {
        // Zeros at the end are left out, but for the first byte (mavlink.io, "Empty-Byte Payload Truncation").
        let length = payload.iter().rposition(|byte| *byte != 0).map_or(1, |last| last + 1);
        let [low, middle, high, _] = message.to_le_bytes();
        let header = [MAGIC_2, length as u8, 0, 0, self.sequence, self.system, self.component, low, middle, high];
        self.sequence = self.sequence.wrapping_add(1);
        let mut frame = OutFrame::new();
        // All fit: 10 and 255 bytes, the CRC's two and 13 of a signature, of 280.
        let _ = frame.extend_from_slice(&header);
        let _ = frame.extend_from_slice(payload.get(..length).unwrap_or_default());
        if self.signer.is_some() {
            Signer::mark(&mut frame);
        }
        let crc = mavlink::calculate_crc(frame.get(1..).unwrap_or_default(), extra_crc(message));
        let _ = frame.extend_from_slice(&crc.to_le_bytes());
        if let Some(signer) = &mut self.signer {
            signer.seal(&mut frame);
        }
        frame
    }
}
