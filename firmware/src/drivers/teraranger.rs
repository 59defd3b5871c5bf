//! `TeraRanger` One and Evo range sensors on I2C.
//!
//! A measurement is two transactions: [`TeraRanger::trigger`], and no sooner than [`MEASURING_US`] later
//! [`TeraRanger::read_raw_mm`]. They are never joined by a repeated START, which these sensors do not stand. The answer
//! has no header, so a dead bus that reads 00 00 00 passes the checksum as a distance of zero: whoever judges the
//! readings over time has to suspect a run of zeros. An open bus reads FF FF FF and fails.
//!
//! What the raw value means depends on the family: [`RangeReading::from_raw`](crate::io::RangeReading::from_raw).
//!
//! Sources: TeraRanger One user manual (firmware 5.0), TeraRanger Evo 15 m I2C manual pp. 11-12.

use core::fmt::Debug;
use core::ops::RangeInclusive;

use embedded_hal_async::i2c::I2c;

use super::TERABEE_CRC;

/// Factory address of a One (One user manual).
pub const ONE_ADDRESS: u8 = 0x30;
/// Factory address of an Evo (Evo I2C manual p. 11).
pub const EVO_ADDRESS: u8 = 0x31;
/// Addresses that a sensor can be given (Evo I2C manual p. 12).
pub const ADDRESSES: RangeInclusive<u8> = 0x02..=0x7F;
/// Shortest time from the trigger to the reading, microseconds (Evo I2C manual p. 12).
pub const MEASURING_US: u32 = 500;
/// Time that an Evo needs to come back under a new address, milliseconds (Evo I2C manual p. 12). A One comes back only
/// after its supply has been off and on again (One user manual).
pub const EVO_READDRESSING_MS: u32 = 1000;

/// Commands (Evo I2C manual p. 11).
const TRIGGER: u8 = 0x00;
const WHO_AM_I: u8 = 0x01;
const CHANGE_ADDRESS: u8 = 0xA2;
/// The answer to `WHO_AM_I` (Evo I2C manual p. 11).
const IDENTITY: u8 = 0xA1;

/// Why there is no reading.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum TeraRangerError<E: Debug> {
    /// The bus failed; most often nobody acknowledged.
    #[error("range sensor at {address:#04x}: the bus failed: {error:?}")]
    Bus {
        /// Where the sensor should be.
        address: u8,
        /// What the bus says.
        error: E,
    },
    /// The checksum does not fit the distance.
    #[error("range sensor at {address:#04x}: {raw_mm} mm came with checksum {found:#04x} instead of {expected:#04x}")]
    Crc {
        /// Where the sensor is.
        address: u8,
        /// The distance that came.
        raw_mm: u16,
        /// The checksum that came with it.
        found: u8,
        /// The checksum that belongs to it.
        expected: u8,
    },
    /// Something answers, but it is no such sensor.
    #[error("at {address:#04x} is no range sensor: it says {found:#04x} instead of {expected:#04x}")]
    WrongDevice {
        /// Where it answers.
        address: u8,
        /// What it says it is.
        found: u8,
        /// What a range sensor says.
        expected: u8,
    },
    /// A sensor cannot be given this address.
    #[error("address {address:#04x} is not allowed: {lowest:#04x} to {highest:#04x} are")]
    AddressNotAllowed {
        /// The address asked for.
        address: u8,
        /// The lowest allowed.
        lowest: u8,
        /// The highest allowed.
        highest: u8,
    },
}

/// A sensor, known by its address. Four of a kind on one bus have to be given different ones first.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TeraRanger {
    /// Its 7-bit address.
    pub address: u8,
}

impl TeraRanger {
    /// Makes the sensor measure.
    ///
    /// # Errors
    /// [`TeraRangerError::Bus`].
    pub async fn trigger<B: I2c>(self, bus: &mut B) -> Result<(), TeraRangerError<B::Error>> {
        self.write(bus, &[TRIGGER]).await
    }

    /// Fetches the distance measured since the trigger: millimetres, or one of the family's special values.
    ///
    /// # Errors
    /// [`TeraRangerError::Bus`] or [`TeraRangerError::Crc`].
    pub async fn read_raw_mm<B: I2c>(self, bus: &mut B) -> Result<u16, TeraRangerError<B::Error>> {
        let [high, low, found] = self.read(bus).await?;
        let raw_mm = u16::from_be_bytes([high, low]);
        let expected = TERABEE_CRC.checksum(&[high, low]);
        if found != expected {
            return Err(TeraRangerError::Crc { address: self.address, raw_mm, found, expected });
        }
        Ok(raw_mm)
    }

    /// Checks that a range sensor is what answers at the address.
    ///
    /// # Errors
    /// [`TeraRangerError::Bus`] or [`TeraRangerError::WrongDevice`].
    pub async fn who_am_i<B: I2c>(self, bus: &mut B) -> Result<(), TeraRangerError<B::Error>> {
        self.write(bus, &[WHO_AM_I]).await?;
        let [found] = self.read(bus).await?;
        if found != IDENTITY {
            return Err(TeraRangerError::WrongDevice { address: self.address, found, expected: IDENTITY });
        }
        Ok(())
    }

    /// Gives the sensor another address, which it keeps without power; returns the sensor under the new one.
    ///
    /// An Evo answers there after [`EVO_READDRESSING_MS`], a One after its supply has been off and on again. All
    /// sensors that hear the old address take the new one: connect one at a time.
    ///
    /// # Errors
    /// [`TeraRangerError::AddressNotAllowed`], and nothing has been sent, or [`TeraRangerError::Bus`].
    pub async fn readdress<B: I2c>(self, bus: &mut B, new: u8) -> Result<Self, TeraRangerError<B::Error>> {
        if !ADDRESSES.contains(&new) {
            let (lowest, highest) = (*ADDRESSES.start(), *ADDRESSES.end());
            return Err(TeraRangerError::AddressNotAllowed { address: new, lowest, highest });
        }
        self.write(bus, &[CHANGE_ADDRESS, new]).await?;
        Ok(Self { address: new })
    }

    async fn write<B: I2c>(self, bus: &mut B, bytes: &[u8]) -> Result<(), TeraRangerError<B::Error>> {
        let address = self.address;
        bus.write(address, bytes).await.map_err(|error| TeraRangerError::Bus { address, error })
    }

    async fn read<B: I2c, const N: usize>(self, bus: &mut B) -> Result<[u8; N], TeraRangerError<B::Error>> {
        let address = self.address;
        let mut bytes = [0; N];
        bus.read(address, &mut bytes).await.map_err(|error| TeraRangerError::Bus { address, error })?;
        Ok(bytes)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::drivers::scripted::{NACK, ScriptedI2c, Step, block_on};
    use crate::io::RangeReading;
    use adit_protocol::parameters::RangeFamily;

    const EVO: TeraRanger = TeraRanger { address: EVO_ADDRESS };

    fn read_raw_mm(answer: [u8; 3]) -> Result<u16, TeraRangerError<embedded_hal::i2c::ErrorKind>> {
        let mut bus = ScriptedI2c::new([Step::Read(EVO_ADDRESS, answer.to_vec())]);
        let outcome = block_on(EVO.read_raw_mm(&mut bus));
        bus.finish();
        outcome
    }

    #[test]
    fn the_checksum_is_the_one_of_the_manuals() {
        assert_eq!(TERABEE_CRC.checksum(b"123456789"), 0xF4);
        for (bytes, expected) in [([0x00, 0x00], 0x8F), ([0x00, 0x01], 0x88), ([0xFF, 0xFF], 0xAB)] {
            assert_eq!(TERABEE_CRC.checksum(&[b'T', bytes[0], bytes[1]]), expected);
        }
    }

    #[test]
    fn distances_are_big_endian_millimetres_with_a_checksum() {
        for (answer, raw_mm) in [([0x00, 0x01, 0x07], 1), ([0x03, 0xE8, 0xA9], 1000), ([0xFF, 0xFF, 0x24], 0xFFFF)] {
            assert_eq!(read_raw_mm(answer), Ok(raw_mm));
        }
    }

    #[test]
    fn a_dead_bus_of_zeros_passes_the_checksum_and_is_no_distance_in_any_family() {
        assert_eq!(read_raw_mm([0; 3]), Ok(0));
        for family in [RangeFamily::Evo, RangeFamily::One, RangeFamily::OneHub] {
            assert!(!matches!(RangeReading::from_raw(family, 0), RangeReading::Measured(_)), "{family:?}");
        }
    }

    #[test]
    fn an_open_bus_fails_the_checksum() {
        let error = TeraRangerError::Crc { address: EVO_ADDRESS, raw_mm: 0xFFFF, found: 0xFF, expected: 0x24 };
        assert_eq!(read_raw_mm([0xFF; 3]), Err(error));
        assert_eq!(error.to_string(), "range sensor at 0x31: 65535 mm came with checksum 0xff instead of 0x24");
    }

    #[test]
    fn every_single_bit_error_is_found() {
        for bit in 0..24 {
            let mut answer = [0x03, 0xE8, 0xA9];
            answer[bit / 8] ^= 1 << (bit % 8);
            assert!(matches!(read_raw_mm(answer), Err(TeraRangerError::Crc { .. })), "bit {bit}");
        }
    }

    #[test]
    fn triggering_and_reading_are_two_transactions() {
        let steps = [Step::Write(ONE_ADDRESS, vec![0x00]), Step::Read(ONE_ADDRESS, vec![0x03, 0xE8, 0xA9])];
        let mut bus = ScriptedI2c::new(steps);
        let one = TeraRanger { address: ONE_ADDRESS };
        assert_eq!(block_on(one.trigger(&mut bus)), Ok(()));
        assert_eq!(block_on(one.read_raw_mm(&mut bus)), Ok(1000));
        bus.finish();
    }

    #[test]
    fn a_sensor_that_is_not_there_is_named() {
        let mut bus = ScriptedI2c::new([Step::Nack(0x31), Step::Nack(0x31)]);
        let error = TeraRangerError::Bus { address: 0x31, error: NACK };
        assert_eq!(block_on(EVO.trigger(&mut bus)), Err(error));
        assert_eq!(block_on(EVO.read_raw_mm(&mut bus)), Err(error));
        bus.finish();
    }

    #[test]
    fn a_stranger_at_the_address_is_found_out() {
        let steps = [0xA1, 0xAF].map(|identity| [Step::Write(0x31, vec![0x01]), Step::Read(0x31, vec![identity])]);
        let mut bus = ScriptedI2c::new(steps.into_iter().flatten());
        assert_eq!(block_on(EVO.who_am_i(&mut bus)), Ok(()));
        let error = TeraRangerError::WrongDevice { address: 0x31, found: 0xAF, expected: 0xA1 };
        assert_eq!(block_on(EVO.who_am_i(&mut bus)), Err(error));
        bus.finish();
    }

    #[test]
    fn a_new_address_is_sent_to_the_old_one() {
        let mut bus = ScriptedI2c::new([Step::Write(0x31, vec![0xA2, 0x02]), Step::Write(0x02, vec![0xA2, 0x7F])]);
        let moved = block_on(EVO.readdress(&mut bus, 0x02)).unwrap();
        assert_eq!(moved, TeraRanger { address: 0x02 });
        assert_eq!(block_on(moved.readdress(&mut bus, 0x7F)), Ok(TeraRanger { address: 0x7F }));
        bus.finish();
    }

    #[test]
    fn a_forbidden_address_is_never_sent() {
        let mut bus = ScriptedI2c::new([]);
        for address in [0x00, 0x01, 0x80, 0xFF] {
            let error = TeraRangerError::AddressNotAllowed { address, lowest: 0x02, highest: 0x7F };
            assert_eq!(block_on(EVO.readdress(&mut bus, address)), Err(error));
        }
    }
}
