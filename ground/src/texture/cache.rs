//! Decoded photos between the two passes and between strips, within a limit of memory.

use std::collections::BTreeMap;
use std::sync::Arc;

use super::sample::Mips;
use crate::survey::Size;

/// Photos handled at the same time at most, however small they are.
const MOST_AT_ONCE: usize = 64;

/// Photos that may be decoded at the same time beside a full cache, so that memory does not grow with the number of threads:
/// half as much again as the cache.
pub(super) fn photos_at_once(size: Size, cache_bytes: usize) -> usize {
    // Red, green, blue and the halved copies.
    let photo_bytes = size.width_px as usize * size.height_px as usize * 4;
    (cache_bytes / 2 / photo_bytes.max(1)).clamp(1, MOST_AT_ONCE)
}

/// Photos by their numbers, which grow along the journey: the highest are needed last.
pub(super) struct Cache {
    limit_bytes: usize,
    /// Whole photos that the first pass left.
    whole: BTreeMap<usize, Mips>,
    /// What the strips may need of the photos around.
    crops: BTreeMap<usize, Arc<Mips>>,
    /// Bytes of both.
    bytes: usize,
}

impl Cache {
    pub(super) fn new(limit_bytes: usize) -> Self {
        Self { limit_bytes, whole: BTreeMap::new(), crops: BTreeMap::new(), bytes: 0 }
    }

    /// Keeps a whole photo if there is room.
    pub(super) fn keep_whole(&mut self, index: usize, mips: Mips) {
        if self.bytes + mips.bytes() <= self.limit_bytes {
            self.bytes += mips.bytes();
            self.whole.insert(index, mips);
        }
    }

    /// Hands out a whole photo that was kept.
    pub(super) fn take_whole(&mut self, index: usize) -> Option<Mips> {
        let mips = self.whole.remove(&index)?;
        self.bytes -= mips.bytes();
        Some(mips)
    }

    pub(super) fn crop(&self, index: usize) -> Option<Arc<Mips>> {
        self.crops.get(&index).cloned()
    }

    /// Keeps a crop; what is needed last gives way.
    pub(super) fn keep_crop(&mut self, index: usize, crop: Arc<Mips>) {
        self.bytes += crop.bytes();
        if let Some(before) = self.crops.insert(index, crop) {
            self.bytes -= before.bytes();
        }
        while self.bytes > self.limit_bytes {
            let last = self.whole.pop_last().map(|(_, mips)| mips.bytes());
            let Some(bytes) = last.or_else(|| self.crops.pop_last().map(|(_, crop)| crop.bytes())) else { break };
            self.bytes -= bytes;
        }
    }

    /// Drops crops that are not wanted any more.
    pub(super) fn retain_crops(&mut self, wanted: impl Fn(usize) -> bool) {
        let bytes = &mut self.bytes;
        self.crops.retain(|&index, crop| {
            let keep = wanted(index);
            if !keep {
                *bytes -= crop.bytes();
            }
            keep
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::raster::Raster;

    fn photo() -> Mips {
        Mips::new(Raster::new(40, 30))
    }

    #[test]
    fn the_cache_stays_within_its_limit_and_what_is_needed_last_gives_way() {
        let bytes = photo().bytes();
        let mut cache = Cache::new(bytes * 3);
        for index in 0..5 {
            cache.keep_whole(index, photo());
        }
        assert!(cache.take_whole(3).is_none(), "no room for the fourth");
        cache.keep_crop(0, Arc::new(photo()));
        assert!(cache.take_whole(2).is_none() && cache.take_whole(1).is_some());
        for index in 1..9 {
            cache.keep_crop(index, Arc::new(photo()));
        }
        assert!(cache.crop(0).is_some() && cache.crop(8).is_none());
        cache.retain_crops(|index| index > 1);
        assert!(cache.crop(0).is_none() && cache.bytes <= bytes * 3);
    }

    #[test]
    fn large_photos_are_decoded_one_by_one() {
        let size = |width_px: u32| Size { width_px, height_px: width_px * 3 / 4 };
        assert_eq!(photos_at_once(size(1000), 512 << 20), 64);
        assert_eq!(photos_at_once(size(4000), 512 << 20), 5);
        assert_eq!(photos_at_once(size(12_000), 512 << 20), 1);
    }
}
