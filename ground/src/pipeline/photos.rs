//! Photos of a survey as the matching asks for them, decoded on demand and kept for the next round while there is room.

use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, MutexGuard, OnceLock, PoisonError};

use fixedbitset::FixedBitSet;

use crate::matching::{Photos, Pixels};
use crate::raster::Luma;
use crate::survey::{Size, Survey, decode_luma, load_mask};

/// Room for decoded photos, whatever the survey's length: saves a short one from decoding all of them in each round.
const KEPT_BYTES: usize = 128 << 20;

/// Decoded photos, the first ones that fit into [`KEPT_BYTES`], and what their masks hide.
pub(super) struct KeptPhotos {
    photos: Vec<Mutex<Option<Pixels>>>,
    hidden: Vec<OnceLock<Hidden>>,
    room_bytes: AtomicUsize,
}

/// Which pixels a photo's mask hides.
#[derive(Clone, Debug)]
pub(super) struct Hidden {
    size: [usize; 2],
    /// Row by row.
    pixels: FixedBitSet,
}

impl Hidden {
    /// Of a mask, or of a photo with its mask laid into it.
    pub(super) fn new(levels: &Luma) -> Self {
        let block = |levels: &[u8]| levels.iter().rev().fold(0, |bits, &level| bits << 1 | usize::from(level == 0));
        let blocks = levels.data.chunks(usize::BITS as usize).map(block);
        let pixels = FixedBitSet::with_capacity_and_blocks(levels.data.len(), blocks);
        Self { size: [levels.width, levels.height], pixels }
    }

    /// Tells whether the pixel at a place, or the nearest to it, is hidden.
    pub(super) fn contains(&self, place: [f32; 2]) -> bool {
        let nearest = |axis: usize| (place[axis].max(0.0) as usize).min(self.size[axis].saturating_sub(1));
        self.pixels.contains(nearest(1) * self.size[0] + nearest(0))
    }
}

impl KeptPhotos {
    /// Room for photos of `survey`.
    pub(super) fn new(survey: &Survey) -> Self {
        Self::with_room(survey.photos.len(), KEPT_BYTES)
    }

    fn with_room(photos: usize, room_bytes: usize) -> Self {
        Self {
            photos: std::iter::repeat_with(Mutex::default).take(photos).collect(),
            hidden: vec![OnceLock::new(); photos],
            room_bytes: AtomicUsize::new(room_bytes),
        }
    }

    /// What the mask of a kept photo hides, if it has one; still known when the pixels are gone.
    pub(super) fn hidden(&self, index: usize) -> Option<&Hidden> {
        self.hidden.get(index)?.get()
    }

    fn slot(&self, index: usize) -> Option<MutexGuard<'_, Option<Pixels>>> {
        Some(self.photos.get(index)?.lock().unwrap_or_else(PoisonError::into_inner))
    }

    /// Keeps a photo if it fits.
    fn keep(&self, index: usize, pixels: &Pixels) {
        let take = |room: usize| room.checked_sub(pixels.grey().data.len());
        if self.room_bytes.fetch_update(Ordering::Relaxed, Ordering::Relaxed, take).is_err() {
            return;
        }
        if pixels.is_masked() {
            self.hidden[index].get_or_init(|| Hidden::new(pixels.grey()));
        }
        if let Some(mut slot) = self.slot(index) {
            *slot = Some(pixels.clone());
        }
    }
}

/// Whether photos are needed again after a round.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Use {
    /// Kept while there is room.
    Again,
    /// What was kept is given out for good, and so makes room.
    Last,
}

/// The survey's photos in a round; those that fail are left out of the matching and named by [`Self::faults`].
pub(super) struct SurveyPhotos<'a> {
    survey: &'a Survey,
    kept: &'a KeptPhotos,
    use_masks: bool,
    used: Use,
    faults: std::sync::Mutex<Vec<(usize, String)>>,
}

impl<'a> SurveyPhotos<'a> {
    /// Photos of `survey`; without masks if P1 is switched off. The same `kept` serves only rounds with the same masks.
    pub(super) fn new(survey: &'a Survey, kept: &'a KeptPhotos, use_masks: bool, used: Use) -> Self {
        Self { survey, kept, use_masks, used, faults: std::sync::Mutex::default() }
    }

    /// The photos that could not be decoded, with the reason, in order.
    pub(super) fn faults(self) -> Vec<(usize, String)> {
        let mut faults = self.faults.into_inner().unwrap_or_default();
        faults.sort();
        faults
    }

    fn fault(&self, photo: usize, reason: &dyn std::fmt::Display) {
        if let Ok(mut faults) = self.faults.lock() {
            faults.push((photo, reason.to_string()));
        }
    }
}

impl Photos for SurveyPhotos<'_> {
    fn load(&self, index: usize) -> Option<Pixels> {
        let kept = self.kept.slot(index).and_then(|mut slot| match self.used {
            Use::Again => slot.clone(),
            Use::Last => slot.take(),
        });
        if kept.is_some() {
            return kept;
        }
        let photo = self.survey.photos.get(index)?;
        let size = size_of(self.survey);
        let grey = decode_luma(&photo.path, size).map_err(|error| self.fault(index, &error)).ok()?;
        let mask = photo.mask.as_ref().filter(|_| self.use_masks).map(|path| load_mask(path, size)).transpose();
        let mask = mask.map_err(|error| self.fault(index, &error)).ok()?;
        let pixels = match mask {
            Some(mask) => Pixels::with_mask(grey, &mask)?,
            None => Pixels::new(grey),
        };
        if self.used == Use::Again {
            self.kept.keep(index, &pixels);
        }
        Some(pixels)
    }
}

/// The size that every photo and mask of the survey must have.
pub(super) fn size_of(survey: &Survey) -> Size {
    let camera = &survey.config.camera.camera;
    Size { width_px: camera.width_px, height_px: camera.height_px }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::raster::Mask;

    #[test]
    fn photos_are_kept_while_there_is_room() {
        let kept = KeptPhotos::with_room(3, 2 * 10 * 10 + 50);
        for index in 0..3 {
            kept.keep(index, &Pixels::new(Luma { width: 10, height: 10, data: vec![index as u8; 100] }));
        }
        let first = |index: usize| kept.slot(index)?.as_ref().map(|pixels| pixels.grey().data[0]);
        assert_eq!([0, 1, 2].map(first), [Some(0), Some(1), None]);
    }

    #[test]
    fn what_a_mask_hides_is_known_after_the_pixels_are_gone() {
        let kept = KeptPhotos::with_room(1, 1000);
        let mut mask = Mask { width: 11, height: 7, data: vec![255; 77] };
        mask.set(10, 6, [0]);
        mask.set(3, 0, [0]);
        let grey = Luma { width: 11, height: 7, data: vec![0; 77] };
        kept.keep(0, &Pixels::with_mask(grey, &mask).unwrap());
        *kept.slot(0).unwrap() = None;
        let hidden = kept.hidden(0).expect("a mask");
        assert!(hidden.contains([10.5, 6.5]) && hidden.contains([3.9, -2.0]) && hidden.contains([20.0, 8.0]));
        assert!(!hidden.contains([9.9, 6.5]) && !hidden.contains([4.0, 0.0]));
    }
}
