//! `adit evaluate`: a reconstruction against the truth of a synthetic survey.

mod align;
mod coverage;
mod drift;
mod poses;
mod relief;
mod shift;
mod table;
mod wall_image;

use std::collections::HashSet;
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
    let coverage = match &panorama {
        Some(panorama) => {
            let profile = survey.config.profile.build()?;
            let ours_from_truth =
                relief::truth_from_ours(&ours, &truth).map_or_else(Isometry3::identity, |m| m.inverse());
            Some(coverage::measure_coverage(&survey, &profile, &truth, panorama, &ours_from_truth)?)
        }
        None => None,
    };
    let relief = relief(&survey, &ours, &truth, out)?;
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

/// The measured wall against the true one, where both are there.
fn relief(
    survey: &Survey,
    ours: &[PhotoPose],
    truth: &[PhotoPose],
    out: &Path,
) -> Result<Option<ReliefEvaluation>, EvaluateError> {
    let measured = out.join("surface/surface.json").is_file();
    let true_relief = TrueRelief::read(&survey.folder.join("truth"))?.filter(|_| measured);
    let (Some(true_relief), Some(truth_from_ours)) = (true_relief, relief::truth_from_ours(ours, truth)) else {
        return Ok(None);
    };
    let nominal = &survey.config.profile;
    let seen = coverage::Seen::by(survey, &nominal.build()?, truth, &true_relief.grid)?;
    let store = SurfaceStore::open(out)?;
    Ok(relief::measure_relief(&store, nominal, &true_relief, &seen, &truth_from_ours)?)
}

/// The true poses of the survey's photos. A double shot has a truth too, but may be no photo of the survey.
fn of_survey(truth: Vec<PhotoPose>, survey: &Survey, notes: &mut Vec<String>) -> Vec<PhotoPose> {
    let named: HashSet<&str> = survey.photos.iter().map(|photo| poses::file_name(&photo.name)).collect();
    let (truth, others): (Vec<_>, Vec<_>) =
        truth.into_iter().partition(|pose| named.contains(poses::file_name(&pose.photo)));
    if !others.is_empty() {
        let names: Vec<&str> = others.iter().map(|pose| pose.photo.as_str()).collect();
        notes.push(format!("no photos of the survey, so not compared: {}", names.join(", ")));
    }
    truth
}
