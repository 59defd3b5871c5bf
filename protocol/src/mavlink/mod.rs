//! MAVLink as the board speaks it; the only place that names the `mavlink` crate.
//!
//! Incoming frames are checked for their CRC and then read field by field ([`Incoming`]): a peer that is newer than our
//! dialect may send values that the crate's types do not know, and would refuse a whole message for one of them. Outgoing
//! messages are the crate's ([`Sender`]). Signing, parameters and time synchronisation are not here yet.
//!
//! Sources: mavlink.io, "Packet Serialization"; `common.xml`.

mod frame;
mod incoming;
mod outgoing;

pub use frame::{Counters, FrameDecoder, MAX_FRAME_BYTES, RawFrame};
pub use incoming::Incoming;
pub use outgoing::{Beat, OutFrame, RangeReport, Sender};

/// Component of the autopilot, `MAV_COMP_ID_AUTOPILOT1`.
pub const AUTOPILOT_COMPONENT: u8 = 1;
/// Our component, `MAV_COMP_ID_ONBOARD_COMPUTER`.
pub const BOARD_COMPONENT: u8 = 191;
/// `MAV_AUTOPILOT_INVALID`: what is no autopilot.
pub const NO_AUTOPILOT: u8 = 8;
/// The longest text of a notice, `STATUSTEXT`.
pub const TEXT_BYTES: usize = 50;

/// Numbers of commands, `MAV_CMD`.
pub mod command {
    /// `DO_CHANGE_SPEED`: type of speed, speed in m/s.
    pub const CHANGE_SPEED: u16 = 178;
    /// `COMPONENT_ARM_DISARM`: 1 arms, 0 disarms.
    pub const ARM_DISARM: u16 = 400;
    /// `IMAGE_START_CAPTURE`.
    pub const START_CAPTURE: u16 = 2000;
    /// `IMAGE_STOP_CAPTURE`.
    pub const STOP_CAPTURE: u16 = 2001;
    /// `USER_1`: gives the range sensor at the first address the second (7 bits each); while the board is idle.
    pub const READDRESS: u16 = 31_010;
}

/// Outcome of a command, `MAV_RESULT`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CommandResult {
    /// It is done, or will be.
    Accepted,
    /// Nobody here knows it.
    Unsupported,
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
