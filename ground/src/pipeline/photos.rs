//! Photos of a survey as the matching asks for them, decoded on demand.

use std::borrow::Cow;

use crate::matching::{Photos, Pixels};
use crate::raster::Mask;
use crate::survey::{Size, Survey, decode_luma, load_mask};

/// Decodes the survey's photos; those that fail are left out of the matching and named by [`Self::faults`].
pub(super) struct SurveyPhotos<'a> {
    survey: &'a Survey,
    use_masks: bool,
    faults: std::sync::Mutex<Vec<(usize, String)>>,
}

impl<'a> SurveyPhotos<'a> {
    /// Photos of `survey`; without masks if P1 is switched off.
    pub(super) fn new(survey: &'a Survey, use_masks: bool) -> Self {
        Self { survey, use_masks, faults: std::sync::Mutex::default() }
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
        let photo = self.survey.photos.get(index)?;
        let size = size_of(self.survey);
        let grey = decode_luma(&photo.path, size).map_err(|error| self.fault(index, &error)).ok()?;
        let mask = if self.use_masks { photo_mask(self.survey, index) } else { Ok(None) };
        let mask = mask.map_err(|error| self.fault(index, &error)).ok()?;
        Some(Pixels { grey: Cow::Owned(grey), mask: mask.map(Cow::Owned) })
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
