//! What goes wrong, when, for how long: listed in the mission file or drawn from the seed.

use adit_protocol::beams::Beam;
use serde::{Deserialize, Serialize};

use crate::seed::{Random, Stream};
use crate::sensors::range::RangeDefect;

/// A kind of fault.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum FaultKind {
    /// A range sensor is broken.
    Range {
        /// Which.
        beam: BeamName,
        /// How.
        defect: RangeDefect,
    },
    /// The camera feels no trigger.
    CameraDeaf,
    /// The servo does not move.
    ServoStall,
    /// The encoder is silent.
    EncoderSilent,
    /// The estimator reports neither attitude nor odometry.
    NavigationSilent,
    /// The autopilot takes no notice of the limit.
    LimitIgnored,
    /// Power is lost: the flight is over for the board, and its log is torn in the middle of a record.
    PowerLoss,
}

/// The word for a fault in the mission file.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
enum FaultWord {
    RangeDead,
    RangeFrozen,
    RangeZeros,
    CameraDeaf,
    ServoStall,
    EncoderSilent,
    NavigationSilent,
    LimitIgnored,
    PowerLoss,
}

/// A fault as the mission file has it.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct FaultRow {
    kind: FaultWord,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    beam: Option<BeamName>,
    at_s: f64,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    for_s: Option<f64>,
}

/// Why a fault was refused.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum FaultError {
    /// A range sensor's fault does not say which sensor.
    #[error("a fault of a range sensor needs `beam`: up, right, down or left")]
    NoBeam,
    /// Another fault names a range sensor.
    #[error("`beam` belongs to faults of range sensors only")]
    SurplusBeam,
}

/// A body-fixed range sensor, by where it looks.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum BeamName {
    /// Body -z.
    Up,
    /// Body +y.
    Right,
    /// Body +z.
    Down,
    /// Body -y.
    Left,
}

impl From<BeamName> for Beam {
    fn from(name: BeamName) -> Self {
        match name {
            BeamName::Up => Self::Up,
            BeamName::Right => Self::Right,
            BeamName::Down => Self::Down,
            BeamName::Left => Self::Left,
        }
    }
}

/// A fault and its time.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "FaultRow", into = "FaultRow")]
pub struct Fault {
    /// What happens.
    pub kind: FaultKind,
    /// When it begins, from the board's start.
    pub at_s: f64,
    /// How long it lasts; `None`: to the end.
    pub for_s: Option<f64>,
}

impl TryFrom<FaultRow> for Fault {
    type Error = FaultError;

    fn try_from(row: FaultRow) -> Result<Self, FaultError> {
        let range = |defect| row.beam.map(|beam| FaultKind::Range { beam, defect }).ok_or(FaultError::NoBeam);
        let other = |kind| if row.beam.is_some() { Err(FaultError::SurplusBeam) } else { Ok(kind) };
        let kind = match row.kind {
            FaultWord::RangeDead => range(RangeDefect::Dead),
            FaultWord::RangeFrozen => range(RangeDefect::Frozen),
            FaultWord::RangeZeros => range(RangeDefect::Zeros),
            FaultWord::CameraDeaf => other(FaultKind::CameraDeaf),
            FaultWord::ServoStall => other(FaultKind::ServoStall),
            FaultWord::EncoderSilent => other(FaultKind::EncoderSilent),
            FaultWord::NavigationSilent => other(FaultKind::NavigationSilent),
            FaultWord::LimitIgnored => other(FaultKind::LimitIgnored),
            FaultWord::PowerLoss => other(FaultKind::PowerLoss),
        }?;
        Ok(Self { kind, at_s: row.at_s, for_s: row.for_s })
    }
}

impl From<Fault> for FaultRow {
    fn from(fault: Fault) -> Self {
        let (kind, beam) = match fault.kind {
            FaultKind::Range { beam, defect: RangeDefect::Dead } => (FaultWord::RangeDead, Some(beam)),
            FaultKind::Range { beam, defect: RangeDefect::Frozen } => (FaultWord::RangeFrozen, Some(beam)),
            FaultKind::Range { beam, defect: RangeDefect::Zeros } => (FaultWord::RangeZeros, Some(beam)),
            FaultKind::CameraDeaf => (FaultWord::CameraDeaf, None),
            FaultKind::ServoStall => (FaultWord::ServoStall, None),
            FaultKind::EncoderSilent => (FaultWord::EncoderSilent, None),
            FaultKind::NavigationSilent => (FaultWord::NavigationSilent, None),
            FaultKind::LimitIgnored => (FaultWord::LimitIgnored, None),
            FaultKind::PowerLoss => (FaultWord::PowerLoss, None),
        };
        Self { kind, beam, at_s: fault.at_s, for_s: fault.for_s }
    }
}

impl Fault {
    /// Tells whether the fault holds at `now_s`.
    pub fn holds(&self, now_s: f64) -> bool {
        now_s >= self.at_s && self.for_s.is_none_or(|for_s| now_s < self.at_s + for_s)
    }
}

/// All faults of a flight.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Faults(pub Vec<Fault>);

impl Faults {
    /// Adds `count` faults drawn from the seed, beginning within the first `within_s`.
    pub fn draw(&mut self, count: u32, within_s: f64, seed: u64) {
        let mut random = Random::new(seed, Stream::Faults);
        for _ in 0..count {
            let beam = [BeamName::Up, BeamName::Right, BeamName::Down, BeamName::Left][random.index(4)];
            let kind = match random.index(9) {
                0 => FaultKind::Range { beam, defect: RangeDefect::Dead },
                1 => FaultKind::Range { beam, defect: RangeDefect::Frozen },
                2 => FaultKind::Range { beam, defect: RangeDefect::Zeros },
                3 => FaultKind::CameraDeaf,
                4 => FaultKind::ServoStall,
                5 => FaultKind::EncoderSilent,
                6 => FaultKind::NavigationSilent,
                7 => FaultKind::LimitIgnored,
                _ => FaultKind::PowerLoss,
            };
            let at_s = random.uniform(0.0, within_s);
            let for_s = random.uniform(0.5, 15.0);
            let lasting = random.chance(0.3);
            self.0.push(Fault { kind, at_s, for_s: (!lasting).then_some(for_s) });
        }
    }

    /// Tells whether a fault of this kind holds.
    pub fn holds(&self, kind: FaultKind, now_s: f64) -> bool {
        self.0.iter().any(|fault| fault.kind == kind && fault.holds(now_s))
    }

    /// How a range sensor is broken now; the worst of several.
    pub fn range_defect(&self, beam: Beam, now_s: f64) -> Option<RangeDefect> {
        let defect = |fault: &Fault| match fault.kind {
            FaultKind::Range { beam: at, defect } if Beam::from(at) == beam => Some(defect),
            _ => None,
        };
        let rank = |defect: &RangeDefect| match defect {
            RangeDefect::Dead => 2,
            RangeDefect::Zeros => 1,
            RangeDefect::Frozen => 0,
        };
        self.0.iter().filter(|fault| fault.holds(now_s)).filter_map(defect).max_by_key(rank)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_fault_holds_from_its_beginning_to_its_end() {
        let fault = Fault { kind: FaultKind::ServoStall, at_s: 2.0, for_s: Some(1.0) };
        assert_eq!([1.9, 2.0, 2.9, 3.0].map(|now_s| fault.holds(now_s)), [false, true, true, false]);
    }

    #[test]
    fn drawn_faults_depend_on_the_seed_alone() {
        let draw = |seed| {
            let mut faults = Faults::default();
            faults.draw(5, 60.0, seed);
            faults
        };
        assert_eq!(draw(1), draw(1));
        assert_ne!(draw(1), draw(2));
    }

    #[test]
    fn the_worse_of_two_defects_counts() {
        let beam = BeamName::Up;
        let faults = Faults(vec![
            Fault { kind: FaultKind::Range { beam, defect: RangeDefect::Frozen }, at_s: 0.0, for_s: None },
            Fault { kind: FaultKind::Range { beam, defect: RangeDefect::Dead }, at_s: 5.0, for_s: None },
        ]);
        assert_eq!(faults.range_defect(Beam::Up, 1.0), Some(RangeDefect::Frozen));
        assert_eq!(faults.range_defect(Beam::Up, 6.0), Some(RangeDefect::Dead));
        assert_eq!(faults.range_defect(Beam::Left, 6.0), None);
    }
}
