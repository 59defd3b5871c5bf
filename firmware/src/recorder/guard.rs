//! The card as `embedded-sdmmc` sees it: silent after the first error, and never written behind its end.
//!
//! The library takes some errors of the device for answers: a failed read of the directory for "no such file", a failed
//! write to the FAT for "disk full". It must not go on writing on such grounds, so the guard lets nothing through any more
//! once an access has failed, and it keeps the device's own error for whoever asks.

use core::cell::{Cell, RefCell};

use embedded_sdmmc::{Block, BlockCount, BlockDevice, BlockIdx};

use super::card::Layout;

/// An access was not let through: this one failed, or one before it, or it was to write behind the volume's end.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("the access was not let through")]
pub struct Refused;

/// The guarded device.
#[derive(Debug)]
pub(crate) struct Guard<'d, D: BlockDevice> {
    device: &'d D,
    layout: Layout,
    is_shut: Cell<bool>,
    error: RefCell<Option<D::Error>>,
}

impl<'d, D: BlockDevice> Guard<'d, D> {
    pub(crate) fn new(device: &'d D, layout: Layout) -> Self {
        Self { device, layout, is_shut: Cell::new(false), error: RefCell::new(None) }
    }

    /// What the device said when an access failed.
    pub(crate) fn take_error(&self) -> Option<D::Error> {
        self.error.try_borrow_mut().ok().and_then(|mut error| error.take())
    }

    fn pass(&self, answer: Result<(), D::Error>) -> Result<(), Refused> {
        answer.map_err(|error| {
            self.is_shut.set(true);
            if let Ok(mut place) = self.error.try_borrow_mut() {
                *place = Some(error);
            }
            Refused
        })
    }
}

impl<D: BlockDevice> BlockDevice for Guard<'_, D> {
    type Error = Refused;

    fn read(&self, blocks: &mut [Block], start_block_idx: BlockIdx) -> Result<(), Refused> {
        if self.is_shut.get() {
            return Err(Refused);
        }
        self.pass(self.device.read(blocks, start_block_idx))?;
        for (block, sector) in blocks.iter_mut().zip(start_block_idx.0..) {
            self.layout.amend(sector, block);
        }
        Ok(())
    }

    fn write(&self, blocks: &[Block], start_block_idx: BlockIdx) -> Result<(), Refused> {
        let last = start_block_idx.0.saturating_add((blocks.len() as u32).saturating_sub(1));
        if self.layout.is_behind(last) {
            self.is_shut.set(true);
        }
        if self.is_shut.get() {
            return Err(Refused);
        }
        self.pass(self.device.write(blocks, start_block_idx))
    }

    fn num_blocks(&self) -> Result<BlockCount, Refused> {
        self.device.num_blocks().map_err(|_| Refused)
    }
}
