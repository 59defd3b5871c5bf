//! Names of the autopilots' modes, as they themselves and ground stations have them: what the board says of a mode, the ground
//! says in the same word.

use core::fmt;

use super::Autopilot;

impl Autopilot {
    /// What it calls its mode; `None` for a mode, or an autopilot, that is not known here.
    ///
    /// Sources: `ArduCopter/mode.h`, `Mode::Number`; PX4's `px4_custom_mode.h`, main mode in bits 16 to 23, sub mode above.
    pub fn mode_name(self, custom_mode: u32) -> Option<&'static str> {
        match self {
            Self::ArduPilot => ardupilot(custom_mode),
            Self::Px4 => px4(custom_mode >> 16 & 0xFF, custom_mode >> 24),
            Self::Other(_) => None,
        }
    }
}

fn ardupilot(mode: u32) -> Option<&'static str> {
    Some(match mode {
        0 => "STABILIZE",
        1 => "ACRO",
        2 => "ALT_HOLD",
        3 => "AUTO",
        4 => "GUIDED",
        5 => "LOITER",
        6 => "RTL",
        7 => "CIRCLE",
        9 => "LAND",
        11 => "DRIFT",
        16 => "POSHOLD",
        17 => "BRAKE",
        20 => "GUIDED_NOGPS",
        22 => "FLOWHOLD",
        27 => "AUTO_RTL",
        _ => return None,
    })
}

fn px4(main: u32, sub: u32) -> Option<&'static str> {
    Some(match (main, sub) {
        (1, _) => "MANUAL",
        (2, _) => "ALTITUDE",
        (3, 0) => "POSITION",
        (3, 1) => "ORBIT",
        (3, 2) => "POSITION SLOW",
        (4, 2) => "TAKEOFF",
        (4, 3) => "HOLD",
        (4, 4) => "MISSION",
        (4, 5) => "RETURN",
        (4, 6) => "LAND",
        (5, _) => "ACRO",
        (6, _) => "OFFBOARD",
        (7, _) => "STABILIZED",
        _ => return None,
    })
}

/// A mode in words: its name, or its number where it has no name here.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ModeWords(pub Autopilot, pub u32);

impl fmt::Display for ModeWords {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.0.mode_name(self.1) {
            Some(name) => out.write_str(name),
            None => write!(out, "mode {}", self.1),
        }
    }
}

#[cfg(test)]
mod tests {
    use std::string::ToString;

    use super::*;

    #[test]
    fn modes_are_named_by_their_autopilot_and_unknown_ones_numbered() {
        let words = |autopilot: u8, mode| ModeWords(autopilot.into(), mode).to_string();
        assert_eq!(words(3, 5), "LOITER");
        assert_eq!(words(12, 3 << 16 | 2 << 24), "POSITION SLOW");
        assert_eq!(words(12, 5), "mode 5");
        assert_eq!(words(0, 3), "mode 3");
    }
}
