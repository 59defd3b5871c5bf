//! FM25V02 and its kin, ferroelectric memories on SPI: the board's place for what must outlive a loss of power.
//!
//! The memory is never busy, wears out after 1e14 writes and needs no erasing. It ignores writes in silence while its
//! write latch is not set or a block is protected, so every write is read back. The chip takes a command 250 us after
//! power-up at the soonest.
//!
//! Source: Cypress 001-84494 rev. G, FM25V02, tables 1 (commands) and 6 (identity), p. 8 (writing), p. 9 (reading).

use core::fmt::Debug;

use embedded_hal::spi::{Operation, SpiDevice};

use super::memory::Memory;

/// Bytes used: all of an FM25V01, half of an FM25V02 (32 KiB). Boards of the same kind carry either.
pub const SIZE_BYTES: usize = 16 * 1024;
/// Begin of the identity of all these chips: six times the continuation code, then the maker (table 6).
pub const MAKER: [u8; 7] = [0x7F, 0x7F, 0x7F, 0x7F, 0x7F, 0x7F, 0xC2];

/// Commands (table 1).
const WREN: u8 = 0x06;
const WRITE: u8 = 0x02;
const READ: u8 = 0x03;
const RDID: u8 = 0x9F;

/// Bytes that are read back at a time.
const CHUNK_BYTES: usize = 32;

/// Why an access failed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum FramError<E: Debug> {
    /// The bus failed.
    #[error("FRAM: the bus failed: {0:?}")]
    Bus(E),
    /// The range lies outside what is used of the memory; nothing was read or written.
    #[error("FRAM: {length} bytes from {address} on lie outside its {SIZE_BYTES} bytes")]
    OutOfRange {
        /// Where the range begins.
        address: u16,
        /// How long it is.
        length: usize,
    },
    /// Some other chip answers, or none.
    #[error("FRAM: it says it is {found:02x?}; expected {MAKER:02x?} to begin with")]
    WrongChip {
        /// The identity as it came.
        found: [u8; 9],
    },
    /// A byte did not arrive.
    #[error("FRAM: address {address} holds {found:#04x} after {expected:#04x} was written")]
    NotStored {
        /// Where.
        address: usize,
        /// What is there.
        found: u8,
        /// What was written.
        expected: u8,
    },
}

/// The memory.
#[derive(Debug)]
pub struct Fram<S> {
    spi: S,
}

impl<S: SpiDevice> Fram<S> {
    /// The memory behind `spi` (mode 0 or 3, at most 40 MHz).
    pub fn new(spi: S) -> Self {
        Self { spi }
    }

    /// Reads the chip's identity.
    ///
    /// # Errors
    /// [`FramError::Bus`], or [`FramError::WrongChip`] if it does not begin with [`MAKER`].
    pub fn device_id(&mut self) -> Result<[u8; 9], FramError<S::Error>> {
        let mut found = [0; 9];
        let mut operations = [Operation::Write(&[RDID]), Operation::Read(&mut found)];
        self.spi.transaction(&mut operations).map_err(FramError::Bus)?;
        if found.starts_with(&MAKER) { Ok(found) } else { Err(FramError::WrongChip { found }) }
    }

    /// Reads `bytes` from `address` on.
    ///
    /// # Errors
    /// [`FramError::Bus`] or [`FramError::OutOfRange`].
    pub fn read(&mut self, address: u16, bytes: &mut [u8]) -> Result<(), FramError<S::Error>> {
        check_range(address, bytes.len())?;
        let [high, low] = address.to_be_bytes();
        let mut operations = [Operation::Write(&[READ, high, low]), Operation::Read(bytes)];
        self.spi.transaction(&mut operations).map_err(FramError::Bus)
    }

    /// Writes `bytes` from `address` on and reads them back.
    ///
    /// # Errors
    /// [`FramError::Bus`], [`FramError::OutOfRange`] or [`FramError::NotStored`].
    pub fn write(&mut self, address: u16, bytes: &[u8]) -> Result<(), FramError<S::Error>> {
        check_range(address, bytes.len())?;
        let [high, low] = address.to_be_bytes();
        // The latch is set when chip select rises after the command, so this is a transaction of its own.
        self.spi.write(&[WREN]).map_err(FramError::Bus)?;
        let mut operations = [Operation::Write(&[WRITE, high, low]), Operation::Write(bytes)];
        self.spi.transaction(&mut operations).map_err(FramError::Bus)?;
        self.verify(address, bytes)
    }

    fn verify(&mut self, address: u16, bytes: &[u8]) -> Result<(), FramError<S::Error>> {
        let mut at = address;
        for expected in bytes.chunks(CHUNK_BYTES) {
            let mut chunk = [0; CHUNK_BYTES];
            let Some(found) = chunk.get_mut(..expected.len()) else { continue };
            self.read(at, found)?;
            for (offset, (&found, &expected)) in found.iter().zip(expected).enumerate() {
                if found != expected {
                    return Err(FramError::NotStored { address: usize::from(at) + offset, found, expected });
                }
            }
            at = at.wrapping_add(expected.len() as u16);
        }
        Ok(())
    }
}

impl<S: SpiDevice> Memory for Fram<S> {
    type Error = FramError<S::Error>;

    fn read(&mut self, address: u16, bytes: &mut [u8]) -> Result<(), Self::Error> {
        Fram::read(self, address, bytes)
    }

    fn write(&mut self, address: u16, bytes: &[u8]) -> Result<(), Self::Error> {
        Fram::write(self, address, bytes)
    }
}

fn check_range<E: Debug>(address: u16, length: usize) -> Result<(), FramError<E>> {
    if usize::from(address).saturating_add(length) <= SIZE_BYTES {
        Ok(())
    } else {
        Err(FramError::OutOfRange { address, length })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use embedded_hal::spi::{ErrorKind, ErrorType};
    use proptest::prelude::*;

    /// A chip written from the datasheet.
    #[derive(Debug)]
    struct Chip {
        bytes: Vec<u8>,
        identity: [u8; 9],
        latch: bool,
        /// From here on the array is protected (table 4).
        protected_from: usize,
        broken: bool,
        transactions: usize,
    }

    impl Chip {
        fn new() -> Self {
            Self {
                bytes: vec![0; 32 * 1024],
                identity: [0x7F, 0x7F, 0x7F, 0x7F, 0x7F, 0x7F, 0xC2, 0x22, 0x00],
                latch: false,
                protected_from: usize::MAX,
                broken: false,
                transactions: 0,
            }
        }
    }

    impl ErrorType for Chip {
        type Error = ErrorKind;
    }

    impl SpiDevice for Chip {
        fn transaction(&mut self, operations: &mut [Operation<'_, u8>]) -> Result<(), ErrorKind> {
            self.transactions += 1;
            if self.broken {
                return Err(ErrorKind::Other);
            }
            match operations {
                [Operation::Write([0x06])] => self.latch = true,
                [Operation::Write([0x9F]), Operation::Read(answer)] => answer.copy_from_slice(&self.identity),
                [Operation::Write([0x03, high, low]), Operation::Read(answer)] => {
                    let from = usize::from(u16::from_be_bytes([*high, *low]) & 0x7FFF);
                    answer.copy_from_slice(&self.bytes[from..from + answer.len()]);
                }
                [Operation::Write([0x02, high, low]), Operation::Write(data)] => {
                    let from = usize::from(u16::from_be_bytes([*high, *low]) & 0x7FFF);
                    for (place, byte) in (from..self.protected_from).zip(*data).take_while(|_| self.latch) {
                        self.bytes[place] = *byte;
                    }
                    self.latch = false;
                }
                _ => panic!("no command of this chip: {operations:x?}"),
            }
            Ok(())
        }
    }

    #[test]
    fn what_is_written_is_read() {
        let mut fram = Fram::new(Chip::new());
        let written: Vec<u8> = (0..100).collect();
        assert_eq!(fram.write(0x1234, &written), Ok(()));
        assert_eq!(fram.spi.bytes[0x1234..0x1234 + 100], written[..]);
        let mut read = [0; 100];
        assert_eq!(fram.read(0x1234, &mut read), Ok(()));
        assert_eq!(read[..], written[..]);
        assert!(!fram.spi.latch, "the memory is left writable");
    }

    #[test]
    fn the_chip_is_known_by_its_maker() {
        let mut fram = Fram::new(Chip::new());
        assert_eq!(fram.device_id(), Ok([0x7F, 0x7F, 0x7F, 0x7F, 0x7F, 0x7F, 0xC2, 0x22, 0x00]));
        for byte in [0x00, 0xFF, 0x7F] {
            fram.spi.identity = [byte; 9];
            assert_eq!(fram.device_id(), Err(FramError::WrongChip { found: [byte; 9] }));
        }
    }

    #[test]
    fn a_range_outside_is_refused_before_the_bus_is_touched() {
        let mut fram = Fram::new(Chip::new());
        for (address, length) in [(0x3FFF, 2), (0x4000, 1), (0, SIZE_BYTES + 1), (0xFFFF, 1), (0x8000, 16)] {
            let error = Err(FramError::OutOfRange { address, length });
            assert_eq!(fram.read(address, &mut vec![0; length]), error);
            assert_eq!(fram.write(address, &vec![0; length]), error);
        }
        assert_eq!(fram.spi.transactions, 0);
        assert_eq!(fram.write(0x3FFF, &[7]), Ok(()));
        assert_eq!(fram.write(0, &vec![7; SIZE_BYTES]), Ok(()));
    }

    #[test]
    fn a_write_that_the_chip_ignores_is_an_error() {
        let mut fram = Fram::new(Chip { protected_from: 0x100, ..Chip::new() });
        let error = FramError::NotStored { address: 0x100, found: 0, expected: 9 };
        assert_eq!(fram.write(0x0C0, &[9; 80]), Err(error));
        assert_eq!(error.to_string(), "FRAM: address 256 holds 0x00 after 0x09 was written");
    }

    #[test]
    fn a_broken_bus_is_an_error() {
        let mut fram = Fram::new(Chip { broken: true, ..Chip::new() });
        assert_eq!(fram.read(0, &mut [0]), Err(FramError::Bus(ErrorKind::Other)));
        assert_eq!(fram.write(0, &[0]), Err(FramError::Bus(ErrorKind::Other)));
        assert_eq!(fram.device_id(), Err(FramError::Bus(ErrorKind::Other)));
    }

    proptest! {
        #[test]
        fn writes_behave_like_a_slice(
            writes in prop::collection::vec((0_u16..0x4100, prop::collection::vec(any::<u8>(), 0..80)), 1..20),
        ) {
            let mut fram = Fram::new(Chip::new());
            let mut expected = vec![0; SIZE_BYTES];
            for (address, bytes) in writes {
                let inside = expected.get_mut(usize::from(address)..usize::from(address) + bytes.len());
                prop_assert_eq!(Memory::write(&mut fram, address, &bytes).is_ok(), inside.is_some());
                if let Some(inside) = inside {
                    inside.copy_from_slice(&bytes);
                }
            }
            let mut read = vec![0; SIZE_BYTES];
            prop_assert_eq!(Memory::read(&mut fram, 0, &mut read), Ok(()));
            prop_assert_eq!(read, expected);
        }
    }
}
