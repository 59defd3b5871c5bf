//! What an inspector marked on the wall: kind, severity, note, distance, clock positions, a picture.
//!
//! `findings.json` and `findings/NNNN.jpg` lie beside the results in `out/`, so a new reconstruction does not touch them.
//! A place is a stretch `[x_from_m, x_to_m]` of the axis (tunnel frame) and an arc from `clock_from` clockwise (looking
//! forward) to `clock_to`, 12 = 0 = crown: the terms in which findings are reported, which hold when the panorama is made
//! anew at another resolution or the section is refined.

mod export;
mod store;

use serde::{Deserialize, Serialize};

pub use export::{to_csv, to_en13508_xml, to_geojson};
pub use store::{FindingsError, Store};

/// The longest note, in bytes.
const LONGEST_NOTE: usize = 4000;
/// The longest field of an [`Inspection`], in bytes.
const LONGEST_FIELD: usize = 200;
/// No survey reaches farther from its start.
const FARTHEST_M: f64 = 1e5;

/// What was found, in the terms of EN 13508-2.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Kind {
    /// The section is out of shape.
    Deformation,
    /// A crack line, not open.
    Crack,
    /// An open crack.
    Fracture,
    /// A piece displaced or missing.
    Break,
    /// Displaced or missing bricks.
    DefectiveBrickwork,
    /// Mortar missing from joints.
    MissingMortar,
    /// Spalling, corrosion, visible reinforcement.
    SurfaceDamage,
    /// Rings or pipes out of line.
    DisplacedJoint,
    /// A lining that is detached, bulged or torn.
    LiningDefect,
    /// A repair that failed.
    DefectiveRepair,
    /// Roots.
    Roots,
    /// Attached to the wall: scale, efflorescence, grease.
    AttachedDeposit,
    /// Settled on the floor.
    SettledDeposit,
    /// Water that comes in.
    Infiltration,
    /// Something in the way.
    Obstacle,
    /// A connection.
    Connection,
    /// Anything else; the note says what.
    Remark,
}

impl Kind {
    /// Main code and characterisation of EN 13508-2, Annex C.
    fn en13508(self) -> (&'static str, Option<&'static str>) {
        match self {
            Self::Deformation => ("BAA", None),
            Self::Crack => ("BAB", Some("B")),
            Self::Fracture => ("BAB", Some("C")),
            Self::Break => ("BAC", None),
            Self::DefectiveBrickwork => ("BAD", None),
            Self::MissingMortar => ("BAE", None),
            Self::SurfaceDamage => ("BAF", None),
            Self::DisplacedJoint => ("BAJ", None),
            Self::LiningDefect => ("BAK", None),
            Self::DefectiveRepair => ("BAL", None),
            Self::Roots => ("BBA", None),
            Self::AttachedDeposit => ("BBB", None),
            Self::SettledDeposit => ("BBC", None),
            Self::Infiltration => ("BBF", None),
            Self::Obstacle => ("BBE", None),
            Self::Connection => ("BCA", None),
            Self::Remark => ("BDB", None),
        }
    }
}

/// A finding without what the store adds.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Observation {
    /// What.
    pub kind: Kind,
    /// 1 (note it) to 5 (act now).
    pub severity: u8,
    /// In the inspector's words.
    pub note: String,
    /// Start along the axis.
    pub x_from_m: f64,
    /// End along the axis, not before the start.
    pub x_to_m: f64,
    /// Clock position in `[0, 12)` where the arc starts.
    pub clock_from: f64,
    /// Where it ends, going clockwise.
    pub clock_to: f64,
}

/// Why an observation or an inspection is refused.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum Refused {
    /// Not one of the five.
    #[error("severity is {found}, expected 1 to 5")]
    Severity {
        /// What was given.
        found: u8,
    },
    /// Too long to be kept.
    #[error("{field} is {bytes} bytes long, at most {most} are kept")]
    TooLong {
        /// Which text.
        field: &'static str,
        /// Its length.
        bytes: usize,
        /// The most.
        most: usize,
    },
    /// The stretch runs backwards or lies outside any tunnel.
    #[error("the distance runs from {from} to {to} m, expected numbers in this order")]
    Distance {
        /// Start.
        from: f64,
        /// End.
        to: f64,
    },
    /// No clock position.
    #[error("clock position {found}, expected a number from 0 (or 12, the crown) to less than 12")]
    Clock {
        /// What was given.
        found: f64,
    },
    /// No date.
    #[error("the date is `{found}`, expected YYYY-MM-DD or nothing")]
    Date {
        /// What was given.
        found: String,
    },
    /// The picture is no JPEG.
    #[error("the snapshot is no JPEG in base64")]
    Snapshot,
}

impl Observation {
    /// Returns it with clock 12 written as 0, or says why it cannot be kept.
    ///
    /// # Errors
    /// [`Refused`].
    pub fn checked(mut self) -> Result<Self, Refused> {
        if !(1..=5).contains(&self.severity) {
            return Err(Refused::Severity { found: self.severity });
        }
        short("the note", &self.note, LONGEST_NOTE)?;
        let (from, to) = (self.x_from_m, self.x_to_m);
        if !(from <= to && from.abs() <= FARTHEST_M && to.abs() <= FARTHEST_M) {
            return Err(Refused::Distance { from, to });
        }
        for clock in [&mut self.clock_from, &mut self.clock_to] {
            if *clock == 12.0 {
                *clock = 0.0;
            }
            if !(0.0..12.0).contains(clock) {
                return Err(Refused::Clock { found: *clock });
            }
        }
        Ok(self)
    }
}

/// A finding as it is kept.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Finding {
    /// Its number, from 1, never given twice.
    pub id: u32,
    /// What was seen.
    #[serde(flatten)]
    pub observation: Observation,
    /// File of the picture, relative to `out/`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub snapshot: Option<String>,
}

/// What a transfer file says about the inspection as a whole. Empty: not known.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Inspection {
    /// Reference of the pipe or tunnel.
    pub reference: String,
    /// Reference of the node at which the survey starts.
    pub from_node: String,
    /// Reference of the node at which it ends.
    pub to_node: String,
    /// Street or place.
    pub location: String,
    /// YYYY-MM-DD.
    pub date: String,
    /// Who judged.
    pub inspector: String,
}

impl Inspection {
    /// Returns it, or says why it cannot be kept.
    ///
    /// # Errors
    /// [`Refused`].
    pub fn checked(self) -> Result<Self, Refused> {
        let fields = [
            ("reference", &self.reference),
            ("from_node", &self.from_node),
            ("to_node", &self.to_node),
            ("location", &self.location),
            ("inspector", &self.inspector),
        ];
        for (name, text) in fields {
            short(name, text, LONGEST_FIELD)?;
        }
        if self.date.is_empty() || is_date(&self.date) { Ok(self) } else { Err(Refused::Date { found: self.date }) }
    }
}

/// The content of findings.json.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Findings {
    /// Version of the file.
    pub format: u32,
    /// The number of the next finding.
    pub next_id: u32,
    /// About the whole.
    #[serde(default)]
    pub inspection: Inspection,
    /// In the order in which they were marked.
    pub findings: Vec<Finding>,
}

impl Default for Findings {
    fn default() -> Self {
        Self { format: store::FORMAT, next_id: 1, inspection: Inspection::default(), findings: Vec::new() }
    }
}

fn short(field: &'static str, text: &str, most: usize) -> Result<(), Refused> {
    if text.len() <= most { Ok(()) } else { Err(Refused::TooLong { field, bytes: text.len(), most }) }
}

fn is_date(text: &str) -> bool {
    let parts: Vec<&str> = text.split('-').collect();
    let [year, month, day] = parts[..] else { return false };
    let number = |part: &str, digits: usize| {
        (part.len() == digits && part.bytes().all(|byte| byte.is_ascii_digit()))
            .then(|| part.parse::<u32>().ok())
            .flatten()
    };
    number(year, 4).is_some()
        && number(month, 2).is_some_and(|month| (1..=12).contains(&month))
        && number(day, 2).is_some_and(|day| (1..=31).contains(&day))
}

#[cfg(test)]
pub(crate) fn example() -> Observation {
    Observation {
        kind: Kind::Crack,
        severity: 3,
        note: "hairline".to_owned(),
        x_from_m: 1.25,
        x_to_m: 1.5,
        clock_from: 11.0,
        clock_to: 1.0,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn twelve_o_clock_is_kept_as_zero_and_thirteen_is_refused() {
        let kept = Observation { clock_from: 12.0, ..example() }.checked().unwrap();
        assert_eq!(kept.clock_from, 0.0);
        let refused = Observation { clock_to: 13.0, ..example() }.checked();
        assert_eq!(refused, Err(Refused::Clock { found: 13.0 }));
        assert!(Observation { clock_to: f64::NAN, ..example() }.checked().is_err());
    }

    #[test]
    fn what_makes_no_sense_is_refused_and_named() {
        let why = |observation: Observation| observation.checked().unwrap_err().to_string();
        assert!(why(Observation { severity: 0, ..example() }).contains("1 to 5"));
        assert!(why(Observation { severity: 6, ..example() }).contains("1 to 5"));
        assert!(why(Observation { x_from_m: 2.0, ..example() }).contains("from 2 to 1.5"));
        assert!(why(Observation { x_to_m: f64::INFINITY, ..example() }).contains("distance"));
        assert!(why(Observation { note: "x".repeat(LONGEST_NOTE + 1), ..example() }).contains("4001 bytes"));
    }

    #[test]
    fn a_date_is_three_numbers() {
        let dated = |date: &str| Inspection { date: date.to_owned(), ..Inspection::default() }.checked().is_ok();
        assert!(dated("") && dated("2026-11-26"));
        assert!(!dated("26.11.2026") && !dated("2026-13-01") && !dated("2026-1-01") && !dated("2026-+1-01"));
    }
}
