//! `ArduPilot` Copter: which mode takes a speed from whom.
//!
//! | mode | the speed it steers for |
//! |---|---|
//! | Auto, RTL | `DO_CHANGE_SPEED`'s until the next change of mode, else `WPNAV_SPEED` |
//! | Guided, to a place | the same; lost as well when another target comes |
//! | Guided, a velocity | the velocity, whatever was limited; nothing once it is older than `GUID_TIMEOUT` |
//! | Loiter | the stick; full deflection is `LOIT_SPEED`, and overshoots it |
//! | Stabilize, `AltHold`, `PosHold` | the stick, without any limit |
//! | Land | the stick, up to 1.25 m/s |
//! | Brake | nothing |

use adit_protocol::mavlink::{CommandResult, Value};

use super::setpoint::SetPoint;
use super::table::Table;
use super::ways::SpeedChange;

const STABILIZE: u32 = 0;
const ALT_HOLD: u32 = 2;
const AUTO: u32 = 3;
const GUIDED: u32 = 4;
pub(super) const LOITER: u32 = 5;
const RTL: u32 = 6;
const LAND: u32 = 9;
const POSHOLD: u32 = 16;
const BRAKE: u32 = 17;

/// The modes that are modelled.
pub const MODES: [(u32, &str); 9] = [
    (STABILIZE, "STABILIZE"),
    (ALT_HOLD, "ALT_HOLD"),
    (AUTO, "AUTO"),
    (GUIDED, "GUIDED"),
    (LOITER, "LOITER"),
    (RTL, "RTL"),
    (LAND, "LAND"),
    (POSHOLD, "POSHOLD"),
    (BRAKE, "BRAKE"),
];

/// Loiter takes nothing below this.
const LOITER_FLOOR_MPS: f64 = 0.2;
/// By how much Loiter is faster than its speed when that has changed or the stick was pushed: #17747 saw more.
const OVERSHOOT_SHARE: f64 = 0.3;
/// In such a time that dies away.
const OVERSHOOT_S: f64 = 3.0;
/// Half of what `WPNAV_ACCEL` is by default, taken for a speed (`mode.cpp`, `land_run_horizontal_control`).
const LAND_MPS: f64 = 1.25;

/// Which release.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Edition {
    V46,
    V47,
}

impl Edition {
    /// Waypoint speed and loiter speed, and how much a unit of them is.
    fn speeds(self) -> [&'static str; 2] {
        match self {
            Self::V46 => ["WPNAV_SPEED", "LOIT_SPEED"],
            Self::V47 => ["WP_SPD", "LOIT_SPEED_MS"],
        }
    }

    fn unit_mps(self) -> f64 {
        match self {
            Self::V46 => 0.01,
            Self::V47 => 1.0,
        }
    }

    /// Auto and RTL accept a lower speed than this and ignore it.
    fn least_mps(self) -> f32 {
        match self {
            Self::V46 => 0.1,
            Self::V47 => 0.01,
        }
    }
}

/// What a companion wants in Guided.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Target {
    /// A place far ahead.
    Place,
    /// A speed, since when.
    Velocity { speed_mps: f64, at_s: f64 },
}

/// The autopilot.
#[derive(Clone, Debug)]
pub(super) struct ArduPilot {
    edition: Edition,
    /// What `DO_CHANGE_SPEED` said.
    commanded_mps: Option<f64>,
    target: Target,
    /// What Loiter's stick called for last, and since when.
    called: (f64, f64),
}

impl ArduPilot {
    pub(super) fn new(edition: Edition) -> Self {
        Self { edition, commanded_mps: None, target: Target::Place, called: (0.0, 0.0) }
    }

    /// The parameters as they leave the factory.
    pub(super) fn stock(&self) -> Table {
        let [waypoint, loiter] = self.edition.speeds();
        let speed = |speed_mps: f64| Value::Real((speed_mps / self.edition.unit_mps()) as f32);
        let values = [
            ("FORMAT_VERSION", Value::Whole(120)),
            (waypoint, speed(10.0)),
            (loiter, speed(12.5)),
            ("GUID_TIMEOUT", Value::Real(3.0)),
            ("LOG_BITMASK", Value::Whole(180_222)),
        ];
        // What is changed is saved at once.
        Table::new(&values, &["FORMAT_VERSION"], 0.0)
    }

    /// What was commanded is lost with the mode.
    pub(super) fn enter(&mut self) {
        (self.commanded_mps, self.target, self.called) = (None, Target::Place, (0.0, 0.0));
    }

    pub(super) fn change_speed(&mut self, mode: u32, change: SpeedChange) -> CommandResult {
        if !(change.speed_mps > 0.0) {
            return if self.edition == Edition::V46 { CommandResult::Failed } else { CommandResult::Denied };
        }
        if !matches!(mode, AUTO | GUIDED | RTL) {
            return CommandResult::Failed;
        }
        let is_horizontal = change.kind == 0.0 || change.kind == 1.0;
        let is_ignored = mode != GUIDED && change.speed_mps < self.edition.least_mps();
        if is_horizontal && !is_ignored {
            self.commanded_mps = Some(f64::from(change.speed_mps));
        }
        CommandResult::Accepted
    }

    pub(super) fn set_point(&mut self, now_s: f64, mode: u32, point: SetPoint) {
        // Outside Guided nobody listens.
        if mode != GUIDED {
            return;
        }
        let before = self.target;
        self.target = match point {
            SetPoint::Place => Target::Place,
            SetPoint::Velocity(speed_mps) => Target::Velocity { speed_mps, at_s: now_s },
            SetPoint::Nonsense => Target::Velocity { speed_mps: 0.0, at_s: now_s },
        };
        let is_another = std::mem::discriminant(&before) != std::mem::discriminant(&self.target);
        if is_another || self.target == Target::Place {
            self.commanded_mps = None;
        }
    }

    pub(super) fn aim_mps(&mut self, now_s: f64, mode: u32, table: &Table, wish_mps: f64) -> f64 {
        let [waypoint_mps, loiter_mps] = self.edition.speeds().map(|name| table.real(name) * self.edition.unit_mps());
        let mission_mps = if wish_mps > 0.0 { self.commanded_mps.unwrap_or(waypoint_mps) } else { 0.0 };
        match mode {
            AUTO | RTL => mission_mps,
            GUIDED => match self.target {
                Target::Place => mission_mps,
                Target::Velocity { speed_mps, at_s } if now_s - at_s <= table.real("GUID_TIMEOUT") => speed_mps,
                Target::Velocity { .. } => 0.0,
            },
            LOITER => self.loiter_mps(now_s, loiter_mps.max(LOITER_FLOOR_MPS), wish_mps),
            LAND => wish_mps.clamp(-LAND_MPS, LAND_MPS),
            BRAKE => 0.0,
            _ => wish_mps,
        }
    }

    /// Loiter: as far as the stick goes, and more for a while after each change.
    fn loiter_mps(&mut self, now_s: f64, full_mps: f64, wish_mps: f64) -> f64 {
        let calls_mps = wish_mps.clamp(-full_mps, full_mps);
        let (before_mps, since_s) = self.called;
        if (calls_mps - before_mps).abs() > 0.02 * full_mps {
            self.called = (calls_mps, now_s);
        } else {
            self.called = (calls_mps, since_s);
        }
        let overshoot = OVERSHOOT_SHARE * (-(now_s - self.called.1) / OVERSHOOT_S).exp();
        // A pilot who wants less than the stick gives takes it back in time.
        let most_mps = wish_mps.abs();
        (calls_mps * (1.0 + overshoot)).clamp(-most_mps, most_mps)
    }
}
