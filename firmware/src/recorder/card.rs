//! Is this a card that the recorder can write to, and where on it is what?
//!
//! `embedded-sdmmc` believes the boot sector: a cluster size of zero would divide by it. So the few fields that matter are
//! checked here first, and a card in the wrong format is named for what it is. Layout: Microsoft, FAT32 File System
//! Specification 1.03, "Boot Sector and BPB" and "FAT Type Determination".

use embedded_sdmmc::{Block, BlockDevice, BlockIdx};

/// The size of every sector.
pub(crate) const SECTOR_BYTES: u32 = Block::LEN_U32;

/// The first two entries of the FAT are no clusters.
const FIRST_CLUSTER: u32 = 2;
const PARTITION_TABLE: usize = 446;
/// Fewer clusters are a FAT12, more a FAT16 (specification, "FAT Type Determination").
const FAT16_CLUSTERS: u32 = 4085;
/// As many clusters and more are a FAT32.
const FAT32_CLUSTERS: u32 = 65_525;
/// Numbers from here on mean something else than a cluster (specification, "FAT Data Structure").
const MOST_CLUSTERS: u64 = 0x0FFF_FFF5;
/// No directory is longer: 65 536 entries of 32 bytes (specification, "FAT Directory Structure").
const DIRECTORY_BYTES: u32 = 65_536 * 32;

/// Why a card cannot be written to. Each of these is cured by formatting it with FAT32 on a computer.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum CardFormat {
    /// The first sector has no signature.
    #[error("the card has no partition table; format it with FAT32")]
    NoPartitionTable,
    /// The first partition does not exist.
    #[error("the card's first partition is empty; format the card with FAT32")]
    NoPartition,
    /// The first partition is exFAT (cards above 32 GB as sold) or NTFS.
    #[error("the card is formatted with exFAT or NTFS; format it with FAT32")]
    ExFat,
    /// The first partition is of another type.
    #[error("the card's first partition is of type {kind:#04x}; format it with FAT32")]
    PartitionType {
        /// The type in the partition table.
        kind: u8,
    },
    /// The partition's first sector is no boot sector of a FAT, or one with impossible numbers.
    #[error("the card's partition holds no sound FAT; format it with FAT32")]
    NoFat,
    /// The sectors have another size.
    #[error("the card's sectors count {bytes} bytes instead of 512; format it with FAT32")]
    SectorBytes {
        /// Their size.
        bytes: u16,
    },
    /// The FAT is too small a kind.
    #[error("the card is formatted with FAT12 ({clusters} clusters); format it with FAT32")]
    Fat12 {
        /// How many clusters it has.
        clusters: u32,
    },
    /// The chain of the root directory's clusters bites its tail.
    #[error("the card's root directory has no end; format the card with FAT32")]
    EndlessDirectory,
}

/// Where on the card is what.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Layout {
    /// First sector of the first FAT.
    fat_start: u32,
    /// Length of a FAT.
    fat_sectors: u32,
    /// Bytes per entry of the FAT: 2 or 4.
    entry_bytes: u32,
    /// How many clusters there are.
    clusters: u32,
    /// Bytes per cluster.
    pub(crate) cluster_bytes: u32,
    /// First cluster of the root directory, on FAT32.
    root: Option<u32>,
    /// The sector with the count of free clusters, on FAT32.
    info_sector: Option<u32>,
    /// First sector behind the last cluster.
    end: u32,
}

/// Reads the partition table and the boot sector.
pub(crate) fn layout_of<D: BlockDevice>(device: &D) -> Result<Result<Layout, CardFormat>, D::Error> {
    let mut block = [Block::new()];
    device.read(&mut block, BlockIdx(0))?;
    let [table] = &block;
    let start = match partition_start(table) {
        Ok(start) => start,
        Err(format) => return Ok(Err(format)),
    };
    device.read(&mut block, BlockIdx(start))?;
    let [boot] = &block;
    let layout = match layout_in(boot, start) {
        Ok(layout) => layout,
        Err(format) => return Ok(Err(format)),
    };
    Ok(if layout.directory_ends(device)? { Ok(layout) } else { Err(CardFormat::EndlessDirectory) })
}

fn partition_start(table: &Block) -> Result<u32, CardFormat> {
    if u16_at(table, 510) != 0xAA55 {
        return Err(CardFormat::NoPartitionTable);
    }
    let entry = table.get(PARTITION_TABLE..).and_then(|rest| rest.first_chunk::<16>()).copied().unwrap_or_default();
    let [status, _, _, _, kind, _, _, _, s0, s1, s2, s3, ..] = entry;
    // A card without partition table whose boot sector lies here has program code in this place.
    if status & 0x7F != 0 {
        return Err(CardFormat::NoPartitionTable);
    }
    match kind {
        0x00 => Err(CardFormat::NoPartition),
        0x07 => Err(CardFormat::ExFat),
        0x04 | 0x06 | 0x0B | 0x0C | 0x0E => Ok(u32::from_le_bytes([s0, s1, s2, s3])),
        _ => Err(CardFormat::PartitionType { kind }),
    }
}

fn layout_in(boot: &Block, start: u32) -> Result<Layout, CardFormat> {
    if boot.get(3..11) == Some(b"EXFAT   ") {
        return Err(CardFormat::ExFat);
    }
    if u16_at(boot, 510) != 0xAA55 {
        return Err(CardFormat::NoFat);
    }
    let sector_bytes = u16_at(boot, 11);
    if u32::from(sector_bytes) != SECTOR_BYTES {
        return Err(CardFormat::SectorBytes { bytes: sector_bytes });
    }
    let cluster_sectors = boot.get(13).copied().map_or(0, u32::from);
    let fats = boot.get(16).copied().map_or(0, u32::from);
    if !cluster_sectors.is_power_of_two() || !(1..=2).contains(&fats) {
        return Err(CardFormat::NoFat);
    }
    let reserved = u32::from(u16_at(boot, 14));
    let root_sectors = (u32::from(u16_at(boot, 17)) * 32).div_ceil(SECTOR_BYTES);
    let small = |small, large| if small != 0 { u32::from(small) } else { u32_at(boot, large) };
    let (total, fat_sectors) = (small(u16_at(boot, 19), 32), small(u16_at(boot, 22), 36));
    // All in 64 bits: the numbers may be anything.
    let before_data = u64::from(reserved) + u64::from(fats) * u64::from(fat_sectors) + u64::from(root_sectors);
    let data = u64::from(total).checked_sub(before_data).ok_or(CardFormat::NoFat)?;
    let clusters = data / u64::from(cluster_sectors);
    if clusters > MOST_CLUSTERS {
        return Err(CardFormat::NoFat);
    }
    let clusters = clusters as u32;
    if clusters < FAT16_CLUSTERS {
        return Err(CardFormat::Fat12 { clusters });
    }
    let is_fat32 = clusters >= FAT32_CLUSTERS;
    let entry_bytes = if is_fat32 { 4 } else { 2 };
    let end = u64::from(start) + before_data + u64::from(clusters) * u64::from(cluster_sectors);
    let entries_bytes = u64::from(clusters + FIRST_CLUSTER) * u64::from(entry_bytes);
    let (root, info_sector) = (u32_at(boot, 44), u32::from(u16_at(boot, 48)));
    let is_sound = reserved > 0
        && u32::try_from(end).is_ok()
        && entries_bytes <= u64::from(fat_sectors) * u64::from(SECTOR_BYTES)
        && (!is_fat32 || (FIRST_CLUSTER..clusters + FIRST_CLUSTER).contains(&root) && info_sector < reserved);
    if !is_sound {
        return Err(CardFormat::NoFat);
    }
    Ok(Layout {
        fat_start: start + reserved,
        fat_sectors,
        entry_bytes,
        clusters,
        cluster_bytes: cluster_sectors * SECTOR_BYTES,
        root: is_fat32.then_some(root),
        info_sector: is_fat32.then(|| start + info_sector),
        end: end as u32,
    })
}

impl Layout {
    /// Is this sector behind the last cluster?
    pub(crate) fn is_behind(&self, sector: u32) -> bool {
        sector >= self.end
    }

    /// Where a search for free clusters best begins: where the card's own note says, if it has one.
    pub(crate) fn search_start<D: BlockDevice>(&self, device: &D) -> Result<u32, D::Error> {
        let Some(sector) = self.info_sector else {
            return Ok(FIRST_CLUSTER);
        };
        let mut block = [Block::new()];
        device.read(&mut block, BlockIdx(sector))?;
        let [info] = &block;
        Ok(u32_at(info, 492))
    }

    /// Counts free clusters, but no more than `wanted`: from cluster `from` on, then from the first on.
    ///
    /// Returns the count and the first free cluster found.
    pub(crate) fn free_clusters<D: BlockDevice>(
        &self,
        device: &D,
        from: u32,
        wanted: u32,
    ) -> Result<(u32, u32), D::Error> {
        let mut fat = FatReader::new(self, device);
        let (mut free, mut first) = (0, FIRST_CLUSTER);
        let skipped = from.saturating_sub(FIRST_CLUSTER) % self.clusters;
        for step in 0..self.clusters {
            let cluster = FIRST_CLUSTER + (skipped + step) % self.clusters;
            if fat.entry_of(cluster)? == 0 {
                if free == 0 {
                    first = cluster;
                }
                free += 1;
                if free == wanted {
                    break;
                }
            }
        }
        Ok((free, first))
    }

    /// Has the root directory an end? If its chain led back into itself, every search in it would go on for ever.
    fn directory_ends<D: BlockDevice>(&self, device: &D) -> Result<bool, D::Error> {
        let Some(mut cluster) = self.root else {
            return Ok(true);
        };
        let mut fat = FatReader::new(self, device);
        for _ in 0..=DIRECTORY_BYTES / self.cluster_bytes {
            if !self.is_cluster(cluster) {
                return Ok(true);
            }
            cluster = fat.entry_of(cluster)?;
        }
        Ok(false)
    }

    fn is_cluster(&self, entry: u32) -> bool {
        (FIRST_CLUSTER..self.clusters + FIRST_CLUSTER).contains(&entry)
    }

    /// Corrects what `embedded-sdmmc` 0.10 would stumble over in a sector just read.
    ///
    /// Its search for a free cluster runs on to the end of the FAT's last sector, where entries belong to no cluster and
    /// most programs leave zeros: it would put data behind the volume's end. They are shown as used. It follows an entry
    /// that leads to no cluster, such as a write that was torn leaves; that is shown as the end of its chain. And it counts
    /// free clusters down from the card's own figure, which may be anything and so fall below zero. It is shown as
    /// unknown, as the specification allows; a computer then counts for itself.
    pub(crate) fn amend(&self, sector: u32, block: &mut Block) {
        if self.info_sector == Some(sector)
            && let Some(count) = block.get_mut(488..492)
        {
            count.fill(0xFF);
        }
        let Some(before) = sector.checked_sub(self.fat_start).filter(|before| *before < self.fat_sectors) else {
            return;
        };
        let first = before.saturating_mul(SECTOR_BYTES / self.entry_bytes);
        for (cluster, entry) in (first..).zip(block.chunks_exact_mut(self.entry_bytes as usize)) {
            let (value, bad, end): (_, _, &[u8]) = match *entry {
                [b0, b1, b2, b3] => {
                    (u32::from_le_bytes([b0, b1, b2, b3]) & 0x0FFF_FFFF, 0x0FFF_FFF7, &[0xFF, 0xFF, 0xFF, 0x0F])
                }
                [b0, b1] => (u32::from(u16::from_le_bytes([b0, b1])), 0xFFF7, &[0xFF, 0xFF]),
                _ => continue,
            };
            if self.is_nonsense(cluster, value, bad) {
                entry.copy_from_slice(end);
            }
        }
    }

    /// Is this entry one of no cluster, or does it lead to none? `bad` and larger values have meanings of their own.
    fn is_nonsense(&self, cluster: u32, value: u32, bad: u32) -> bool {
        let leads_nowhere = cluster >= FIRST_CLUSTER && value > 0 && value < bad && !self.is_cluster(value);
        cluster >= self.clusters + FIRST_CLUSTER || leads_nowhere
    }
}

/// Reads entries of the first FAT, each sector once while the entries lie in it.
struct FatReader<'a, D> {
    layout: &'a Layout,
    device: &'a D,
    block: [Block; 1],
    loaded: Option<u32>,
}

impl<'a, D: BlockDevice> FatReader<'a, D> {
    fn new(layout: &'a Layout, device: &'a D) -> Self {
        Self { layout, device, block: [Block::new()], loaded: None }
    }

    fn entry_of(&mut self, cluster: u32) -> Result<u32, D::Error> {
        let offset = cluster * self.layout.entry_bytes;
        let sector = self.layout.fat_start + offset / SECTOR_BYTES;
        if self.loaded != Some(sector) {
            self.loaded = None;
            self.device.read(&mut self.block, BlockIdx(sector))?;
            self.loaded = Some(sector);
        }
        let [entries] = &self.block;
        let place = (offset % SECTOR_BYTES) as usize;
        Ok(match self.layout.entry_bytes {
            // The upper four bits of a FAT32 entry are reserved.
            4 => u32_at(entries, place) & 0x0FFF_FFFF,
            _ => u32::from(u16_at(entries, place)),
        })
    }
}

fn u16_at(block: &Block, offset: usize) -> u16 {
    block.get(offset..).and_then(|rest| rest.first_chunk()).map_or(0, |bytes| u16::from_le_bytes(*bytes))
}

fn u32_at(block: &Block, offset: usize) -> u32 {
    block.get(offset..).and_then(|rest| rest.first_chunk()).map_or(0, |bytes| u32::from_le_bytes(*bytes))
}
