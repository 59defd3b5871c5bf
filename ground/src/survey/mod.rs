//! A survey folder in memory: configuration, tags, photos and masks, checked.
//!
//! [`load()`] reads everything but the pixels. What makes the survey unusable is an error; a single photo or tag that
//! cannot be used is a named [`Loss`] and the rest goes on. Pixels come from [`decode_rgb`], [`decode_luma`] and
//! [`load_mask`], one photo at a time.

mod error;
mod jpeg;
mod load;
mod masks;
mod photos;
mod tags;

use std::path::PathBuf;

use adit_protocol::mission::SurveyConfig;
use adit_protocol::tag::CaptureTag;

pub use error::{MaskError, PhotoError, Size, SurveyError, TagFault, TagsError};
pub use jpeg::{decode_grey, decode_luma, decode_rgb, probe};
pub use load::load;
pub use masks::load_mask;
pub use photos::{FoundPhoto, find_photos};
pub use tags::{TagColumn, TagRow, read_tags, write_tags};

/// One photo, with the tag that belongs to it if there is one.
#[derive(Clone, Debug, PartialEq)]
pub struct Photo {
    /// File name as in `photos/`, the photo's identity in every output (folders joined by `/`).
    pub name: String,
    /// Path to the JPEG.
    pub path: PathBuf,
    /// Path of its mask, if there is one.
    pub mask: Option<PathBuf>,
    /// Its tag, with angles and lengths as tags.csv gave them, in SI; `None` if no row names the photo.
    pub tag: Option<CaptureTag>,
}

/// A loaded survey folder.
#[derive(Clone, Debug)]
pub struct Survey {
    /// The folder.
    pub folder: PathBuf,
    /// Content of survey.toml.
    pub config: SurveyConfig,
    /// Photos in order of capture: those that have a tag, and those without one that were taken between two that have.
    pub photos: Vec<Photo>,
    /// What was left out and why; each ends up in the report.
    pub losses: Vec<Loss>,
}

/// Something of the survey that could not be used.
#[derive(Clone, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct Loss {
    /// File, or file and line.
    pub what: String,
    /// Reason.
    pub why: String,
}

impl Loss {
    /// Returns a loss with the given file (or file and line) and reason.
    pub fn new(what: impl Into<String>, why: impl Into<String>) -> Self {
        Self { what: what.into(), why: why.into() }
    }
}
