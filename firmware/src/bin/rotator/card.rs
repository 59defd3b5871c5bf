//! The microSD card as a block device that waits.
//!
//! The file system's library waits for its card, so the log runs in thread mode, where waiting costs nobody anything: the
//! core sleeps until an interrupt comes, and looks again.

use core::cell::RefCell;
use core::pin::pin;
use core::task::{Context, Poll, Waker};

use adit_firmware::health::Task;
use embassy_stm32::sdmmc::sd::{Card, DataBlock, StorageDevice};
use embassy_stm32::sdmmc::{self, Sdmmc};
use embassy_stm32::time::{Hertz, mhz};
use embedded_sdmmc::{Block, BlockCount, BlockDevice, BlockIdx};

use crate::blackboard::{CHECK_INS, now_us};
use crate::pins::{CardParts, Irqs};

/// Default speed of every card (SD physical layer specification 6.00, 6.6.6: 25 MHz).
pub(crate) const CLOCK: Hertz = mhz(24);
/// Clock periods until a block counts as lost: 250 ms at 24 MHz, what a card may take (SD specification, 4.6.2.2).
const TIMEOUT_PERIODS: u32 = 6_000_000;

/// What went wrong with the card.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct CardError(pub(crate) sdmmc::Error);

impl core::fmt::Display for CardError {
    fn fmt(&self, formatter: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        write!(formatter, "{:?}", self.0)
    }
}

impl core::error::Error for CardError {}

/// A card that answers, and a buffer that DMA can reach.
pub(crate) struct CardDevice<'a, 'b> {
    inner: RefCell<Inner<'a, 'b>>,
}

struct Inner<'a, 'b> {
    card: StorageDevice<'a, 'b, Card>,
    buffer: &'a mut DataBlock,
}

/// The driver of the slot.
pub(crate) fn driver(parts: &mut CardParts) -> Sdmmc<'_> {
    let mut config = sdmmc::Config::default();
    config.data_transfer_timeout = TIMEOUT_PERIODS;
    Sdmmc::new_4bit(
        parts.sdio.reborrow(),
        parts.dma.reborrow(),
        Irqs,
        parts.clk.reborrow(),
        parts.cmd.reborrow(),
        parts.d0.reborrow(),
        parts.d1.reborrow(),
        parts.d2.reborrow(),
        parts.d3.reborrow(),
        config,
    )
}

impl<'a, 'b> CardDevice<'a, 'b> {
    /// `buffer` must lie where DMA reaches it: in a static, never on the stack.
    pub(crate) fn new(card: StorageDevice<'a, 'b, Card>, buffer: &'a mut DataBlock) -> Self {
        Self { inner: RefCell::new(Inner { card, buffer }) }
    }
}

impl BlockDevice for CardDevice<'_, '_> {
    type Error = CardError;

    fn read(&self, blocks: &mut [Block], first: BlockIdx) -> Result<(), CardError> {
        let Inner { card, buffer } = &mut *self.inner.borrow_mut();
        for (index, block) in (first.0..).zip(blocks) {
            CHECK_INS.report(Task::Log, now_us());
            wait_for(card.read_block(index, buffer)).map_err(CardError)?;
            block.contents.copy_from_slice(&buffer[..]);
        }
        Ok(())
    }

    fn write(&self, blocks: &[Block], first: BlockIdx) -> Result<(), CardError> {
        let Inner { card, buffer } = &mut *self.inner.borrow_mut();
        for (index, block) in (first.0..).zip(blocks) {
            CHECK_INS.report(Task::Log, now_us());
            buffer.copy_from_slice(&block.contents);
            wait_for(card.write_block(index, buffer)).map_err(CardError)?;
        }
        Ok(())
    }

    fn num_blocks(&self) -> Result<BlockCount, CardError> {
        use embassy_stm32::sdmmc::sd::Addressable;
        let bytes = self.inner.borrow().card.card().size();
        Ok(BlockCount(u32::try_from(bytes / Block::LEN as u64).unwrap_or(u32::MAX)))
    }
}

/// Waits for a future in thread mode. Every interrupt wakes the core, the card's among them.
fn wait_for<F: Future>(future: F) -> F::Output {
    let mut future = pin!(future);
    let mut context = Context::from_waker(Waker::noop());
    loop {
        if let Poll::Ready(output) = future.as_mut().poll(&mut context) {
            return output;
        }
        cortex_m::asm::wfe();
    }
}
