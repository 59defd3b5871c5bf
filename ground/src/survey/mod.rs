//! A survey folder in memory: configuration, tags, photos and masks, checked.

use std::path::PathBuf;

use adit_protocol::mission::SurveyConfig;
use adit_protocol::tag::CaptureTag;

/// One photo with the tag that belongs to it.
#[derive(Clone, Debug, PartialEq)]
pub struct Photo {
    /// File name as in `photos/`, the photo's identity in every output (folders joined by `/`).
    pub name: String,
    /// Path to the JPEG.
    pub path: PathBuf,
    /// Path of its mask, if there is one.
    pub mask: Option<PathBuf>,
    /// Its tag, with angles and lengths as tags.csv gave them, in SI.
    pub tag: CaptureTag,
}

/// A loaded survey folder.
#[derive(Clone, Debug)]
pub struct Survey {
    /// The folder.
    pub folder: PathBuf,
    /// Content of survey.toml.
    pub config: SurveyConfig,
    /// Photos that have a tag, in order of capture.
    pub photos: Vec<Photo>,
    /// What was left out and why; each ends up in the report.
    pub losses: Vec<Loss>,
}

/// Something of the survey that could not be used.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Loss {
    /// File, or file and line.
    pub what: String,
    /// Reason.
    pub why: String,
}
