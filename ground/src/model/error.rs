//! Why a model cannot be written.

use std::io;
use std::path::{Path, PathBuf};

use crate::surface::SurfaceError;
use crate::texture::TextureError;

/// Failure of the model stage.
#[derive(Debug, thiserror::Error)]
pub enum ModelError {
    /// A file cannot be written.
    #[error("{}: {source}", path.display())]
    Io {
        /// The file or folder.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// The panorama's tiles cannot be read.
    #[error("the panorama of the texture stage: {0}")]
    Panorama(#[from] TextureError),
    /// The measured wall cannot be read.
    #[error(transparent)]
    Surface(#[from] SurfaceError),
    /// A texture cannot be encoded.
    #[error("texture of {width_px} x {height_px} px: {source}")]
    Jpeg {
        /// Its width.
        width_px: usize,
        /// Its height.
        height_px: usize,
        /// What the encoder said.
        source: jpeg_encoder::EncodingError,
    },
    /// The description of the model cannot be serialised.
    #[error("model.glb: {0}")]
    Json(#[from] serde_json::Error),
    /// GLB's lengths are 32-bit.
    #[error("model.glb would take {bytes} bytes, the format ends at 4 GiB; lower the texture budget")]
    TooLarge {
        /// What it would take.
        bytes: u64,
    },
}

/// Attaches the path to an I/O error.
pub(super) fn at_path(path: &Path) -> impl FnOnce(io::Error) -> ModelError + '_ {
    move |source| ModelError::Io { path: path.to_owned(), source }
}
