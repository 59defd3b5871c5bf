//! A record of every frame, as Mission Planner, MAVProxy and pymavlink read it: `.tlog`.
//!
//! Each frame stands behind the time at which it was heard or sent, 8 bytes, big-endian, microseconds since 1970 (MAVProxy
//! `mavproxy.py`, pymavlink `mavutil.mavlogfile`). Nothing is buffered: a killed session loses no frame.

use std::fs::File;
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::time::SystemTime;

use super::error::LinkError;

/// Writes a record.
#[derive(Debug)]
pub struct Recorder<W = File> {
    path: PathBuf,
    out: W,
    frames: u64,
}

impl Recorder {
    /// Begins a record; a file of that name that has content is kept and not touched.
    ///
    /// # Errors
    /// [`LinkError::Record`].
    pub fn create(path: &Path) -> Result<Self, LinkError> {
        let failed = |source| LinkError::Record { path: path.to_owned(), source };
        if path.metadata().is_ok_and(|file| file.len() > 0) {
            return Err(failed(io::Error::new(io::ErrorKind::AlreadyExists, "there is a record of that name already")));
        }
        Ok(Self::new(path, File::create(path).map_err(failed)?))
    }
}

impl<W: Write> Recorder<W> {
    /// Records to anything; the path is for messages.
    pub fn new(path: &Path, out: W) -> Self {
        Self { path: path.to_owned(), out, frames: 0 }
    }

    /// Frames so far.
    pub fn frames(&self) -> u64 {
        self.frames
    }

    /// Adds a frame.
    ///
    /// # Errors
    /// [`LinkError::Record`]: the disk is full, or gone.
    pub fn add(&mut self, at: SystemTime, frame: &[u8]) -> Result<(), LinkError> {
        let since = at.duration_since(SystemTime::UNIX_EPOCH).unwrap_or_default();
        let time_us = u64::try_from(since.as_micros()).unwrap_or(u64::MAX);
        let entry = [&time_us.to_be_bytes()[..], frame].concat();
        let written = self.out.write_all(&entry).and_then(|()| self.out.flush());
        written.map_err(|source| LinkError::Record { path: self.path.clone(), source })?;
        self.frames += 1;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;

    #[test]
    fn a_frame_stands_behind_its_time() {
        let mut record = Recorder::new(Path::new("x.tlog"), Vec::new());
        record.add(SystemTime::UNIX_EPOCH + Duration::from_micros(0x0102_0304), &[0xFD, 1]).unwrap();
        assert_eq!(record.out, [0, 0, 0, 0, 1, 2, 3, 4, 0xFD, 1]);
        assert_eq!(record.frames(), 1);
    }

    #[test]
    fn a_full_disk_is_an_error_with_the_files_name() {
        let mut disk = [0_u8; 12];
        let mut record = Recorder::new(Path::new("x.tlog"), &mut disk[..]);
        record.add(SystemTime::UNIX_EPOCH, &[1, 2]).unwrap();
        let error = record.add(SystemTime::UNIX_EPOCH, &[1, 2]).unwrap_err();
        assert!(error.to_string().contains("x.tlog"), "{error}");
        assert_eq!(record.frames(), 1);
    }

    #[test]
    fn a_record_that_is_there_is_not_overwritten() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("flight.tlog");
        Recorder::create(&path).unwrap().add(SystemTime::now(), &[7]).unwrap();
        assert!(Recorder::create(&path).is_err());
        assert_eq!(std::fs::read(&path).unwrap().len(), 9);
    }
}
