//! Why two surveys cannot be compared.

use std::io;
use std::path::{Path, PathBuf};

use crate::surface::SurfaceError;
use crate::texture::TextureError;

/// Why two surveys cannot be compared.
#[derive(Debug, thiserror::Error)]
pub enum ChangeError {
    /// A panorama cannot be read.
    #[error(transparent)]
    Texture(#[from] TextureError),
    /// A measured wall cannot be read.
    #[error(transparent)]
    Surface(#[from] SurfaceError),
    /// The sections differ by more than a reconstruction's scale may.
    #[error("{} is {a_m:.3} m around, {} {b_m:.3} m: these are not surveys of one tunnel", a.display(), b.display())]
    Sections {
        /// The earlier reconstruction.
        a: PathBuf,
        /// Its section's perimeter.
        a_m: f64,
        /// The later one.
        b: PathBuf,
        /// Its section's perimeter.
        b_m: f64,
    },
    /// Nothing of one wall is found in the other.
    #[error(
        "no common wall: the best agreement between {} and {} is {correlation:.2} (at least {least:.2} is expected)",
        a.display(), b.display()
    )]
    NothingCommon {
        /// The earlier reconstruction.
        a: PathBuf,
        /// The later one.
        b: PathBuf,
        /// Normalised correlation of the best place.
        correlation: f64,
        /// What would have been believed.
        least: f64,
    },
    /// A file cannot be written.
    #[error("cannot write {}", path.display())]
    Write {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// A picture cannot be encoded.
    #[error("a picture of the comparison")]
    Picture(#[from] jpeg_encoder::EncodingError),
    /// The figures cannot be encoded.
    #[error("compare.json")]
    Json(#[from] serde_json::Error),
}

/// Names the file that could not be written.
pub(super) fn writing(path: &Path) -> impl FnOnce(io::Error) -> ChangeError {
    let path = path.to_owned();
    move |source| ChangeError::Write { path, source }
}
