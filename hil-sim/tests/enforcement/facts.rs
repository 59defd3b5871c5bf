//! What the facts (shared/facts/flight-side.md 3.1, 3.2) say can be enforced, written down apart from the firmware's table.

use adit_hil_sim::autopilot::Kind;

/// Whether there is any way to hold this autopilot to such a limit in that mode; in Guided the board may lead.
pub(crate) fn is_possible(kind: Kind, mode: &str, leads: bool, limit_mps: f64) -> bool {
    match (kind, mode) {
        // It flies the velocities that it is sent.
        (Kind::ArduPilot46 | Kind::ArduPilot47, "GUIDED") if leads => true,
        // By command; less than the least is accepted and ignored.
        (Kind::ArduPilot46, "AUTO" | "GUIDED" | "RTL") => limit_mps >= 0.1,
        (Kind::ArduPilot47, "AUTO" | "GUIDED" | "RTL") => limit_mps >= 0.01,
        // By its parameter, whose floor is 0.2 m/s.
        (Kind::ArduPilot46 | Kind::ArduPilot47, "LOITER") => limit_mps >= 0.2,
        // The first two by command, the third by its parameter, whose declared minimum is not enforced.
        (Kind::Px4 | Kind::Px4Development, "MISSION" | "HOLD" | "POSITION") => true,
        // It can only reduce below that, not below 0.3 m/s.
        (Kind::Px4 | Kind::Px4Development, "POSITION SLOW") => limit_mps >= 0.3,
        _ => false,
    }
}

/// A mode in which nothing can be enforced, or can where `mode` is such a one.
pub(crate) fn another_mode(kind: Kind, mode: &str) -> &'static str {
    match kind {
        Kind::ArduPilot46 | Kind::ArduPilot47 if mode == "ALT_HOLD" => "LOITER",
        Kind::ArduPilot46 | Kind::ArduPilot47 => "ALT_HOLD",
        Kind::Px4 | Kind::Px4Development if mode == "ALTITUDE" => "POSITION",
        Kind::Px4 | Kind::Px4Development => "ALTITUDE",
    }
}
