//! `adit evaluate`: a reconstruction against the truth of a synthetic survey.

mod align;
mod coverage;
mod drift;
mod poses;
mod relief;
mod shift;
mod table;
mod wall_image;

use std::path::{Path, PathBuf};

use adit_geometry::profile::ProfileError;
use nalgebra::Isometry3;
use serde::Serialize;

pub use coverage::CoverageEvaluation;
pub(crate) use poses::compare_poses;
pub use poses::{AlignedErrors, FrameErrors, PoseEvaluation, Spread};
pub use relief::{ReliefEvaluation, RingOvality};
pub(crate) use shift::Patch;
pub use shift::ShiftEvaluation;
pub use wall_image::{WallGrid, WallImageError};

use crate::poses::{PhotoPose, PosesError, read_poses};
use crate::surface::{SurfaceError, SurfaceStore};
use crate::survey::{MaskError, Survey, SurveyError, load};
use coverage::TrueWall;
use poses::Names;
use relief::TrueRelief;
use wall_image::WallImage;

/// Why a reconstruction cannot be evaluated.
#[derive(Debug, thiserror::Error)]
pub enum EvaluateError {
    /// No truth.
    #[error("{}: not there; only a synthetic survey has a truth to compare with", path.display())]
    NoTruth {
        /// Where truth/poses.csv should be.
        path: PathBuf,
    },
    /// No result.
    #[error("{}: not there; run `adit reconstruct` first, or name its output folder with --out", path.display())]
    NoResult {
        /// Where poses.csv should be.
        path: PathBuf,
    },
    /// The survey cannot be read.
    #[error(transparent)]
    Survey(#[from] SurveyError),
    /// Poses cannot be read.
    #[error(transparent)]
    Poses(#[from] PosesError),
    /// Panorama or texture cannot be read.
    #[error(transparent)]
    WallImage(#[from] WallImageError),
    /// A mask cannot be read.
    #[error(transparent)]
    Mask(#[from] MaskError),
    /// The measured wall cannot be read.
    #[error(transparent)]
    Surface(#[from] SurfaceError),
    /// The profile of survey.toml cannot be built.
    #[error("survey.toml, [tunnel]")]
    Profile(#[from] ProfileError),
}

/// A reconstruction against the truth.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Evaluation {
    /// The survey folder.
    pub survey: PathBuf,
    /// The reconstruction's folder.
    pub out: PathBuf,
    /// Poses against truth/poses.csv.
    pub poses: PoseEvaluation,
    /// Panorama against truth/texture; absent if either is.
    pub panorama: Option<ShiftEvaluation>,
    /// Colour where a photo saw the wall; absent without a panorama.
    pub coverage: Option<CoverageEvaluation>,
    /// The wall's height against truth/relief.f32; absent if either is.
    pub relief: Option<ReliefEvaluation>,
    /// What could not be compared, and why.
    pub notes: Vec<String>,
}

/// Compares the reconstruction in `out` with the truth in `survey/truth`.
///
/// # Errors
/// [`EvaluateError`] if there is no truth or no result, or if a file cannot be read.
pub fn evaluate(survey_folder: &Path, out: &Path) -> Result<Evaluation, EvaluateError> {
    let truth_folder = survey_folder.join("truth");
    let truth_path = truth_folder.join("poses.csv");
    if !truth_path.is_file() {
        return Err(EvaluateError::NoTruth { path: truth_path });
    }
    let poses_path = out.join("poses.csv");
    if !poses_path.is_file() {
        return Err(EvaluateError::NoResult { path: poses_path });
    }
    let mut notes = Vec::new();
    let survey = load(survey_folder)?;
    let truth = of_survey(read_poses(&truth_path)?, &survey, &mut notes);
    let ours = read_poses(&poses_path)?;
    let poses = poses::compare_poses(&ours, &truth);
    let panorama = WallImage::read(&out.join("panorama"), "panorama")?;
    let texture = WallImage::read(&truth_folder, "texture")?;
    if panorama.is_none() {
        notes.push(format!("no panorama: {} has no panorama.png with panorama.json", out.join("panorama").display()));
    }
    if texture.is_none() {
        notes.push(format!("no true texture: {} has no texture.jpg with texture.json", truth_folder.display()));
    }
    let shift = panorama.as_ref().zip(texture.as_ref()).map(|(ours, theirs)| shift::measure_shift(ours, theirs));
    let true_relief = TrueRelief::read(&truth_folder)?;
    let truth_from_ours = relief::truth_from_ours(&ours, &truth);
    let true_wall = TrueWall {
        survey: &survey,
        profile: survey.config.profile.build()?,
        poses: &truth,
        relief: true_relief.as_ref(),
    };
    let coverage = match &panorama {
        Some(panorama) => {
            let ours_from_truth = truth_from_ours.map_or_else(Isometry3::identity, |found| found.inverse());
            Some(coverage::measure_coverage(&true_wall, panorama, &ours_from_truth)?)
        }
        None => None,
    };
    let relief = match (&true_relief, truth_from_ours) {
        (Some(relief), Some(truth_from_ours)) if out.join("surface/surface.json").is_file() => {
            relief::measure_relief(&SurfaceStore::open(out)?, &true_wall, relief, &truth_from_ours)?
        }
        _ => None,
    };
    Ok(Evaluation {
        survey: survey_folder.to_owned(),
        out: out.to_owned(),
        poses,
        panorama: shift,
        coverage,
        relief,
        notes,
    })
}

/// The true poses of the survey's photos, under the survey's names. A double shot has a truth too, but may be no photo of the
/// survey.
fn of_survey(truth: Vec<PhotoPose>, survey: &Survey, notes: &mut Vec<String>) -> Vec<PhotoPose> {
    let names = Names::of(survey.photos.iter().map(|photo| (photo.name.as_str(), photo)));
    let (mut found, mut others) = (Vec::new(), Vec::new());
    for pose in truth {
        match names.find(&pose.photo) {
            Some(photo) => found.push(PhotoPose { photo: photo.name.clone(), ..pose }),
            None => others.push(pose.photo),
        }
    }
    if !others.is_empty() {
        notes.push(format!("no photos of the survey, so not compared: {}", others.join(", ")));
    }
    found
}
