//! A `TeraRanger` Evo or One on I2C, as its manual has it used.
//!
//! Write 0x00 triggers a measurement; not before 500 us later, in a transaction of its own, three bytes are read: distance
//! in millimetres (big endian) and CRC-8 (polynomial 0x07) of it. Write 0x01, then read: 0xA1. Write 0xA2 and an address:
//! the sensor moves there. Sources: Evo 15m I2C manual pp. 11-12; One manual (firmware 5.0).
//!
//! What the manual forbids answers 0xFF 0xFF 0xFF, whose checksum fails, and is counted: a read too early, a read without
//! trigger, a combined write-read. A controller may clock one byte more than it wants (the emulated I2C does under DMA);
//! that reads 0xFF and disturbs nothing.

use adit_protocol::parameters::RangeFamily;
use crc::{CRC_8_SMBUS, Crc};
use rigless::chip::{Timeline, i2c};
use rigless::snapshot::Store;

const TRIGGER: u8 = 0x00;
const WHO_AM_I: u8 = 0x01;
const CHANGE_ADDRESS: u8 = 0xA2;
/// The answer to [`WHO_AM_I`].
const IDENTITY: u8 = 0xA1;
/// What a measurement takes (Evo manual p. 12).
const CONVERSION_NS: u64 = 500_000;
/// After a change of address an Evo is away for a second (Evo manual p. 12).
const MOVING_NS: u64 = 1_000_000_000;
/// Addresses that an Evo takes (Evo manual p. 11).
const ADDRESSES: core::ops::RangeInclusive<u8> = 0x02..=0x7F;
const RANGE_CRC: Crc<u8> = Crc::<u8>::new(&CRC_8_SMBUS);

/// How often the manual's rules were broken.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
pub struct RangerMisuse {
    /// Reads sooner than 500 us after the trigger.
    pub early_reads: u32,
    /// Reads with nothing triggered.
    pub untriggered_reads: u32,
    /// Reads joined to a write by a repeated start.
    pub combined: u32,
}

/// One sensor.
#[derive(Clone, Debug)]
pub(crate) struct Ranger {
    family: RangeFamily,
    address: u8,
    /// The address that a One takes at its next power-up.
    next_address: u8,
    away_until_ns: u64,
    /// What it measures now; `None` while it is unplugged.
    pub(crate) raw_mm: Option<u16>,
    triggered: Option<Triggered>,
    writing: Vec<u8>,
    in_transaction: bool,
    answer: Vec<u8>,
    given: usize,
    pub(crate) misuse: RangerMisuse,
}

/// A measurement that was asked for.
#[derive(Clone, Copy, Debug)]
struct Triggered {
    ready_ns: u64,
    raw_mm: u16,
}

impl Ranger {
    pub(crate) fn new(family: RangeFamily, address: u8) -> Self {
        Self {
            family,
            address,
            next_address: address,
            away_until_ns: 0,
            raw_mm: None,
            triggered: None,
            writing: Vec::new(),
            in_transaction: false,
            answer: Vec::new(),
            given: 0,
            misuse: RangerMisuse::default(),
        }
    }

    /// The sensor after its supply was off: the clock starts again, addresses take effect.
    pub(crate) fn power_up(&mut self) {
        *self = Self { misuse: self.misuse, raw_mm: self.raw_mm, ..Self::new(self.family, self.next_address) };
    }

    fn begin(&mut self, address: u8, read: bool, now_ns: u64) -> bool {
        if address != self.address || self.raw_mm.is_none() || now_ns < self.away_until_ns {
            return false;
        }
        if read {
            let combined = self.in_transaction;
            if combined {
                self.obey(now_ns);
            }
            self.prepare(combined, now_ns);
        } else {
            self.writing.clear();
        }
        self.in_transaction = true;
        true
    }

    fn prepare(&mut self, combined: bool, now_ns: u64) {
        self.given = 0;
        if combined {
            self.misuse.combined += 1;
            self.answer.clear();
            return;
        }
        // An answer to a question is given once, before any distance.
        if self.answer == [IDENTITY] {
            return;
        }
        self.answer.clear();
        match self.triggered {
            None => self.misuse.untriggered_reads += 1,
            Some(triggered) if now_ns < triggered.ready_ns => self.misuse.early_reads += 1,
            Some(triggered) => {
                self.answer.extend(frame(triggered.raw_mm));
                self.triggered = None;
            }
        }
    }

    fn give(&mut self) -> u8 {
        let byte = self.answer.get(self.given).copied().unwrap_or(0xFF);
        self.given += 1;
        byte
    }

    fn end(&mut self, now_ns: u64) {
        if self.given > 0 {
            self.answer.clear();
            self.given = 0;
        }
        self.obey(now_ns);
        self.in_transaction = false;
    }

    /// Does what was written.
    fn obey(&mut self, now_ns: u64) {
        match *std::mem::take(&mut self.writing) {
            [TRIGGER] => {
                let raw_mm = self.raw_mm.unwrap_or(0);
                self.triggered = Some(Triggered { ready_ns: now_ns + CONVERSION_NS, raw_mm });
            }
            [WHO_AM_I] => self.answer = vec![IDENTITY],
            [CHANGE_ADDRESS, address] if ADDRESSES.contains(&address) => {
                self.next_address = address;
                if self.family == RangeFamily::Evo {
                    self.address = address;
                    self.away_until_ns = now_ns + MOVING_NS;
                    self.triggered = None;
                }
            }
            _ => {}
        }
    }
}

/// The three bytes of a reading.
fn frame(raw_mm: u16) -> [u8; 3] {
    let [high, low] = raw_mm.to_be_bytes();
    [high, low, RANGE_CRC.checksum(&[high, low])]
}

impl Store for Ranger {}

impl i2c::Peer for Ranger {
    fn start(&mut self, address: u8, read: bool, context: &mut Timeline<'_, '_>) -> bool {
        self.begin(address, read, context.now().0)
    }

    fn write(&mut self, byte: u8, _context: &mut Timeline<'_, '_>) -> bool {
        self.writing.push(byte);
        true
    }

    fn read(&mut self, _last: bool, _context: &mut Timeline<'_, '_>) -> u8 {
        self.give()
    }

    fn stop(&mut self, context: &mut Timeline<'_, '_>) {
        self.end(context.now().0);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ranger(raw_mm: u16) -> Ranger {
        Ranger { raw_mm: Some(raw_mm), ..Ranger::new(RangeFamily::Evo, 0x31) }
    }

    fn write(ranger: &mut Ranger, address: u8, bytes: &[u8], now_ns: u64) -> bool {
        let acknowledged = ranger.begin(address, false, now_ns);
        if acknowledged {
            ranger.writing.extend_from_slice(bytes);
            ranger.end(now_ns);
        }
        acknowledged
    }

    fn read<const N: usize>(ranger: &mut Ranger, address: u8, now_ns: u64) -> Option<[u8; N]> {
        let bytes = ranger.begin(address, true, now_ns).then(|| std::array::from_fn(|_| ranger.give()));
        if bytes.is_some() {
            ranger.end(now_ns);
        }
        bytes
    }

    #[test]
    fn a_reading_is_ready_after_500_microseconds_and_not_before() {
        let mut ranger = ranger(1000);
        assert!(write(&mut ranger, 0x31, &[TRIGGER], 0));
        assert_eq!(read(&mut ranger, 0x31, 499_999), Some([0xFF; 3]));
        assert_eq!(read(&mut ranger, 0x31, 500_000), Some([0x03, 0xE8, 0xA9]));
        assert_eq!(read(&mut ranger, 0x31, 600_000), Some([0xFF; 3]), "one trigger, one reading");
        assert_eq!(ranger.misuse, RangerMisuse { early_reads: 1, untriggered_reads: 1, combined: 0 });
    }

    #[test]
    fn a_byte_too_many_reads_as_an_idle_bus_and_disturbs_nothing() {
        let mut ranger = ranger(1);
        write(&mut ranger, 0x31, &[TRIGGER], 0);
        assert_eq!(read(&mut ranger, 0x31, 1_000_000), Some([0x00, 0x01, 0x07, 0xFF]));
        write(&mut ranger, 0x31, &[TRIGGER], 2_000_000);
        assert_eq!(read(&mut ranger, 0x31, 3_000_000), Some([0x00, 0x01, 0x07]));
        assert_eq!(ranger.misuse, RangerMisuse::default());
    }

    #[test]
    fn a_combined_write_and_read_is_refused() {
        let mut ranger = ranger(1000);
        assert!(ranger.begin(0x31, false, 0));
        ranger.writing.push(TRIGGER);
        assert!(ranger.begin(0x31, true, 1_000_000));
        assert_eq!([ranger.give(), ranger.give(), ranger.give()], [0xFF; 3]);
        ranger.end(1_000_000);
        assert_eq!(ranger.misuse.combined, 1);
    }

    #[test]
    fn a_sensor_says_who_it_is() {
        let mut ranger = ranger(1000);
        write(&mut ranger, 0x31, &[WHO_AM_I], 0);
        assert_eq!(read(&mut ranger, 0x31, 0), Some([IDENTITY]));
    }

    #[test]
    fn an_evo_answers_at_its_new_address_after_a_second() {
        let mut ranger = ranger(1000);
        write(&mut ranger, 0x31, &[CHANGE_ADDRESS, 0x34], 0);
        let answers = |ranger: &mut Ranger, address, now_ns| write(ranger, address, &[TRIGGER], now_ns);
        assert!(!answers(&mut ranger, 0x34, 999_999_999));
        assert!(answers(&mut ranger, 0x34, 1_000_000_000));
        assert!(!answers(&mut ranger, 0x31, 1_000_000_000));
        write(&mut ranger, 0x34, &[CHANGE_ADDRESS, 0x80], 0);
        assert!(answers(&mut ranger, 0x34, 3_000_000_000), "0x80 is no address");
    }

    #[test]
    fn a_one_moves_when_its_power_was_off() {
        let mut ranger = Ranger { raw_mm: Some(500), ..Ranger::new(RangeFamily::One, 0x30) };
        write(&mut ranger, 0x30, &[CHANGE_ADDRESS, 0x32], 0);
        assert!(write(&mut ranger, 0x30, &[TRIGGER], 0));
        ranger.power_up();
        assert!(!write(&mut ranger, 0x30, &[TRIGGER], 0));
        assert!(write(&mut ranger, 0x32, &[TRIGGER], 0));
    }

    #[test]
    fn an_unplugged_sensor_acknowledges_nothing() {
        let mut ranger = Ranger::new(RangeFamily::Evo, 0x31);
        assert!(!write(&mut ranger, 0x31, &[TRIGGER], 0));
        assert_eq!(read::<3>(&mut ranger, 0x31, 1_000_000), None);
    }

    #[test]
    fn a_sensor_stuck_at_zero_has_a_valid_checksum() {
        let mut ranger = ranger(0);
        write(&mut ranger, 0x31, &[TRIGGER], 0);
        assert_eq!(read(&mut ranger, 0x31, 1_000_000), Some([0, 0, 0]));
    }
}
