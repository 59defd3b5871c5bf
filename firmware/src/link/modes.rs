//! How each autopilot takes a speed limit in each of its modes: the table that the enforcement follows.
//!
//! | autopilot, mode | way | floor | why |
//! |---|---|---|---|
//! | `ArduPilot` Auto, Guided, RTL, Auto RTL | `DO_CHANGE_SPEED` | 0.1 m/s, from 4.7 on 0.01 m/s | lower values are accepted and ignored; lost on change of mode |
//! | `ArduPilot` Loiter | parameter `LOIT_SPEED` or `LOIT_SPEED_MS` | 0.2 m/s | the command fails there; the stick's full speed follows the parameter, with overshoot |
//! | PX4 Mission, Hold | `DO_CHANGE_SPEED` | 0.01 m/s | always accepted, so only the measured speed tells |
//! | PX4 Position | parameter `MPC_VEL_MANUAL` | 0.05 m/s | its declared minimum of 3 m/s is not enforced |
//! | PX4 Position Slow | that, and `SET_VELOCITY_LIMITS` | 0.3 m/s | the message acts in builds of the development dialect only |
//! | any other | none | - | the pilot flies by the display |
//!
//! Sources: shared/facts/flight-side.md 3.1 and 3.2 with theirs (`ArduPilot` 4.6.3 and 4.7, PX4 of March 2026).

use adit_protocol::mavlink::Autopilot;
use serde::{Deserialize, Serialize};

/// A way to set a limit.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Way {
    /// `DO_CHANGE_SPEED`.
    Command,
    /// The parameter of `ArduPilot`'s Loiter.
    LoiterParameter,
    /// The parameter of PX4's Position.
    ManualParameter,
    /// There is none.
    None,
}

/// A row of the table.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Row {
    /// The mode, as pilots call it.
    pub(super) name: &'static str,
    /// How it takes a limit.
    pub(super) way: Way,
    /// The lowest limit that it takes.
    pub(super) floor_mps: f32,
    /// Does PX4's `SET_VELOCITY_LIMITS` act here, in the builds that know it?
    pub(super) velocity_limits: bool,
    /// Does it fly the velocities that it is sent?
    pub(super) follows: bool,
}

/// `ArduPilot` 4.7, from which on speeds down to 0.01 m/s are taken.
const FINE_VERSION: [u8; 2] = [4, 7];
const COMMAND: Row = Row { name: "", way: Way::Command, floor_mps: 0.01, velocity_limits: false, follows: false };
const PARAMETER: Row = Row { name: "", way: Way::ManualParameter, floor_mps: 0.05, ..COMMAND };
const NONE: Row = Row { name: "", way: Way::None, floor_mps: 0.0, ..COMMAND };

/// The row of an autopilot's mode. An autopilot that does not tell its version (major, minor) counts as an old one.
pub(super) fn row(autopilot: Autopilot, version: Option<[u8; 2]>, custom_mode: u32) -> Row {
    let (row, unnamed) = match autopilot {
        Autopilot::ArduPilot => (ardupilot(custom_mode), "this mode"),
        // main << 16 | sub << 24.
        Autopilot::Px4 => (px4(custom_mode >> 16 & 0xFF, custom_mode >> 24), "this mode"),
        Autopilot::Other(_) => (NONE, "unknown autopilot"),
    };
    let is_coarse = autopilot == Autopilot::ArduPilot
        && row.way == Way::Command
        && version.is_none_or(|version| version < FINE_VERSION);
    let floor_mps = if is_coarse { 0.1 } else { row.floor_mps };
    Row { name: autopilot.mode_name(custom_mode).unwrap_or(unnamed), floor_mps, ..row }
}

fn ardupilot(mode: u32) -> Row {
    match mode {
        // Auto, RTL, Auto RTL.
        3 | 6 | 27 => COMMAND,
        // Guided.
        4 => Row { follows: true, ..COMMAND },
        // Loiter.
        5 => Row { way: Way::LoiterParameter, floor_mps: 0.2, ..PARAMETER },
        _ => NONE,
    }
}

fn px4(main: u32, sub: u32) -> Row {
    match (main, sub) {
        // Hold, Mission.
        (4, 3 | 4) => COMMAND,
        // Position Slow.
        (3, 2) => Row { floor_mps: 0.3, velocity_limits: true, ..PARAMETER },
        // Position.
        (3, 0) => PARAMETER,
        _ => NONE,
    }
}

/// A parameter of an autopilot that bounds its speed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum LimitParameter {
    /// `ArduPilot` up to 4.6, in cm/s.
    LoiterCentimetres,
    /// `ArduPilot` from 4.7 on, in m/s.
    LoiterMetres,
    /// PX4, in m/s.
    VelocityManual,
}

impl LimitParameter {
    /// Those of a way; of two only one exists in an autopilot.
    pub(super) fn of(way: Way) -> &'static [Self] {
        match way {
            Way::LoiterParameter => &[Self::LoiterCentimetres, Self::LoiterMetres],
            Way::ManualParameter => &[Self::VelocityManual],
            Way::Command | Way::None => &[],
        }
    }

    /// Its name.
    pub fn name(self) -> &'static str {
        match self {
            Self::LoiterCentimetres => "LOIT_SPEED",
            Self::LoiterMetres => "LOIT_SPEED_MS",
            Self::VelocityManual => "MPC_VEL_MANUAL",
        }
    }

    /// The one of that name.
    pub fn named(name: &str) -> Option<Self> {
        [Self::LoiterCentimetres, Self::LoiterMetres, Self::VelocityManual].into_iter().find(|one| one.name() == name)
    }

    /// Its unit in m/s.
    pub fn unit_mps(self) -> f32 {
        match self {
            Self::LoiterCentimetres => 0.01,
            Self::LoiterMetres | Self::VelocityManual => 1.0,
        }
    }

    /// Whether an autopilot can have this value: what is not plausible may be in another unit.
    pub(super) fn is_plausible(self, value: f32) -> bool {
        let least = if self == Self::VelocityManual { 0.1 } else { 0.19 };
        (least..=50.0).contains(&(value * self.unit_mps()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_table_says_what_the_facts_say() {
        let rows = [
            (Autopilot::ArduPilot, None, 3, "AUTO", Way::Command, 0.1),
            (Autopilot::ArduPilot, Some([4, 6]), 3, "AUTO", Way::Command, 0.1),
            (Autopilot::ArduPilot, Some([4, 7]), 4, "GUIDED", Way::Command, 0.01),
            (Autopilot::ArduPilot, Some([4, 7]), 5, "LOITER", Way::LoiterParameter, 0.2),
            (Autopilot::ArduPilot, None, 16, "POSHOLD", Way::None, 0.0),
            (Autopilot::Px4, None, 4 << 16 | 4 << 24, "MISSION", Way::Command, 0.01),
            (Autopilot::Px4, None, 3 << 16, "POSITION", Way::ManualParameter, 0.05),
            (Autopilot::Px4, None, 3 << 16 | 2 << 24, "POSITION SLOW", Way::ManualParameter, 0.3),
            (Autopilot::Px4, None, 6 << 16, "OFFBOARD", Way::None, 0.0),
            (Autopilot::Other(4), None, 3, "unknown autopilot", Way::None, 0.0),
        ];
        for (autopilot, version, mode, name, way, floor_mps) in rows {
            let row = row(autopilot, version, mode);
            assert_eq!((row.name, row.way, row.floor_mps), (name, way, floor_mps));
        }
    }

    #[test]
    fn centimetres_are_never_taken_for_metres() {
        assert!(LimitParameter::LoiterCentimetres.is_plausible(1250.0));
        assert!(!LimitParameter::LoiterCentimetres.is_plausible(12.5));
        assert!(LimitParameter::LoiterMetres.is_plausible(12.5));
        assert!(!LimitParameter::LoiterMetres.is_plausible(1250.0));
        assert!(!LimitParameter::VelocityManual.is_plausible(f32::NAN));
    }
}
