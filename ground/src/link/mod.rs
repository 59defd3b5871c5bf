//! The link to the board: one session type for the live view, the parameter commands and recording.
//!
//! A [`Session`] owns the line ([`transport`], which connects again by itself), reads and writes frames, signs and verifies
//! them if there is a key, records both ways, and hands everything it hears to whoever listens. Questions to the board are
//! methods of it; the bookkeeping behind the longer ones is free of sockets and clocks ([`ParameterFetch`], [`LogFetch`]).
//!
//! Every question is asked again until it is answered or the line has been silent for [`Patience::silence`]: lines over radio
//! lose, repeat and reorder.
//!
//! What a record holds: the messages of MAVLink's common dialect. A frame of any other cannot be told from damage, since its
//! checksum covers a number that only its dialect has.

mod clock;
mod commands;
mod error;
mod key;
mod log_fetch;
mod logs;
mod parameter_fetch;
mod parameter_file;
mod parameter_set;
mod parameters;
mod pump;
mod record;
mod session;
mod transport;
mod trust;
mod version;

pub use clock::ClockReading;
pub use commands::CommandOutcome;
pub use error::{LinkError, Question, SerialTrouble};
pub use key::{KeyError, KeyFile};
pub use log_fetch::{LOG_WINDOW_BYTES, LogEndedEarly, LogFetch};
pub use logs::{LogEntry, LogProgress, log_name};
pub use parameter_fetch::{Parameter, ParameterFetch};
pub use parameter_file::{ParameterFile, ParameterFileError, ParameterFileProblem, value_like};
pub use parameter_set::{GatherError, figures, fingerprint, gathered};
pub use parameters::{Shown, same_value};
pub use record::Recorder;
pub use session::{Config, Heard, LinkState, Patience, Peer, Session, Summary};
pub use transport::{Line, LineEvent, serial_ports};
pub use trust::{Trust, Verifier};
pub use version::Board;

#[cfg(test)]
pub(crate) mod tests;
