//! Why a surface cannot be measured or read.

use std::io;
use std::path::{Path, PathBuf};

/// Failure of the surface stage. A single bad photo is not one: it is named in the report's losses.
#[derive(Debug, thiserror::Error)]
pub enum SurfaceError {
    /// A file of the output cannot be written or read back.
    #[error("{}: {source}", path.display())]
    Io {
        /// The file or folder.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// surface.json cannot be written or read.
    #[error("{}: {source}", path.display())]
    Json {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        source: serde_json::Error,
    },
    /// A TIFF cannot be written.
    #[error("{}: {source}", path.display())]
    Tiff {
        /// The file.
        path: PathBuf,
        /// What the encoder said.
        source: tiff::TiffError,
    },
    /// The heights are not as long as surface.json says.
    #[error("{}: {found} bytes, expected {expected}: written by another run, or cut off", path.display())]
    Length {
        /// The file.
        path: PathBuf,
        /// Bytes there.
        found: u64,
        /// Bytes that there should be.
        expected: u64,
    },
    /// The picture of the relief cannot be written.
    #[error(transparent)]
    Picture(#[from] crate::texture::TextureError),
    /// The section of the reconstruction is not a profile.
    #[error("the reconstruction's section: {0}")]
    Profile(#[from] adit_geometry::profile::ProfileError),
    /// Not one photo with an adjusted pose looks at the wall.
    #[error("none of the {photos} photos has an adjusted pose that sees the wall")]
    NothingSeen {
        /// How many photos there are.
        photos: usize,
    },
}

/// Attaches the path to an I/O error.
pub(super) fn at_path(path: &Path) -> impl FnOnce(io::Error) -> SurfaceError + '_ {
    move |source| SurfaceError::Io { path: path.to_owned(), source }
}
