//! AS5600 magnetic encoder on I2C: the angle of the camera shaft.
//!
//! Status and angle are read in one transaction, so that they belong to the same instant. Without a magnet the chip
//! still delivers an angle, made of noise; here that is an error. The angle grows clockwise, seen from the chip's top,
//! with the DIR pin low; where the optical axis lies against the magnet is the caller's business.
//!
//! Source: ams AS5600 datasheet v1-06, figures 21 and 22 (registers, STATUS), p. 13 (address pointer).

use core::f32::consts::TAU;
use core::fmt::Debug;

use embedded_hal_async::i2c::I2c;

/// The chip's only address (datasheet p. 12).
pub const ADDRESS: u8 = 0x36;

/// STATUS; RAW ANGLE follows, high byte first. The address pointer counts up over both, because it was not set to the
/// angle itself (p. 13).
const STATUS: u8 = 0x0B;
/// STATUS bits (figure 22): magnet detected, too weak, too strong.
const DETECTED: u8 = 0x20;
const TOO_WEAK: u8 = 0x10;
const TOO_STRONG: u8 = 0x08;
/// Counts in a turn: RAW ANGLE has 12 bits.
const COUNTS: u16 = 4096;

/// How the magnet sits.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Magnet {
    /// At the right distance.
    Good,
    /// Too far away: the angle is noisier than it could be.
    Weak,
    /// Too near: the angle is less linear than it could be.
    Strong,
}

/// A reading.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Angle {
    /// Angle of the magnet, 0 to 2 pi radians in steps of 1.5 mrad.
    pub angle_rad: f32,
    /// How far the angle is to be trusted.
    pub magnet: Magnet,
}

/// Why there is no angle.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum As5600Error<E: Debug> {
    /// The bus failed; most often nobody acknowledged.
    #[error("shaft encoder: the bus failed: {0:?}")]
    Bus(E),
    /// The chip sees no magnet.
    #[error("shaft encoder: no magnet (status {status:#04x}, raw angle {raw})")]
    NoMagnet {
        /// STATUS as it came.
        status: u8,
        /// RAW ANGLE as it came.
        raw: u16,
    },
    /// The chip cannot have said this: a magnet both too weak and too strong, or an angle beyond a turn.
    #[error("shaft encoder: impossible answer (status {status:#04x}, raw angle {raw} of {COUNTS})")]
    Garbled {
        /// STATUS as it came.
        status: u8,
        /// RAW ANGLE as it came.
        raw: u16,
    },
}

/// The encoder. It needs no setting up and keeps no state.
#[derive(Clone, Copy, Debug, Default)]
pub struct As5600;

impl As5600 {
    /// Reads the angle.
    ///
    /// # Errors
    /// [`As5600Error`]: there is no angle without a magnet.
    pub async fn read<B: I2c>(self, bus: &mut B) -> Result<Angle, As5600Error<B::Error>> {
        let mut answer = [0; 3];
        bus.write_read(ADDRESS, &[STATUS], &mut answer).await.map_err(As5600Error::Bus)?;
        let [status, high, low] = answer;
        let raw = u16::from_be_bytes([high, low]);
        let magnet = match (status & TOO_WEAK != 0, status & TOO_STRONG != 0) {
            (true, true) => return Err(As5600Error::Garbled { status, raw }),
            (true, false) => Magnet::Weak,
            (false, true) => Magnet::Strong,
            (false, false) => Magnet::Good,
        };
        if status & DETECTED == 0 {
            return Err(As5600Error::NoMagnet { status, raw });
        }
        if raw >= COUNTS {
            return Err(As5600Error::Garbled { status, raw });
        }
        Ok(Angle { angle_rad: f32::from(raw) * (TAU / f32::from(COUNTS)), magnet })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::drivers::scripted::{NACK, ScriptedI2c, Step, block_on};

    fn read(status: u8, raw: u16) -> Result<Angle, As5600Error<embedded_hal::i2c::ErrorKind>> {
        let [high, low] = raw.to_be_bytes();
        let mut bus = ScriptedI2c::new([Step::WriteRead(0x36, vec![0x0B], vec![status, high, low])]);
        let outcome = block_on(As5600.read(&mut bus));
        bus.finish();
        outcome
    }

    #[test]
    fn a_turn_has_4096_counts() {
        for (raw, expected_deg) in [(0, 0.0), (1024, 90.0), (2048, 180.0), (4095, 359.912)] {
            let angle = read(DETECTED, raw).unwrap();
            assert!((angle.angle_rad.to_degrees() - expected_deg).abs() < 1e-3, "{raw}: {angle:?}");
        }
    }

    #[test]
    fn a_weak_or_strong_magnet_is_told() {
        let magnet = |status| read(status, 7).map(|angle| angle.magnet);
        assert_eq!(magnet(0x20), Ok(Magnet::Good));
        assert_eq!(magnet(0x30), Ok(Magnet::Weak));
        assert_eq!(magnet(0x28), Ok(Magnet::Strong));
        assert_eq!(magnet(0xE7 | DETECTED), Ok(Magnet::Good), "the other bits say nothing");
    }

    #[test]
    fn without_a_magnet_there_is_no_angle() {
        for status in [0x00, TOO_WEAK, TOO_STRONG, 0xC7] {
            assert_eq!(read(status, 1234), Err(As5600Error::NoMagnet { status, raw: 1234 }));
        }
    }

    #[test]
    fn dead_and_open_buses_give_no_angle() {
        assert_eq!(read(0x00, 0x0000), Err(As5600Error::NoMagnet { status: 0, raw: 0 }));
        assert_eq!(read(0xFF, 0xFFFF), Err(As5600Error::Garbled { status: 0xFF, raw: 0xFFFF }));
        assert_eq!(read(0x20, 0x1000), Err(As5600Error::Garbled { status: 0x20, raw: 0x1000 }));
        let mut bus = ScriptedI2c::new([Step::Nack(0x36)]);
        assert_eq!(block_on(As5600.read(&mut bus)), Err(As5600Error::Bus(NACK)));
    }
}
