//! MAVLink as board, autopilots and ground speak it here; the only place that names the `mavlink` crate.
//!
//! Incoming frames are checked for their CRC and then read field by field ([`Incoming`]): a peer that is newer than our
//! dialect may send values that the crate's types do not know, and would refuse a whole message for one of them. Outgoing
//! messages are the crate's where it has them ([`Sender`]); a number that its types cannot name, and extension fields (which
//! need a feature that does not build for the board), are laid out by hand. [`signing`] says who is believed.
//!
//! Sources: mavlink.io, "Packet Serialization"; `common.xml`.

mod board;
mod camera;
mod frame;
mod incoming;
mod instruments;
mod modes;
mod requests;
mod sender;
pub mod signing;
mod value;
mod vehicle;

use core::fmt;

use crate::record::Mode;

pub use board::{RangeReport, VersionReport};
pub use camera::{CameraReport, CaptureReport};
pub use frame::{Counters, FrameDecoder, MAX_FRAME_BYTES, RawFrame, Seal};
pub use incoming::{Incoming, LOG_BYTES, TUNNEL_BYTES, Target};
pub use instruments::Instrument;
pub use modes::ModeWords;
pub use sender::{OutFrame, Sender};
pub use signing::{Key, SignatureError, Signer, Streams};
pub use value::{Encoding, NAME_BYTES, Name, RawValue, Value};
pub use vehicle::VehicleBeat;

/// Component of the autopilot, `MAV_COMP_ID_AUTOPILOT1`.
pub const AUTOPILOT_COMPONENT: u8 = 1;
/// Our component, `MAV_COMP_ID_ONBOARD_COMPUTER`.
pub const BOARD_COMPONENT: u8 = 191;
/// Our component as a camera, `MAV_COMP_ID_CAMERA`: ground stations look for cameras there.
pub const CAMERA_COMPONENT: u8 = 100;
/// `MAV_AUTOPILOT_INVALID`: what is no autopilot.
pub const NO_AUTOPILOT: u8 = 8;
/// The longest text of a notice, `STATUSTEXT`.
pub const TEXT_BYTES: usize = 50;

/// Numbers of commands, `MAV_CMD`.
pub mod command {
    /// `DO_CHANGE_SPEED`: type of speed, speed in m/s.
    pub const CHANGE_SPEED: u16 = 178;
    /// `PREFLIGHT_REBOOT_SHUTDOWN`: the second parameter 1 restarts an onboard computer.
    pub const REBOOT: u16 = 246;
    /// `COMPONENT_ARM_DISARM`: 1 arms, 0 disarms.
    pub const ARM_DISARM: u16 = 400;
    /// `SET_MESSAGE_INTERVAL`: message, interval in microseconds.
    pub const SET_MESSAGE_INTERVAL: u16 = 511;
    /// `REQUEST_MESSAGE`: message, which one of several.
    pub const REQUEST_MESSAGE: u16 = 512;
    /// `REQUEST_AUTOPILOT_CAPABILITIES`, superseded.
    pub const REQUEST_CAPABILITIES: u16 = 520;
    /// `REQUEST_CAMERA_INFORMATION`, superseded.
    pub const REQUEST_CAMERA_INFORMATION: u16 = 521;
    /// `REQUEST_CAMERA_SETTINGS`, superseded.
    pub const REQUEST_CAMERA_SETTINGS: u16 = 522;
    /// `REQUEST_STORAGE_INFORMATION`, superseded.
    pub const REQUEST_STORAGE_INFORMATION: u16 = 525;
    /// `REQUEST_CAMERA_CAPTURE_STATUS`, superseded.
    pub const REQUEST_CAPTURE_STATUS: u16 = 527;
    /// `IMAGE_START_CAPTURE`.
    pub const START_CAPTURE: u16 = 2000;
    /// `IMAGE_STOP_CAPTURE`.
    pub const STOP_CAPTURE: u16 = 2001;
    /// `USER_1`: gives the range sensor at the first address the second (7 bits each); while the board is idle.
    pub const READDRESS: u16 = 31_010;
}

/// Numbers of messages that are asked for by number.
pub mod message {
    /// `LOCAL_POSITION_NED`.
    pub const LOCAL_POSITION: u32 = 32;
    /// `ATTITUDE`.
    pub const ATTITUDE: u32 = 30;
    /// `VFR_HUD`.
    pub const HEAD_UP: u32 = 74;
    /// `AUTOPILOT_VERSION`.
    pub const VERSION: u32 = 148;
    /// `CAMERA_INFORMATION`.
    pub const CAMERA_INFORMATION: u32 = 259;
    /// `CAMERA_SETTINGS`.
    pub const CAMERA_SETTINGS: u32 = 260;
    /// `STORAGE_INFORMATION`.
    pub const STORAGE_INFORMATION: u32 = 261;
    /// `CAMERA_CAPTURE_STATUS`.
    pub const CAPTURE_STATUS: u32 = 262;
    /// `CAMERA_IMAGE_CAPTURED`.
    pub const IMAGE_CAPTURED: u32 = 263;
}

/// The autopilots whose ways are known.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub enum Autopilot {
    /// `MAV_AUTOPILOT_ARDUPILOTMEGA`.
    ArduPilot,
    /// `MAV_AUTOPILOT_PX4`.
    Px4,
    /// Any other.
    Other(u8),
}

impl Autopilot {
    /// Its name; `None` of any other.
    pub fn name(self) -> Option<&'static str> {
        match self {
            Self::ArduPilot => Some("ArduPilot"),
            Self::Px4 => Some("PX4"),
            Self::Other(_) => None,
        }
    }
}

impl fmt::Display for Autopilot {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Other(number) => write!(out, "MAV_AUTOPILOT {number}"),
            known => out.write_str(known.name().unwrap_or_default()),
        }
    }
}

impl From<u8> for Autopilot {
    fn from(number: u8) -> Self {
        match number {
            3 => Self::ArduPilot,
            12 => Self::Px4,
            other => Self::Other(other),
        }
    }
}

/// Outcome of a command, `MAV_RESULT`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CommandResult {
    /// It is done, or will be.
    Accepted = 0,
    /// Not now; ask again later.
    TemporarilyRejected = 1,
    /// Not like this.
    Denied = 2,
    /// Nobody here knows it.
    Unsupported = 3,
    /// It was tried and did not work.
    Failed = 4,
}

/// How much a notice matters, `MAV_SEVERITY`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Severity {
    /// Something is broken.
    Error,
    /// Something will break, or is off.
    Warning,
    /// Good to know.
    Info,
}

#[cfg(all(test, feature = "std"))]
mod tests;
