//! A file on the card that is longer than what it holds: zeros lie ahead of the log's end.

use core::ops::ControlFlow;

use embedded_sdmmc::{BlockDevice, Error, Mode, RawFile, TimeSource, VolumeIdx, VolumeManager};

use super::card::{Layout, SECTOR_BYTES, layout_of};
use super::error::{Doing, RecorderError};
use super::guard::Guard;
use super::number::{Taken, name_of};
use super::shelf::{Volumes, failed};

/// What the file grows by: a multiple of every cluster size, and of 2^16, see the module doc of the recorder.
const CHUNK_BYTES: u32 = 64 * 1024;

/// The file's largest size: the last multiple of a chunk below 2^24, see there.
const MAX_FILE_BYTES: u32 = (1 << 24) - CHUNK_BYTES;

const ZEROS: [u8; SECTOR_BYTES as usize] = [0; SECTOR_BYTES as usize];

#[derive(Debug)]
pub(crate) struct ZeroedFile<'d, D: BlockDevice, T: TimeSource> {
    device: &'d D,
    layout: Layout,
    volumes: Volumes<'d, D, T>,
    file: RawFile,
    number: u16,
    /// The size in the directory: all of it may be written to.
    bytes: u32,
    /// Zeros are on the card up to here.
    zeros_end: u32,
    /// The size aimed at.
    target: u32,
    /// Where the search for free clusters begins.
    search_start: u32,
}

impl<'d, D: BlockDevice, T: TimeSource> ZeroedFile<'d, D, T> {
    /// Makes a file with the number wanted or the next that is free, and its first chunk of zeros.
    pub(crate) fn create(device: &'d D, time: T, wanted: u32) -> Result<Self, RecorderError<D::Error>> {
        let examining = |error| RecorderError::Device { doing: Doing::Examining, error };
        let layout = layout_of(device).map_err(examining)??;
        let search_start = layout.search_start(device).map_err(examining)?;
        let search_start = Self::require_room(device, &layout, search_start)?;

        let volumes: Volumes<'d, D, T> = VolumeManager::new_with_limits(Guard::new(device, layout), time, 1);
        let volume = volumes.open_raw_volume(VolumeIdx(0)).map_err(|e| failed(&volumes, Doing::Examining, e))?;
        let root = volumes.open_root_dir(volume).map_err(|e| failed(&volumes, Doing::Listing, e))?;
        let mut taken = Taken::none();
        volumes
            .iterate_dir(root, |entry| {
                taken.note(&entry.name);
                ControlFlow::Continue(())
            })
            .map_err(|e| failed(&volumes, Doing::Listing, e))?;
        let number = taken.next_free(wanted).ok_or(RecorderError::NumbersTaken)?;
        let file =
            volumes.open_file_in_dir(root, name_of(number).as_str(), Mode::ReadWriteCreate).map_err(
                |e| match failed(&volumes, Doing::Creating, e) {
                    RecorderError::FileSystem { error: Error::NotEnoughSpace, .. } => RecorderError::DirectoryFull,
                    other => other,
                },
            )?;
        let mut zeroed =
            Self { device, layout, volumes, file, number, bytes: 0, zeros_end: 0, target: 0, search_start };
        zeroed.extend(u32::MAX)?;
        Ok(zeroed)
    }

    pub(crate) fn number(&self) -> u16 {
        self.number
    }

    /// How long the file is.
    pub(crate) fn bytes(&self) -> u32 {
        self.bytes
    }

    /// Has an extension begun that is not at its end?
    pub(crate) fn is_extending(&self) -> bool {
        self.target > self.bytes
    }

    /// Writes one sector of the file; `start` is a multiple of a sector, within the file.
    pub(crate) fn write_sector(
        &self,
        start: u32,
        sector: &[u8; SECTOR_BYTES as usize],
    ) -> Result<(), RecorderError<D::Error>> {
        self.write(Doing::Writing, start, sector)
    }

    /// Begins an extension by one chunk, or goes on with the one begun: writes zeros, but no more than `step_bytes`, and
    /// raises the file's size when all are written.
    pub(crate) fn extend(&mut self, step_bytes: u32) -> Result<(), RecorderError<D::Error>> {
        if !self.is_extending() {
            self.target = self.bytes + self.growth_bytes()?;
        }
        let step_end = self.target.min(self.zeros_end.saturating_add(step_bytes));
        while self.zeros_end < step_end {
            self.write(Doing::Extending, self.zeros_end, &ZEROS)?;
            self.zeros_end += SECTOR_BYTES;
        }
        if self.zeros_end >= self.target {
            self.volumes.flush_file(self.file).map_err(|e| failed(&self.volumes, Doing::Extending, e))?;
            self.bytes = self.target;
        }
        Ok(())
    }

    /// By how much the file can grow now: a chunk, or what is left on the card.
    fn growth_bytes(&mut self) -> Result<u32, RecorderError<D::Error>> {
        if self.bytes >= MAX_FILE_BYTES {
            return Err(RecorderError::FileFull { bytes: self.bytes });
        }
        let cluster_bytes = self.layout.cluster_bytes;
        let wanted = CHUNK_BYTES / cluster_bytes;
        // The library takes the allocation of a card's very last cluster for a failure: one more must be free.
        let (free, first) = self
            .layout
            .free_clusters(self.device, self.search_start, wanted + 1)
            .map_err(|error| RecorderError::Device { doing: Doing::Extending, error })?;
        self.search_start = first;
        let usable = free.saturating_sub(1).min(wanted);
        if usable == 0 {
            return Err(full(&self.layout, free, 2));
        }
        Ok(usable * cluster_bytes)
    }

    /// Is there room for a first chunk, and a cluster for the directory should it be full? Tells where.
    fn require_room(device: &D, layout: &Layout, search_start: u32) -> Result<u32, RecorderError<D::Error>> {
        let wanted = CHUNK_BYTES / layout.cluster_bytes + 2;
        let (free, first) = layout
            .free_clusters(device, search_start, wanted)
            .map_err(|error| RecorderError::Device { doing: Doing::Examining, error })?;
        if free < wanted {
            return Err(full(layout, free, wanted));
        }
        Ok(first)
    }

    fn write(&self, doing: Doing, start: u32, bytes: &[u8]) -> Result<(), RecorderError<D::Error>> {
        self.volumes
            .file_seek_from_start(self.file, start)
            .and_then(|()| self.volumes.write(self.file, bytes))
            .map_err(|e| failed(&self.volumes, doing, e))
    }
}

fn full<E: core::error::Error + 'static>(layout: &Layout, free: u32, wanted: u32) -> RecorderError<E> {
    let bytes = |clusters| u64::from(clusters) * u64::from(layout.cluster_bytes);
    RecorderError::Full { free_bytes: bytes(free), wanted_bytes: bytes(wanted) }
}
