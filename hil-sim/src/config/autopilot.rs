//! Which autopilot flies, and in which mode.

use serde::de::Error as _;
use serde::{Deserialize, Deserializer, Serialize};

use crate::autopilot::Kind;

/// Which one.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, clap::ValueEnum)]
pub enum AutopilotKind {
    /// Takes every limit at once, from the board's hand: no line between them.
    #[default]
    #[serde(rename = "simple")]
    Simple,
    /// `ArduPilot` Copter 4.6.
    #[serde(rename = "ardupilot")]
    #[value(name = "ardupilot")]
    ArduPilot,
    /// `ArduPilot` Copter 4.7.
    #[serde(rename = "ardupilot-4.7")]
    #[value(name = "ardupilot-4.7")]
    ArduPilot47,
    /// PX4 as it is released.
    #[serde(rename = "px4")]
    #[value(name = "px4")]
    Px4,
    /// PX4 built with the development dialect.
    #[serde(rename = "px4-development")]
    #[value(name = "px4-development")]
    Px4Development,
}

impl AutopilotKind {
    #[expect(clippy::trivially_copy_pass_by_ref, reason = "serde hands values over by reference")]
    pub(super) fn is_simple(&self) -> bool {
        *self == Self::Simple
    }

    /// The one at the other end of a line; `None` for the simple one.
    pub fn named(self) -> Option<Kind> {
        match self {
            Self::Simple => None,
            Self::ArduPilot => Some(Kind::ArduPilot46),
            Self::ArduPilot47 => Some(Kind::ArduPilot47),
            Self::Px4 => Some(Kind::Px4),
            Self::Px4Development => Some(Kind::Px4Development),
        }
    }
}

/// A mode that some autopilot has, by its name: small letters, a hyphen between words.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(into = "String")]
pub struct ModeName(&'static str);

/// A name that no mode of any autopilot has.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("no autopilot has a mode {found:?}; known are {known}")]
pub struct ModeError {
    /// What was given.
    pub found: String,
    /// What would do.
    pub known: String,
}

impl ModeName {
    /// As the autopilot's people write it.
    pub fn name(self) -> &'static str {
        self.0
    }
}

impl TryFrom<String> for ModeName {
    type Error = ModeError;

    fn try_from(found: String) -> Result<Self, ModeError> {
        let all = || Kind::ALL.into_iter().flat_map(|kind| kind.modes().iter().map(|(_, name)| *name));
        if let Some(name) = all().find(|name| written(name) == found) {
            return Ok(Self(name));
        }
        let mut known: Vec<String> = all().map(written).collect();
        known.sort();
        known.dedup();
        Err(ModeError { found, known: known.join(", ") })
    }
}

// Derived, it would want text that lives forever.
impl<'de> Deserialize<'de> for ModeName {
    fn deserialize<D: Deserializer<'de>>(from: D) -> Result<Self, D::Error> {
        Self::try_from(String::deserialize(from)?).map_err(D::Error::custom)
    }
}

impl From<ModeName> for String {
    fn from(mode: ModeName) -> Self {
        written(mode.0)
    }
}

/// As the mission file has it.
fn written(name: &str) -> String {
    name.to_lowercase().replace([' ', '_'], "-")
}

#[cfg(test)]
mod tests {
    use crate::config::Simulation;

    #[test]
    fn an_autopilot_and_its_mode_are_read_and_written_alike() {
        let text = "[simulation.autopilot]\nkind = \"ardupilot-4.7\"\nmode = \"alt-hold\"\n";
        let simulation = Simulation::from_mission(text).expect("parses");
        assert_eq!(simulation.autopilot.mode.map(super::ModeName::name), Some("ALT_HOLD"));
        let again = toml::to_string(&simulation.autopilot).expect("serialises");
        assert!(again.starts_with("kind = \"ardupilot-4.7\"\nmode = \"alt-hold\"\n"), "{again}");
    }

    #[test]
    fn a_mode_that_nobody_has_is_refused_with_those_that_there_are() {
        let error = Simulation::from_mission("[simulation.autopilot]\nmode = \"hover\"").expect_err("no such mode");
        assert!(error.to_string().contains("alt-hold, altitude, auto"), "{error}");
    }
}
