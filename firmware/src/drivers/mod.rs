//! Drivers of what hangs on the board's buses: bytes on one side, meaning on the other.
//!
//! They are generic over the bus traits of `embedded-hal` and know neither the microcontroller nor its clock: waits
//! between transactions are the caller's, given as constants. The same code runs on the board, in the emulator and,
//! over scripted buses, in the tests here.

pub mod as5600;
pub mod fram;
pub mod herobus;
pub mod hub;
pub mod imu;
pub mod memory;
#[cfg(test)]
pub(crate) mod scripted;
pub mod teraranger;

use crc::{CRC_8_SMBUS, Crc};

/// The checksum of everything Terabee makes: polynomial 0x07, initially zero, not reflected (manuals of One and
/// Evo; the table in the maker's `helper_lib.cpp` is the same).
static TERABEE_CRC: Crc<u8> = Crc::<u8>::new(&CRC_8_SMBUS);
