//! Board logs as captures in one row, with what the log says about each one's photo.

use std::collections::HashMap;
use std::fs;
use std::path::{Path, PathBuf};

use adit_protocol::log::{FlightLog, Session};
use adit_protocol::mission::Mission;
use adit_protocol::parameters::CaptureWiring;
use adit_protocol::record::{EventKind, MissReason};
use adit_protocol::tag::{CaptureState, CaptureTag};

use super::IngestError;
use super::align::Shot;
use super::pairing::Capture;
use crate::survey::Loss;

/// All captures of a flight's logs.
pub(super) struct Flight {
    /// In order of capture, numbered without repeats.
    pub(super) tags: Vec<CaptureTag>,
    /// The same for pairing.
    pub(super) captures: Vec<Capture>,
    /// What is damaged or contradictory in the logs, and what the user should know about them.
    pub(super) notes: Vec<Loss>,
}

/// A camera forgets or repeats a shot about this often, before the photos have told.
const MISSED_SHARE: f64 = 0.02;
const ECHO_SHARE: f64 = 0.01;

/// Reads logs in the order given. Each run of the board is a session with a clock of its own.
pub(super) fn read_logs(paths: &[PathBuf], mission: &Mission) -> Result<Flight, IngestError> {
    let mut flight = Flight { tags: Vec::new(), captures: Vec::new(), notes: Vec::new() };
    let mut session_number = 0;
    for path in paths {
        let bytes = fs::read(path).map_err(|source| IngestError::Log { path: path.clone(), source })?;
        let log = FlightLog::from_bytes(&bytes);
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        flight.notes.extend(log.damage.iter().map(|damage| Loss::new(name.as_ref(), damage.to_string())));
        flight.notes.extend(log.conflicts.iter().map(|conflict| Loss::new(name.as_ref(), conflict.to_string())));
        for session in log.sessions.iter().filter(|session| !session.tags.is_empty()) {
            flight.add(session, session_number, &name, mission);
            session_number += 1;
        }
    }
    if flight.tags.is_empty() {
        return Err(no_captures(paths, &flight.notes));
    }
    Ok(flight)
}

fn no_captures(paths: &[PathBuf], notes: &[Loss]) -> IngestError {
    let path = paths.first().map_or_else(PathBuf::new, Clone::clone);
    match notes.first() {
        Some(first) => IngestError::DamagedLog { path, faults: notes.len(), first: first.why.clone() },
        None => IngestError::EmptyLog { path },
    }
}

impl Flight {
    fn add(&mut self, session: &Session, number: usize, log: &str, mission: &Mission) {
        let base = self.tags.iter().map(|tag| tag.capture).max().unwrap_or(0);
        let repeats = session.tags.first().is_some_and(|tag| tag.capture <= base);
        if number > 0 {
            let renumbered = if repeats { format!("; its captures count on from {}", base + 1) } else { String::new() };
            self.notes.push(Loss::new(log, format!("the board restarted: run {} begins{renumbered}", number + 1)));
        }
        match &session.header {
            None => self.notes.push(Loss::new(log, "the start of the log is lost, and with it the board's parameters")),
            Some(header) if header.parameters != mission.parameters() => self.notes.push(Loss::new(
                log,
                "the board flew with other parameters than the mission file says; is it the right mission file?",
            )),
            Some(_) => {}
        }
        let shares = Shares::of(session);
        for tag in &session.tags {
            let shot = Shot {
                time_s: tag.time_us as f64 * 1e-6,
                photo_share: shares.photo(tag),
                echo_share: shares.echo(tag),
            };
            self.captures.push(Capture { shot, session: number });
            let capture = if repeats { base + tag.capture } else { tag.capture };
            self.tags.push(CaptureTag { capture, ..*tag });
        }
    }
}

/// What a session's log says about the photos of its captures.
struct Shares {
    wiring: CaptureWiring,
    missed: HashMap<u32, MissReason>,
    surplus_after: HashMap<u32, u32>,
}

impl Shares {
    fn of(session: &Session) -> Self {
        let wiring = session.header.as_ref().map_or(CaptureWiring::None, |header| header.parameters.shutter.wiring);
        let mut shares = Self { wiring, missed: HashMap::new(), surplus_after: HashMap::new() };
        for event in &session.events {
            match event.kind {
                EventKind::Missed { capture, reason, .. } => {
                    shares.missed.insert(capture, reason);
                }
                EventKind::SurplusPhotos { count, after_capture } => {
                    *shares.surplus_after.entry(after_capture).or_default() += count;
                }
                _ => {}
            }
        }
        shares
    }

    /// Probability that the capture has a photo.
    fn photo(&self, tag: &CaptureTag) -> f64 {
        let missed = self.missed.get(&tag.capture);
        match (tag.state, self.wiring, missed) {
            (CaptureState::Confirmed, ..) => 0.999,
            (_, _, Some(MissReason::NeverBusy)) => 0.03,
            (_, _, Some(MissReason::NeverConfirmed)) => 0.1,
            (_, _, Some(MissReason::Abandoned)) | (CaptureState::Busy, CaptureWiring::Confirm, None) => 0.5,
            (CaptureState::Commanded, CaptureWiring::Busy | CaptureWiring::Confirm, None) => 0.3,
            (CaptureState::Busy, ..) => 0.99,
            (CaptureState::Commanded, CaptureWiring::None, None) => 1.0 - MISSED_SHARE,
        }
    }

    /// Probability that the camera took a second photo after this capture.
    fn echo(&self, tag: &CaptureTag) -> f64 {
        if self.surplus_after.contains_key(&tag.capture) {
            0.6
        } else if self.wiring == CaptureWiring::Confirm {
            ECHO_SHARE / 10.0
        } else {
            ECHO_SHARE
        }
    }
}

/// The copy of a log inside the survey.
pub(super) fn log_names(paths: &[PathBuf]) -> Vec<(PathBuf, String)> {
    let name = |path: &Path| path.file_name().unwrap_or_default().to_string_lossy().into_owned();
    paths
        .iter()
        .enumerate()
        .map(|(i, path)| {
            let taken = paths[..i].iter().any(|earlier| name(earlier) == name(path));
            (path.clone(), if taken { format!("{}-{}", i + 1, name(path)) } else { name(path) })
        })
        .collect()
}
