//! The card's blocks, and the FAT32 volume on them as another computer sees it.
//!
//! Formatting and reading are the crate `fatfs`, which shares no code with the firmware: what it reads, a team's laptop
//! reads.

use std::collections::BTreeMap;
use std::io::{self, Read, Seek, SeekFrom, Write};

use fatfs::{FatType, FileSystem, FormatVolumeOptions, FsOptions};

/// Bytes in a block.
const BLOCK_BYTES: usize = 512;
/// Where the partition begins: one megabyte in, as every formatter of today has it.
const PARTITION_START: u32 = 2048;
/// Partition type FAT32 with block addresses.
const PARTITION_TYPE: u8 = 0x0C;
/// Where the first partition's entry stands in block 0.
const PARTITION_ENTRY: usize = 446;
/// A FAT entry that marks a broken cluster.
const BROKEN_CLUSTER: u32 = 0x0FFF_FFF7;

/// Why the card's volume could not be made or read.
#[derive(Debug, thiserror::Error)]
pub enum VolumeError {
    /// Reading or writing the volume.
    #[error("the card's volume: {0}")]
    Io(#[from] io::Error),
    /// Block 0 names no FAT32 partition.
    #[error("the card has no FAT32 partition: type {kind:#04x} from block {start}")]
    NoPartition {
        /// The type in the first entry.
        kind: u8,
        /// Its first block.
        start: u32,
    },
}

/// The blocks of a card; only those ever written are held.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct BlockImage {
    blocks: u32,
    written: BTreeMap<u32, Box<[u8; BLOCK_BYTES]>>,
}

impl BlockImage {
    /// A card of `blocks` blocks, all zero.
    pub fn empty(blocks: u32) -> Self {
        Self { blocks, written: BTreeMap::new() }
    }

    /// A card with a partition table and an empty FAT32 volume.
    ///
    /// # Errors
    /// [`VolumeError::Io`] if the card is too small for FAT32 (34 MB).
    pub fn formatted(blocks: u32) -> Result<Self, VolumeError> {
        let mut image = Self::empty(blocks);
        let mut table = [0; BLOCK_BYTES];
        let entry = &mut table[PARTITION_ENTRY..PARTITION_ENTRY + 16];
        entry[4] = PARTITION_TYPE;
        entry[8..12].copy_from_slice(&PARTITION_START.to_le_bytes());
        entry[12..16].copy_from_slice(&blocks.saturating_sub(PARTITION_START).to_le_bytes());
        table[510..].copy_from_slice(&[0x55, 0xAA]);
        image.set_block(0, &table);
        let options = FormatVolumeOptions::new().fat_type(FatType::Fat32).volume_id(0x4144_4954);
        fatfs::format_volume(image.partition()?, options)?;
        Ok(image)
    }

    /// How many blocks the card has.
    pub fn blocks(&self) -> u32 {
        self.blocks
    }

    /// What a block holds.
    pub fn block(&self, at: u32) -> [u8; BLOCK_BYTES] {
        self.written.get(&at).map_or([0; BLOCK_BYTES], |block| **block)
    }

    /// Writes a block.
    pub fn set_block(&mut self, at: u32, data: &[u8; BLOCK_BYTES]) {
        // Formatting zeroes whole tables: blocks that were zero stay unheld.
        if data.iter().all(|byte| *byte == 0) && !self.written.contains_key(&at) {
            return;
        }
        self.written.insert(at, Box::new(*data));
    }

    /// The files of the root folder, by name.
    ///
    /// # Errors
    /// [`VolumeError`] if there is no volume or it is damaged.
    pub fn root_files(&self) -> Result<BTreeMap<String, Vec<u8>>, VolumeError> {
        // Reading may update the volume's dirty flag; the card itself stays as the firmware left it.
        let mut copy = self.clone();
        let volume = FileSystem::new(copy.partition()?, FsOptions::new())?;
        let mut files = BTreeMap::new();
        for entry in volume.root_dir().iter() {
            let entry = entry?;
            if entry.is_file() {
                let mut bytes = Vec::new();
                entry.to_file().read_to_end(&mut bytes)?;
                files.insert(entry.file_name(), bytes);
            }
        }
        Ok(files)
    }

    /// Puts a file into the root folder.
    ///
    /// # Errors
    /// [`VolumeError`] if there is no volume, or no room on it.
    pub fn put_file(&mut self, name: &str, bytes: &[u8]) -> Result<(), VolumeError> {
        let volume = FileSystem::new(self.partition()?, FsOptions::new())?;
        volume.root_dir().create_file(name)?.write_all(bytes)?;
        volume.unmount()?;
        Ok(())
    }

    /// Marks every free cluster as broken, so that nothing more fits.
    ///
    /// # Errors
    /// [`VolumeError::NoPartition`] if there is no volume.
    pub fn fill(&mut self) -> Result<(), VolumeError> {
        let start = self.partition()?.start;
        let boot = self.block(start);
        let word = |at: usize| u32::from_le_bytes([boot[at], boot[at + 1], boot[at + 2], boot[at + 3]]);
        let reserved = u32::from(u16::from_le_bytes([boot[14], boot[15]]));
        let (tables, table_blocks, volume_blocks) = (u32::from(boot[16]), word(36), word(32));
        let data_blocks = volume_blocks.saturating_sub(reserved + tables * table_blocks);
        let clusters = data_blocks / u32::from(boot[13]).max(1) + 2;
        for table in 0..tables {
            for at in 0..table_blocks {
                let place = start + reserved + table * table_blocks + at;
                let mut block = self.block(place);
                for (entry, cluster) in block.chunks_exact_mut(4).zip(at * 128..clusters) {
                    if cluster >= 2 && entry == [0; 4] {
                        entry.copy_from_slice(&BROKEN_CLUSTER.to_le_bytes());
                    }
                }
                self.set_block(place, &block);
            }
        }
        Ok(())
    }

    fn partition(&mut self) -> Result<Partition<'_>, VolumeError> {
        let table = self.block(0);
        let word = |at: usize| u32::from_le_bytes([table[at], table[at + 1], table[at + 2], table[at + 3]]);
        let (kind, start, blocks) = (table[PARTITION_ENTRY + 4], word(PARTITION_ENTRY + 8), word(PARTITION_ENTRY + 12));
        if kind != PARTITION_TYPE || start == 0 || start.saturating_add(blocks) > self.blocks {
            return Err(VolumeError::NoPartition { kind, start });
        }
        Ok(Partition { image: self, start, bytes: u64::from(blocks) * BLOCK_BYTES as u64, position: 0 })
    }
}

/// A partition of a card as a file.
struct Partition<'i> {
    image: &'i mut BlockImage,
    start: u32,
    bytes: u64,
    position: u64,
}

impl Partition<'_> {
    /// The block at the position, the place in it, and how many of `wanted` bytes lie in it.
    fn here(&self, wanted: usize) -> (u32, usize, usize) {
        let within = (self.position % BLOCK_BYTES as u64) as usize;
        let left = self.bytes.saturating_sub(self.position).min((BLOCK_BYTES - within) as u64) as usize;
        (self.start + (self.position / BLOCK_BYTES as u64) as u32, within, wanted.min(left))
    }
}

impl Read for Partition<'_> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let (at, within, count) = self.here(buffer.len());
        buffer[..count].copy_from_slice(&self.image.block(at)[within..within + count]);
        self.position += count as u64;
        Ok(count)
    }
}

impl Write for Partition<'_> {
    fn write(&mut self, buffer: &[u8]) -> io::Result<usize> {
        let (at, within, count) = self.here(buffer.len());
        let mut block = self.image.block(at);
        block[within..within + count].copy_from_slice(&buffer[..count]);
        self.image.set_block(at, &block);
        self.position += count as u64;
        Ok(count)
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

impl Seek for Partition<'_> {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        let position = match to {
            SeekFrom::Start(at) => Some(at),
            SeekFrom::End(by) => self.bytes.checked_add_signed(by),
            SeekFrom::Current(by) => self.position.checked_add_signed(by),
        };
        self.position = position.ok_or_else(|| io::Error::from(io::ErrorKind::InvalidInput))?;
        Ok(self.position)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// 64 MB, enough for FAT32 and quick to format.
    const SMALL: u32 = 1 << 17;

    #[test]
    fn a_file_put_on_the_volume_is_found_in_its_root() {
        let mut image = BlockImage::formatted(SMALL).expect("a volume");
        assert!(image.root_files().expect("an empty root").is_empty());
        let bytes: Vec<u8> = (0..3000_u16).map(|at| at as u8).collect();
        image.put_file("FLIGHT.LOG", &bytes).expect("room");
        assert_eq!(image.root_files().expect("a root"), BTreeMap::from([("FLIGHT.LOG".to_owned(), bytes)]));
    }

    #[test]
    fn nothing_fits_on_a_full_volume() {
        let mut image = BlockImage::formatted(SMALL).expect("a volume");
        image.put_file("OLD.LOG", &[1; 100]).expect("room");
        image.fill().expect("a volume");
        assert!(image.put_file("NEW.LOG", &[1; 10_000]).is_err());
        assert_eq!(image.root_files().expect("a root")["OLD.LOG"], [1; 100], "what is there stays");
    }

    #[test]
    fn a_card_without_volume_is_named() {
        let error = BlockImage::empty(SMALL).root_files().expect_err("no volume");
        assert!(matches!(error, VolumeError::NoPartition { kind: 0, start: 0 }), "{error}");
    }
}
