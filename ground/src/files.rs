//! Writing files so that a kill or a full disk leaves the old content or the new, never half of it.

use std::ffi::OsString;
use std::fs;
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

/// The name under which a file is made before it takes its place.
pub(crate) fn beside(path: &Path) -> PathBuf {
    let mut name = path.file_name().map_or_else(OsString::new, OsString::from);
    name.push(".new");
    path.with_file_name(name)
}

/// Writes a file whole: under another name beside it, flushed, renamed.
pub(crate) fn write_whole(path: &Path, content: &[u8]) -> io::Result<()> {
    let mut file = WholeFile::create(path)?;
    file.content.write_all(content)?;
    file.finish()
}

/// A file that takes its place once it is whole and on the disk.
#[derive(Debug)]
pub(crate) struct WholeFile {
    path: PathBuf,
    /// What will be in it, so far.
    pub(crate) content: BufWriter<fs::File>,
}

impl WholeFile {
    pub(crate) fn create(path: &Path) -> io::Result<Self> {
        Ok(Self { path: path.to_owned(), content: BufWriter::new(fs::File::create(beside(path))?) })
    }

    /// Waits for the disk: up to tenths of a second where it is slow or busy.
    pub(crate) fn finish(self) -> io::Result<()> {
        self.content.into_inner().map_err(io::IntoInnerError::into_error)?.sync_all()?;
        fs::rename(beside(&self.path), &self.path)
    }
}
