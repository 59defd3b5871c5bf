//! The FM25V02 ferroelectric memory on SPI2, with contents in and out and a journal of every byte written.
//!
//! Opcodes, device identity and write-enable latch as in Cypress 001-84494 rev. G, tables 1 to 6. Bytes land as they
//! arrive ("no delay" writes): power that fails in the middle of a write leaves what had arrived. Left out: sleep, block
//! protection, power-up time. The runtime has a model of the chip too, but none that can be given contents.

use rigless::chip::{Timeline, spi};
use rigless::snapshot::Store;

/// Bytes in the array.
pub const FRAM_BYTES: usize = 32 * 1024;

const WRITE_STATUS: u8 = 0x01;
const WRITE: u8 = 0x02;
const READ: u8 = 0x03;
const WRITE_DISABLE: u8 = 0x04;
const READ_STATUS: u8 = 0x05;
const WRITE_ENABLE: u8 = 0x06;
const FAST_READ: u8 = 0x0B;
const READ_IDENTITY: u8 = 0x9F;
/// Status register: write-enable latch.
const LATCH: u8 = 0x02;
/// Table 6: continuation codes, maker, family and density.
const IDENTITY: [u8; 9] = [0x7F, 0x7F, 0x7F, 0x7F, 0x7F, 0x7F, 0xC2, 0x22, 0x00];

/// A byte that the firmware wrote.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
pub struct FramWrite {
    /// Virtual time since the flight's start.
    pub at_ns: u64,
    /// Where.
    pub address: u16,
    /// What.
    pub byte: u8,
}

/// The memory.
#[derive(Clone, Debug)]
pub(crate) struct Fram {
    contents: Vec<u8>,
    pub(crate) journal: Vec<FramWrite>,
    /// When the present power-up was, in flight time.
    pub(crate) epoch_ns: u64,
    latch: bool,
    command: Vec<u8>,
    /// Bytes answered or taken since the address was complete.
    moved: usize,
}

impl Fram {
    /// A memory that holds `contents`, then zeros.
    pub(crate) fn holding(contents: &[u8]) -> Self {
        let mut bytes = contents.to_vec();
        bytes.resize(FRAM_BYTES, 0);
        Self { contents: bytes, journal: Vec::new(), epoch_ns: 0, latch: false, command: Vec::new(), moved: 0 }
    }

    pub(crate) fn contents(&self) -> &[u8] {
        &self.contents
    }

    /// Turns bits over, as radiation or a bad supply does.
    pub(crate) fn corrupt(&mut self, masks: &[u8]) {
        for (byte, mask) in self.contents.iter_mut().zip(masks) {
            *byte ^= mask;
        }
    }

    pub(crate) fn power_up(&mut self, epoch_ns: u64) {
        self.epoch_ns = epoch_ns;
        self.latch = false;
        self.begin();
    }

    fn begin(&mut self) {
        self.command.clear();
        self.moved = 0;
    }

    fn end(&mut self) {
        if matches!(self.command.first(), Some(&(WRITE | WRITE_STATUS | WRITE_DISABLE))) {
            self.latch = false;
        }
        self.begin();
    }

    /// How many bytes come before data: opcode, address, dummy.
    fn preamble(opcode: u8) -> usize {
        match opcode {
            READ | WRITE => 3,
            FAST_READ => 4,
            _ => 1,
        }
    }

    fn cross(&mut self, mosi: u8, now_ns: u64) -> u8 {
        let opcode = *self.command.first().unwrap_or(&mosi);
        if self.command.len() < Self::preamble(opcode) {
            self.command.push(mosi);
            self.latch |= opcode == WRITE_ENABLE;
            return 0;
        }
        let nth = self.moved;
        self.moved += 1;
        match opcode {
            READ | FAST_READ => self.contents[self.address(nth)],
            WRITE if self.latch => {
                let address = self.address(nth);
                self.contents[address] = mosi;
                self.journal.push(FramWrite { at_ns: self.epoch_ns + now_ns, address: address as u16, byte: mosi });
                0
            }
            READ_STATUS => u8::from(self.latch) * LATCH,
            READ_IDENTITY => IDENTITY.get(nth).copied().unwrap_or(0),
            _ => 0,
        }
    }

    /// Address of the `nth` byte: counts up and rolls over; its highest bit is not decoded.
    fn address(&self, nth: usize) -> usize {
        let [high, low] = [self.command[1], self.command[2]];
        (usize::from(u16::from_be_bytes([high, low])) + nth) % FRAM_BYTES
    }
}

impl Store for Fram {}

impl spi::Peer for Fram {
    fn transfer(&mut self, mosi: u32, _bits: u8, context: &mut Timeline<'_, '_>) -> u32 {
        u32::from(self.cross(mosi as u8, context.now().0))
    }

    fn select(&mut self, _context: &mut Timeline<'_, '_>) {
        self.begin();
    }

    fn deselect(&mut self, _context: &mut Timeline<'_, '_>) {
        self.end();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn exchange(fram: &mut Fram, bytes: &[u8]) -> Vec<u8> {
        fram.begin();
        let answer = bytes.iter().map(|byte| fram.cross(*byte, 7)).collect();
        fram.end();
        answer
    }

    #[test]
    fn what_was_put_in_is_read() {
        let mut fram = Fram::holding(&[1, 2, 3]);
        assert_eq!(exchange(&mut fram, &[READ, 0, 1, 0, 0, 0])[3..], [2, 3, 0]);
        assert_eq!(exchange(&mut fram, &[FAST_READ, 0, 0, 0, 0, 0])[4..], [1, 2]);
    }

    #[test]
    fn a_write_needs_the_latch_and_uses_it_up() {
        let mut fram = Fram::holding(&[]);
        exchange(&mut fram, &[WRITE, 0, 5, 9]);
        assert_eq!(fram.contents()[5], 0);
        exchange(&mut fram, &[WRITE_ENABLE]);
        assert_eq!(exchange(&mut fram, &[READ_STATUS, 0])[1], LATCH);
        exchange(&mut fram, &[WRITE, 0, 5, 9, 8]);
        assert_eq!(fram.contents()[5..7], [9, 8]);
        assert_eq!(exchange(&mut fram, &[READ_STATUS, 0])[1], 0);
        let journal = [FramWrite { at_ns: 7, address: 5, byte: 9 }, FramWrite { at_ns: 7, address: 6, byte: 8 }];
        assert_eq!(fram.journal, journal);
    }

    #[test]
    fn addresses_roll_over_at_the_top() {
        let mut fram = Fram::holding(&[]);
        exchange(&mut fram, &[WRITE_ENABLE]);
        exchange(&mut fram, &[WRITE, 0xFF, 0xFF, 1, 2]);
        assert_eq!((fram.contents()[FRAM_BYTES - 1], fram.contents()[0]), (1, 2));
    }

    #[test]
    fn the_chip_says_what_it_is() {
        let mut fram = Fram::holding(&[]);
        let mut question = vec![READ_IDENTITY];
        question.extend([0; 9]);
        assert_eq!(exchange(&mut fram, &question)[1..], IDENTITY);
    }
}
