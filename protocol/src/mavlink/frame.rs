//! From bytes to frames. Any bytes give an answer, and no sound frame is lost behind or within garbage.
//!
//! Layout (mavlink.io): version 2 is `FD length incompat compat sequence system component id(3) payload crc(2)`, with 13
//! bytes of signature behind if bit 0 of `incompat` is set; version 1 is `FE length sequence system component id payload
//! crc(2)`. The CRC is CRC-16/MCRF4XX over everything behind the first byte and one byte that stands for the message's layout.

use mavlink::Message;
use mavlink::dialects::common::MavMessage;

/// The longest frame: version 2 with full payload and signature.
pub const MAX_FRAME_BYTES: usize = 280;

/// Not in the crate's dialect: `development.xml` of MAVLink, work in progress.
pub(super) const SET_VELOCITY_LIMITS: u32 = 354;
/// By the rule of mavlink.io, "`CRC_EXTRA` Calculation", over `development.xml`.
const SET_VELOCITY_LIMITS_EXTRA: u8 = 210;

const MAGIC_1: u8 = 0xFE;
pub(super) const MAGIC_2: u8 = 0xFD;
const HEADER_1: usize = 6;
const HEADER_2: usize = 10;
const CRC_BYTES: usize = 2;
pub(super) const SIGNATURE_BYTES: usize = 13;
/// How much of the hash a signature carries.
pub(super) const HASH_BYTES: usize = 6;
/// Bit 0 of `incompat`: the frame is signed. With any other bit set nobody may read the frame.
pub(super) const SIGNED: u8 = 1;

/// A frame whose CRC fits, as it came off the wire.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RawFrame {
    /// Who sent it.
    pub system: u8,
    /// Which part of it.
    pub component: u8,
    /// The sender's count.
    pub sequence: u8,
    /// Kind of message.
    pub message: u32,
    bytes: heapless::Vec<u8, MAX_FRAME_BYTES>,
    header: usize,
    length: usize,
}

/// What stands behind a signed frame. It has not been looked at.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Seal {
    /// The sender's number for the link that the frame was sent on.
    pub link: u8,
    /// When it was sent, in units of 10 us since 2015-01-01 UTC.
    pub time: u64,
    /// The first bytes of the hash.
    pub hash: [u8; HASH_BYTES],
}

impl RawFrame {
    /// The whole frame.
    pub fn wire(&self) -> &[u8] {
        &self.bytes
    }

    /// The fields. Zeros at the end may be left out.
    pub fn payload(&self) -> &[u8] {
        self.bytes.get(self.header..self.header + self.length).unwrap_or_default()
    }

    /// The signature, if there is one, and the bytes that it was made from besides the key, its hash left out.
    pub fn seal(&self) -> Option<(Seal, &[u8])> {
        let start = self.header + self.length + CRC_BYTES;
        let [link, t0, t1, t2, t3, t4, t5, hash @ ..] = *self.bytes.get(start..)?.first_chunk::<SIGNATURE_BYTES>()?;
        let time = u64::from_le_bytes([t0, t1, t2, t3, t4, t5, 0, 0]);
        let covered = self.bytes.get(..start + SIGNATURE_BYTES - HASH_BYTES)?;
        Some((Seal { link, time, hash }, covered))
    }

    /// `N` bytes of the payload from `offset` on, zeros beyond its end.
    pub fn bytes<const N: usize>(&self, offset: usize) -> [u8; N] {
        let mut bytes = [0; N];
        for (place, byte) in bytes.iter_mut().zip(self.payload().iter().skip(offset)) {
            *place = *byte;
        }
        bytes
    }

    /// A byte.
    pub fn u8(&self, offset: usize) -> u8 {
        u8::from_le_bytes(self.bytes(offset))
    }

    /// A half word.
    pub fn u16(&self, offset: usize) -> u16 {
        u16::from_le_bytes(self.bytes(offset))
    }

    /// A word.
    pub fn u32(&self, offset: usize) -> u32 {
        u32::from_le_bytes(self.bytes(offset))
    }

    /// A double word.
    pub fn u64(&self, offset: usize) -> u64 {
        u64::from_le_bytes(self.bytes(offset))
    }

    /// A single.
    pub fn f32(&self, offset: usize) -> f32 {
        f32::from_le_bytes(self.bytes(offset))
    }
}

/// What came in so far.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counters {
    /// Frames whose CRC fits.
    pub good: u32,
    /// Stretches that looked like a frame and were none: damage, or a message that this dialect does not know.
    pub bad: u32,
    /// Bytes that belonged to no frame.
    pub dropped_bytes: u32,
}

/// Collects bytes into frames.
#[derive(Clone, Debug, Default)]
pub struct FrameDecoder {
    bytes: heapless::Vec<u8, MAX_FRAME_BYTES>,
    counters: Counters,
}

/// What the bytes at the buffer's start are.
#[expect(clippy::large_enum_variant, reason = "taken apart where it is returned")]
enum Front {
    /// Too few to tell.
    Incomplete,
    /// Nothing that begins here is a frame.
    Garbage,
    /// A frame of so many bytes.
    Frame(RawFrame, usize),
}

impl FrameDecoder {
    /// Bytes of a frame that has begun.
    pub fn pending_bytes(&self) -> usize {
        self.bytes.len()
    }

    /// Gives up a frame that has begun: its end will not come. Returns a whole frame that was waiting behind its start.
    ///
    /// To be called when the line has been silent for longer than bytes of one frame lie apart; until it returns `None`.
    pub fn resynchronise(&mut self) -> Option<RawFrame> {
        if self.bytes.is_empty() {
            return None;
        }
        self.skip();
        self.take()
    }

    /// What came in so far.
    pub fn counters(&self) -> Counters {
        self.counters
    }

    /// Takes a byte; returns a frame that it completes.
    pub fn push(&mut self, byte: u8) -> Option<RawFrame> {
        // There is room: a buffer that holds the longest frame is judged and shortened below.
        let _ = self.bytes.push(byte);
        self.take()
    }

    /// The frame at the buffer's start, garbage before it removed.
    fn take(&mut self) -> Option<RawFrame> {
        loop {
            match front(&self.bytes) {
                Front::Incomplete => return None,
                Front::Frame(frame, length) => {
                    self.counters.good = self.counters.good.wrapping_add(1);
                    self.remove(length);
                    return Some(frame);
                }
                Front::Garbage => self.skip(),
            }
        }
    }

    /// Removes what is no frame: up to the next byte that could begin one.
    fn skip(&mut self) {
        let began = self.bytes.first().is_some_and(|first| is_magic(*first));
        self.counters.bad = self.counters.bad.wrapping_add(u32::from(began));
        let next = self.bytes.iter().skip(1).position(|byte| is_magic(*byte));
        let garbage = next.map_or(self.bytes.len(), |next| next + 1);
        self.counters.dropped_bytes = self.counters.dropped_bytes.wrapping_add(garbage as u32);
        self.remove(garbage);
    }

    fn remove(&mut self, count: usize) {
        let count = count.min(self.bytes.len());
        let left = self.bytes.len() - count;
        self.bytes.rotate_left(count);
        self.bytes.truncate(left);
    }
}

fn is_magic(byte: u8) -> bool {
    byte == MAGIC_1 || byte == MAGIC_2
}

fn front(bytes: &[u8]) -> Front {
    let (header, signature) = match bytes {
        [] | [MAGIC_2] | [MAGIC_2, _] => return Front::Incomplete,
        [MAGIC_1, ..] => (HEADER_1, 0),
        [MAGIC_2, _, incompat, ..] if incompat & !SIGNED != 0 => return Front::Garbage,
        [MAGIC_2, _, incompat, ..] => (HEADER_2, if incompat & SIGNED == 0 { 0 } else { SIGNATURE_BYTES }),
        _ => return Front::Garbage,
    };
    let Some(length) = bytes.get(1).map(|length| usize::from(*length)) else { return Front::Incomplete };
    let whole = header + length + CRC_BYTES + signature;
    let Some(frame) = bytes.get(..whole) else { return Front::Incomplete };
    match read(frame, header, length) {
        Some(read) => Front::Frame(read, whole),
        None => Front::Garbage,
    }
}

/// Reads a whole frame; `None` if its CRC does not fit.
fn read(frame: &[u8], header: usize, length: usize) -> Option<RawFrame> {
    let byte = |index: usize| frame.get(index).copied();
    let (sequence, system, component, message) = if header == HEADER_1 {
        (byte(2)?, byte(3)?, byte(4)?, u32::from(byte(5)?))
    } else {
        (byte(4)?, byte(5)?, byte(6)?, u32::from_le_bytes([byte(7)?, byte(8)?, byte(9)?, 0]))
    };
    let checked = frame.get(1..header + length)?;
    // Nothing is known of a message without such a byte, its CRC least of all.
    let extra = Some(extra_crc(message)).filter(|extra| *extra != 0)?;
    let crc = mavlink::calculate_crc(checked, extra);
    let found = u16::from_le_bytes([byte(header + length)?, byte(header + length + 1)?]);
    let bytes = heapless::Vec::from_slice(frame).ok()?;
    (crc == found).then_some(RawFrame { system, component, sequence, message, bytes, header, length })
}

/// The byte that stands for a message's layout; 0 for messages that are not known.
pub(super) fn extra_crc(message: u32) -> u8 {
    match message {
        SET_VELOCITY_LIMITS => SET_VELOCITY_LIMITS_EXTRA,
        _ => MavMessage::extra_crc(message),
    }
}
