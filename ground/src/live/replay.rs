//! A record, message by message: `.tlog`, ours or another ground station's.

use std::fs::File;
use std::io::{self, BufReader, Read};
use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime};

use adit_protocol::mavlink::{FrameDecoder, Incoming};

use crate::link::{Heard, Trust};

/// Bytes of a frame besides its payload: MAVLink 1, MAVLink 2, and what a signature adds.
const FRAME_1: usize = 8;
const FRAME_2: usize = 12;
const SIGNATURE: usize = 13;
/// A longer silence is shown as one of this length: a clock that was set meanwhile is not waited for.
const LONGEST_SILENCE: Duration = Duration::from_secs(30);

/// Why a record cannot be shown.
#[derive(Debug, thiserror::Error)]
pub enum ReplayError {
    /// The file cannot be read.
    #[error("{}: cannot be read", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// It is no record.
    #[error("{}: no .tlog: no MAVLink frame behind a time, 8 bytes, at its beginning", path.display())]
    NoRecord {
        /// The file.
        path: PathBuf,
    },
}

/// A record that is being read.
#[derive(Debug)]
pub struct Replay<R = BufReader<File>> {
    path: PathBuf,
    input: R,
    /// The time of the entry before, as the file has it, and as it is shown.
    before_us: Option<u64>,
    lasted: Duration,
}

impl Replay {
    /// Opens a record.
    ///
    /// # Errors
    /// [`ReplayError::Read`], and [`ReplayError::NoRecord`] where the first entry is none.
    pub fn open(path: &Path) -> Result<Self, ReplayError> {
        let failed = |source| ReplayError::Read { path: path.to_owned(), source };
        let mut head = [0; 9];
        let mut file = File::open(path).map_err(failed)?;
        let is_record = match file.read_exact(&mut head) {
            Ok(()) => matches!(head[8], 0xFD | 0xFE),
            Err(error) if error.kind() == io::ErrorKind::UnexpectedEof => false,
            Err(error) => return Err(failed(error)),
        };
        if !is_record {
            return Err(ReplayError::NoRecord { path: path.to_owned() });
        }
        let file = File::open(path).map_err(failed)?;
        Ok(Self::new(path, BufReader::new(file)))
    }
}

impl<R: Read> Replay<R> {
    /// Reads from anything; the path is for messages.
    pub fn new(path: &Path, input: R) -> Self {
        Self { path: path.to_owned(), input, before_us: None, lasted: Duration::ZERO }
    }

    /// The file's name.
    pub fn name(&self) -> String {
        self.path.file_name().map_or_else(|| "record".to_owned(), |name| name.to_string_lossy().into_owned())
    }

    /// Time from the first entry to the last that was read.
    pub fn lasted(&self) -> Duration {
        self.lasted
    }

    /// The next frame that is understood, and its time since the first entry; `None` at the end, a torn last entry included.
    ///
    /// # Errors
    /// [`ReplayError::Read`]
    pub fn read(&mut self) -> Result<Option<(Duration, Heard)>, ReplayError> {
        self.entry().map_err(|source| ReplayError::Read { path: self.path.clone(), source })
    }

    fn entry(&mut self) -> io::Result<Option<(Duration, Heard)>> {
        loop {
            let (mut time, mut head) = ([0; 8], [0; 3]);
            if !self.fill(&mut time)? || !self.fill(&mut head)? {
                return Ok(None);
            }
            // What lies between two entries is damage: the next one begins at the next byte that could be a frame's first.
            while !matches!(head, [0xFD | 0xFE, ..]) {
                let mut byte = [0];
                if !self.fill(&mut byte)? {
                    return Ok(None);
                }
                let [_, t1, t2, t3, t4, t5, t6, t7] = time;
                time = [t1, t2, t3, t4, t5, t6, t7, head[0]];
                head = [head[1], head[2], byte[0]];
            }
            let length = match head {
                [0xFE, payload, _] => FRAME_1 + usize::from(payload),
                [_, payload, flags] => FRAME_2 + usize::from(payload) + if flags & 1 == 0 { 0 } else { SIGNATURE },
            };
            let mut frame = vec![0; length];
            frame[..3].copy_from_slice(&head);
            if !self.fill(&mut frame[3..])? {
                return Ok(None);
            }
            let time_us = u64::from_be_bytes(time);
            self.advance(time_us);
            let mut decoder = FrameDecoder::default();
            // A message of another dialect cannot be told from damage, and nobody here has a use for it.
            if let Some(frame) = frame.iter().find_map(|byte| decoder.push(*byte)) {
                let at = SystemTime::UNIX_EPOCH + Duration::from_micros(time_us);
                let incoming = Incoming::read(&frame);
                return Ok(Some((self.lasted, Heard { at, frame, incoming, trust: Trust::Unchecked })));
            }
        }
    }

    fn advance(&mut self, time_us: u64) {
        let before_us = self.before_us.replace(time_us).unwrap_or(time_us);
        self.lasted += Duration::from_micros(time_us.saturating_sub(before_us)).min(LONGEST_SILENCE);
    }

    /// False if the file ends before the buffer is full.
    fn fill(&mut self, buffer: &mut [u8]) -> io::Result<bool> {
        match self.input.read_exact(buffer) {
            Ok(()) => Ok(true),
            Err(error) if error.kind() == io::ErrorKind::UnexpectedEof => Ok(false),
            Err(error) => Err(error),
        }
    }
}

#[cfg(test)]
mod tests {
    use adit_protocol::mavlink::Sender;
    use adit_protocol::record::Mode;

    use super::*;
    use crate::link::Recorder;

    fn record() -> Vec<u8> {
        let (mut sender, mut bytes) = (Sender::new(1, 191), Vec::new());
        let mut recorder = Recorder::new(Path::new("x.tlog"), &mut bytes);
        for time_ms in [1000, 1200, 1100, 9_000_000] {
            let at = SystemTime::UNIX_EPOCH + Duration::from_millis(time_ms);
            recorder.add(at, &sender.heartbeat(Mode::Ready)).unwrap();
        }
        bytes
    }

    fn times_ms(bytes: &[u8]) -> Vec<u128> {
        let mut replay = Replay::new(Path::new("x.tlog"), bytes);
        std::iter::from_fn(|| replay.read().unwrap()).map(|(at, _)| at.as_millis()).collect()
    }

    #[test]
    fn a_record_is_read_as_it_was_written_and_a_clock_that_was_set_is_not_waited_for() {
        assert_eq!(times_ms(&record()), [0, 200, 200, 30_200]);
    }

    #[test]
    fn a_torn_end_loses_the_last_entry_and_damage_between_two_loses_none() {
        let bytes = record();
        assert_eq!(times_ms(&bytes[..bytes.len() - 4]).len(), 3);
        let entry = bytes.len() / 4;
        let damaged = [&bytes[..entry], &[1, 2, 3], &bytes[entry..]].concat();
        assert_eq!(times_ms(&damaged).len(), 4);
    }

    #[test]
    fn what_is_no_record_is_refused_by_name() {
        let folder = tempfile::tempdir().unwrap();
        for (name, content) in [("empty.tlog", &b""[..]), ("photo.jpg", b"\xFF\xD8 no record at all")] {
            let path = folder.path().join(name);
            std::fs::write(&path, content).unwrap();
            assert!(Replay::open(&path).unwrap_err().to_string().contains(name));
        }
    }
}
