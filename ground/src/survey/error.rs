//! What can be wrong with a survey folder. Every message names the file, what was found and what was expected.

use std::fmt;
use std::io;
use std::path::PathBuf;

/// Width and height of an image.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Size {
    /// Columns.
    pub width_px: u32,
    /// Rows.
    pub height_px: u32,
}

impl fmt::Display for Size {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(out, "{} x {} pixels", self.width_px, self.height_px)
    }
}

/// Why a survey folder cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum SurveyError {
    /// A file or folder cannot be read.
    #[error("{}: cannot be read", path.display())]
    Io {
        /// The file or folder.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// survey.toml is wrong.
    #[error("{}", path.display())]
    Config {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        source: adit_protocol::mission::MissionError,
    },
    /// tags.csv is wrong.
    #[error(transparent)]
    Tags(#[from] TagsError),
    /// No row of tags.csv names a photo.
    #[error(
        "{}: no row names a photo (column `photo` is empty in all {rows} rows); `adit ingest` pairs captures with photos",
        path.display()
    )]
    NotIngested {
        /// tags.csv.
        path: PathBuf,
        /// Its number of rows.
        rows: usize,
    },
    /// There is neither tags.csv nor a photo.
    #[error("{}: no JPEG below it, and no tags.csv that would name one", folder.display())]
    NoPhotos {
        /// The folder `photos/`.
        folder: PathBuf,
    },
    /// Not a single photo can be used.
    #[error("{}: none of the {tags} photos can be used; the first: {first_what}: {first_why}", folder.display())]
    NoUsablePhoto {
        /// The folder `photos/`.
        folder: PathBuf,
        /// Photos that tags.csv names, or that are there.
        tags: usize,
        /// The first loss.
        first_what: String,
        /// Its reason.
        first_why: String,
    },
    /// A photo's size contradicts survey.toml.
    #[error("{}: the photo is {found}, survey.toml says {expected} ([camera] width_px, height_px)", path.display())]
    PhotoSize {
        /// The photo.
        path: PathBuf,
        /// Its size.
        found: Size,
        /// The size in survey.toml.
        expected: Size,
    },
    /// A mask is wrong.
    #[error(transparent)]
    Mask(#[from] MaskError),
}

/// Why tags.csv cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum TagsError {
    /// The file cannot be read.
    #[error("{}: cannot be read", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// Nothing in it.
    #[error("{}: no captures in it; expected a header line and one row per capture", path.display())]
    Empty {
        /// The file.
        path: PathBuf,
    },
    /// One or more lines are wrong.
    #[error("{} line(s) of {} are wrong:{}", faults.len(), path.display(), list(faults, path))]
    Faults {
        /// The file.
        path: PathBuf,
        /// Every fault found, in order of the lines.
        faults: Vec<TagFault>,
    },
}

/// One wrong cell of tags.csv.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct TagFault {
    /// Line in the file, from 1.
    pub line: u64,
    /// Column heading.
    pub column: &'static str,
    /// What stands there.
    pub found: String,
    /// What should.
    pub expected: &'static str,
}

/// More faults than this are counted, not listed.
const LISTED_FAULTS: usize = 20;

fn list(faults: &[TagFault], path: &std::path::Path) -> String {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let line = |f: &TagFault| {
        format!("\n  {name}:{}: column `{}`: found `{}`, expected {}", f.line, f.column, f.found, f.expected)
    };
    let mut lines: Vec<String> = faults.iter().take(LISTED_FAULTS).map(line).collect();
    if faults.len() > LISTED_FAULTS {
        lines.push(format!("\n  and {} more", faults.len() - LISTED_FAULTS));
    }
    lines.concat()
}

/// Why a photo cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum PhotoError {
    /// The file cannot be read.
    #[error("{}: {}", path.display(), self.reason())]
    Io {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// Not a JPEG.
    #[error("{}: {}", path.display(), self.reason())]
    NotJpeg {
        /// The file.
        path: PathBuf,
        /// Its first bytes.
        found: Vec<u8>,
    },
    /// The file ends before its picture does.
    #[error("{}: {}", path.display(), self.reason())]
    Truncated {
        /// The file.
        path: PathBuf,
        /// Its length.
        length_bytes: u64,
    },
    /// The picture inside is damaged.
    #[error("{}: {}", path.display(), self.reason())]
    Damaged {
        /// The file.
        path: PathBuf,
        /// What the decoder said.
        reason: String,
    },
    /// The size contradicts survey.toml.
    #[error("{}: {}", path.display(), self.reason())]
    WrongSize {
        /// The file.
        path: PathBuf,
        /// Its size.
        found: Size,
        /// The size in survey.toml.
        expected: Size,
    },
}

impl PhotoError {
    /// Returns the reason without the path, for a report line that names the photo itself.
    pub fn reason(&self) -> String {
        match self {
            Self::Io { source, .. } => format!("cannot be read: {source}"),
            Self::NotJpeg { found, .. } => format!("not a JPEG (starts with {found:02x?}, expected ff d8)"),
            Self::Truncated { length_bytes, .. } => {
                format!("truncated: the file ends after {length_bytes} bytes without an end-of-image marker")
            }
            Self::Damaged { reason, .. } => format!("damaged JPEG: {reason}"),
            Self::WrongSize { found, expected, .. } => {
                format!("the photo is {found}, survey.toml says {expected} ([camera] width_px, height_px)")
            }
        }
    }
}

/// Why a mask cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum MaskError {
    /// The file cannot be read.
    #[error("{}: cannot be read", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// Not a PNG, or a damaged one.
    #[error("{}: cannot be decoded as PNG", path.display())]
    NotPng {
        /// The file.
        path: PathBuf,
        /// What the decoder said.
        source: png::DecodingError,
    },
    /// The mask's size is not the photos'.
    #[error("{}: the mask is {found}, the photos are {expected} (survey.toml)", path.display())]
    WrongSize {
        /// The file.
        path: PathBuf,
        /// Its size.
        found: Size,
        /// The photos' size.
        expected: Size,
    },
}
