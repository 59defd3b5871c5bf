//! What outlives the power: values in the board's FRAM, each in two copies.
//!
//! A save writes over the older copy and never touches the newest valid one, so that power may fail at any byte of it:
//! the next start finds the old value or the new one. A copy is sealed with a CRC, so a torn one is told from a whole one;
//! the sequence number tells which of two whole ones is newer. FRAM has no wear that matters (10^14 writes, Cypress
//! FM25V01 data sheet, "Features"), so both copies stay where they are.
//!
//! ```text
//! offset  bytes  content, little endian
//! 0       4      mark: what is stored here
//! 4       2      version of the payload's layout
//! 6       2      length of the payload
//! 8       4      sequence number, wraps
//! 12      n      payload, postcard
//! 12 + n  4      CRC-32/ISO-HDLC of everything before
//! ```

mod board;
#[cfg(test)]
mod tests;

use core::marker::PhantomData;

use crc::{CRC_32_ISO_HDLC, Crc};
use serde::Serialize;
use serde::de::DeserializeOwned;

pub use board::{FlightState, FlightStore, HashedParameters, LinkStore, ParameterStore};

use crate::drivers::memory::Memory;

const HEADER_BYTES: usize = 12;
const CRC_BYTES: usize = 4;
const COPY_CRC: Crc<u32> = Crc::<u32>::new(&CRC_32_ISO_HDLC);

/// Why a value could not be loaded or saved.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum StoreError<E> {
    /// An access failed.
    #[error("the memory does not answer at address {address:#06x}")]
    Memory {
        /// Where the access began.
        address: u16,
        /// What the memory says.
        error: E,
    },
    /// The value is too long for its place.
    #[error("the value does not fit the {room_bytes} bytes of its place")]
    TooLong {
        /// Room for the payload.
        room_bytes: usize,
    },
    /// What was written does not read back: the memory is protected, broken or missing. The old value is still there.
    #[error("what was written at address {address:#06x} does not read back")]
    NotKept {
        /// Where the copy begins.
        address: u16,
    },
}

/// What was found in a place.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Stored<T> {
    /// The newest value.
    Loaded {
        /// The value.
        value: T,
        /// Its sequence number.
        sequence: u32,
        /// Where its copy begins.
        address: u16,
        /// Was the other copy damaged? It is after a save that was cut short, and then a value newer than this one is lost.
        other_damaged: bool,
    },
    /// Nothing was ever saved here: the memory is blank.
    Empty,
    /// Neither copy is whole.
    Corrupt,
    /// The newest value was saved by a program with another layout.
    OtherVersion {
        /// Its version.
        found: u16,
        /// The version that this program knows.
        known: u16,
    },
}

impl<T> Stored<T> {
    /// The value, if there is one.
    pub fn value(self) -> Option<T> {
        match self {
            Self::Loaded { value, .. } => Some(value),
            Self::Empty | Self::Corrupt | Self::OtherVersion { .. } => None,
        }
    }
}

/// The place of one value: two copies of at most `COPY_BYTES` bytes each, the second right behind the first.
#[derive(Clone, Copy, Debug)]
pub struct Place<T, const COPY_BYTES: usize> {
    /// Tells what is stored here from anything else.
    pub mark: [u8; 4],
    /// Version of the payload's layout.
    pub version: u16,
    /// Where the first copy begins.
    pub address: u16,
    /// The type that is stored.
    pub value: PhantomData<T>,
}

/// What the bytes of one copy are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Copy {
    /// Never written.
    Blank,
    /// Torn or disturbed.
    Damaged,
    /// Whole.
    Sealed { sequence: u32, version: u16, payload_bytes: usize },
}

impl<T: Serialize + DeserializeOwned, const COPY_BYTES: usize> Place<T, COPY_BYTES> {
    /// How many bytes of the memory both copies take.
    pub const BYTES: usize = 2 * COPY_BYTES;

    const ROOM_BYTES: usize = COPY_BYTES - HEADER_BYTES - CRC_BYTES;

    /// Reads the newest value.
    ///
    /// # Errors
    /// [`StoreError::Memory`] if the memory does not answer.
    pub fn load<M: Memory>(&self, memory: &mut M) -> Result<Stored<T>, StoreError<M::Error>> {
        let mut buffer = [0; COPY_BYTES];
        let copies = self.copies(memory, &mut buffer)?;
        let Some(newest) = newest_of(copies) else {
            return Ok(if copies == [Copy::Blank; 2] { Stored::Empty } else { Stored::Corrupt });
        };
        // The buffer holds the second copy; the newest may be the first.
        let copy = self.copy(memory, newest, &mut buffer)?;
        let Copy::Sealed { sequence, version, payload_bytes } = copy else {
            return Ok(Stored::Corrupt);
        };
        if version != self.version {
            return Ok(Stored::OtherVersion { found: version, known: self.version });
        }
        let payload = buffer.get(HEADER_BYTES..HEADER_BYTES + payload_bytes).unwrap_or_default();
        Ok(match postcard::take_from_bytes(payload) {
            Ok((value, [])) => Stored::Loaded {
                value,
                sequence,
                address: self.address_of(newest),
                other_damaged: copies.contains(&Copy::Damaged),
            },
            _ => Stored::Corrupt,
        })
    }

    /// Writes the value over the older copy and reads it back.
    ///
    /// # Errors
    /// Any [`StoreError`]; the old value survives.
    pub fn save<M: Memory>(&self, memory: &mut M, value: &T) -> Result<(), StoreError<M::Error>> {
        let too_long = StoreError::TooLong { room_bytes: Self::ROOM_BYTES };
        let mut buffer = [0; COPY_BYTES];
        let copies = self.copies(memory, &mut buffer)?;
        let newest = newest_of(copies);
        let sequence = match newest.and_then(|place| copies.get(place)) {
            Some(Copy::Sealed { sequence, .. }) => sequence.wrapping_add(1),
            _ => 0,
        };
        let target = usize::from(newest == Some(0));

        let Some((head, room)) = buffer.split_first_chunk_mut::<HEADER_BYTES>() else {
            return Err(too_long);
        };
        let room = room.get_mut(..Self::ROOM_BYTES).unwrap_or_default();
        let Ok(payload) = postcard::to_slice(value, room) else {
            return Err(too_long);
        };
        let payload_bytes = payload.len();
        *head = header(self.mark, self.version, payload_bytes as u16, sequence);
        let sealed_bytes = HEADER_BYTES + payload_bytes;
        let crc = COPY_CRC.checksum(buffer.get(..sealed_bytes).unwrap_or_default());
        if let Some(tail) = buffer.get_mut(sealed_bytes..sealed_bytes + CRC_BYTES) {
            tail.copy_from_slice(&crc.to_le_bytes());
        }

        let address = self.address_of(target);
        let bytes = buffer.get(..sealed_bytes + CRC_BYTES).unwrap_or_default();
        memory.write(address, bytes).map_err(|error| StoreError::Memory { address, error })?;
        let wanted = Copy::Sealed { sequence, version: self.version, payload_bytes };
        if self.copy(memory, target, &mut buffer)? != wanted {
            return Err(StoreError::NotKept { address });
        }
        Ok(())
    }

    fn address_of(&self, copy: usize) -> u16 {
        self.address + (copy * COPY_BYTES) as u16
    }

    fn copies<M: Memory>(
        &self,
        memory: &mut M,
        buffer: &mut [u8; COPY_BYTES],
    ) -> Result<[Copy; 2], StoreError<M::Error>> {
        Ok([self.copy(memory, 0, buffer)?, self.copy(memory, 1, buffer)?])
    }

    /// Reads one copy into the buffer and judges it.
    fn copy<M: Memory>(
        &self,
        memory: &mut M,
        copy: usize,
        buffer: &mut [u8; COPY_BYTES],
    ) -> Result<Copy, StoreError<M::Error>> {
        let address = self.address_of(copy);
        memory.read(address, buffer).map_err(|error| StoreError::Memory { address, error })?;
        Ok(self.judge(buffer))
    }

    fn judge(&self, bytes: &[u8; COPY_BYTES]) -> Copy {
        if bytes.iter().all(|byte| *byte == 0) || bytes.iter().all(|byte| *byte == 0xFF) {
            return Copy::Blank;
        }
        let Some((head, rest)) = bytes.split_first_chunk::<HEADER_BYTES>() else {
            return Copy::Damaged;
        };
        let [m0, m1, m2, m3, v0, v1, l0, l1, s0, s1, s2, s3] = *head;
        let payload_bytes = usize::from(u16::from_le_bytes([l0, l1]));
        let tail = rest.get(payload_bytes..).and_then(<[u8]>::first_chunk::<CRC_BYTES>);
        let sealed = bytes.get(..HEADER_BYTES + payload_bytes);
        let (Some(tail), Some(sealed)) = (tail, sealed) else {
            return Copy::Damaged;
        };
        if [m0, m1, m2, m3] != self.mark || u32::from_le_bytes(*tail) != COPY_CRC.checksum(sealed) {
            return Copy::Damaged;
        }
        Copy::Sealed {
            sequence: u32::from_le_bytes([s0, s1, s2, s3]),
            version: u16::from_le_bytes([v0, v1]),
            payload_bytes,
        }
    }
}

fn header(mark: [u8; 4], version: u16, payload_bytes: u16, sequence: u32) -> [u8; HEADER_BYTES] {
    let [m0, m1, m2, m3] = mark;
    let ([v0, v1], [l0, l1]) = (version.to_le_bytes(), payload_bytes.to_le_bytes());
    let [s0, s1, s2, s3] = sequence.to_le_bytes();
    [m0, m1, m2, m3, v0, v1, l0, l1, s0, s1, s2, s3]
}

/// Which whole copy is the newer; the numbers wrap, and two copies are never far apart.
fn newest_of(copies: [Copy; 2]) -> Option<usize> {
    match copies {
        [Copy::Sealed { sequence: first, .. }, Copy::Sealed { sequence: second, .. }] => {
            Some(usize::from(second.wrapping_sub(first).cast_signed() > 0))
        }
        [Copy::Sealed { .. }, _] => Some(0),
        [_, Copy::Sealed { .. }] => Some(1),
        _ => None,
    }
}
