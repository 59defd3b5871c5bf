//! Autopilots by name: what `ArduPilot` and PX4 say and do at the other end of the board's line.
//!
//! They speak MAVLink and take speed limits as the facts say that the real ones do, silent acceptance, floors and lost
//! limits included, so that the board's enforcement meets what it will meet. What they steer for is one number, the speed
//! along the tunnel's axis ([`NamedAutopilot::aim_mps`]); the vehicle that follows it is another module's.
//!
//! Numbers of modes and messages are written down here again, on purpose: an error in the firmware's table must not find the
//! same error on this side. Sources: shared/facts/flight-side.md 3.1 to 3.3, with theirs (`ArduPilot` 4.6.3 and 4.7, PX4 of
//! March 2026); layouts from `common.xml`.
//!
//! Limits of the model: one dimension; no arming checks, no failsafes but those named; every stream is on from the start.

pub mod ardupilot;
mod hearing;
pub mod px4;
pub mod routing;
mod setpoint;
mod streams;
mod table;
mod ways;
pub mod wire;

use std::collections::BTreeMap;

use adit_protocol::mavlink::{
    AUTOPILOT_COMPONENT, Encoding, FrameDecoder, OutFrame, Sender, Severity, TEXT_BYTES, VehicleBeat,
};

use ardupilot::{ArduPilot, Edition};
use px4::Px4;
use streams::Streams;
use table::Table;
use ways::Ways;

/// `MAV_AUTOPILOT_ARDUPILOTMEGA`.
const ARDUPILOT: u8 = 3;
/// `MAV_AUTOPILOT_PX4`.
const PX4: u8 = 12;
/// The vehicle's number: what every autopilot leaves the factory with.
pub const SYSTEM: u8 = 1;
/// From a reset to the first heartbeat.
pub const BOOT_S: f64 = 3.0;
/// `MAV_MODE_FLAG_CUSTOM_MODE_ENABLED`.
const CUSTOM: u8 = 1;
/// `MAV_MODE_FLAG_SAFETY_ARMED`.
const ARMED: u8 = 128;
/// Four lithium cells in series, full and as they should be landed with.
const FULL_V: f64 = 16.8;
const EMPTY_V: f64 = 14.0;

/// Which autopilot.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Kind {
    /// `ArduPilot` Copter 4.6: speeds of parameters in cm/s.
    ArduPilot46,
    /// `ArduPilot` Copter 4.7: other names, in m/s.
    ArduPilot47,
    /// PX4 as it is released.
    Px4,
    /// PX4 built with the development dialect: it knows `SET_VELOCITY_LIMITS`.
    Px4Development,
}

impl Kind {
    /// All of them.
    pub const ALL: [Self; 4] = [Self::ArduPilot46, Self::ArduPilot47, Self::Px4, Self::Px4Development];

    /// As people call it.
    pub fn name(self) -> &'static str {
        match self {
            Self::ArduPilot46 => "ArduPilot 4.6",
            Self::ArduPilot47 => "ArduPilot 4.7",
            Self::Px4 => "PX4",
            Self::Px4Development => "PX4 development",
        }
    }

    /// The modes that are modelled: number and name.
    pub fn modes(self) -> &'static [(u32, &'static str)] {
        match self {
            Self::ArduPilot46 | Self::ArduPilot47 => &ardupilot::MODES,
            Self::Px4 | Self::Px4Development => &px4::MODES,
        }
    }

    /// The mode of that name, in any case of letters.
    pub fn mode(self, name: &str) -> Option<u32> {
        self.modes().iter().find(|(_, known)| known.eq_ignore_ascii_case(name)).map(|(number, _)| *number)
    }

    fn is_ardupilot(self) -> bool {
        matches!(self, Self::ArduPilot46 | Self::ArduPilot47)
    }

    fn encoding(self) -> Encoding {
        if self.is_ardupilot() { Encoding::Cast } else { Encoding::Bytewise }
    }

    fn ways(self) -> Ways {
        match self {
            Self::ArduPilot46 => Ways::ArduPilot(ArduPilot::new(Edition::V46)),
            Self::ArduPilot47 => Ways::ArduPilot(ArduPilot::new(Edition::V47)),
            Self::Px4 => Ways::Px4(Px4::new(false)),
            Self::Px4Development => Ways::Px4(Px4::new(true)),
        }
    }
}

/// What the autopilot's estimator sees of the vehicle.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Seen {
    /// Roll, pitch and yaw against the tunnel.
    pub attitude_rad: [f64; 3],
    /// Place along the axis.
    pub place_m: f64,
    /// Speed along the axis.
    pub speed_mps: f64,
    /// Where the axis points, from north.
    pub axis_yaw_rad: f64,
}

/// The autopilot.
#[derive(Clone, Debug)]
pub struct NamedAutopilot {
    kind: Kind,
    ways: Ways,
    mode: u32,
    armed: bool,
    table: Table,
    decoder: FrameDecoder,
    sender: Sender,
    streams: Streams,
    /// Answers that wait to be said.
    outbox: Vec<u8>,
    /// Parameters that somebody listed and that are still to be said.
    listed: std::ops::Range<usize>,
    started_s: f64,
    wants_reboot: bool,
    axis_yaw_rad: f64,
}

impl NamedAutopilot {
    /// An armed autopilot, on since long before time zero, in a mode in which it holds its place.
    pub fn new(kind: Kind) -> Self {
        let ways = kind.ways();
        Self {
            kind,
            mode: ways.first_mode(),
            armed: true,
            table: ways.stock(),
            ways,
            decoder: FrameDecoder::default(),
            sender: Sender::new(SYSTEM, AUTOPILOT_COMPONENT),
            streams: Streams::default(),
            outbox: Vec::new(),
            listed: 0..0,
            started_s: -BOOT_S,
            wants_reboot: false,
            axis_yaw_rad: 0.0,
        }
    }

    /// With a parameter as its owner has set it, in its own unit.
    ///
    /// # Panics
    /// If there is no such parameter.
    #[must_use]
    pub fn with(mut self, name: &str, value: f32) -> Self {
        assert!(self.table.set_up(name, value), "{} has no parameter {name}", self.kind.name());
        self
    }

    /// Which one it is.
    pub fn kind(&self) -> Kind {
        self.kind
    }

    /// Its mode, as in its heartbeat.
    pub fn mode(&self) -> u32 {
        self.mode
    }

    /// The mode switch is turned; a mode that is not modelled is refused, the same mode again is no change.
    pub fn set_mode(&mut self, mode: u32) {
        let known = self.kind.modes().iter().any(|(number, _)| *number == mode);
        if known && mode != self.mode {
            self.mode = mode;
            self.ways.enter();
        }
    }

    /// Loses its power for a moment: silent for [`BOOT_S`], then in the mode of its switch, with the parameters that were
    /// saved and without anything that it was told.
    pub fn reboot(&mut self, now_s: f64) {
        self.table.reload(now_s);
        self.ways = self.kind.ways();
        self.decoder = FrameDecoder::default();
        self.sender = Sender::new(SYSTEM, AUTOPILOT_COMPONENT);
        self.streams = Streams::default();
        self.outbox.clear();
        self.listed = 0..0;
        self.started_s = now_s;
        self.wants_reboot = false;
    }

    /// Is it more than a bootloader?
    pub fn is_up(&self, now_s: f64) -> bool {
        now_s - self.started_s >= BOOT_S
    }

    /// All parameters, in their own units.
    pub fn parameters(&self) -> BTreeMap<&'static str, f64> {
        self.table.snapshot()
    }

    /// Changes of parameters that went to the permanent memory, which wears.
    pub fn saves(&self) -> u32 {
        self.table.saves()
    }

    /// The forward speed that it steers for, where pilot or mission wants `wish_mps`. Zero is a hover in every mode.
    ///
    /// A pilot moves the stick as far as the wish needs, and no further than it goes. A mission, once begun (a wish above
    /// zero), flies as fast as the autopilot was set up for: it knows no wish.
    pub fn aim_mps(&mut self, now_s: f64, wish_mps: f64) -> f64 {
        if !self.is_up(now_s) {
            return 0.0;
        }
        self.ways.aim_mps(now_s, self.mode, &self.table, wish_mps)
    }

    /// What it says now. An autopilot that sees nothing of the vehicle still lives and answers.
    pub fn say<'s>(&mut self, now_s: f64, seen: impl Into<Option<&'s Seen>>) -> Vec<u8> {
        let seen = seen.into();
        if std::mem::take(&mut self.wants_reboot) {
            self.reboot(now_s);
        }
        self.table.save_due(now_s);
        self.axis_yaw_rad = seen.map_or(self.axis_yaw_rad, |seen| seen.axis_yaw_rad);
        if !self.is_up(now_s) {
            return Vec::new();
        }
        let mut said = std::mem::take(&mut self.outbox);
        if let Some(index) = self.listed.next() {
            said.extend(self.table.tell(&mut self.sender, index, self.kind.encoding()));
        }
        if self.streams.heartbeat.is_due(now_s) {
            let autopilot = if self.kind.is_ardupilot() { ARDUPILOT } else { PX4 };
            let base_mode = CUSTOM | if self.armed { ARMED } else { 0 };
            said.extend(self.sender.vehicle_heartbeat(VehicleBeat { autopilot, base_mode, custom_mode: self.mode }));
        }
        if let Some(seen) = seen {
            self.say_state(now_s, seen, &mut said);
        }
        said
    }

    fn say_state(&mut self, now_s: f64, seen: &Seen, said: &mut Vec<u8>) {
        let boot_ms = ((now_s - self.started_s) * 1000.0) as u32;
        let sender = &mut self.sender;
        let (sin, cos) = seen.axis_yaw_rad.sin_cos();
        if self.streams.attitude.is_due(now_s) {
            let [roll, pitch, yaw] = seen.attitude_rad;
            let yaw = adit_geometry::angles::wrap_half_turn(yaw + seen.axis_yaw_rad);
            said.extend(sender.attitude(boot_ms, [roll, pitch, yaw].map(|angle| angle as f32)));
        }
        if self.streams.place.is_due(now_s) {
            let along = |length: f64| [length * cos, length * sin, 0.0].map(|part| part as f32);
            said.extend(sender.local_position(boot_ms, along(seen.place_m), along(seen.speed_mps)));
        }
        if self.streams.head_up.is_due(now_s) {
            said.extend(sender.head_up(seen.speed_mps.abs() as f32));
        }
    }

    /// What it says of its battery, to ground stations only.
    pub fn tell_battery(&mut self, remaining: f64) -> OutFrame {
        let voltage_v = EMPTY_V + (FULL_V - EMPTY_V) * remaining;
        self.sender.battery(voltage_v as f32, remaining as f32)
    }

    /// Tells whoever reads it.
    fn text(&mut self, words: &str) {
        let text = words.chars().take(TEXT_BYTES).collect();
        let frame = self.sender.text(Severity::Error, &text);
        self.outbox.extend(frame);
    }
}

#[cfg(test)]
mod tests;
