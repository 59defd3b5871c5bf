//! PX4: which mode takes a speed from whom.
//!
//! | mode | the speed it steers for |
//! |---|---|
//! | Mission, Hold (flying to a new place) | `DO_CHANGE_SPEED`'s until the next change of mode, else `MPC_XY_CRUISE`; at most `MPC_XY_VEL_MAX` |
//! | Return | `MPC_XY_CRUISE`, whatever was commanded |
//! | Position | the stick; full deflection is `MPC_VEL_MANUAL` |
//! | Position Slow | the same, at most `MC_SLOW_DEF_HVEL` or what `SET_VELOCITY_LIMITS` said since the mode began |
//! | Offboard | what the companion sends, unlimited but for `MPC_XY_VEL_MAX` |
//! | Altitude, Stabilized | the stick, without any limit |
//! | Takeoff, Land | nothing |

use adit_protocol::mavlink::{CommandResult, Value};

use super::setpoint::SetPoint;
use super::table::Table;
use super::ways::SpeedChange;

/// `main << 16 | sub << 24`, as in `px4_custom_mode.h`.
const fn mode(main: u32, sub: u32) -> u32 {
    main << 16 | sub << 24
}

const ALTITUDE: u32 = mode(2, 0);
pub(super) const POSITION: u32 = mode(3, 0);
const POSITION_SLOW: u32 = mode(3, 2);
const TAKEOFF: u32 = mode(4, 2);
const HOLD: u32 = mode(4, 3);
const MISSION: u32 = mode(4, 4);
const RETURN: u32 = mode(4, 5);
const LAND: u32 = mode(4, 6);
const OFFBOARD: u32 = mode(6, 0);
const STABILIZED: u32 = mode(7, 0);

/// The modes that are modelled.
pub const MODES: [(u32, &str); 10] = [
    (ALTITUDE, "ALTITUDE"),
    (POSITION, "POSITION"),
    (POSITION_SLOW, "POSITION SLOW"),
    (TAKEOFF, "TAKEOFF"),
    (HOLD, "HOLD"),
    (MISSION, "MISSION"),
    (RETURN, "RETURN"),
    (LAND, "LAND"),
    (OFFBOARD, "OFFBOARD"),
    (STABILIZED, "STABILIZED"),
];

/// What is changed goes to the permanent memory after this.
const SAVE_DELAY_S: f64 = 0.3;

/// The parameters as they leave the factory.
pub(super) fn stock() -> Table {
    let values = [
        ("COM_FLTMODE1", Value::Whole(-1)),
        ("COM_OF_LOSS_T", Value::Real(1.0)),
        ("MAV_SYS_ID", Value::Whole(1)),
        ("MC_SLOW_DEF_HVEL", Value::Real(3.0)),
        ("MC_SLOW_MIN_HVEL", Value::Real(0.3)),
        ("MPC_VEL_MANUAL", Value::Real(10.0)),
        ("MPC_VEL_MAN_BACK", Value::Real(-1.0)),
        ("MPC_VEL_MAN_SIDE", Value::Real(-1.0)),
        ("MPC_XY_CRUISE", Value::Real(5.0)),
        ("MPC_XY_VEL_MAX", Value::Real(12.0)),
        ("SYS_AUTOSTART", Value::Whole(4050)),
    ];
    Table::new(&values, &[], SAVE_DELAY_S)
}

/// A speed that is larger than `MPC_XY_VEL_MAX` is made to be no larger, for good.
pub(super) fn changed(now_s: f64, name: &str, table: &mut Table) -> Vec<&'static str> {
    let mut said = Vec::new();
    if !matches!(name, "MPC_XY_VEL_MAX" | "MPC_XY_CRUISE" | "MPC_VEL_MANUAL") {
        return said;
    }
    let most_mps = table.real("MPC_XY_VEL_MAX");
    if table.real("MPC_XY_CRUISE") > most_mps {
        table.change(now_s, "MPC_XY_CRUISE", most_mps);
        said.push("Cruise speed has been constrained by max speed");
    }
    if table.real("MPC_VEL_MANUAL") > most_mps {
        table.change(now_s, "MPC_VEL_MANUAL", most_mps);
        said.push("Manual speed has been constrained by max speed");
    }
    said
}

/// The autopilot.
#[derive(Clone, Debug)]
pub(super) struct Px4 {
    knows_velocity_limits: bool,
    /// What `DO_CHANGE_SPEED` said.
    cruise_mps: Option<f64>,
    /// What `SET_VELOCITY_LIMITS` said.
    slow_mps: Option<f64>,
    /// What a companion sent last, and when.
    sent: Option<(f64, f64)>,
}

impl Px4 {
    pub(super) fn new(knows_velocity_limits: bool) -> Self {
        Self { knows_velocity_limits, cruise_mps: None, slow_mps: None, sent: None }
    }

    /// What was told is lost with the mode.
    pub(super) fn enter(&mut self) {
        (self.cruise_mps, self.slow_mps, self.sent) = (None, None, None);
    }

    /// It always accepts, in every mode, whatever kind of speed it is.
    pub(super) fn change_speed(&mut self, change: SpeedChange) -> CommandResult {
        self.cruise_mps = (change.speed_mps > f32::EPSILON).then_some(f64::from(change.speed_mps));
        CommandResult::Accepted
    }

    pub(super) fn limit_velocity(&mut self, mode: u32, horizontal_mps: f32) {
        if self.knows_velocity_limits && mode == POSITION_SLOW && !horizontal_mps.is_nan() {
            self.slow_mps = Some(f64::from(horizontal_mps));
        }
    }

    pub(super) fn set_point(&mut self, now_s: f64, point: SetPoint) {
        if let SetPoint::Velocity(speed_mps) = point {
            self.sent = Some((speed_mps, now_s));
        }
    }

    pub(super) fn aim_mps(&mut self, now_s: f64, mode: u32, table: &Table, wish_mps: f64) -> f64 {
        let most_mps = table.real("MPC_XY_VEL_MAX");
        let flies = |speed_mps: f64| if wish_mps > 0.0 { speed_mps.min(most_mps) } else { 0.0 };
        let cruise_mps = table.real("MPC_XY_CRUISE");
        match mode {
            MISSION | HOLD => flies(self.cruise_mps.unwrap_or(cruise_mps)),
            RETURN => flies(cruise_mps),
            POSITION => stick_mps(wish_mps, f64::INFINITY, table),
            POSITION_SLOW => {
                let slow_mps = self.slow_mps.unwrap_or(table.real("MC_SLOW_DEF_HVEL"));
                stick_mps(wish_mps, slow_mps.max(table.real("MC_SLOW_MIN_HVEL")), table)
            }
            OFFBOARD => {
                let fresh = self.sent.filter(|(_, at_s)| now_s - at_s <= table.real("COM_OF_LOSS_T"));
                // Without setpoints from this side another companion flies it: as it wishes.
                fresh.map_or(wish_mps, |(speed_mps, _)| speed_mps).clamp(-most_mps, most_mps)
            }
            TAKEOFF | LAND => 0.0,
            _ => wish_mps,
        }
    }
}

/// As far as the stick goes.
fn stick_mps(wish_mps: f64, slow_mps: f64, table: &Table) -> f64 {
    let forward_mps = table.real("MPC_VEL_MANUAL").min(table.real("MPC_XY_VEL_MAX")).min(slow_mps);
    // A negative one is that of the way forward.
    let own_mps = table.real("MPC_VEL_MAN_BACK");
    let back_mps = if own_mps < 0.0 { forward_mps } else { own_mps.min(forward_mps) };
    wish_mps.clamp(-back_mps, forward_mps)
}
