//! What the link says, gathered: the newest of each, and how often each came.

use adit_protocol::mavlink::{
    AUTOPILOT_COMPONENT, BOARD_COMPONENT, CAMERA_COMPONENT, Incoming, NO_AUTOPILOT, VehicleBeat,
};
use adit_protocol::record::{FAILED, Failure, Mode};
use adit_protocol::telemetry::{Telemetry, Tunnelled};

use crate::link::Heard;

/// `MAV_SEVERITY_WARNING`: the mildest words that are quoted.
const WARNING: u8 = 4;

/// What was heard since the last [`Watch::begin`].
#[derive(Clone, Debug, Default)]
pub(super) struct Watch {
    system: u8,
    /// The newest, and how many came.
    pub(super) telemetry: Option<Telemetry>,
    pub(super) telemetries: u32,
    /// Of these, with a reading up, right, down, left; and with a place in the section.
    pub(super) readings: [u32; 4],
    pub(super) places: u32,
    /// The board's mode by its newest heartbeat.
    pub(super) mode: Option<u32>,
    /// The autopilot's newest heartbeat.
    pub(super) vehicle: Option<VehicleBeat>,
    /// The board's newest warning.
    pub(super) warning: Option<String>,
    pub(super) failure: Option<Failure>,
    /// Photos that were taken, and that were not.
    pub(super) taken: u32,
    pub(super) missed: u32,
}

impl Watch {
    /// Listens to the parts of this vehicle.
    pub(super) fn new(system: u8) -> Self {
        Self { system, ..Self::default() }
    }

    /// Forgets what was heard.
    pub(super) fn begin(&mut self) {
        *self = Self { system: self.system, vehicle: self.vehicle, ..Self::default() };
    }

    /// Whether the board is in this mode.
    pub(super) fn is_in(&self, mode: Mode) -> bool {
        self.mode == Some(mode as u32)
    }

    /// Takes a message in.
    pub(super) fn hear(&mut self, heard: &Heard) {
        let (Some(incoming), true) = (&heard.incoming, heard.trust.is_believed() && heard.frame.system == self.system)
        else {
            return;
        };
        match (heard.frame.component, incoming) {
            (AUTOPILOT_COMPONENT, &Incoming::Heartbeat { autopilot, base_mode, custom_mode, .. })
                if autopilot != NO_AUTOPILOT =>
            {
                self.vehicle = Some(VehicleBeat { autopilot, base_mode, custom_mode });
            }
            (BOARD_COMPONENT, Incoming::Heartbeat { custom_mode, .. }) => self.mode = Some(*custom_mode),
            (BOARD_COMPONENT, Incoming::Tunnel { kind, payload, .. }) => {
                if let Some(Tunnelled::Telemetry(telemetry)) = Tunnelled::read(*kind, payload) {
                    self.take(telemetry);
                }
            }
            (BOARD_COMPONENT, Incoming::Text { severity, text }) if *severity <= WARNING => self.read(text),
            (CAMERA_COMPONENT, Incoming::ImageCaptured { result, .. }) => {
                let count = if *result == 1 { &mut self.taken } else { &mut self.missed };
                *count += 1;
            }
            _ => {}
        }
    }

    fn take(&mut self, telemetry: Telemetry) {
        self.telemetries += 1;
        for (count, range_m) in self.readings.iter_mut().zip(telemetry.ranges_m) {
            *count += u32::from(range_m.is_some());
        }
        self.places += u32::from(telemetry.offset_m.is_some());
        self.telemetry = Some(telemetry);
    }

    fn read(&mut self, text: &str) {
        let failed = text.strip_prefix(FAILED);
        let failure = failed.and_then(|word| Failure::ALL.into_iter().find(|failure| failure.word() == word));
        match failure {
            Some(_) => self.failure = failure,
            // That it is in fault its heartbeat says.
            None if text.starts_with("rotator: ") => {}
            None => self.warning = Some(text.to_owned()),
        }
    }
}
