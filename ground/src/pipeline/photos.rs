//! Photos of a survey as the matching asks for them, decoded on demand and kept for the next round while there is room.

use std::borrow::Cow;
use std::sync::OnceLock;
use std::sync::atomic::{AtomicUsize, Ordering};

use crate::matching::{Photos, Pixels};
use crate::raster::{Luma, Mask};
use crate::survey::{Size, Survey, decode_luma, load_mask};

/// Room for decoded photos and masks, whatever the survey's length: saves a short one from decoding all of them in each round.
const KEPT_BYTES: usize = 128 << 20;

/// Decoded photos with their masks, the first ones that fit into [`KEPT_BYTES`].
pub(super) struct KeptPhotos {
    photos: Vec<OnceLock<Pixels<'static>>>,
    room_bytes: AtomicUsize,
}

impl KeptPhotos {
    /// Room for photos of `survey`.
    pub(super) fn new(survey: &Survey) -> Self {
        let photos = std::iter::repeat_with(OnceLock::new).take(survey.photos.len()).collect();
        Self { photos, room_bytes: AtomicUsize::new(KEPT_BYTES) }
    }

    fn get(&self, index: usize) -> Option<Pixels<'_>> {
        self.photos.get(index)?.get().map(borrowed)
    }

    /// Gives the photos' memory back once they have been matched; the masks stay.
    pub(super) fn release_greys(&mut self) {
        for pixels in self.photos.iter_mut().filter_map(OnceLock::get_mut) {
            pixels.grey = Cow::Owned(Luma { width: 0, height: 0, data: Vec::new() });
        }
    }

    /// A photo's mask, if it has one that is kept.
    pub(super) fn mask(&self, index: usize) -> Option<&Mask> {
        self.photos.get(index)?.get()?.mask.as_deref()
    }

    /// Keeps a photo if it fits, and hands it back.
    fn keep(&self, index: usize, pixels: Pixels<'static>) -> Pixels<'_> {
        let bytes = pixels.grey.data.len() + pixels.mask.as_ref().map_or(0, |mask| mask.data.len());
        let take = |room: usize| room.checked_sub(bytes);
        let fits = self.room_bytes.fetch_update(Ordering::Relaxed, Ordering::Relaxed, take).is_ok();
        match self.photos.get(index).filter(|_| fits) {
            Some(slot) => borrowed(slot.get_or_init(|| pixels)),
            None => pixels,
        }
    }
}

fn borrowed<'a>(pixels: &'a Pixels<'static>) -> Pixels<'a> {
    Pixels { grey: Cow::Borrowed(&*pixels.grey), mask: pixels.mask.as_deref().map(Cow::Borrowed) }
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
        let mask = if self.use_masks { photo_mask(self.survey, index) } else { Ok(None) };
        let mask = mask.map_err(|error| self.fault(index, &error)).ok()?;
        Some(self.kept.keep(index, Pixels { grey: Cow::Owned(grey), mask: mask.map(Cow::Owned) }))
    }
}

/// The size that every photo and mask of the survey must have.
pub(super) fn size_of(survey: &Survey) -> Size {
    let camera = &survey.config.camera.camera;
    Size { width_px: camera.width_px, height_px: camera.height_px }
}

/// A photo's mask, if it has one.
///
/// # Errors
/// If the mask cannot be read or has another size.
fn photo_mask(survey: &Survey, index: usize) -> Result<Option<Mask>, crate::survey::MaskError> {
    let Some(path) = survey.photos.get(index).and_then(|photo| photo.mask.as_ref()) else { return Ok(None) };
    load_mask(path, size_of(survey)).map(Some)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn kept(photos: usize, room_bytes: usize) -> KeptPhotos {
        let photos = std::iter::repeat_with(OnceLock::new).take(photos).collect();
        KeptPhotos { photos, room_bytes: AtomicUsize::new(room_bytes) }
    }

    #[test]
    fn photos_are_kept_while_there_is_room_and_handed_back_in_any_case() {
        let kept = kept(3, 2 * 10 * 10 + 50);
        for index in 0..3 {
            let grey = Luma { width: 10, height: 10, data: vec![index as u8; 100] };
            let pixels = kept.keep(index, Pixels { grey: Cow::Owned(grey), mask: None });
            assert_eq!(pixels.grey.data[99], index as u8);
        }
        assert_eq!(kept.get(1).map(|pixels| pixels.grey.data[0]), Some(1));
        assert!(kept.get(0).is_some() && kept.get(2).is_none());
    }
}
