//! A microSD card in memory: sparse, it writes down every sector in order, and it can be pulled.

use std::cell::{Cell, RefCell};
use std::collections::BTreeMap;
use std::io::{Read, Result, Seek, SeekFrom, Write};

use embedded_sdmmc::{Block, BlockCount, BlockDevice, BlockIdx, TimeSource, Timestamp};
use fatfs::{FatType, FileSystem, FormatVolumeOptions, FsOptions};

pub(crate) const SECTOR_BYTES: usize = 512;

/// Where the partition begins, as cards are sold: 4 MiB.
pub(crate) const PARTITION_START: u32 = 8192;

/// The file that [`Card::used`] has: 100 000 bytes of 0xA5.
pub(crate) const PHOTO: &str = "PHOTO.JPG";

/// The card is not there.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Pulled;

impl core::fmt::Display for Pulled {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str("no card")
    }
}

impl core::error::Error for Pulled {}

/// What the sectors hold; those never written are zero.
pub(crate) type Image = BTreeMap<u32, [u8; SECTOR_BYTES]>;

pub(crate) struct Card {
    pub(crate) image: RefCell<Image>,
    /// Every sector written, in order.
    pub(crate) journal: RefCell<Vec<(u32, [u8; SECTOR_BYTES])>>,
    pub(crate) reads: Cell<usize>,
    /// Accesses until the card fails.
    pub(crate) accesses_left: Cell<usize>,
    /// How many accesses fail then.
    pub(crate) failures: Cell<usize>,
    pub(crate) sectors: u32,
}

/// How a card is formatted.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Geometry {
    pub(crate) fat: FatType,
    /// Of the partition.
    pub(crate) sectors: u32,
    pub(crate) cluster_bytes: u32,
}

/// 64 MB, as small as cards come.
pub(crate) const FAT16: Geometry = Geometry { fat: FatType::Fat16, sectors: 120_000, cluster_bytes: 4096 };
/// As small as a FAT32 may be: many clusters, and a root directory that holds 16 files in its first one.
pub(crate) const FAT32_TINY: Geometry = Geometry { fat: FatType::Fat32, sectors: 80_000, cluster_bytes: 512 };
/// 8 GB, as cards are sold.
pub(crate) const FAT32_8GB: Geometry = Geometry { fat: FatType::Fat32, sectors: 15_600_000, cluster_bytes: 32_768 };

impl Card {
    pub(crate) fn unformatted(sectors: u32) -> Self {
        Self {
            image: RefCell::default(),
            journal: RefCell::default(),
            reads: Cell::new(0),
            accesses_left: Cell::new(usize::MAX),
            failures: Cell::new(usize::MAX),
            sectors,
        }
    }

    /// A card with one partition. As most programs do, and unlike `fatfs`, the rest of the FAT's last sector is zero.
    pub(crate) fn formatted(geometry: Geometry) -> Self {
        let card = Self::unformatted(PARTITION_START + geometry.sectors);
        let kind = if geometry.fat == FatType::Fat16 { 0x06 } else { 0x0C };
        card.write_partition_table(kind, geometry.sectors);
        let mut image = card.image.borrow_mut();
        let options = FormatVolumeOptions::new()
            .fat_type(geometry.fat)
            .total_sectors(geometry.sectors)
            .bytes_per_cluster(geometry.cluster_bytes);
        fatfs::format_volume(Partition::of(&mut image), options).unwrap();
        clear_tail_of_fat(&mut image);
        drop(image);
        card
    }

    /// The same card with something on it: a photo, and what is left of a deleted file in the clusters behind.
    pub(crate) fn used(geometry: Geometry) -> Self {
        let card = Self::formatted(geometry);
        let mut image = card.image.borrow_mut();
        let volume = FileSystem::new(Partition::of(&mut image), FsOptions::new()).unwrap();
        for (name, bytes) in [(PHOTO, 100_000), ("DELETED.BIN", 1_000_000)] {
            volume.root_dir().create_file(name).unwrap().write_all(&vec![0xA5; bytes]).unwrap();
        }
        volume.root_dir().remove("DELETED.BIN").unwrap();
        drop(volume);
        drop(image);
        card
    }

    pub(crate) fn write_partition_table(&self, kind: u8, sectors: u32) {
        let mut table = [0; SECTOR_BYTES];
        table[446 + 4] = kind;
        table[446 + 8..446 + 12].copy_from_slice(&PARTITION_START.to_le_bytes());
        table[446 + 12..446 + 16].copy_from_slice(&sectors.to_le_bytes());
        table[510..].copy_from_slice(&[0x55, 0xAA]);
        self.image.borrow_mut().insert(0, table);
    }

    /// Does the card answer, and has it such a sector?
    fn access(&self, sector: u32) -> core::result::Result<(), Pulled> {
        self.accesses_left.set(self.accesses_left.get().saturating_sub(1));
        let fails = self.accesses_left.get() == 0 && self.failures.get() > 0;
        if fails {
            self.failures.set(self.failures.get() - 1);
        }
        if fails || sector >= self.sectors { Err(Pulled) } else { Ok(()) }
    }

    /// How many sectors were written since this was asked last.
    pub(crate) fn take_writes(&self) -> usize {
        self.journal.take().len()
    }
}

impl BlockDevice for Card {
    type Error = Pulled;

    fn read(&self, blocks: &mut [Block], start: BlockIdx) -> core::result::Result<(), Pulled> {
        for (block, sector) in blocks.iter_mut().zip(start.0..) {
            self.access(sector)?;
            self.reads.set(self.reads.get() + 1);
            block.contents = self.image.borrow().get(&sector).copied().unwrap_or([0; SECTOR_BYTES]);
        }
        Ok(())
    }

    fn write(&self, blocks: &[Block], start: BlockIdx) -> core::result::Result<(), Pulled> {
        for (block, sector) in blocks.iter().zip(start.0..) {
            self.access(sector)?;
            self.journal.borrow_mut().push((sector, block.contents));
            self.image.borrow_mut().insert(sector, block.contents);
        }
        Ok(())
    }

    fn num_blocks(&self) -> core::result::Result<BlockCount, Pulled> {
        Ok(BlockCount(self.sectors))
    }
}

fn u16_at(sector: &[u8; SECTOR_BYTES], offset: usize) -> usize {
    usize::from(u16::from_le_bytes([sector[offset], sector[offset + 1]]))
}

/// First sector, sectors and entry size of the first FAT.
pub(crate) fn fat_of(image: &Image) -> (u32, u32, usize) {
    let boot = &image[&PARTITION_START];
    let small = u16_at(boot, 22);
    let sectors = if small > 0 { small } else { u16_at(boot, 36) + (u16_at(boot, 38) << 16) };
    (PARTITION_START + u16_at(boot, 14) as u32, sectors as u32, if small > 0 { 2 } else { 4 })
}

/// How many clusters the volume has.
pub(crate) fn clusters_of(image: &mut Image) -> u32 {
    FileSystem::new(Partition::of(image), FsOptions::new()).unwrap().stats().unwrap().total_clusters()
}

fn clear_tail_of_fat(image: &mut Image) {
    let (start, sectors, entry_bytes) = fat_of(image);
    let end = (clusters_of(image) as usize + 2) * entry_bytes;
    assert!(!end.is_multiple_of(SECTOR_BYTES), "there is a tail");
    for copy in 0..2 {
        for offset in end..sectors as usize * SECTOR_BYTES {
            let sector = start + copy * sectors + (offset / SECTOR_BYTES) as u32;
            if let Some(sector) = image.get_mut(&sector) {
                sector[offset % SECTOR_BYTES] = 0;
            }
        }
    }
}

/// The card's partition as a reader on a computer sees it.
pub(crate) struct Partition<'i> {
    image: &'i mut Image,
    offset: u64,
}

impl<'i> Partition<'i> {
    pub(crate) fn of(image: &'i mut Image) -> Self {
        Self { image, offset: 0 }
    }

    fn place(&self, wanted: usize) -> (u32, usize, usize) {
        let within = (self.offset % SECTOR_BYTES as u64) as usize;
        let sector = PARTITION_START + (self.offset / SECTOR_BYTES as u64) as u32;
        (sector, within, wanted.min(SECTOR_BYTES - within))
    }
}

impl Read for Partition<'_> {
    fn read(&mut self, buffer: &mut [u8]) -> Result<usize> {
        let (sector, within, bytes) = self.place(buffer.len());
        match self.image.get(&sector) {
            Some(content) => buffer[..bytes].copy_from_slice(&content[within..within + bytes]),
            None => buffer[..bytes].fill(0),
        }
        self.offset += bytes as u64;
        Ok(bytes)
    }
}

impl Write for Partition<'_> {
    fn write(&mut self, buffer: &[u8]) -> Result<usize> {
        let (sector, within, bytes) = self.place(buffer.len());
        // Zeros on zeros need no place: a card of 8 GB is formatted in some thousand sectors.
        if self.image.contains_key(&sector) || buffer[..bytes].iter().any(|byte| *byte != 0) {
            let content = self.image.entry(sector).or_insert([0; SECTOR_BYTES]);
            content[within..within + bytes].copy_from_slice(&buffer[..bytes]);
        }
        self.offset += bytes as u64;
        Ok(bytes)
    }

    fn flush(&mut self) -> Result<()> {
        Ok(())
    }
}

impl Seek for Partition<'_> {
    fn seek(&mut self, to: SeekFrom) -> Result<u64> {
        self.offset = match to {
            SeekFrom::Start(offset) => offset,
            SeekFrom::Current(offset) => self.offset.checked_add_signed(offset).unwrap(),
            SeekFrom::End(_) => unreachable!("the size is given"),
        };
        Ok(self.offset)
    }
}

/// Reads all files of the root directory, with another library than the recorder's.
pub(crate) fn files_of(image: &mut Image) -> BTreeMap<String, Vec<u8>> {
    let volume = FileSystem::new(Partition::of(image), FsOptions::new()).expect("the volume mounts");
    let root = volume.root_dir();
    root.iter()
        .map(|entry| entry.expect("the directory can be listed"))
        .filter(fatfs::DirEntry::is_file)
        .map(|entry| {
            let mut bytes = Vec::new();
            entry.to_file().read_to_end(&mut bytes).unwrap_or_else(|e| panic!("{}: {e}", entry.file_name()));
            assert_eq!(bytes.len() as u64, entry.len(), "{} is as long as it says", entry.file_name());
            (entry.file_name(), bytes)
        })
        .collect()
}

/// Reads one file of the root directory.
pub(crate) fn file_of(image: &mut Image, name: &str) -> Option<Vec<u8>> {
    let volume = FileSystem::new(Partition::of(image), FsOptions::new()).expect("the volume mounts");
    let mut bytes = Vec::new();
    volume.root_dir().open_file(name).ok()?.read_to_end(&mut bytes).ok()?;
    Some(bytes)
}

/// A board without a clock.
#[derive(Clone, Copy)]
pub(crate) struct NoClock;

impl TimeSource for NoClock {
    fn get_timestamp(&self) -> Timestamp {
        Timestamp::from_calendar(2026, 1, 1, 0, 0, 0).unwrap()
    }
}
