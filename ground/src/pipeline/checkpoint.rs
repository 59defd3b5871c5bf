//! What a stage leaves on disk, so that a killed run goes on where it was.
//!
//! A stage's result is one file, written beside its final name and renamed, so it is whole or absent. It starts with a key:
//! a digest of everything it was made from (survey files, options, program version, the previous stage's key). Another key
//! means another input, and the stage runs again.

use std::fs;
use std::io::{ErrorKind, Write};
use std::path::{Path, PathBuf};
use std::thread::{self, JoinHandle};

use anyhow::{Context, Result, anyhow};
use serde::Serialize;
use serde::de::DeserializeOwned;
use sha2::{Digest, Sha256};

use crate::files::WholeFile;
use crate::survey::Survey;

/// Digest of everything that a stage's result depends on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Key([u8; 32]);

impl Key {
    /// The key of a survey: its configuration and tags by content, photos and masks by name, size and time of change.
    ///
    /// # Errors
    /// If a file of the survey cannot be read.
    pub fn of_survey(survey: &Survey) -> Result<Self> {
        let mut digest = Sha256::new();
        digest.update(env!("CARGO_PKG_VERSION"));
        for name in ["survey.toml", "tags.csv"] {
            let path = survey.folder.join(name);
            // Photos alone, without tags.csv, are a survey too.
            let content = match fs::read(&path) {
                Err(error) if error.kind() == ErrorKind::NotFound && name == "tags.csv" => Vec::new(),
                read => read.with_context(|| format!("cannot read {}", path.display()))?,
            };
            digest.update((content.len() as u64).to_le_bytes());
            digest.update(&content);
        }
        for photo in &survey.photos {
            for path in std::iter::once(&photo.path).chain(&photo.mask) {
                let about = fs::metadata(path).with_context(|| format!("cannot read {}", path.display()))?;
                let changed = about.modified().ok().and_then(|time| time.duration_since(std::time::UNIX_EPOCH).ok());
                digest.update(photo.name.as_bytes());
                digest.update(about.len().to_le_bytes());
                digest.update(changed.unwrap_or_default().as_nanos().to_le_bytes());
            }
        }
        Ok(Self(digest.finalize().into()))
    }

    /// The key of a stage that follows on this one with these options.
    ///
    /// # Errors
    /// If the options cannot be serialised.
    pub fn then(self, stage: &str, options: &impl Serialize) -> Result<Self> {
        let mut digest = Sha256::new();
        digest.update(self.0);
        digest.update(stage);
        digest.update(serde_json::to_vec(options)?);
        Ok(Self(digest.finalize().into()))
    }
}

/// The folder of all stages' results.
#[derive(Debug)]
pub struct Checkpoints {
    out: PathBuf,
    /// Waits for the disk while the next stage works.
    storing: Option<JoinHandle<Result<()>>>,
}

impl Checkpoints {
    /// Opens (or makes) `out/stages`; `fresh` forgets what is there.
    ///
    /// # Errors
    /// If the folder cannot be made or emptied.
    pub fn open(out: &Path, fresh: bool) -> Result<Self> {
        let folder = out.join("stages");
        if fresh && folder.exists() {
            fs::remove_dir_all(&folder).with_context(|| format!("cannot empty {}", folder.display()))?;
        }
        fs::create_dir_all(&folder)
            .with_context(|| format!("cannot write results to {}; choose another folder with --out", out.display()))?;
        Ok(Self { out: out.to_owned(), storing: None })
    }

    /// Returns a stage's result if it was made from the same input. A damaged file counts as absent.
    pub fn load<T: DeserializeOwned>(&self, stage: &str, key: Key) -> Option<T> {
        let content = fs::read(self.path(stage)).ok()?;
        content.starts_with(&key.0).then(|| Self::decode(&content))?
    }

    /// The file of a stage's result below a reconstruction's folder.
    pub fn file(out: &Path, stage: &str) -> PathBuf {
        out.join("stages").join(format!("{stage}.bin"))
    }

    /// Returns the result in the content of a stage's file, whatever it was made from; `None` if it is not one.
    pub fn decode<T: DeserializeOwned>(content: &[u8]) -> Option<T> {
        let (_, body) = content.split_first_chunk::<32>()?;
        let (result, rest) = postcard::take_from_bytes(body).ok()?;
        rest.is_empty().then_some(result)
    }

    /// Stores a stage's result: written at the return, in its place after [`Self::finish`].
    ///
    /// # Errors
    /// If it, or the one before, cannot be written (a full disk, a read-only folder); what was there before is kept.
    pub fn store<T: Serialize>(&mut self, stage: &str, key: Key, result: &T) -> Result<()> {
        self.finish()?;
        let path = self.path(stage);
        let failed = format!("cannot write {}", path.display());
        let mut file = WholeFile::create(&path).context(failed.clone())?;
        file.content.write_all(&key.0).context(failed.clone())?;
        postcard::to_io(result, &mut file.content).context(failed.clone())?;
        // A full disk is told now, not after the next stage's work.
        file.content.flush().context(failed.clone())?;
        self.storing = Some(thread::spawn(move || file.finish().context(failed)));
        Ok(())
    }

    /// Waits until what was stored is in its place.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn finish(&mut self) -> Result<()> {
        let stored = self.storing.take().map(JoinHandle::join);
        stored.unwrap_or(Ok(Ok(()))).map_err(|_| anyhow!("storing a stage's result panicked"))?
    }

    fn path(&self, stage: &str) -> PathBuf {
        Self::file(&self.out, stage)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn key(seed: u8) -> Key {
        Key([seed; 32])
    }

    #[test]
    fn a_result_comes_back_only_under_its_own_key() {
        let folder = tempfile::tempdir().unwrap();
        let mut checkpoints = Checkpoints::open(folder.path(), false).unwrap();
        checkpoints.store("prior", key(1), &vec![1.5, 2.5]).unwrap();
        checkpoints.finish().unwrap();
        assert_eq!(checkpoints.load::<Vec<f64>>("prior", key(1)), Some(vec![1.5, 2.5]));
        assert_eq!(checkpoints.load::<Vec<f64>>("prior", key(2)), None);
        assert_eq!(checkpoints.load::<Vec<f64>>("match", key(1)), None);
    }

    #[test]
    fn a_file_torn_at_any_byte_counts_as_absent() {
        let folder = tempfile::tempdir().unwrap();
        let mut checkpoints = Checkpoints::open(folder.path(), false).unwrap();
        checkpoints.store("prior", key(1), &(7_u32, vec![1.5, 2.5, 3.5])).unwrap();
        checkpoints.finish().unwrap();
        let path = folder.path().join("stages/prior.bin");
        let whole = fs::read(&path).unwrap();
        for length in 0..whole.len() {
            fs::write(&path, &whole[..length]).unwrap();
            assert_eq!(checkpoints.load::<(u32, Vec<f64>)>("prior", key(1)), None, "torn at {length}");
        }
    }

    #[test]
    fn an_output_folder_that_cannot_be_made_is_named() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("file");
        fs::write(&file, "").unwrap();
        let error = Checkpoints::open(&file.join("out"), false).unwrap_err();
        assert!(format!("{error:#}").contains("file/out"), "{error:#}");
    }

    #[test]
    fn keys_differ_with_stage_and_options() {
        let first = key(0).then("match", &1).unwrap();
        assert_ne!(first, key(0).then("match", &2).unwrap());
        assert_ne!(first, key(0).then("adjust", &1).unwrap());
        assert_eq!(first, key(0).then("match", &1).unwrap());
    }
}
