//! findings.json on disk: read before, written whole after every change, so that other programs and hands may edit it too.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;

use super::{Finding, Findings, Inspection, Observation, Refused};
use crate::files::write_whole;

/// Version of the file.
pub(super) const FORMAT: u32 = 1;
/// The most findings of one survey.
const MOST_FINDINGS: usize = 10_000;

/// Why findings cannot be read or kept.
#[derive(Debug, thiserror::Error)]
pub enum FindingsError {
    /// The file cannot be read.
    #[error("{}: cannot be read", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// The file cannot be written.
    #[error("{}: cannot be written", path.display())]
    Write {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// Not what we wrote. It is left as it is.
    #[error("{}: not a file of findings; it is left untouched: repair it or move it away", path.display())]
    Json {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        source: serde_json::Error,
    },
    /// A newer program's.
    #[error("{}: format {found}, this program knows {FORMAT}", path.display())]
    Format {
        /// The file.
        path: PathBuf,
        /// Its version.
        found: u32,
    },
    /// The observation cannot be kept.
    #[error(transparent)]
    Refused(#[from] Refused),
    /// No finding has this number.
    #[error("no finding has the number {id}")]
    Unknown {
        /// The number.
        id: u32,
    },
    /// Full.
    #[error("there are {MOST_FINDINGS} findings already, the most that one survey holds")]
    Full,
}

/// The findings beside a reconstruction.
#[derive(Clone, Debug)]
pub struct Store {
    out: PathBuf,
}

impl Store {
    /// The store in the folder `out`; nothing is read yet.
    pub fn new(out: &Path) -> Self {
        Self { out: out.to_owned() }
    }

    fn path(&self) -> PathBuf {
        self.out.join("findings.json")
    }

    /// Reads them; none where there is no file.
    ///
    /// # Errors
    /// If the file is there and cannot be understood.
    pub fn load(&self) -> Result<Findings, FindingsError> {
        let path = self.path();
        let text = match fs::read_to_string(&path) {
            Ok(text) => text,
            Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(Findings::default()),
            Err(source) => return Err(FindingsError::Read { path, source }),
        };
        let findings: Findings = match serde_json::from_str(&text) {
            Ok(findings) => findings,
            Err(source) => return Err(FindingsError::Json { path, source }),
        };
        if findings.format == FORMAT {
            Ok(findings)
        } else {
            Err(FindingsError::Format { path, found: findings.format })
        }
    }

    fn save(&self, findings: &Findings) -> Result<(), FindingsError> {
        let path = self.path();
        let text = match serde_json::to_string_pretty(findings) {
            Ok(text) => text + "\n",
            Err(source) => return Err(FindingsError::Json { path, source }),
        };
        write_whole(&path, text.as_bytes()).map_err(|source| FindingsError::Write { path, source })
    }

    /// Keeps a new finding and returns it with its number. `snapshot`: a JPEG in base64.
    ///
    /// # Errors
    /// If it makes no sense, or the file cannot be read or written.
    pub fn add(&self, observation: Observation, snapshot: Option<&str>) -> Result<Finding, FindingsError> {
        let observation = observation.checked()?;
        let mut findings = self.load()?;
        if findings.findings.len() >= MOST_FINDINGS {
            return Err(FindingsError::Full);
        }
        // A file edited by hand may have lost count.
        let id = findings.findings.iter().map(|finding| finding.id + 1).fold(findings.next_id, u32::max);
        let snapshot = snapshot.map(|picture| self.write_snapshot(id, picture)).transpose()?;
        let finding = Finding { id, observation, snapshot };
        findings.next_id = id + 1;
        findings.findings.push(finding.clone());
        self.save(&findings)?;
        Ok(finding)
    }

    /// Replaces what a finding says; its picture stays.
    ///
    /// # Errors
    /// As [`Self::add`], or if there is none with this number.
    pub fn change(&self, id: u32, observation: Observation) -> Result<Finding, FindingsError> {
        let observation = observation.checked()?;
        let mut findings = self.load()?;
        let finding = findings.findings.iter_mut().find(|finding| finding.id == id);
        let finding = finding.ok_or(FindingsError::Unknown { id })?;
        finding.observation = observation;
        let changed = finding.clone();
        self.save(&findings)?;
        Ok(changed)
    }

    /// Forgets a finding and its picture.
    ///
    /// # Errors
    /// If there is none with this number, or the file cannot be read or written.
    pub fn remove(&self, id: u32) -> Result<(), FindingsError> {
        let mut findings = self.load()?;
        let before = findings.findings.len();
        findings.findings.retain(|finding| finding.id != id);
        if findings.findings.len() == before {
            return Err(FindingsError::Unknown { id });
        }
        self.save(&findings)?;
        let picture = self.out.join(snapshot_name(id));
        match fs::remove_file(&picture) {
            Err(source) if source.kind() != io::ErrorKind::NotFound => {
                Err(FindingsError::Write { path: picture, source })
            }
            _ => Ok(()),
        }
    }

    /// Keeps what is known about the inspection.
    ///
    /// # Errors
    /// If it makes no sense, or the file cannot be read or written.
    pub fn describe(&self, inspection: Inspection) -> Result<(), FindingsError> {
        let inspection = inspection.checked()?;
        let mut findings = self.load()?;
        findings.inspection = inspection;
        self.save(&findings)
    }

    fn write_snapshot(&self, id: u32, base64: &str) -> Result<String, FindingsError> {
        let jpeg = STANDARD.decode(base64).map_err(|_| Refused::Snapshot)?;
        if !jpeg.starts_with(&[0xFF, 0xD8, 0xFF]) {
            return Err(Refused::Snapshot.into());
        }
        let name = snapshot_name(id);
        let path = self.out.join(&name);
        let folder = self.out.join("findings");
        fs::create_dir_all(&folder).map_err(|source| FindingsError::Write { path: folder, source })?;
        write_whole(&path, &jpeg).map_err(|source| FindingsError::Write { path, source })?;
        Ok(name)
    }
}

/// Pictures are named by numbers, never by text from outside.
fn snapshot_name(id: u32) -> String {
    format!("findings/{id:04}.jpg")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::findings::example;

    fn store() -> (tempfile::TempDir, Store) {
        let folder = tempfile::tempdir().unwrap();
        let store = Store::new(folder.path());
        (folder, store)
    }

    #[test]
    fn findings_survive_and_numbers_are_never_given_twice() {
        let (_folder, store) = store();
        assert_eq!(store.load().unwrap(), Findings::default());
        assert_eq!(store.add(example(), None).unwrap().id, 1);
        assert_eq!(store.add(example(), None).unwrap().id, 2);
        store.remove(2).unwrap();
        assert_eq!(store.add(example(), None).unwrap().id, 3);
        let changed = Observation { note: "wider".to_owned(), ..example() };
        store.change(1, changed.clone()).unwrap();
        let ids_and_notes: Vec<_> =
            store.load().unwrap().findings.into_iter().map(|f| (f.id, f.observation.note)).collect();
        assert_eq!(ids_and_notes, [(1, "wider".to_owned()), (3, "hairline".to_owned())]);
        assert!(matches!(store.change(2, changed), Err(FindingsError::Unknown { id: 2 })));
        assert!(matches!(store.remove(2), Err(FindingsError::Unknown { id: 2 })));
    }

    #[test]
    fn a_broken_file_is_never_overwritten() {
        let (folder, store) = store();
        let path = folder.path().join("findings.json");
        fs::write(&path, "{\"format\": 1, \"findings\": [").unwrap();
        assert!(matches!(store.add(example(), None), Err(FindingsError::Json { .. })));
        fs::write(&path, "{\"format\": 9, \"next_id\": 1, \"findings\": []}").unwrap();
        assert!(matches!(store.add(example(), None), Err(FindingsError::Format { found: 9, .. })));
        assert!(fs::read_to_string(&path).unwrap().contains("\"format\": 9"));
    }

    #[test]
    fn a_snapshot_is_kept_beside_and_goes_with_its_finding() {
        let (folder, store) = store();
        let jpeg = STANDARD.encode([0xFF, 0xD8, 0xFF, 0xE0, 1, 2]);
        let finding = store.add(example(), Some(&jpeg)).unwrap();
        let picture = folder.path().join(finding.snapshot.unwrap());
        assert_eq!(fs::read(&picture).unwrap()[4..], [1, 2]);
        store.remove(finding.id).unwrap();
        assert!(!picture.exists());
    }

    #[test]
    fn a_snapshot_that_is_no_jpeg_is_refused_and_nothing_is_kept() {
        let (_folder, store) = store();
        for wrong in ["no base64!", &STANDARD.encode("<svg onload=alert(1)>")] {
            assert!(matches!(store.add(example(), Some(wrong)), Err(FindingsError::Refused(Refused::Snapshot))));
        }
        assert!(store.load().unwrap().findings.is_empty());
    }
}
