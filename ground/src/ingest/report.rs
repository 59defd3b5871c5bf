//! What ingest tells: pairs, doubts, and a line for everything that stays alone.

use std::fmt;
use std::path::PathBuf;

use adit_protocol::tag::CaptureState;
use serde::Serialize;

use super::IngestOptions;
use super::card::CardPhoto;
use super::flight::Flight;
use super::pairing::Pairing;
use crate::survey::{Loss, TagRow};

/// Pairs below this probability are named.
const SURE: f64 = 0.95;

/// A capture and its photo.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PairReport {
    /// Number of the capture.
    pub capture: u32,
    /// Name of the photo in the survey.
    pub photo: String,
    /// Its name on the card.
    pub on_card: String,
    /// Probability that they belong together.
    pub confidence: f64,
}

/// The camera's clock against the board's.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct ClockReport {
    /// Run of the board, from 1.
    pub run: usize,
    /// Camera time (seconds since 1970) minus board time, in the middle of the run.
    pub offset_s: f64,
    /// How much faster the camera's clock runs.
    pub drift_ppm: f64,
    /// Pairs that say so.
    pub pairs: usize,
}

/// What ingest did; also ingest.json.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct IngestReport {
    /// Version of this file.
    pub format: u32,
    /// The program's version.
    pub version: &'static str,
    /// The survey folder.
    pub survey: PathBuf,
    /// The logs that were read.
    pub logs: Vec<PathBuf>,
    /// Where the photos came from.
    pub card: PathBuf,
    /// The mission file.
    pub mission: PathBuf,
    /// Number of captures in the logs.
    pub captures: usize,
    /// Number of photos on the card.
    pub photos: usize,
    /// Clocks found.
    pub clocks: Vec<ClockReport>,
    /// Every pair, in order of capture.
    pub pairs: Vec<PairReport>,
    /// Pairs that may be wrong.
    pub doubtful: Vec<Loss>,
    /// Captures without photo.
    pub unmatched_captures: Vec<Loss>,
    /// Photos without capture; they stay where they are.
    pub unmatched_photos: Vec<Loss>,
    /// Damage and oddities of logs and photos.
    pub notes: Vec<Loss>,
}

pub(super) fn report(
    options: &IngestOptions,
    flight: &Flight,
    photos: &[CardPhoto],
    pairing: &Pairing,
    rows: &[TagRow],
) -> IngestReport {
    let pairs: Vec<PairReport> = pairing
        .pairs
        .iter()
        .map(|pair| PairReport {
            capture: flight.tags[pair.capture].capture,
            photo: rows[pair.capture].photo.clone().unwrap_or_default(),
            on_card: photos[pair.photo].name.clone(),
            confidence: (pair.confidence * 1e4).round() / 1e4,
        })
        .collect();
    let doubtful = pairs
        .iter()
        .filter(|pair| pair.confidence < SURE)
        .map(|pair| {
            let why = format!("paired with {} by {:.0} %", pair.photo, pair.confidence * 100.0);
            Loss::new(format!("capture {}", pair.capture), why)
        })
        .collect();
    let notes = photos.iter().filter_map(|photo| {
        let reason = photo.no_stamp.as_ref()?;
        Some(Loss::new(&photo.name, format!("{reason}; its place in the order of the card decided")))
    });
    IngestReport {
        format: 1,
        version: env!("CARGO_PKG_VERSION"),
        survey: options.out.clone(),
        logs: options.logs.clone(),
        card: options.photos.clone(),
        mission: options.mission.clone(),
        captures: flight.tags.len(),
        photos: photos.len(),
        clocks: pairing
            .clocks
            .iter()
            .map(|found| ClockReport {
                run: found.session + 1,
                offset_s: found.clock.offset_s,
                drift_ppm: found.clock.drift * 1e6,
                pairs: found.pairs,
            })
            .collect(),
        pairs,
        doubtful,
        unmatched_captures: unmatched_captures(flight, pairing),
        unmatched_photos: unmatched_photos(photos, pairing),
        notes: flight.notes.iter().cloned().chain(notes).collect(),
    }
}

fn unmatched_captures(flight: &Flight, pairing: &Pairing) -> Vec<Loss> {
    let paired: std::collections::HashSet<usize> = pairing.pairs.iter().map(|pair| pair.capture).collect();
    let alone = flight.tags.iter().enumerate().filter(|(i, _)| !paired.contains(i));
    alone
        .map(|(_, tag)| {
            let state = match tag.state {
                CaptureState::Commanded => "commanded, never seen busy",
                CaptureState::Busy => "seen busy, never confirmed",
                CaptureState::Confirmed => "confirmed by the camera, so its photo was lost afterwards",
            };
            let why = format!("no photo at {:.3} s of the board's clock ({state})", tag.time_us as f64 * 1e-6);
            Loss::new(format!("capture {}", tag.capture), why)
        })
        .collect()
}

fn unmatched_photos(photos: &[CardPhoto], pairing: &Pairing) -> Vec<Loss> {
    let paired: std::collections::HashSet<usize> = pairing.pairs.iter().map(|pair| pair.photo).collect();
    let (first, last) =
        pairing.pairs.iter().fold((usize::MAX, 0), |(low, high), pair| (low.min(pair.photo), high.max(pair.photo)));
    let alone = photos.iter().enumerate().filter(|(i, _)| !paired.contains(i));
    alone
        .map(|(i, photo)| {
            let when = if i < first {
                "taken before the first capture"
            } else if i > last {
                "taken after the last capture"
            } else {
                "taken in flight without a command that fits (a double shot, or one by hand)"
            };
            Loss::new(&photo.name, when)
        })
        .collect()
}

impl fmt::Display for IngestReport {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(
            out,
            "paired              {} of {} captures with {} photos",
            self.pairs.len(),
            self.captures,
            self.photos
        )?;
        for clock in &self.clocks {
            writeln!(
                out,
                "clock, run {:<8} camera ahead by {:.2} s, {:+.0} ppm ({} pairs)",
                clock.run, clock.offset_s, clock.drift_ppm, clock.pairs
            )?;
        }
        for (label, losses) in [
            ("doubtful", &self.doubtful),
            ("no photo", &self.unmatched_captures),
            ("no capture", &self.unmatched_photos),
            ("note", &self.notes),
        ] {
            for loss in losses {
                writeln!(out, "{label:<20}{}: {}", loss.what, loss.why)?;
            }
        }
        writeln!(out, "survey              {}", self.survey.display())
    }
}
