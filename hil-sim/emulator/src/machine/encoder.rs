//! The AS5600 magnetic encoder on the camera shaft.
//!
//! Twelve bits per turn at I2C address 0x36. A write sets the register pointer, reads go on from it; behind the low byte of
//! RAW ANGLE, ANGLE and MAGNITUDE the pointer returns to the high byte, so that an angle can be read again and again.
//! Source: ams AS5600 datasheet v1-06, figures 11 (pointer) and 22 (registers). Configuration registers are stored and mean
//! nothing; burning is left out.

use rigless::chip::{Timeline, i2c};
use rigless::snapshot::Store;

const ADDRESS: u8 = 0x36;
const STATUS: u8 = 0x0B;
const RAW_ANGLE_HIGH: u8 = 0x0C;
const ANGLE_HIGH: u8 = 0x0E;
const AGC: u8 = 0x1A;
const MAGNITUDE_HIGH: u8 = 0x1B;
/// STATUS: magnet detected.
const MAGNET: u8 = 0x20;
/// Gain in the middle of its range at 3.3 V, and a magnitude to match: a magnet at the right distance.
const GAIN: u8 = 0x40;
const MAGNITUDE: u16 = 0x0700;

/// The encoder.
#[derive(Clone, Debug, Default)]
pub(crate) struct ShaftEncoder {
    /// Steps of 1/4096 turn; `None` while it is silent.
    pub(crate) steps: Option<u16>,
    pointer: u8,
    pointing: bool,
    settings: [u8; 8],
}

impl ShaftEncoder {
    fn begin(&mut self, address: u8, read: bool) -> bool {
        self.pointing = !read;
        address == ADDRESS && self.steps.is_some()
    }

    fn take(&mut self, byte: u8) {
        if self.pointing {
            self.pointer = byte;
            self.pointing = false;
            return;
        }
        // ZPOS, MPOS, MANG and CONF are the writable registers 0x01 to 0x08.
        if let Some(setting) = usize::from(self.pointer).checked_sub(1).and_then(|at| self.settings.get_mut(at)) {
            *setting = byte;
        }
        self.pointer = self.pointer.wrapping_add(1);
    }

    fn give(&mut self) -> u8 {
        let at = self.pointer;
        let [angle_high, angle_low] = (self.steps.unwrap_or(0) & 0x0FFF).to_be_bytes();
        let [magnitude_high, magnitude_low] = MAGNITUDE.to_be_bytes();
        let (byte, next) = match at {
            STATUS => (MAGNET, at + 1),
            RAW_ANGLE_HIGH | ANGLE_HIGH => (angle_high, at + 1),
            0x0D | 0x0F => (angle_low, at - 1),
            AGC => (GAIN, at + 1),
            MAGNITUDE_HIGH => (magnitude_high, at + 1),
            0x1C => (magnitude_low, at - 1),
            1..=8 => (self.settings[usize::from(at) - 1], at + 1),
            _ => (0, at.wrapping_add(1)),
        };
        self.pointer = next;
        byte
    }
}

impl Store for ShaftEncoder {}

impl i2c::Peer for ShaftEncoder {
    fn start(&mut self, address: u8, read: bool, _context: &mut Timeline<'_, '_>) -> bool {
        self.begin(address, read)
    }

    fn write(&mut self, byte: u8, _context: &mut Timeline<'_, '_>) -> bool {
        self.take(byte);
        true
    }

    fn read(&mut self, _last: bool, _context: &mut Timeline<'_, '_>) -> u8 {
        self.give()
    }

    fn stop(&mut self, _context: &mut Timeline<'_, '_>) {}
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(encoder: &mut ShaftEncoder, register: u8) -> [u8; 3] {
        assert!(encoder.begin(ADDRESS, false));
        encoder.take(register);
        assert!(encoder.begin(ADDRESS, true));
        std::array::from_fn(|_| encoder.give())
    }

    #[test]
    fn angle_and_status_read_from_their_registers() {
        let mut encoder = ShaftEncoder { steps: Some(0x0ABC), ..ShaftEncoder::default() };
        assert_eq!(read(&mut encoder, RAW_ANGLE_HIGH), [0x0A, 0xBC, 0x0A], "the pointer returns to the high byte");
        assert_eq!(read(&mut encoder, ANGLE_HIGH), [0x0A, 0xBC, 0x0A]);
        assert_eq!(read(&mut encoder, STATUS), [MAGNET, 0x0A, 0xBC]);
    }

    #[test]
    fn a_setting_reads_back() {
        let mut encoder = ShaftEncoder { steps: Some(0), ..ShaftEncoder::default() };
        assert!(encoder.begin(ADDRESS, false));
        for byte in [0x07, 0x12, 0x34] {
            encoder.take(byte);
        }
        assert_eq!(read(&mut encoder, 0x07)[..2], [0x12, 0x34]);
    }

    #[test]
    fn a_silent_encoder_acknowledges_nothing() {
        let mut encoder = ShaftEncoder::default();
        assert!(!encoder.begin(ADDRESS, false));
        encoder.steps = Some(1);
        assert!(encoder.begin(ADDRESS, true) && !encoder.begin(0x31, true));
    }
}
