//! The board's logs: listed, fetched.
//!
//! A log is written to `NAME.part` without gaps and renamed at its end; a fetch that was cut short goes on where it was, if the
//! board's log begins and goes on as the part does: cards are swapped, and each counts its logs from 1.

use std::collections::BTreeMap;
use std::fs::{self, File, OpenOptions};
use std::io::{self, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use adit_protocol::log::{FlightLog, MAX_FRAME_BYTES};
use adit_protocol::mavlink::{Incoming, LOG_BYTES, Target};
use adit_protocol::record::Header;
use tracing::warn;

use super::error::{LinkError, Question};
use super::log_fetch::{LogEndedEarly, LogFetch};
use super::session::{Dialogue, Session, Step, Turn};
use super::version::Board;

const PIECE: u32 = LOG_BYTES as u32;

/// A log on the board's card.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
pub struct LogEntry {
    /// Its number.
    pub number: u16,
    /// Its length.
    pub bytes: u32,
}

/// How far a fetch is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LogProgress {
    /// Bytes on disk.
    pub bytes: u32,
    /// The log's length.
    pub of: u32,
}

/// The name of a log's file: `ADIT0042.LOG`.
pub fn log_name(number: u16) -> String {
    format!("ADIT{number:04}.LOG")
}

struct ListDialogue {
    whom: Target,
    count: Option<u16>,
    found: BTreeMap<u16, u32>,
}

impl Dialogue for ListDialogue {
    type Answer = ();

    fn turn(&mut self, _attempt: u32) -> Turn<()> {
        let whom = self.whom;
        Turn::Send(vec![Box::new(move |sender| sender.log_list(whom))])
    }

    fn hear(&mut self, incoming: &Incoming) -> Step<()> {
        let Incoming::LogEntry { id, count, bytes, .. } = incoming else { return Step::Nothing };
        if self.count.replace(*count) != Some(*count) {
            self.found.clear();
        }
        if *count == 0 {
            return Step::Done(());
        }
        let is_new = self.found.insert(*id, *bytes).is_none();
        match usize::from(*count) {
            count if self.found.len() >= count => Step::Done(()),
            _ if is_new => Step::Progress,
            _ => Step::Nothing,
        }
    }
}

/// What a fetch ends with.
type Fetched = Result<(), FetchError>;

enum FetchError {
    Ended(LogEndedEarly),
    Write(io::Error),
}

struct FetchDialogue<'p> {
    whom: Target,
    number: u16,
    fetch: LogFetch,
    out: &'p mut (dyn Write + Send),
    progress: &'p mut (dyn FnMut(u32) + Send),
}

impl Dialogue for FetchDialogue<'_> {
    type Answer = Fetched;

    fn turn(&mut self, _attempt: u32) -> Turn<Fetched> {
        let Some((offset, count)) = self.fetch.request() else { return Turn::Done(Ok(())) };
        let (whom, number) = (self.whom, self.number);
        Turn::Send(vec![Box::new(move |sender| sender.log_request(whom, number, offset, count))])
    }

    fn hear(&mut self, incoming: &Incoming) -> Step<Fetched> {
        match self.fetch.hear(incoming) {
            Ok(false) => return Step::Nothing,
            Ok(true) => {}
            Err(ended) => return Step::Done(Err(FetchError::Ended(ended))),
        }
        if let Err(error) = self.out.write_all(&self.fetch.take()) {
            return Step::Done(Err(FetchError::Write(error)));
        }
        (self.progress)(self.fetch.position());
        match self.fetch.is_complete() {
            true => Step::Done(Ok(())),
            false if self.fetch.is_answered() => Step::Ask,
            false => Step::Progress,
        }
    }
}

impl Session {
    /// The logs on the board's card, the oldest first. The board does not answer while it scans.
    ///
    /// # Errors
    /// [`LinkError::NoAnswer`], [`LinkError::Ended`].
    pub async fn logs(&self, board: &Board) -> Result<Vec<LogEntry>, LinkError> {
        let mut dialogue = ListDialogue { whom: board.target, count: None, found: BTreeMap::new() };
        self.lead(board.target, Question::Logs, &mut dialogue).await?;
        Ok(dialogue.found.into_iter().map(|(number, bytes)| LogEntry { number, bytes }).collect())
    }

    /// The header of a log, which holds the parameters that were in force when it began; `None` if it has none.
    ///
    /// # Errors
    /// [`LinkError::NoAnswer`], [`LinkError::Ended`].
    pub async fn log_header(&self, board: &Board, log: LogEntry) -> Result<Option<Header>, LinkError> {
        let until = log.bytes.min(MAX_FRAME_BYTES as u32);
        let mut bytes = Vec::new();
        // A log that is shorter than the list says may hold its header all the same.
        let _ = self.fetch_stretch(board, log.number, [0, until], &mut bytes, &mut |_| ()).await?;
        let whom = board.target;
        self.send(move |sender| sender.log_end(whom)).await?;
        Ok(FlightLog::from_bytes(&bytes).sessions.into_iter().next().and_then(|session| session.header))
    }

    /// Fetches a log into a folder; returns its file. What is there already is not fetched again.
    ///
    /// # Errors
    /// [`LinkError::LogFile`], also if there is another log of that name; [`LinkError::LogEnded`], [`LinkError::NoAnswer`].
    pub async fn fetch_log(
        &self,
        board: &Board,
        log: LogEntry,
        folder: &Path,
        progress: &mut (dyn FnMut(LogProgress) + Send),
    ) -> Result<PathBuf, LinkError> {
        let path = folder.join(log_name(log.number));
        let part = part_path(&path);
        let failed = |path: &Path| {
            let path = path.to_owned();
            move |source| LinkError::LogFile { path, source }
        };
        if path.exists() {
            if !self.begins_like(board, log, &path).await? {
                let other = "there is another log of that name; fetch into another folder";
                return Err(failed(&path)(io::Error::new(io::ErrorKind::AlreadyExists, other)));
            }
            if length(&path) >= u64::from(log.bytes) {
                return Ok(path);
            }
            // It was fetched while the board wrote it.
            fs::rename(&path, &part).map_err(failed(&part))?;
        } else if part.exists() && !self.begins_like(board, log, &part).await? {
            warn!("{}: is of another log, and begun anew", part.display());
            fs::remove_file(&part).map_err(failed(&part))?;
        }
        let (mut file, from) = open_part(&part).map_err(failed(&part))?;
        let mut tell = |bytes| progress(LogProgress { bytes, of: log.bytes });
        tell(from);
        let fetched = self.fetch_stretch(board, log.number, [from, log.bytes], &mut file, &mut tell).await;
        let whom = board.target;
        self.send(move |sender| sender.log_end(whom)).await?;
        fetched?.map_err(|error| match error {
            FetchError::Ended(ended) => ended.into(),
            FetchError::Write(source) => failed(&part)(source),
        })?;
        file.sync_all().map_err(failed(&part))?;
        fs::rename(&part, &path).map_err(failed(&path))?;
        Ok(path)
    }

    async fn fetch_stretch(
        &self,
        board: &Board,
        number: u16,
        [from, until]: [u32; 2],
        out: &mut (dyn Write + Send),
        progress: &mut (dyn FnMut(u32) + Send),
    ) -> Result<Fetched, LinkError> {
        let fetch = LogFetch::new(number, from, until);
        let mut dialogue = FetchDialogue { whom: board.target, number, fetch, out, progress };
        self.lead(board.target, Question::Log(number), &mut dialogue).await
    }

    /// Whether the board's log has the first and the last whole piece of a file.
    async fn begins_like(&self, board: &Board, log: LogEntry, path: &Path) -> Result<bool, LinkError> {
        let failed = |source| LinkError::LogFile { path: path.to_owned(), source };
        let whole = u32::try_from(length(path) / u64::from(PIECE)).unwrap_or(u32::MAX);
        if length(path) > u64::from(log.bytes) {
            return Ok(false);
        }
        for index in [0, whole.saturating_sub(1)].into_iter().take(whole.min(2) as usize) {
            let (from, until) = (index * PIECE, (index + 1) * PIECE);
            let mut there = Vec::new();
            let fetched = self.fetch_stretch(board, log.number, [from, until], &mut there, &mut |_| ()).await?;
            let here = read_piece(path, from).map_err(failed)?;
            if fetched.is_err() || here != there {
                return Ok(false);
            }
        }
        Ok(true)
    }
}

fn part_path(path: &Path) -> PathBuf {
    let mut name = path.file_name().unwrap_or_default().to_owned();
    name.push(".part");
    path.with_file_name(name)
}

fn length(path: &Path) -> u64 {
    path.metadata().map_or(0, |file| file.len())
}

/// Opens what is there of a log, cut to whole pieces, to go on at its end.
fn open_part(path: &Path) -> io::Result<(File, u32)> {
    let mut file = OpenOptions::new().create(true).truncate(false).write(true).open(path)?;
    let length = file.metadata()?.len();
    let whole = length - length % u64::from(PIECE);
    file.set_len(whole)?;
    file.seek(SeekFrom::Start(whole))?;
    Ok((file, u32::try_from(whole).unwrap_or(u32::MAX)))
}

fn read_piece(path: &Path, from: u32) -> io::Result<Vec<u8>> {
    let mut file = File::open(path)?;
    file.seek(SeekFrom::Start(u64::from(from)))?;
    let mut piece = vec![0; LOG_BYTES];
    file.read_exact(&mut piece)?;
    Ok(piece)
}
