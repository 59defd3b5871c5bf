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
}

/// Where on the card is what.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Layout {
    /// First sector of the first FAT.
    fat_start: u32,
    /// Bytes per entry of the FAT: 2 or 4.
    entry_bytes: u32,
    /// How many clusters there are.
    clusters: u32,
    /// Bytes per cluster.
    pub(crate) cluster_bytes: u32,
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
    Ok(layout_in(boot, start))
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
    let root = u32_at(boot, 44);
    let is_sound = reserved > 0
        && u32::try_from(end).is_ok()
        && entries_bytes <= u64::from(fat_sectors) * u64::from(SECTOR_BYTES)
        && (!is_fat32 || (FIRST_CLUSTER..clusters + FIRST_CLUSTER).contains(&root));
    if !is_sound {
        return Err(CardFormat::NoFat);
    }
    Ok(Layout {
        fat_start: start + reserved,
        entry_bytes,
        clusters,
        cluster_bytes: cluster_sectors * SECTOR_BYTES,
        info_sector: is_fat32.then(|| start + u32::from(u16_at(boot, 48))),
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
        let mut block = [Block::new()];
        let mut loaded = None;
        let (mut free, mut first) = (0, FIRST_CLUSTER);
        let skipped = from.saturating_sub(FIRST_CLUSTER) % self.clusters;
        for step in 0..self.clusters {
            let cluster = FIRST_CLUSTER + (skipped + step) % self.clusters;
            let offset = cluster * self.entry_bytes;
            let sector = self.fat_start + offset / SECTOR_BYTES;
            if loaded != Some(sector) {
                device.read(&mut block, BlockIdx(sector))?;
                loaded = Some(sector);
            }
            let [entries] = &block;
            if self.entry_at(entries, (offset % SECTOR_BYTES) as usize) == 0 {
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

    fn entry_at(&self, entries: &Block, offset: usize) -> u32 {
        // The upper four bits of a FAT32 entry are reserved.
        if self.entry_bytes == 4 { u32_at(entries, offset) & 0x0FFF_FFFF } else { u32::from(u16_at(entries, offset)) }
    }

    /// Corrects what `embedded-sdmmc` 0.10 would stumble over in a sector just read.
    ///
    /// Its search for a free cluster runs on to the end of the FAT's last sector, where entries belong to no cluster and
    /// most programs leave zeros: it would put data behind the volume's end. They are shown as used. And it counts free
    /// clusters down from the card's own figure, which may be anything and so fall below zero. It is shown as unknown, as
    /// the specification allows; a computer then counts for itself.
    pub(crate) fn amend(&self, sector: u32, block: &mut Block) {
        let end = (self.clusters + FIRST_CLUSTER) * self.entry_bytes;
        if !end.is_multiple_of(SECTOR_BYTES)
            && sector == self.fat_start + end / SECTOR_BYTES
            && let Some(tail) = block.get_mut((end % SECTOR_BYTES) as usize..)
        {
            for entry in tail.chunks_exact_mut(self.entry_bytes as usize) {
                entry.fill(0xFF);
                if let [.., top] = entry
                    && self.entry_bytes == 4
                {
                    *top = 0x0F;
                }
            }
        }
        if self.info_sector == Some(sector)
            && let Some(count) = block.get_mut(488..492)
        {
            count.fill(0xFF);
        }
    }
}

fn u16_at(block: &Block, offset: usize) -> u16 {
    block.get(offset..).and_then(|rest| rest.first_chunk()).map_or(0, |bytes| u16::from_le_bytes(*bytes))
}

fn u32_at(block: &Block, offset: usize) -> u32 {
    block.get(offset..).and_then(|rest| rest.first_chunk()).map_or(0, |bytes| u32::from_le_bytes(*bytes))
}
