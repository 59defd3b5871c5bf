//! The board log on a microSD card (FAT16 or FAT32), so that any computer reads it.
//!
//! Every start of the board, and every card that is put in, begins a new file, `ADITnnnn.LOG`. Power may fail at any
//! moment, so whatever changes the file system happens before the records that need it: the file grows by chunks of zeros,
//! its size is raised only when the zeros are on the card, and records are then written into the zeros. A record costs one
//! or two sectors and no change of FAT or directory. A reader of the log skips zeros, so the unused tail is harmless.
//!
//! A sector is written again with every commit until it is full, and only ever gains bytes behind those it held: if the
//! write is torn at any byte, the records committed before are whole. (A card that loses the old sector as well when power
//! fails costs up to 511 bytes of them; no format on a card can help that.)
//!
//! Growing a file changes one byte of the size in its directory entry, since chunks are 64 KiB and files stay below 16 MiB:
//! torn at any byte, the size is the old or the new one. A longer log goes on in another file
//! ([`RecorderError::FileFull`]); at one capture and two samples a second that is after half a day.
//!
//! Limits: exFAT is not written (cards above 32 GB come with it). The library links a new cluster to the root directory
//! before it is cleared, so that a power failure in just that moment (once in some hundred files) may show files in the
//! directory that are none; existing files stay whole.

mod card;
mod error;
mod file;
mod guard;
mod number;
mod offered;
mod shelf;

use embedded_sdmmc::{BlockDevice, TimeSource};

pub use card::CardFormat;
pub use error::{Doing, RecorderError};
pub use guard::Refused;
pub use offered::{Offer, offered_parameters};
pub use shelf::{logs, read_log};

use card::SECTOR_BYTES;
use file::ZeroedFile;

/// Space left below which the file is extended ahead of need: a minute of log.
const LOW_WATER_BYTES: u32 = 16 * 1024;

/// Zeros written by one [`Recorder::make_room`]: 16 sectors take 10 to 30 ms on common cards.
const STEP_BYTES: u32 = 16 * SECTOR_BYTES;

/// An open log file.
///
/// The device is only lent: when the recorder is dropped after an error, it may be initialised again.
#[derive(Debug)]
pub struct Recorder<'d, D: BlockDevice, T: TimeSource> {
    file: ZeroedFile<'d, D, T>,
    /// What the sector at the log's end shall hold.
    sector: [u8; SECTOR_BYTES as usize],
    /// Where in the file that sector begins.
    sector_start: u32,
    /// How many of its bytes are log.
    used: usize,
    /// Does the card hold less than that?
    is_dirty: bool,
}

impl<'d, D: BlockDevice, T: TimeSource> Recorder<'d, D, T> {
    /// Begins a new file with this header, [`encode_header`](adit_protocol::log::encode_header), and makes it durable.
    ///
    /// The file's number is `log_number` or the next that is free, from 1 to 9999 and round again; it is to be kept
    /// ([`Recorder::number`]), so that the next start need not use one twice when the card is another.
    ///
    /// # Errors
    /// Any [`RecorderError`]. Nothing is created on a card that is full or in the wrong format.
    pub fn open(device: &'d D, time: T, header_frame: &[u8], log_number: u32) -> Result<Self, RecorderError<D::Error>> {
        let file = ZeroedFile::create(device, time, log_number)?;
        let mut recorder = Self { file, sector: [0; SECTOR_BYTES as usize], sector_start: 0, used: 0, is_dirty: false };
        recorder.append(header_frame)?;
        recorder.commit()?;
        Ok(recorder)
    }

    /// The file's number.
    pub fn number(&self) -> u16 {
        self.file.number()
    }

    /// Bytes of log so far, those not yet durable included.
    pub fn log_bytes(&self) -> u32 {
        self.sector_start + self.used as u32
    }

    /// Bytes of log that fit before the file must grow.
    pub fn left_bytes(&self) -> u32 {
        self.file.bytes().saturating_sub(self.log_bytes())
    }

    /// Adds a frame to the log's end. It is durable after [`Recorder::commit`].
    ///
    /// # Errors
    /// Any [`RecorderError`]. On [`RecorderError::Full`] and [`RecorderError::FileFull`] nothing of the frame is written,
    /// and a commit still saves what was appended before.
    pub fn append(&mut self, frame: &[u8]) -> Result<(), RecorderError<D::Error>> {
        while (self.left_bytes() as usize) < frame.len() {
            self.file.extend(u32::MAX)?;
        }
        let mut rest = frame;
        while !rest.is_empty() {
            let room = self.sector.get_mut(self.used..).unwrap_or_default();
            let bytes = room.len().min(rest.len());
            for (place, byte) in room.iter_mut().zip(rest) {
                *place = *byte;
            }
            rest = rest.get(bytes..).unwrap_or_default();
            self.used += bytes;
            self.is_dirty = true;
            if self.used == self.sector.len() {
                self.commit()?;
                self.sector = [0; SECTOR_BYTES as usize];
                self.sector_start += SECTOR_BYTES;
                self.used = 0;
            }
        }
        Ok(())
    }

    /// Makes durable what was appended.
    ///
    /// # Errors
    /// [`RecorderError::Device`] if the card does not answer.
    pub fn commit(&mut self) -> Result<(), RecorderError<D::Error>> {
        if self.is_dirty {
            self.file.write_sector(self.sector_start, &self.sector)?;
            self.is_dirty = false;
        }
        Ok(())
    }

    /// Makes the file longer ahead of need, a step at a time; to be called whenever nothing waits to be written. Returns
    /// whether more steps are to follow.
    ///
    /// Without it, [`Recorder::append`] must extend the file all at once. A full card is no error here: there is room left,
    /// and `append` says when there is none.
    ///
    /// # Errors
    /// [`RecorderError::Device`] or [`RecorderError::FileSystem`].
    pub fn make_room(&mut self) -> Result<bool, RecorderError<D::Error>> {
        if !self.file.is_extending() && self.left_bytes() >= LOW_WATER_BYTES {
            return Ok(false);
        }
        match self.file.extend(STEP_BYTES) {
            Ok(()) => Ok(self.file.is_extending()),
            Err(RecorderError::Full { .. } | RecorderError::FileFull { .. }) => Ok(false),
            Err(error) => Err(error),
        }
    }
}
