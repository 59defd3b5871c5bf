//! Writes a plan's files: figures, page, pictures, and the parameters for the board.

use std::io;
use std::path::{Path, PathBuf};

use adit_protocol::log::{EncodeError, PARAMETERS_FILE, encode_header};
use adit_protocol::parameters::Parameters;
use adit_protocol::record::Header;

use super::{Plan, page};
use crate::link::fingerprint;
use crate::texture::{TextureError, write_png};

/// Name and version of the program, in the file for the board.
const PROGRAM: &str = concat!("adit ", env!("CARGO_PKG_VERSION"));

/// Why the files cannot be written.
#[derive(Debug, thiserror::Error)]
pub enum OutputError {
    /// A folder or file cannot be made.
    #[error("cannot write {}", path.display())]
    Io {
        /// Which.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// The figures cannot be encoded.
    #[error("plan.json")]
    Json(#[from] serde_json::Error),
    /// The parameters are too long for a board.
    #[error("the parameters for the board")]
    Parameters(#[from] EncodeError),
    /// A picture cannot be written.
    #[error("a picture of the plan")]
    Picture(#[from] TextureError),
    /// A picture of the page cannot be encoded.
    #[error("a picture of plan.html")]
    Encoding(#[from] jpeg_encoder::EncodingError),
    /// The page's template fails.
    #[error("the template of plan.html")]
    Template(#[from] minijinja::Error),
}

/// Writes plan.json; plan.html, which shows all of it in one file; where the vehicle may move coverage.png (colours as
/// `adit reconstruct`'s) and pixels.png; and PARAMS.ADT, which the board takes its parameters from when it finds it in its
/// card's root, or by `adit board load`.
///
/// # Errors
/// [`OutputError`] names the file.
pub fn write(plan: &Plan, parameters: &Parameters, out: &Path) -> Result<(), OutputError> {
    std::fs::create_dir_all(out).map_err(|source| OutputError::Io { path: out.to_owned(), source })?;
    save(&out.join("plan.json"), serde_json::to_string_pretty(plan)?)?;
    save(&out.join("plan.html"), page::page(plan, fingerprint(parameters)?)?)?;
    save(&out.join(PARAMETERS_FILE), encode_header(&Header::new(parameters, PROGRAM)?)?)?;
    let pictures =
        [("coverage.png", plan.picture.as_ref()), ("pixels.png", plan.pixel_map.as_ref().map(|map| &map.picture))];
    for (name, picture) in pictures {
        if let Some(picture) = picture {
            write_png(&out.join(name), picture.width, picture.height, &picture.data)?;
        }
    }
    Ok(())
}

fn save(path: &Path, content: impl AsRef<[u8]>) -> Result<(), OutputError> {
    std::fs::write(path, content).map_err(|source| OutputError::Io { path: path.to_owned(), source })
}
