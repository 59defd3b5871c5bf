//! The board's log as the card has it: its files in the order of their names, one behind the other.

use adit_protocol::log::Decoder;
use adit_protocol::record::{Entry, Record};

use crate::machine::VolumeError;
use crate::report::Report;

/// What the firmware's log files are called.
const EXTENSION: &str = ".LOG";

/// A log.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct CardLog {
    /// Its bytes; zeros between files and behind the last record are part of the format.
    pub bytes: Vec<u8>,
    /// The entries in it.
    pub entries: Vec<Entry>,
}

/// Reads the log off the card of a flight; one that holds no log gives an empty one.
///
/// # Errors
/// [`VolumeError`] if the card's volume is damaged.
pub fn log_of(report: &Report) -> Result<CardLog, VolumeError> {
    let files = report.files()?;
    let logs = files.into_iter().filter(|(name, _)| name.to_ascii_uppercase().ends_with(EXTENSION));
    let bytes: Vec<u8> = logs.flat_map(|(_, bytes)| bytes).collect();
    let entries = Decoder::new(&bytes).filter_map(|item| match item.ok()?.record {
        Record::Entry(entry) => Some(entry),
        Record::Header(_) | Record::Message(_) => None,
    });
    Ok(CardLog { entries: entries.collect(), bytes })
}
