//! What can go wrong on the link.

use std::fmt;
use std::io;
use std::path::PathBuf;
use std::time::Duration;

use adit_protocol::connection::Connection;
use adit_protocol::mavlink::Value;

use super::key::KeyError;
use super::log_fetch::LogEndedEarly;
use super::parameters::Shown;
use super::transport::serial_ports;

/// What was asked of the board.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Question {
    /// What it is.
    Version,
    /// All parameters.
    Parameters,
    /// One parameter.
    Parameter(String),
    /// A change of one.
    Change(String),
    /// A command by its number.
    Command(u16),
    /// What its clock says.
    Clock,
    /// What logs there are.
    Logs,
    /// A log.
    Log(u16),
    /// That it take a key, or give it up.
    Key,
}

impl fmt::Display for Question {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Version => write!(out, "what the board is"),
            Self::Parameters => write!(out, "the list of parameters"),
            Self::Parameter(name) => write!(out, "parameter {name}"),
            Self::Change(name) => write!(out, "the change of {name}"),
            Self::Command(number) => write!(out, "command {number}"),
            Self::Clock => write!(out, "the question for the time"),
            Self::Logs => write!(out, "the list of logs"),
            Self::Log(number) => write!(out, "log {number}"),
            Self::Key => write!(out, "the key"),
        }
    }
}

/// Why a serial line cannot be opened, and what to do.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum SerialTrouble {
    /// There is no such port.
    #[error("there is no such port; is the cable plugged in at both ends?")]
    Missing,
    /// Another program has it.
    #[error("another program uses it; end that program first (QGroundControl, Mission Planner, ModemManager)")]
    Busy,
    /// It belongs to others.
    #[error(
        "you may not use it; join the group that owns it, on most systems by `sudo usermod -aG dialout $USER`, and log \
         in again"
    )]
    Forbidden,
    /// It is no serial port, or does not know the rate.
    #[error("it is no serial port, or does not know this rate")]
    Other,
}

/// Why the link does not do what was asked.
#[derive(Debug, thiserror::Error)]
pub enum LinkError {
    /// A serial line cannot be opened.
    #[error("{path}: cannot be opened: {trouble}; {}", ports(known))]
    Serial {
        /// The device.
        path: String,
        /// Why, and what to do.
        trouble: SerialTrouble,
        /// The ports that there are.
        known: Vec<String>,
        /// What the system said.
        source: io::Error,
    },
    /// A socket cannot be opened, or nobody listens.
    #[error("{connection}: cannot be opened")]
    Open {
        /// The connection.
        connection: String,
        /// What the system said.
        source: io::Error,
    },
    /// Bytes come in, and none of them is a frame.
    #[error("{connection}: {bytes} bytes came in and no MAVLink among them; {}", noise(connection))]
    Noise {
        /// The connection.
        connection: Connection,
        /// How many bytes.
        bytes: u32,
    },
    /// The key's file cannot be used.
    #[error(transparent)]
    Key(#[from] KeyError),
    /// The record cannot be written.
    #[error("{}: the record cannot be written", path.display())]
    Record {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// No board is heard.
    #[error(
        "no board (component 191) was heard within {} s; {}; is it on, and is this the right connection?",
        within.as_secs_f32(), heard(others)
    )]
    NoBoard {
        /// How long it was waited for.
        within: Duration,
        /// Who was heard instead.
        others: Vec<String>,
    },
    /// A question was asked again and again, and not answered.
    #[error("{question} was not answered within {} s{}", within.as_secs_f32(), reason(said.as_deref()))]
    NoAnswer {
        /// The question.
        question: Question,
        /// How long the line was silent.
        within: Duration,
        /// What the board said meanwhile.
        said: Option<String>,
    },
    /// A change of a parameter was refused: the board answers with another value.
    #[error("{name}: asked for {}, the board has {}{}", Shown(*wanted), Shown(*found), reason(said.as_deref()))]
    ParameterRefused {
        /// Which.
        name: String,
        /// What was asked for.
        wanted: Value,
        /// What it is.
        found: Value,
        /// What the board said.
        said: Option<String>,
    },
    /// A key was refused.
    #[error("the board refused the key{}", reason(said.as_deref()))]
    KeyRefused {
        /// What the board said.
        said: Option<String>,
    },
    /// A log ended before its length.
    #[error(transparent)]
    LogEnded(#[from] LogEndedEarly),
    /// A log's file cannot be written.
    #[error("{}: cannot be written", path.display())]
    LogFile {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// The session has ended.
    #[error("the session has ended")]
    Ended,
}

fn ports(known: &[String]) -> String {
    if known.is_empty() {
        return "this machine has no serial ports".to_owned();
    }
    format!("the serial ports here are {}", known.join(", "))
}

/// What to do about bytes that are no frames.
fn noise(connection: &Connection) -> String {
    match connection {
        Connection::Serial { baud, .. } => format!(
            "{baud} baud is not the other end's rate, or it speaks something else: try 57600 (radios), 115200 (USB), 921600 \
             (the board's TELEM2), or another port; {}",
            ports(&serial_ports())
        ),
        _ => "what is at the other end speaks something else; is this the right port?".to_owned(),
    }
}

fn heard(others: &[String]) -> String {
    if others.is_empty() { "nothing at all was heard".to_owned() } else { format!("heard: {}", others.join(", ")) }
}

fn reason(said: Option<&str>) -> String {
    said.map(|said| format!("; the board says: {said}")).unwrap_or_default()
}
