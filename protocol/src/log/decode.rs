//! From bytes to records. Returns for any bytes, and finds the next record after any damage.

use serde::Deserialize;

use super::{CRC_BYTES, FRAME_CRC, Kind, MAX_FRAME_BYTES};
use crate::record::{Entry, Record};

/// A record and where its frame starts in the log.
#[derive(Clone, Debug, PartialEq)]
pub struct Located {
    /// Offset of the frame's first byte.
    pub offset: usize,
    /// The record.
    pub record: Record,
}

/// Why a stretch of the log gave no record. The reader goes on behind it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum DecodeError {
    /// The log ends within a frame.
    #[error("byte {offset}: the log ends within a record, after {bytes} of its bytes")]
    Torn {
        /// Offset of the frame's first byte.
        offset: usize,
        /// Length of what is there.
        bytes: usize,
    },
    /// The frame is longer than any record, or its stuffing is broken.
    #[error("byte {offset}: {bytes} bytes that are no frame")]
    Broken {
        /// Offset of the frame's first byte.
        offset: usize,
        /// Length of the stretch.
        bytes: usize,
    },
    /// The CRC does not fit.
    #[error("byte {offset}: a record of {bytes} bytes with CRC {found:08x}, its content has {computed:08x}")]
    Crc {
        /// Offset of the frame's first byte.
        offset: usize,
        /// Length of the frame.
        bytes: usize,
        /// What the frame says.
        found: u32,
        /// What its content gives.
        computed: u32,
    },
    /// A sound record of a kind that this program does not know: a newer board wrote the log.
    #[error("byte {offset}: a sound record of the unknown kind {kind}, written by a newer program")]
    UnknownKind {
        /// Offset of the frame's first byte.
        offset: usize,
        /// Its kind.
        kind: u8,
    },
    /// A sound frame of a known kind with content that this program does not know.
    #[error("byte {offset}: a sound record of kind {kind:?} with unknown content, written by a newer program")]
    UnknownContent {
        /// Offset of the frame's first byte.
        offset: usize,
        /// Its kind.
        kind: Kind,
    },
}

impl DecodeError {
    /// Offset of the first byte of the stretch that gave no record.
    pub fn offset(&self) -> usize {
        match *self {
            Self::Torn { offset, .. }
            | Self::Broken { offset, .. }
            | Self::Crc { offset, .. }
            | Self::UnknownKind { offset, .. }
            | Self::UnknownContent { offset, .. } => offset,
        }
    }
}

/// Iterates over the records of a log.
#[derive(Clone, Debug)]
pub struct Decoder<'b> {
    bytes: &'b [u8],
    offset: usize,
}

impl<'b> Decoder<'b> {
    /// Starts at the log's first byte.
    pub fn new(bytes: &'b [u8]) -> Self {
        Self { bytes, offset: 0 }
    }
}

impl Iterator for Decoder<'_> {
    type Item = Result<Located, DecodeError>;

    fn next(&mut self) -> Option<Self::Item> {
        loop {
            let offset = self.offset;
            let rest = self.bytes.get(offset..).filter(|rest| !rest.is_empty())?;
            let Some(end) = rest.iter().position(|byte| *byte == 0) else {
                self.offset = self.bytes.len();
                return Some(Err(DecodeError::Torn { offset, bytes: rest.len() }));
            };
            self.offset = offset + end + 1;
            let frame = rest.get(..end).unwrap_or_default();
            // Zeros in a row: the one in front of a header, or the unused end of a file, which the board fills with them.
            if !frame.is_empty() {
                return Some(record(frame, offset).map(|record| Located { offset, record }));
            }
        }
    }
}

fn record(frame: &[u8], offset: usize) -> Result<Record, DecodeError> {
    let broken = DecodeError::Broken { offset, bytes: frame.len() };
    let mut buffer = [0; MAX_FRAME_BYTES];
    if frame.len() > buffer.len() {
        return Err(broken);
    }
    let bytes = cobs::decode(frame, &mut buffer).map_err(|_| broken)?.frame_size();
    let content = buffer.get(..bytes).ok_or(broken)?;
    let (sealed, tail) = content.split_last_chunk::<CRC_BYTES>().ok_or(broken)?;
    let (found, computed) = (u32::from_le_bytes(*tail), FRAME_CRC.checksum(sealed));
    if found != computed {
        return Err(DecodeError::Crc { offset, bytes: frame.len(), found, computed });
    }
    let (&kind, payload) = sealed.split_first().ok_or(broken)?;
    let kind = Kind::from_byte(kind).ok_or(DecodeError::UnknownKind { offset, kind })?;
    let unknown = DecodeError::UnknownContent { offset, kind };
    Ok(match kind {
        Kind::Header => Record::Header(fields(payload).ok_or(unknown)?),
        Kind::Tag => Record::Entry(Entry::Tag(fields(payload).ok_or(unknown)?)),
        Kind::TagUpdate => Record::Entry(Entry::TagUpdate(fields(payload).ok_or(unknown)?)),
        Kind::Event => Record::Entry(Entry::Event(fields(payload).ok_or(unknown)?)),
        Kind::Centring => Record::Entry(Entry::Centring(fields(payload).ok_or(unknown)?)),
        Kind::Message => Record::Message(fields(payload).ok_or(unknown)?),
        Kind::Speed => Record::Entry(Entry::Speed(fields(payload).ok_or(unknown)?)),
    })
}

/// The known fields; bytes behind them are fields of a newer program.
fn fields<'b, T: Deserialize<'b>>(payload: &'b [u8]) -> Option<T> {
    postcard::take_from_bytes(payload).ok().map(|(value, _)| value)
}
