//! Why something cannot be exported.

use std::io;
use std::path::{Path, PathBuf};

use crate::model::ModelError;
use crate::model::colmap::ColmapError;
use crate::texture::TextureError;

/// Failure of an export.
#[derive(Debug, thiserror::Error)]
pub enum ExportError {
    /// A stage has not left what the format is made from.
    #[error("{} is missing: run `adit reconstruct SURVEY --out {}` as far as stage {stage} first", path.display(), out.display())]
    Missing {
        /// The file.
        path: PathBuf,
        /// The reconstruction's folder.
        out: PathBuf,
        /// The stage that leaves it.
        stage: &'static str,
    },
    /// A stage's result cannot be understood.
    #[error(
        "{} is damaged or was made by another version of adit: run `adit reconstruct SURVEY --out {}` again",
        path.display(),
        out.display()
    )]
    Damaged {
        /// The file.
        path: PathBuf,
        /// The reconstruction's folder.
        out: PathBuf,
    },
    /// Something is there already.
    #[error("{} is there already; choose another folder with --out, or replace it with --force", path.display())]
    Exists {
        /// What is there.
        path: PathBuf,
    },
    /// A file or folder cannot be read or written.
    #[error("{}: {source}", path.display())]
    Io {
        /// The file or folder.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// The panorama or a mesh.
    #[error(transparent)]
    Model(#[from] ModelError),
    /// COLMAP's model.
    #[error("{0}: {source}", source = .0.source)]
    Colmap(#[from] ColmapError),
    /// A tile of the panorama.
    #[error(transparent)]
    Texture(#[from] TextureError),
    /// The TIFF file.
    #[error("{}: {source}", path.display())]
    Tiff {
        /// The file.
        path: PathBuf,
        /// What the encoder said.
        source: tiff::TiffError,
    },
    /// A tile of the TIFF file.
    #[error("{}: {source}", path.display())]
    Jpeg {
        /// The file.
        path: PathBuf,
        /// What the encoder said.
        source: jpeg_encoder::EncodingError,
    },
    /// The LAZ file.
    #[error("{}: {source}", path.display())]
    Las {
        /// The file.
        path: PathBuf,
        /// What the encoder said.
        source: las::Error,
    },
    /// The E57 file.
    #[error("{}: {source}", path.display())]
    E57 {
        /// The file.
        path: PathBuf,
        /// What the encoder said; its own source says why.
        source: e57::Error,
    },
}

/// Attaches the path to an I/O error.
pub(super) fn at_path(path: &Path) -> impl FnOnce(io::Error) -> ExportError + '_ {
    move |source| ExportError::Io { path: path.to_owned(), source }
}
