//! The append-only board log as bytes.
//!
//! A log is a chain of frames. A frame is `COBS(kind, payload, CRC-32) 0x00`: one byte for the kind of record, its fields
//! in postcard's encoding, and the CRC-32/ISO-HDLC (little endian) of both. Zero occurs nowhere but at the ends of frames,
//! so a reader finds its way back after any damage, and a torn tail costs the last record at most. A header begins with a
//! zero of its own, which closes whatever an earlier run of the board left torn in the same file. Any number of zeros may
//! stand between frames: the board writes its records into a file of zeros, and the rest of them stays behind the last.
//!
//! Newer programs may append fields to a record (older readers ignore them) and add kinds (older readers report
//! [`DecodeError::UnknownKind`] and go on). Anything else raises [`FORMAT`].

mod decode;
#[cfg(feature = "std")]
mod flight;

use crc::{CRC_32_ISO_HDLC, CRC_64_XZ, Crc};
use serde::Serialize;

pub use decode::{DecodeError, Decoder, Located};
#[cfg(feature = "std")]
pub use flight::{FlightLog, Session, TagConflict};

use crate::parameters::Parameters;
use crate::record::{Entry, Header, Record};

/// Version of the log's format.
pub const FORMAT: u16 = 3;

/// The longest frame, both zeros included. A header with a chain of 24 vertices needs about 700 bytes.
pub const MAX_FRAME_BYTES: usize = 1024;

/// Name, in a card's root, of the file that offers parameters to the board: a log that ends after its header.
pub const PARAMETERS_FILE: &str = "PARAMS.ADT";

/// A frame, ready to be appended to the log.
pub type Frame = heapless::Vec<u8, MAX_FRAME_BYTES>;

/// COBS adds one byte in 254 and one at the start; the zeros are two more.
const MAX_CONTENT_BYTES: usize = MAX_FRAME_BYTES - MAX_FRAME_BYTES / 254 - 1 - 3;
const CRC_BYTES: usize = 4;
const FRAME_CRC: Crc<u32> = Crc::<u32>::new(&CRC_32_ISO_HDLC);
const PARAMETERS_CRC: Crc<u64> = Crc::<u64>::new(&CRC_64_XZ);

/// What a frame holds; the first byte of its content.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Kind {
    /// [`Header`].
    Header = 0,
    /// [`crate::tag::CaptureTag`].
    Tag = 1,
    /// [`crate::record::TagUpdate`].
    TagUpdate = 2,
    /// [`crate::record::Event`].
    Event = 3,
    /// [`crate::record::CentringSample`].
    Centring = 4,
    /// [`crate::record::SpeedSample`].
    Speed = 5,
    /// [`crate::record::Message`].
    Message = 6,
}

impl Kind {
    fn from_byte(byte: u8) -> Option<Self> {
        [Self::Header, Self::Tag, Self::TagUpdate, Self::Event, Self::Centring, Self::Speed, Self::Message]
            .into_iter()
            .find(|kind| *kind as u8 == byte)
    }
}

/// Why a record cannot be written.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum EncodeError {
    /// The record does not fit a frame.
    #[error("a record is longer than {MAX_CONTENT_BYTES} bytes")]
    TooLong,
}

impl Header {
    /// The header for a log that is written with these parameters by this program (name and version, cut to 24 bytes).
    ///
    /// # Errors
    /// [`EncodeError::TooLong`] if the parameters do not fit a frame.
    pub fn new(parameters: &Parameters, program: &str) -> Result<Self, EncodeError> {
        let mut name = heapless::String::new();
        for letter in program.chars() {
            if name.push(letter).is_err() {
                break;
            }
        }
        Ok(Self {
            format: FORMAT,
            program: name,
            parameters_hash: parameters_hash(parameters)?,
            parameters: parameters.clone(),
        })
    }
}

/// Returns the hash that tells two sets of parameters apart: CRC-64/XZ of their postcard encoding.
///
/// # Errors
/// [`EncodeError::TooLong`] if the parameters do not fit a frame.
pub fn parameters_hash(parameters: &Parameters) -> Result<u64, EncodeError> {
    let mut buffer = [0; MAX_CONTENT_BYTES];
    let bytes = postcard::to_slice(parameters, &mut buffer).map_err(|_| EncodeError::TooLong)?;
    Ok(PARAMETERS_CRC.checksum(bytes))
}

/// Encodes a header, with a zero in front.
///
/// # Errors
/// [`EncodeError::TooLong`] if it does not fit a frame.
pub fn encode_header(header: &Header) -> Result<Frame, EncodeError> {
    frame(Kind::Header, header, true)
}

/// Encodes what the controller asks to be written.
///
/// # Errors
/// [`EncodeError::TooLong`] if it does not fit a frame, which no entry does.
pub fn encode_entry(entry: &Entry) -> Result<Frame, EncodeError> {
    match entry {
        Entry::Tag(tag) => frame(Kind::Tag, tag, false),
        Entry::TagUpdate(update) => frame(Kind::TagUpdate, update, false),
        Entry::Event(event) => frame(Kind::Event, event, false),
        Entry::Centring(sample) => frame(Kind::Centring, sample, false),
        Entry::Speed(sample) => frame(Kind::Speed, sample, false),
    }
}

/// Encodes any record.
///
/// # Errors
/// [`EncodeError::TooLong`] if it does not fit a frame.
pub fn encode(record: &Record) -> Result<Frame, EncodeError> {
    match record {
        Record::Header(header) => encode_header(header),
        Record::Message(message) => frame(Kind::Message, message, false),
        Record::Entry(entry) => encode_entry(entry),
    }
}

fn frame(kind: Kind, payload: &impl Serialize, zero_first: bool) -> Result<Frame, EncodeError> {
    let mut buffer = [0; MAX_CONTENT_BYTES];
    let (first, rest) = buffer.split_first_mut().ok_or(EncodeError::TooLong)?;
    *first = kind as u8;
    let payload_bytes = postcard::to_slice(payload, rest).map_err(|_| EncodeError::TooLong)?.len();
    seal(buffer, 1 + payload_bytes, zero_first)
}

/// Appends the CRC to the first `used` bytes and wraps them up.
fn seal(mut buffer: [u8; MAX_CONTENT_BYTES], used: usize, zero_first: bool) -> Result<Frame, EncodeError> {
    let crc = FRAME_CRC.checksum(buffer.get(..used).ok_or(EncodeError::TooLong)?);
    let tail = buffer.get_mut(used..used + CRC_BYTES).ok_or(EncodeError::TooLong)?;
    tail.copy_from_slice(&crc.to_le_bytes());
    let content = buffer.get(..used + CRC_BYTES).ok_or(EncodeError::TooLong)?;
    let mut stuffed = [0; MAX_FRAME_BYTES];
    let stuffed_bytes = cobs::try_encode(content, &mut stuffed).map_err(|_| EncodeError::TooLong)?;
    let mut frame = Frame::new();
    if zero_first {
        frame.push(0).map_err(|_| EncodeError::TooLong)?;
    }
    frame
        .extend_from_slice(stuffed.get(..stuffed_bytes).ok_or(EncodeError::TooLong)?)
        .map_err(|_| EncodeError::TooLong)?;
    frame.push(0).map_err(|_| EncodeError::TooLong)?;
    Ok(frame)
}

#[cfg(all(test, feature = "std"))]
mod tests;
