//! Is the vehicle ready? Everything that can be found out about it where it stands, over its link.
//!
//! What is looked at: the board and its program, the autopilot, the parameters (kept and in force), the card, the clock, the
//! range sensors; and, by moving things, the board's self-test (shaft, encoder, camera, position, log), a test photo, and
//! whether the autopilot takes a speed limit in the mode it is in. The test photos are a scan of their own, after which the
//! board is restarted, so that the flight's log is the flight's alone.
//!
//! # Limits
//! That a limit is obeyed only a flight shows; here it is asked for and not refused. What the board does not tell (the camera's
//! battery and card) is said to be unknown, never to be good.

mod checks;
mod drive;
#[cfg(test)]
mod tests;
mod watch;

use std::fmt;
use std::time::Duration;

use adit_protocol::mission::Mission;
use serde::Serialize;

pub use drive::preflight;

/// What is checked.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Subject {
    /// Somebody answers.
    Link,
    /// The program on the board.
    Firmware,
    /// The board is at rest.
    Board,
    /// The autopilot, its version and its mode.
    Autopilot,
    /// The parameters, against the mission.
    Parameters,
    /// The board's card.
    Card,
    /// The board's clock.
    Clock,
    /// The range sensors, and the place in the section that they give.
    Sensors,
    /// The board's self-test.
    SelfTest,
    /// A test photo.
    Camera,
    /// The speed limit.
    Enforcement,
    /// The camera's own battery and card.
    CameraSupplies,
    /// The board's restart after the test photos.
    Restart,
}

/// What was found out.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Verdict {
    /// Good.
    Yes,
    /// Not good: do not fly.
    No,
    /// Nobody can tell from here, or it was not tried: see for yourself.
    Unknown,
}

/// One line of the list.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Check {
    /// What was checked.
    pub subject: Subject,
    /// What was found out.
    pub verdict: Verdict,
    /// In words, with the reason and what to do.
    pub words: String,
}

/// The list; its `Display` is the one for people.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Preflight {
    /// In order.
    pub checks: Vec<Check>,
}

/// How long things are waited for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Timing {
    /// The board is listened to at rest.
    pub listen: Duration,
    /// For the end of the self-test, which takes 5 s at most.
    pub self_test: Duration,
    /// The test scan lasts at least, so that an autopilot has time to refuse.
    pub scan_least: Duration,
    /// And at most, if no photo comes.
    pub scan_most: Duration,
    /// For the board to come back from its restart.
    pub restart: Duration,
}

impl Default for Timing {
    fn default() -> Self {
        Self {
            // Telemetry comes twice a second, and a radio may lose some.
            listen: Duration::from_secs(3),
            self_test: Duration::from_secs(8),
            scan_least: Duration::from_secs(4),
            // A camera's longest answer by default, three times.
            scan_most: Duration::from_secs(12),
            restart: Duration::from_secs(15),
        }
    }
}

/// What is to be checked, and how.
#[derive(Clone, Copy, Debug, Default)]
pub struct Options<'a> {
    /// What is to be flown.
    pub mission: Option<&'a Mission>,
    /// Nothing moves: no self-test, no photo, no speed limit.
    pub still: bool,
    /// How long things are waited for.
    pub timing: Timing,
}

impl Preflight {
    /// Whether nothing speaks against the flight.
    pub fn is_ready(&self) -> bool {
        self.reasons() == 0
    }

    fn reasons(&self) -> usize {
        self.checks.iter().filter(|check| check.verdict == Verdict::No).count()
    }

    fn note(&mut self, subject: Subject, verdict: Verdict, words: impl Into<String>) {
        self.checks.push(Check { subject, verdict, words: words.into() });
    }
}

impl Serialize for Preflight {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        #[derive(Serialize)]
        struct Shown<'a> {
            ready: bool,
            checks: &'a [Check],
        }
        Shown { ready: self.is_ready(), checks: &self.checks }.serialize(serializer)
    }
}

impl fmt::Display for Preflight {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        for check in &self.checks {
            let verdict = match check.verdict {
                Verdict::Yes => "yes",
                Verdict::No => "NO",
                Verdict::Unknown => "?",
            };
            writeln!(out, "{verdict:4} {:17} {}", check.subject.name(), check.words)?;
        }
        match self.reasons() {
            0 => writeln!(out, "\nready"),
            1 => writeln!(out, "\nNOT READY: 1 reason"),
            reasons => writeln!(out, "\nNOT READY: {reasons} reasons"),
        }
    }
}

impl Subject {
    fn name(self) -> &'static str {
        match self {
            Self::Link => "link",
            Self::Firmware => "firmware",
            Self::Board => "board",
            Self::Autopilot => "autopilot",
            Self::Parameters => "parameters",
            Self::Card => "card",
            Self::Clock => "clock",
            Self::Sensors => "sensors",
            Self::SelfTest => "self-test",
            Self::Camera => "camera",
            Self::Enforcement => "speed limit",
            Self::CameraSupplies => "camera's supplies",
            Self::Restart => "restart",
        }
    }
}
