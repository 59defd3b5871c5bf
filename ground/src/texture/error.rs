//! Why a panorama cannot be made.

use std::io;
use std::path::{Path, PathBuf};

use crate::surface::SurfaceError;

/// Failure of the texture stage. A single bad photo is not one: it is named in the report's losses.
#[derive(Debug, thiserror::Error)]
pub enum TextureError {
    /// A file or folder of the output cannot be written or read back.
    #[error("{}: {source}", path.display())]
    Io {
        /// The file or folder.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// A PNG cannot be written.
    #[error("{}: {source}", path.display())]
    PngWrite {
        /// The file.
        path: PathBuf,
        /// What the encoder said.
        source: png::EncodingError,
    },
    /// A PNG of an earlier stage cannot be read.
    #[error("{}: {source}", path.display())]
    PngRead {
        /// The file.
        path: PathBuf,
        /// What the decoder said.
        source: png::DecodingError,
    },
    /// A JSON file cannot be written or read.
    #[error("{}: {source}", path.display())]
    Json {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        source: serde_json::Error,
    },
    /// The section of the reconstruction is not a profile.
    #[error("the reconstruction's section: {0}")]
    Profile(#[from] adit_geometry::profile::ProfileError),
    /// The measured wall cannot be read.
    #[error(transparent)]
    Surface(Box<SurfaceError>),
    /// The asked-for resolution makes no sense.
    #[error(
        "mm_per_px is {found}; expected a positive number of at least {least:.3} (the panorama would be {width_px:.0} px wide)"
    )]
    Resolution {
        /// What was asked for.
        found: f64,
        /// The finest possible.
        least: f64,
        /// The width it would give.
        width_px: f64,
    },
    /// Not one photo shows the wall.
    #[error("none of the {photos} photos sees the wall: poses or section must be wrong")]
    NothingSeen {
        /// How many photos there are.
        photos: usize,
    },
}

impl From<SurfaceError> for TextureError {
    fn from(error: SurfaceError) -> Self {
        Self::Surface(Box::new(error))
    }
}

/// Attaches the path to an I/O error.
pub(crate) fn at_path(path: &Path) -> impl FnOnce(io::Error) -> TextureError + '_ {
    move |source| TextureError::Io { path: path.to_owned(), source }
}
