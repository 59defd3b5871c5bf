//! What board, simulator and ground say to each other: the capture tag, the append-only board log, the board's
//! parameters, and (for hosts, feature `std`) the mission, survey and tag files.
#![cfg_attr(not(feature = "std"), no_std)]
#![forbid(unsafe_code)]

pub mod beams;
#[cfg(feature = "std")]
pub mod connection;
pub mod log;
pub mod mavlink;
#[cfg(feature = "std")]
pub mod mission;
pub mod parameters;
pub mod record;
pub mod tag;
#[cfg(feature = "std")]
pub mod tag_table;
pub mod telemetry;
