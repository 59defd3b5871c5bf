//! The board's log as its card holds it: header first, then every entry; torn if power was lost.

use adit_protocol::log::{self, EncodeError};
use adit_protocol::record::{Entry, Header};

use crate::flight::{Flight, Outcome};
use crate::seed::{Random, Stream};

/// Name and version of the program that writes logs here.
const PROGRAM: &str = concat!("adit-sim ", env!("CARGO_PKG_VERSION"));
/// A power loss tears off up to so many bytes: less than the shortest tag, so that one record at most is lost.
const TORN_BYTES: f64 = 20.0;

/// The bytes of the flight's log.
///
/// # Errors
/// [`EncodeError`] if a record does not fit its frame.
pub fn log_bytes(flight: &Flight) -> Result<Vec<u8>, EncodeError> {
    let mut bytes = log::encode_header(&Header::new(&flight.parameters, PROGRAM)?)?.to_vec();
    for entry in &flight.entries {
        bytes.extend_from_slice(&log::encode_entry(entry)?);
    }
    if flight.outcome == Outcome::PowerLost && !flight.entries.is_empty() {
        let last = last_frame_bytes(&flight.entries)?;
        let mut random = Random::numbered(flight.seed, Stream::Faults, 1000);
        let torn = (random.uniform(1.0, TORN_BYTES) as usize).min(last - 1);
        bytes.truncate(bytes.len() - torn);
    }
    Ok(bytes)
}

fn last_frame_bytes(entries: &[Entry]) -> Result<usize, EncodeError> {
    entries.last().map_or(Ok(2), |entry| Ok(log::encode_entry(entry)?.len().max(2)))
}
