//! `adit ingest`: board logs and a camera's card become a survey folder.
//!
//! Captures and photos are paired by their times' differences: the camera's clock is unknown, runs a little faster or
//! slower, and says whole seconds only; shots are missed, photos are taken that nobody asked for. Every pair gets a
//! probability, every item that stays alone a line in the report. Originals are never touched.

mod align;
mod card;
mod clock;
mod flight;
mod pairing;
mod report;
#[cfg(test)]
mod simulation_tests;
mod write;

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use adit_protocol::mission::{Mission, MissionError};

pub use report::{ClockReport, IngestReport, PairReport};

use crate::survey::TagRow;
use card::CardPhoto;
use flight::Flight;
use pairing::{FoundClock, Pairing};

/// What to ingest.
#[derive(Clone, Debug)]
pub struct IngestOptions {
    /// Board logs, in the order in which they were written.
    pub logs: Vec<PathBuf>,
    /// The camera's card, its DCIM folder, or any folder of photos.
    pub photos: PathBuf,
    /// The mission file that was flown.
    pub mission: PathBuf,
    /// The survey folder to make.
    pub out: PathBuf,
}

/// Why nothing was ingested.
#[derive(Debug, thiserror::Error)]
pub enum IngestError {
    /// A log cannot be read.
    #[error("{}: the board log cannot be read", path.display())]
    Log {
        /// The log.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// A log holds no captures and damage.
    #[error("{}: no captures in it, but {faults} damaged stretch(es); the first: {first}; is this a board log?", path.display())]
    DamagedLog {
        /// The log.
        path: PathBuf,
        /// Number of damaged stretches and contradictions.
        faults: usize,
        /// The first.
        first: String,
    },
    /// A log without captures.
    #[error("{}: no captures in it; the board took no photo in this flight", path.display())]
    EmptyLog {
        /// The log.
        path: PathBuf,
    },
    /// The mission file cannot be read.
    #[error("{}: the mission file cannot be read", path.display())]
    MissionFile {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// The mission file is wrong.
    #[error("{}", path.display())]
    Mission {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        source: MissionError,
    },
    /// The photo folder cannot be read.
    #[error("{}: the photos cannot be listed", path.display())]
    Photos {
        /// The folder.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// No photos.
    #[error("{}: no photo (.jpg, .jpeg) in it or in the folders below", path.display())]
    NoPhotos {
        /// The folder.
        path: PathBuf,
    },
    /// Nothing fits.
    #[error("no photo fits any capture: {captures} captures, {photos} photos; do card and log belong to one flight?")]
    NothingFits {
        /// Number of captures.
        captures: usize,
        /// Number of photos.
        photos: usize,
    },
    /// The output folder holds something else.
    #[error("{}: holds a survey that ingest did not make ({found}); choose another folder with --out", path.display())]
    ForeignSurvey {
        /// The folder.
        path: PathBuf,
        /// What is in the way.
        found: &'static str,
    },
    /// The output folder is the card.
    #[error("{}: the survey cannot be made inside the folder that the photos come from", path.display())]
    OutIsCard {
        /// The folder.
        path: PathBuf,
    },
    /// The output cannot be written.
    #[error("{}: cannot be written", path.display())]
    Write {
        /// The file or folder.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
}

/// Reads the mission file at `path`.
///
/// # Errors
/// [`IngestError::MissionFile`] and [`IngestError::Mission`].
pub fn read_mission(path: &Path) -> Result<Mission, IngestError> {
    let text = fs::read_to_string(path).map_err(|source| IngestError::MissionFile { path: path.to_owned(), source })?;
    Mission::from_toml(&text).map_err(|source| IngestError::Mission { path: path.to_owned(), source })
}

/// Makes a survey folder from logs, photos and the mission; a second run goes on where a first was stopped.
///
/// # Errors
/// [`IngestError`]; what was written before stays, and the survey is complete only when ingest.json is there.
pub fn ingest(options: &IngestOptions) -> Result<IngestReport, IngestError> {
    let mission = read_mission(&options.mission)?;
    let mut flight = flight::read_logs(&options.logs, &mission)?;
    let photos = card::read_card(&options.photos)?;
    write::check_out(&options.out, &options.photos)?;
    let stamps: Vec<_> = photos.iter().map(|photo| photo.stamp).collect();
    let pairing = pairing::pair(&flight.captures, &stamps);
    if pairing.pairs.is_empty() {
        return Err(IngestError::NothingFits { captures: flight.captures.len(), photos: photos.len() });
    }
    join_times(&mut flight, &pairing.clocks);
    let rows = rows(&flight, &photos, &pairing);
    let report = report::report(options, &flight, &photos, &pairing, &rows);
    write::write_survey(options, &mission, &photos, &pairing, &rows, &report)?;
    Ok(report)
}

/// Brings the times of later runs of the board onto the first run's clock, by way of the camera's where it is known.
fn join_times(flight: &mut Flight, clocks: &[FoundClock]) {
    let offset_s = |session: usize| {
        let of_session = clocks.iter().filter(|found| found.session == session);
        of_session.max_by_key(|found| found.pairs).map(|found| found.clock.offset_s)
    };
    let first_s = offset_s(0);
    let mut last_us = 0;
    let mut shift: Option<(usize, i64)> = None;
    for (tag, capture) in flight.tags.iter_mut().zip(&flight.captures) {
        if capture.session > 0 {
            let shift_us = match shift {
                Some((session, shift_us)) if session == capture.session => shift_us,
                _ => {
                    let by_camera = offset_s(capture.session).zip(first_s).map(|(own_s, first_s)| own_s - first_s);
                    let by_camera_us = by_camera.map(|shift_s| (shift_s * 1e6).round() as i64);
                    let earliest = last_us as i64 + 1_000_000 - tag.time_us as i64;
                    by_camera_us.filter(|&shift_us| shift_us >= earliest - 1_000_000).unwrap_or(earliest)
                }
            };
            shift = Some((capture.session, shift_us));
            tag.time_us = tag.time_us.saturating_add_signed(shift_us);
        }
        last_us = tag.time_us;
    }
}

/// One row of tags.csv per capture; the photo's name is that inside the survey.
fn rows(flight: &Flight, photos: &[CardPhoto], pairing: &Pairing) -> Vec<TagRow> {
    let names = write::survey_names(photos, pairing);
    let mut rows: Vec<TagRow> = flight.tags.iter().map(|&tag| TagRow { line: 0, photo: None, tag }).collect();
    for (i, row) in rows.iter_mut().enumerate() {
        row.line = i as u64 + 2;
    }
    for (pair, name) in pairing.pairs.iter().zip(names) {
        if let Some(row) = rows.get_mut(pair.capture) {
            row.photo = Some(name);
        }
    }
    rows
}
