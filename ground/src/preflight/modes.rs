//! Names of autopilots' modes, as pilots call them.

/// `MAV_AUTOPILOT` of the two whose modes are known.
const ARDUPILOT: u8 = 3;
const PX4: u8 = 12;

/// `ArduCopter`'s (`mode.h`) that a survey may meet.
const COPTER: [(u32, &str); 15] = [
    (0, "Stabilize"),
    (1, "Acro"),
    (2, "AltHold"),
    (3, "Auto"),
    (4, "Guided"),
    (5, "Loiter"),
    (6, "RTL"),
    (7, "Circle"),
    (9, "Land"),
    (11, "Drift"),
    (16, "PosHold"),
    (17, "Brake"),
    (20, "Guided without GPS"),
    (22, "FlowHold"),
    (27, "Auto RTL"),
];

/// PX4's, main and sub mode (`px4_custom_mode.h`).
const PX4_MODES: [([u32; 2], &str); 12] = [
    ([1, 0], "Manual"),
    ([2, 0], "Altitude"),
    ([3, 0], "Position"),
    ([3, 1], "Orbit"),
    ([3, 2], "Position Slow"),
    ([4, 2], "Takeoff"),
    ([4, 3], "Hold"),
    ([4, 4], "Mission"),
    ([4, 5], "Return"),
    ([4, 6], "Land"),
    ([6, 0], "Offboard"),
    ([7, 0], "Stabilized"),
];

/// The name of a mode; its number where it has none here.
pub(super) fn name(autopilot: u8, mode: u32) -> String {
    let found = match autopilot {
        ARDUPILOT => COPTER.iter().find(|(number, _)| *number == mode).map(|(_, name)| *name),
        PX4 => {
            let parts = [mode >> 16 & 0xFF, mode >> 24];
            PX4_MODES.iter().find(|(known, _)| *known == parts).map(|(_, name)| *name)
        }
        _ => None,
    };
    found.map_or_else(|| format!("mode {mode}"), ToOwned::to_owned)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn modes_are_named_by_their_autopilot_and_unknown_ones_numbered() {
        assert_eq!(name(ARDUPILOT, 5), "Loiter");
        assert_eq!(name(PX4, 3 << 16 | 2 << 24), "Position Slow");
        assert_eq!(name(PX4, 5), "mode 5");
        assert_eq!(name(0, 3), "mode 3");
    }
}
