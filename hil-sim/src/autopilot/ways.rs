//! What differs from one autopilot to the next, behind one face.

use adit_protocol::mavlink::CommandResult;

use super::ardupilot::ArduPilot;
use super::px4::Px4;
use super::setpoint::SetPoint;
use super::table::Table;

/// `DO_CHANGE_SPEED`, as it was asked for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct SpeedChange {
    /// `SPEED_TYPE`: 0 air, 1 ground, 2 climb, 3 descent.
    pub(super) kind: f32,
    /// How fast.
    pub(super) speed_mps: f32,
}

/// One of the autopilots.
#[derive(Clone, Debug)]
pub(super) enum Ways {
    ArduPilot(ArduPilot),
    Px4(Px4),
}

impl Ways {
    /// The mode that the switch stands at before anybody turns it.
    pub(super) fn first_mode(&self) -> u32 {
        match self {
            Self::ArduPilot(_) => super::ardupilot::LOITER,
            Self::Px4(_) => super::px4::POSITION,
        }
    }

    /// The parameters as they leave the factory.
    pub(super) fn stock(&self) -> Table {
        match self {
            Self::ArduPilot(one) => one.stock(),
            Self::Px4(_) => super::px4::stock(),
        }
    }

    /// Another mode begins.
    pub(super) fn enter(&mut self) {
        match self {
            Self::ArduPilot(one) => one.enter(),
            Self::Px4(one) => one.enter(),
        }
    }

    /// Takes `DO_CHANGE_SPEED`.
    pub(super) fn change_speed(&mut self, mode: u32, change: SpeedChange) -> CommandResult {
        match self {
            Self::ArduPilot(one) => one.change_speed(mode, change),
            Self::Px4(one) => one.change_speed(change),
        }
    }

    /// Takes `SET_VELOCITY_LIMITS`.
    pub(super) fn limit_velocity(&mut self, mode: u32, horizontal_mps: f32) {
        if let Self::Px4(one) = self {
            one.limit_velocity(mode, horizontal_mps);
        }
    }

    /// Takes `SET_POSITION_TARGET_LOCAL_NED`.
    pub(super) fn set_point(&mut self, now_s: f64, mode: u32, point: SetPoint) {
        match self {
            Self::ArduPilot(one) => one.set_point(now_s, mode, point),
            Self::Px4(one) => one.set_point(now_s, point),
        }
    }

    /// A parameter was changed; returns what is told to the pilot about it.
    pub(super) fn changed(&self, now_s: f64, name: &str, table: &mut Table) -> Vec<&'static str> {
        match self {
            Self::ArduPilot(_) => Vec::new(),
            Self::Px4(_) => super::px4::changed(now_s, name, table),
        }
    }

    /// The speed that it steers for.
    pub(super) fn aim_mps(&mut self, now_s: f64, mode: u32, table: &Table, wish_mps: f64) -> f64 {
        match self {
            Self::ArduPilot(one) => one.aim_mps(now_s, mode, table, wish_mps),
            Self::Px4(one) => one.aim_mps(now_s, mode, table, wish_mps),
        }
    }
}
