//! From a survey's photos to prior poses.

use adit_geometry::profile::Profile;
use rayon::prelude::*;

use super::{PlacedPhoto, UntaggedError, poses};
use crate::correspond::{Ratio, RepMatch, Strategy, View};
use crate::features::{Features, SiftDescriptor, SiftOptions, sift};
use crate::survey::{Loss, Photo, Size, Survey, decode_grey, load_mask};

/// Features per photo: a prior needs hundreds of matches per pair, not thousands, and matching costs their square.
const MOST_FEATURES: usize = 2000;
/// Least difference of Gaussians, grey levels: concrete shows little more than noise.
const CONTRAST: f32 = 0.5;

/// How photos without tags are matched with each other.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Matcher {
    /// Likelihood and motion curves, for repeated structure.
    RepMatch,
    /// Ratio test and RANSAC, the baseline.
    Ratio,
}

impl Matcher {
    fn strategy(self) -> Box<dyn Strategy<SiftDescriptor>> {
        match self {
            Self::RepMatch => Box::new(RepMatch::default()),
            Self::Ratio => Box::new(Ratio::default()),
        }
    }
}

/// Prior poses of a survey's photos.
#[derive(Clone, Debug, PartialEq)]
pub struct Untagged {
    /// One per photo of the survey, in the same order.
    pub photos: Vec<PlacedPhoto>,
    /// Photos that could not be read or placed: interpolated, and named here.
    pub losses: Vec<Loss>,
}

/// Finds the poses of a survey's photos from their pixels, whatever their tags say.
///
/// # Errors
/// [`UntaggedError`] if the photos do not show a turning camera. A single photo that cannot be read or placed is a loss.
pub fn survey_poses(survey: &Survey, profile: &Profile<f64>, matcher: Matcher) -> Result<Untagged, UntaggedError> {
    let camera = &survey.config.camera.camera;
    let size = Size { width_px: camera.width_px, height_px: camera.height_px };
    let read: Vec<Result<Features<SiftDescriptor>, Loss>> =
        survey.photos.par_iter().map(|photo| features(photo, size)).collect();
    let mut losses = Vec::new();
    let views: Vec<View<SiftDescriptor>> = read
        .into_iter()
        .map(|read| {
            let features = read.unwrap_or_else(|loss| {
                losses.push(loss);
                Features { keypoints: Vec::new(), descriptors: Vec::new() }
            });
            View::new(features, camera)
        })
        .collect();
    let photos = poses(&views, &*matcher.strategy(), profile, &survey.config.rig)?;
    for (photo, placed) in survey.photos.iter().zip(&photos) {
        if !placed.placed {
            let why = format!("matches no other photo ({} matches agree): its pose is interpolated", placed.support);
            losses.push(Loss::new(format!("photos/{}", photo.name), why));
        }
    }
    Ok(Untagged { photos, losses })
}

fn features(photo: &Photo, size: Size) -> Result<Features<SiftDescriptor>, Loss> {
    let lost = |why: String| Loss::new(format!("photos/{}", photo.name), why);
    let grey = decode_grey(&photo.path, size).map_err(|error| lost(error.reason()))?;
    let mask = photo.mask.as_ref().map(|path| load_mask(path, size)).transpose();
    let mask = mask.map_err(|error| lost(error.to_string()))?;
    let options = SiftOptions { contrast: CONTRAST, most: MOST_FEATURES, ..SiftOptions::default() };
    Ok(sift(&grey, mask.as_ref(), &options))
}
