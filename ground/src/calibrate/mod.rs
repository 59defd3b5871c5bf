//! A camera's intrinsics and distortion from photos of a chessboard or `ChArUco` board.
//!
//! [`calibrate`] takes a folder of photos: corners ([`find_corners`]), camera ([`fit_camera`]), what the photos leave open
//! ([`Hint`]), and for every photo whether it was used or why not.

mod board;
mod coverage;
mod detect;
mod fit;
mod output;
mod report;
mod rig;

use std::collections::BTreeMap;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};

use rayon::prelude::*;
use serde::Serialize;

pub use board::{Board, BoardError, Corner, Pattern};
pub use coverage::{Coverage, Hint, Region};
pub use detect::{NoBoard, find_corners};
pub use fit::{Fit, FittedPhoto, IntrinsicSigmas, Sigmas, fit_camera};
pub use output::{OutputError, write};
pub use report::{CalibrationFigures, CameraFigures, PhotoFigures};
pub use rig::{Estimated, RigCalibration, Untold, calibrate_rig};

use crate::survey::{FoundPhoto, PhotoError, Size, decode_luma, find_photos, probe};

/// Camera models that can be fitted, as survey.toml names them.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, clap::ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub enum Model {
    /// Five parameters: k1 k2 p1 p2 k3, on the plane z = 1.
    BrownConrady,
    /// Four parameters: k1..k4 over the angle; for fisheye lenses.
    KannalaBrandt,
}

impl Model {
    fn other(self) -> Self {
        match self {
            Self::BrownConrady => Self::KannalaBrandt,
            Self::KannalaBrandt => Self::BrownConrady,
        }
    }
}

/// Why nothing could be calibrated at all.
#[derive(Debug, thiserror::Error)]
pub enum CalibrateError {
    /// The folder cannot be read.
    #[error("{}: cannot be read", folder.display())]
    Folder {
        /// Which.
        folder: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// There is no photo in it.
    #[error("{}: no JPEG in it or in folders below it", folder.display())]
    NoPhotos {
        /// The folder.
        folder: PathBuf,
    },
}

/// What became of a photo.
#[derive(Debug, thiserror::Error)]
pub enum Reason {
    /// It cannot be read.
    #[error(transparent)]
    Unreadable(#[from] PhotoError),
    /// Most photos have another size.
    #[error("it is {found}, most are {expected}")]
    OtherSize {
        /// Its size.
        found: Size,
        /// The size of most.
        expected: Size,
    },
    /// The board is not found.
    #[error(transparent)]
    NoBoard(#[from] NoBoard),
    /// It does not fit the others.
    #[error("its corners are {rms_px:.2} px off (root mean square) by the camera that fits the other photos")]
    Outlier {
        /// Its own root mean square error.
        rms_px: f64,
    },
    /// There are too few photos with a board, or no board is tilted: nothing could be fitted.
    #[error(
        "its board was found, but there is no camera: {} such photos at least are needed, tilted by turns",
        fit::LEAST_PHOTOS
    )]
    NoCamera,
    /// Cameras of the model asked for do not see the boards as they were seen; the other model's do.
    #[error("its board was found, but no {} camera fits: see the hint", report::model_name(*.0))]
    NoCameraOf(Model),
}

/// A photo, its corners if the board was found, and why it was not used if so.
#[derive(Debug)]
pub struct CalibrationPhoto {
    /// Name below the folder.
    pub name: String,
    /// Path.
    pub path: PathBuf,
    /// Corners by their numbers; empty where none were found.
    pub corners: Vec<Corner>,
    /// `None` if it was used.
    pub unused: Option<Reason>,
}

/// What the photos say of the camera.
#[derive(Debug)]
pub struct Calibration {
    /// The board that was looked for.
    pub board: Board,
    /// The photos' size.
    pub size: Size,
    /// Every photo of the folder, by name.
    pub photos: Vec<CalibrationPhoto>,
    /// The camera with the model asked for; its photos are numbered as above. `None` if too few boards were found.
    pub fit: Option<Fit>,
    /// The same photos with the other model, for comparison.
    pub other_fit: Option<Fit>,
    /// Where corners were seen.
    pub coverage: Coverage,
    /// What to photograph in addition.
    pub hints: Vec<Hint>,
}

/// Calibrates a camera from a folder of photos; `progress` is called with the number done and of all.
///
/// # Errors
/// [`CalibrateError`] if there is nothing to work on. Photos that cannot be used, and too few of them, are part of the answer.
pub fn calibrate(
    folder: &Path,
    board: Board,
    model: Model,
    progress: &(dyn Fn(usize, usize) + Sync),
) -> Result<Calibration, CalibrateError> {
    let found = find_photos(folder).map_err(|source| CalibrateError::Folder { folder: folder.to_owned(), source })?;
    if found.is_empty() {
        return Err(CalibrateError::NoPhotos { folder: folder.to_owned() });
    }
    let sizes: Vec<Result<Size, PhotoError>> = found.iter().map(|photo| probe(&photo.path)).collect();
    let size = most_common(sizes.iter().filter_map(|size| size.as_ref().ok()));
    let done = AtomicUsize::new(0);
    let total = found.len();
    let mut photos: Vec<CalibrationPhoto> = found
        .into_par_iter()
        .zip(sizes)
        .map(|(FoundPhoto { name, path }, found)| {
            let looked = found.map_err(Reason::from).and_then(|found| corners_in(&path, found, size, &board));
            progress(done.fetch_add(1, Ordering::Relaxed) + 1, total);
            match looked {
                Ok(corners) => CalibrationPhoto { name, path, corners, unused: None },
                Err(reason) => CalibrationPhoto { name, path, corners: Vec::new(), unused: Some(reason) },
            }
        })
        .collect();
    let fit = fit_photos(&photos, &board, size, model);
    let other_fit = fit_photos(&photos, &board, size, model.other());
    for (index, photo) in photos.iter_mut().enumerate().filter(|(_, photo)| photo.unused.is_none()) {
        photo.unused = match &fit {
            None if other_fit.is_some() => Some(Reason::NoCameraOf(model)),
            None => Some(Reason::NoCamera),
            Some(fit) => {
                let outlier = fit.outliers.iter().find(|(outlier, _)| *outlier == index);
                outlier.map(|&(_, rms_px)| Reason::Outlier { rms_px })
            }
        };
    }
    let coverage = Coverage::new(&photos, size);
    let hints = coverage::hints(&coverage, fit.as_ref(), other_fit.as_ref());
    Ok(Calibration { board, size, photos, fit, other_fit, coverage, hints })
}

fn corners_in(path: &Path, found: Size, expected: Size, board: &Board) -> Result<Vec<Corner>, Reason> {
    if found != expected {
        return Err(Reason::OtherSize { found, expected });
    }
    Ok(find_corners(&decode_luma(path, found)?, board)?)
}

/// The size that most photos have; the larger of two as common.
fn most_common<'s>(sizes: impl Iterator<Item = &'s Size>) -> Size {
    let mut counts: BTreeMap<[u32; 2], usize> = BTreeMap::new();
    for size in sizes {
        *counts.entry([size.width_px, size.height_px]).or_default() += 1;
    }
    let most = counts.into_iter().max_by_key(|(_, count)| *count);
    let [width_px, height_px] = most.map_or([0, 0], |(size, _)| size);
    Size { width_px, height_px }
}

/// Fits a camera to the photos with a board; the fit's indices are those of `photos`.
fn fit_photos(photos: &[CalibrationPhoto], board: &Board, size: Size, model: Model) -> Option<Fit> {
    let usable: Vec<usize> = (0..photos.len()).filter(|&index| photos[index].unused.is_none()).collect();
    let corners: Vec<Vec<Corner>> = usable.iter().map(|&index| photos[index].corners.clone()).collect();
    let mut fit = fit_camera(&corners, board, size, model)?;
    for photo in &mut fit.photos {
        photo.index = usable[photo.index];
    }
    for (index, _) in &mut fit.outliers {
        *index = usable[*index];
    }
    Some(fit)
}
