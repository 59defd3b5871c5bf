//! Frames of MAVLink by the test's own arithmetic: laid out, checked and signed apart from the code under test.
//!
//! Source: mavlink.io, "Packet Serialization" and "Message Signing"; the extra bytes are those of `common.xml` as `pymavlink`
//! generates them.

use crc::{CRC_16_MCRF4XX, Crc};
use sha2::{Digest, Sha256};

const CRC: Crc<u16> = Crc::<u16>::new(&CRC_16_MCRF4XX);
/// A signature: link, six bytes of time, six of the hash.
const SIGNATURE_BYTES: usize = 13;

/// Messages that the link reads, or that come by: number, extra byte of the CRC, bytes of the payload.
pub(crate) const MESSAGES: [(u32, u8, usize); 26] = [
    (0, 50, 9),
    (20, 214, 20),
    (21, 159, 2),
    (22, 220, 25),
    (23, 168, 23),
    (30, 39, 28),
    (32, 185, 28),
    (74, 20, 20),
    (76, 152, 33),
    (77, 143, 10),
    (84, 143, 53),
    (111, 34, 18),
    (117, 128, 6),
    (118, 56, 14),
    (119, 116, 12),
    (120, 134, 97),
    (122, 203, 2),
    (132, 85, 39),
    (148, 178, 78),
    (251, 170, 18),
    (253, 83, 54),
    (256, 71, 42),
    (263, 133, 255),
    (331, 91, 233),
    (354, 210, 14),
    (385, 147, 133),
];

/// Who sends.
#[derive(Clone, Copy, Debug)]
pub(crate) struct From {
    /// System and component.
    pub(crate) address: [u8; 2],
    /// Its count.
    pub(crate) sequence: u8,
}

/// A signature to be made.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Seal {
    /// The secret.
    pub(crate) key: [u8; 32],
    /// The sender's number for the link.
    pub(crate) link: u8,
    /// In units of 10 us.
    pub(crate) time: u64,
}

/// A frame of version 1; what such a frame cannot carry is cut.
pub(crate) fn frame_1(from: From, message: u32, payload: &[u8]) -> Vec<u8> {
    let payload = &payload[..payload.len().min(255)];
    let [system, component] = from.address;
    let mut frame = vec![0xFE, payload.len() as u8, from.sequence, system, component, message as u8];
    frame.extend_from_slice(payload);
    close(&mut frame, message & 0xFF);
    frame
}

/// A frame of version 2, signed or not; what such a frame cannot carry is cut.
pub(crate) fn frame_2(from: From, message: u32, payload: &[u8], seal: Option<Seal>) -> Vec<u8> {
    let payload = &payload[..payload.len().min(255)];
    let ([system, component], [low, middle, high, _]) = (from.address, message.to_le_bytes());
    let incompat = u8::from(seal.is_some());
    let mut frame = vec![0xFD, payload.len() as u8, incompat, 0, from.sequence, system, component, low, middle, high];
    frame.extend_from_slice(payload);
    close(&mut frame, message);
    if let Some(seal) = seal {
        frame.push(seal.link);
        frame.extend_from_slice(&seal.time.to_le_bytes()[..6]);
        let hash = hash(&seal.key, &frame);
        frame.extend_from_slice(&hash);
    }
    frame
}

fn close(frame: &mut Vec<u8>, message: u32) {
    let extra = MESSAGES.iter().find(|(number, ..)| *number == message).map_or(0, |(_, extra, _)| *extra);
    let mut digest = CRC.digest();
    digest.update(&frame[1..]);
    digest.update(&[extra]);
    frame.extend_from_slice(&digest.finalize().to_le_bytes());
}

fn hash(key: &[u8; 32], covered: &[u8]) -> [u8; 6] {
    let digest = Sha256::new().chain_update(key).chain_update(covered).finalize();
    core::array::from_fn(|at| digest[at])
}

/// When a whole frame was signed with this key; `None` if it was not.
pub(crate) fn signed_at(key: &[u8; 32], frame: &[u8]) -> Option<u64> {
    let is_signed = frame.len() >= 12 + SIGNATURE_BYTES && frame[0] == 0xFD && frame[2] & 1 == 1;
    let (covered, found) = frame.split_at_checked(frame.len().checked_sub(6)?)?;
    if !is_signed || hash(key, covered) != found {
        return None;
    }
    let mut time = [0; 8];
    time[..6].copy_from_slice(&covered[covered.len() - 6..]);
    Some(u64::from_le_bytes(time))
}

/// Message and payload of a whole, unsigned frame of version 2.
pub(crate) fn taken_apart(frame: &[u8]) -> (u32, Vec<u8>) {
    let message = u32::from_le_bytes([frame[7], frame[8], frame[9], 0]);
    (message, frame[10..10 + usize::from(frame[1])].to_vec())
}
