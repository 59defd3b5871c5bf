//! Photos of a survey as the matching asks for them, decoded on demand and kept for the next round while there is room.

use std::borrow::Cow;
use std::sync::OnceLock;
use std::sync::atomic::{AtomicUsize, Ordering};

use fixedbitset::FixedBitSet;

use crate::matching::{Photos, Pixels};
use crate::raster::Luma;
use crate::survey::{Size, Survey, decode_luma, load_mask};

/// Room for decoded photos, whatever the survey's length: saves a short one from decoding all of them in each round.
const KEPT_BYTES: usize = 128 << 20;

/// Decoded photos, the first ones that fit into [`KEPT_BYTES`].
pub(super) struct KeptPhotos {
    photos: Vec<OnceLock<Kept>>,
    room_bytes: AtomicUsize,
}

struct Kept {
    /// `None` once they have been given back.
    pixels: Option<Pixels<'static>>,
    hidden: Option<Hidden>,
}

/// Which pixels a photo's mask hides.
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
        let photos = std::iter::repeat_with(OnceLock::new).take(survey.photos.len()).collect();
        Self { photos, room_bytes: AtomicUsize::new(KEPT_BYTES) }
    }

    fn get(&self, index: usize) -> Option<Pixels<'_>> {
        self.photos.get(index)?.get()?.pixels.as_ref().map(Pixels::borrowed)
    }

    /// Gives the photos' memory back once they have been matched; what masks hide is still known.
    pub(super) fn release(&mut self) {
        for kept in self.photos.iter_mut().filter_map(OnceLock::get_mut) {
            kept.pixels = None;
        }
    }

    /// What the mask of a kept photo hides, if it has one.
    pub(super) fn hidden(&self, index: usize) -> Option<&Hidden> {
        self.photos.get(index)?.get()?.hidden.as_ref()
    }

    /// Keeps a photo if it fits, and hands it back.
    fn keep(&self, index: usize, pixels: Pixels<'static>) -> Option<Pixels<'_>> {
        let take = |room: usize| room.checked_sub(pixels.grey().data.len());
        if self.room_bytes.fetch_update(Ordering::Relaxed, Ordering::Relaxed, take).is_err() {
            return Some(pixels);
        }
        let hidden = pixels.is_masked().then(|| Hidden::new(pixels.grey()));
        let kept = self.photos.get(index)?.get_or_init(|| Kept { pixels: Some(pixels), hidden });
        kept.pixels.as_ref().map(Pixels::borrowed)
    }
}

/// The survey's photos in a round; those that fail are left out of the matching and named by [`Self::faults`].
pub(super) struct SurveyPhotos<'a> {
    survey: &'a Survey,
    kept: &'a KeptPhotos,
    use_masks: bool,
    faults: std::sync::Mutex<Vec<(usize, String)>>,
}

impl<'a> SurveyPhotos<'a> {
    /// Photos of `survey`; without masks if P1 is switched off. The same `kept` serves only rounds with the same masks.
    pub(super) fn new(survey: &'a Survey, kept: &'a KeptPhotos, use_masks: bool) -> Self {
        Self { survey, kept, use_masks, faults: std::sync::Mutex::default() }
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
    fn load(&self, index: usize) -> Option<Pixels<'_>> {
        if let Some(kept) = self.kept.get(index) {
            return Some(kept);
        }
        let photo = self.survey.photos.get(index)?;
        let size = size_of(self.survey);
        let grey = decode_luma(&photo.path, size).map_err(|error| self.fault(index, &error)).ok()?;
        let mask = photo.mask.as_ref().filter(|_| self.use_masks).map(|path| load_mask(path, size)).transpose();
        let mask = mask.map_err(|error| self.fault(index, &error)).ok()?;
        let pixels = match mask {
            Some(mask) => Pixels::with_mask(grey, &mask)?,
            None => Pixels::new(Cow::Owned(grey)),
        };
        self.kept.keep(index, pixels)
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

    fn kept(photos: usize, room_bytes: usize) -> KeptPhotos {
        let photos = std::iter::repeat_with(OnceLock::new).take(photos).collect();
        KeptPhotos { photos, room_bytes: AtomicUsize::new(room_bytes) }
    }

    #[test]
    fn photos_are_kept_while_there_is_room_and_handed_back_in_any_case() {
        let kept = kept(3, 2 * 10 * 10 + 50);
        for index in 0..3 {
            let grey = Luma { width: 10, height: 10, data: vec![index as u8; 100] };
            let pixels = kept.keep(index, Pixels::new(Cow::Owned(grey))).unwrap();
            assert_eq!(pixels.grey().data[99], index as u8);
        }
        assert_eq!(kept.get(1).map(|pixels| pixels.grey().data[0]), Some(1));
        assert!(kept.get(0).is_some() && kept.get(2).is_none());
    }

    #[test]
    fn what_a_mask_hides_is_known_after_the_pixels_were_given_back() {
        let mut kept = kept(1, 1000);
        let mut mask = Mask { width: 11, height: 7, data: vec![255; 77] };
        mask.set(10, 6, [0]);
        mask.set(3, 0, [0]);
        let grey = Luma { width: 11, height: 7, data: vec![0; 77] };
        kept.keep(0, Pixels::with_mask(grey, &mask).unwrap()).unwrap();
        kept.release();
        assert!(kept.get(0).is_none());
        let hidden = kept.hidden(0).expect("a mask");
        assert!(hidden.contains([10.5, 6.5]) && hidden.contains([3.9, -2.0]) && hidden.contains([20.0, 8.0]));
        assert!(!hidden.contains([9.9, 6.5]) && !hidden.contains([4.0, 0.0]));
    }
}
