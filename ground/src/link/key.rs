//! The key in its file, and beside it what must outlive a session: the last time that was signed, and what was heard.

use std::fs::{self, OpenOptions};
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::time::SystemTime;

use adit_protocol::mavlink::Key;
use adit_protocol::mavlink::signing::{EPOCH_UNIX_S, UNITS_PER_S};
use serde::{Deserialize, Serialize};

use super::trust::Verifier;
use crate::files;

/// A session that is killed may have signed up to this long behind what was kept last.
const LEASE_UNITS: u64 = 15 * UNITS_PER_S;

/// What is wrong with a key's file.
#[derive(Debug, thiserror::Error)]
pub enum KeyError {
    /// It cannot be read or written.
    #[error("{}: {doing}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// What was tried.
        doing: &'static str,
        /// What the system said.
        source: io::Error,
    },
    /// It holds no key.
    #[error(
        "{}: holds no key; expected 64 hexadecimal digits, as `adit board key new` writes them, found {found} characters",
        path.display()
    )]
    NoKey {
        /// The file.
        path: PathBuf,
        /// How many letters there are.
        found: usize,
    },
    /// The operating system gives no random bytes.
    #[error("the operating system gives no random bytes")]
    Random(#[from] getrandom::Error),
}

/// A key with what belongs to it.
#[derive(Debug)]
pub struct KeyFile {
    /// The key.
    pub key: Key,
    path: PathBuf,
    kept: Kept,
}

/// What outlives a session.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
struct Kept {
    /// The last time that may have been signed.
    signed: u64,
    /// What was heard.
    heard: Verifier,
}

impl KeyFile {
    /// Makes a new key. A file that is there is not touched: the key in it may be in a board.
    ///
    /// # Errors
    /// [`KeyError`].
    pub fn create(path: &Path) -> Result<Self, KeyError> {
        let mut bytes = [0; 32];
        getrandom::fill(&mut bytes)?;
        let mut options = OpenOptions::new();
        options.write(true).create_new(true);
        #[cfg(unix)]
        std::os::unix::fs::OpenOptionsExt::mode(&mut options, 0o600);
        let failed = |source| KeyError::Io { path: path.to_owned(), doing: "the key cannot be written", source };
        let mut file = options.open(path).map_err(failed)?;
        writeln!(file, "{}", hexadecimal(&bytes)).and_then(|()| file.sync_all()).map_err(failed)?;
        Ok(Self { key: Key(bytes), path: path.to_owned(), kept: Kept::default() })
    }

    /// Reads a key and what was kept beside it.
    ///
    /// # Errors
    /// [`KeyError`].
    pub fn read(path: &Path) -> Result<Self, KeyError> {
        let text = fs::read_to_string(path).map_err(|source| KeyError::Io {
            path: path.to_owned(),
            doing: "the key cannot be read",
            source,
        })?;
        let digits = text.trim();
        let no_key = || KeyError::NoKey { path: path.to_owned(), found: digits.chars().count() };
        let key = Key(bytes(digits).ok_or_else(no_key)?);
        let kept = match fs::read(state_path(path)) {
            Ok(content) => serde_json::from_slice(&content).map_err(|error| KeyError::Io {
                path: state_path(path),
                doing: "what was kept beside the key cannot be read; remove it if no session runs",
                source: error.into(),
            })?,
            Err(error) if error.kind() == io::ErrorKind::NotFound => Kept::default(),
            Err(source) => {
                return Err(KeyError::Io { path: state_path(path), doing: "cannot be read", source });
            }
        };
        Ok(Self { key, path: path.to_owned(), kept })
    }

    /// The time to sign with now: that of the clock, or the last one kept if the clock was put back.
    pub fn time(&self, now: SystemTime) -> u64 {
        signing_time(now).max(self.kept.signed)
    }

    /// What was heard.
    pub(super) fn heard(&self) -> &Verifier {
        &self.kept.heard
    }

    /// Keeps what was heard, and the last time signed; while a session goes on, with what it may sign before the next keeping.
    /// This session's own time goes on from where it was read.
    ///
    /// # Errors
    /// [`KeyError::Io`].
    pub(super) fn keep(&self, signed: u64, heard: &Verifier, goes_on: bool) -> Result<(), KeyError> {
        let lease = if goes_on { LEASE_UNITS } else { 0 };
        let kept = Kept { signed: signed + lease, heard: heard.clone() };
        let path = state_path(&self.path);
        let written =
            serde_json::to_vec(&kept).map_err(io::Error::from).and_then(|content| files::write_whole(&path, &content));
        written.map_err(|source| KeyError::Io { path, doing: "what is kept beside the key cannot be written", source })
    }
}

/// A moment in the units of a signature.
fn signing_time(at: SystemTime) -> u64 {
    let since = at.duration_since(SystemTime::UNIX_EPOCH).unwrap_or_default();
    let units = since.as_micros() / u128::from(1_000_000 / UNITS_PER_S);
    u64::try_from(units).unwrap_or(u64::MAX).saturating_sub(EPOCH_UNIX_S * UNITS_PER_S)
}

/// `NAME.state` beside the key.
fn state_path(key: &Path) -> PathBuf {
    let mut name = key.file_name().unwrap_or_default().to_owned();
    name.push(".state");
    key.with_file_name(name)
}

fn hexadecimal(bytes: &[u8]) -> String {
    let digits = bytes.iter().flat_map(|byte| [byte >> 4, byte & 0xF]);
    digits.filter_map(|nibble| char::from_digit(u32::from(nibble), 16)).collect()
}

fn bytes(digits: &str) -> Option<[u8; 32]> {
    let nibbles: Option<Vec<u8>> = digits.chars().map(|digit| digit.to_digit(16).map(|nibble| nibble as u8)).collect();
    let nibbles = nibbles.filter(|nibbles| nibbles.len() == 64)?;
    let bytes: Vec<u8> =
        nibbles.chunks_exact(2).map(|pair| pair.iter().fold(0, |byte, half| byte * 16 + half)).collect();
    bytes.try_into().ok()
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;

    #[test]
    fn a_new_key_is_read_as_it_was_made_and_nobody_else_may() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("board.key");
        let made = KeyFile::create(&path).unwrap();
        assert_eq!(KeyFile::read(&path).unwrap().key, made.key);
        assert_ne!(made.key, Key([0; 32]));
        assert!(KeyFile::create(&path).is_err(), "a key that is there is not overwritten");
        #[cfg(unix)]
        {
            use std::os::unix::fs::PermissionsExt;
            assert_eq!(fs::metadata(&path).unwrap().permissions().mode() & 0o777, 0o600);
        }
    }

    #[test]
    fn time_begins_in_2015_and_goes_on_where_it_was_if_the_clock_is_put_back() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("board.key");
        let file = KeyFile::create(&path).unwrap();
        let at = |seconds| SystemTime::UNIX_EPOCH + Duration::from_secs(EPOCH_UNIX_S + seconds);
        assert_eq!(file.time(at(2)), 2 * UNITS_PER_S);
        file.keep(500 * UNITS_PER_S, &Verifier::default(), false).unwrap();
        assert_eq!(file.time(at(2)), 2 * UNITS_PER_S, "the session that goes on is not moved");
        let again = KeyFile::read(&path).unwrap();
        assert_eq!(again.time(at(2)), 500 * UNITS_PER_S);
        assert_eq!(again.time(at(501)), 501 * UNITS_PER_S);
    }

    #[test]
    fn what_a_killed_session_may_have_signed_is_not_signed_again() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("board.key");
        KeyFile::create(&path).unwrap().keep(7, &Verifier::default(), true).unwrap();
        assert!(KeyFile::read(&path).unwrap().time(SystemTime::UNIX_EPOCH) >= 7 + 10 * UNITS_PER_S);
    }

    #[test]
    fn a_file_without_a_key_is_named_with_what_belongs_there() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("board.key");
        for content in ["", "abc", &"g".repeat(64), &"0".repeat(66)] {
            fs::write(&path, content).unwrap();
            let error = KeyFile::read(&path).unwrap_err().to_string();
            assert!(error.contains("board.key") && error.contains("64 hexadecimal"), "{error}");
        }
    }
}
