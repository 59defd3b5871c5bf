//! The append-only board log.

/// Version of the log's format.
pub const FORMAT: u16 = 1;
