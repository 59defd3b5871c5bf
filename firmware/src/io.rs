//! What goes into the controller and what comes out of it: plain data.

use adit_protocol::beams::Beams;
use adit_protocol::parameters::RangeFamily;
use adit_protocol::record::{Entry, Mode};
use serde::{Deserialize, Serialize};

/// The most log entries that one step hands out; what does not fit waits for the next step.
pub const MAX_ENTRIES: usize = 8;

/// What a range sensor said, decoded per family. "Cannot measure" is never "far".
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub enum RangeReading {
    /// A distance in metres.
    Measured(f32),
    /// Nearer than the sensor can measure.
    TooClose,
    /// Farther than the sensor can measure.
    TooFar,
    /// No answer from the target, for whatever reason.
    CannotMeasure,
    /// The sensor does not answer.
    #[default]
    Disconnected,
}

impl RangeReading {
    /// Decodes the raw value of a sensor, in millimetres with special values.
    ///
    /// Special values: Evo I2C manual p. 12; One product specification p. 13; One on a Hub: maker's driver
    /// `teraranger_one.h`. On a One, zero means any error, near and far included.
    pub fn from_raw(family: RangeFamily, raw_mm: u16) -> Self {
        let measured = Self::Measured(f32::from(raw_mm) / 1000.0);
        match family {
            RangeFamily::Evo => match raw_mm {
                0 => Self::TooClose,
                1 => Self::CannotMeasure,
                0xFFFF => Self::TooFar,
                _ => measured,
            },
            RangeFamily::One => match raw_mm {
                200..=14_000 => measured,
                _ => Self::CannotMeasure,
            },
            RangeFamily::OneHub => match raw_mm {
                0 => Self::TooFar,
                200 => Self::TooClose,
                0xFFFF => Self::Disconnected,
                _ => measured,
            },
        }
    }
}

impl RangeReading {
    /// The raw value that decodes to this reading; what a family cannot say comes as its nearest kin.
    pub fn to_raw(self, family: RangeFamily) -> u16 {
        match (family, self) {
            (_, Self::Measured(range_m)) => (range_m * 1000.0 + 0.5) as u16,
            (RangeFamily::Evo, Self::CannotMeasure) => 1,
            (RangeFamily::Evo, Self::TooFar) | (RangeFamily::OneHub, Self::Disconnected) => 0xFFFF,
            (RangeFamily::OneHub, Self::TooClose) => 200,
            // Too close on an Evo, any error on a One, too far on a Hub.
            _ => 0,
        }
    }
}

/// The latest sample of a range sensor.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct RangeSample {
    /// What it said.
    pub reading: RangeReading,
    /// Counts the sensor's samples (wrapping); unchanged means that nothing new has come since the last step.
    pub count: u32,
}

/// What is known of the camera, as far as it is wired.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct CameraStatus {
    /// Level of the busy line: true while the camera is busy.
    pub busy: bool,
    /// Photos that the camera has reported as stored since its start (wrapping).
    pub photos_stored: u32,
}

/// What pilot or operator want.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Command {
    /// From Idle: run the self-test and become Ready.
    Arm,
    /// From Ready: take photos.
    Start,
    /// Stop taking photos, back to Ready.
    Stop,
    /// Back to Idle from anywhere; also acknowledges a fault.
    Disarm,
}

/// Everything the controller sees in one step.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Inputs {
    /// The four body-fixed range sensors.
    pub ranges: Beams<RangeSample>,
    /// The range sensor on the rotating head, along the optical axis.
    pub head: RangeSample,
    /// Section angle of the optical axis as the encoder says, radians, any multiple of turns; `None` if it is silent.
    pub shaft_encoder_rad: Option<f32>,
    /// Roll, pitch, yaw of the body against the tunnel (yaw against its axis), radians.
    pub attitude_rad: Option<[f32; 3]>,
    /// Distance along the axis from any source; drift allowed.
    pub odometer_m: Option<f32>,
    /// Speed along the axis from any source, forward positive.
    pub speed_mps: Option<f32>,
    /// The camera.
    pub camera: CameraStatus,
    /// A command that arrived since the last step; each is given once.
    pub command: Option<Command>,
    /// Has the autopilot's heartbeat been heard lately?
    pub autopilot_alive: bool,
    /// Can the log not be written (card full, pulled, broken)?
    pub log_lost: bool,
}

/// Where the vehicle is in the section.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct CentringStatus {
    /// Position `[y, z]` in the section.
    pub offset_m: [f32; 2],
    /// One standard deviation of it, per axis.
    pub sigma_m: [f32; 2],
    /// Which beams took part.
    pub used: Beams<bool>,
}

/// Figures for the pilot's display and for telemetry.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Display {
    /// Captures commanded so far.
    pub captures: u32,
    /// Captures whose photo is known to be missing.
    pub missed: u32,
    /// Level of water or sludge above the floor.
    pub water_level_m: Option<f32>,
    /// Measured speed along the axis.
    pub speed_mps: Option<f32>,
    /// Is the measured speed above the limit?
    pub overspeed: bool,
    /// Is a gap open that halves the limit?
    pub gap_open: bool,
    /// Which range sensors are faulty.
    pub range_faults: Beams<bool>,
}

/// Everything the controller wants done after one step. Levels hold until the next step.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Outputs {
    /// The mode.
    pub mode: Mode,
    /// Where the shaft shall be: section angle of the optical axis, grows over turns.
    pub shaft_setpoint_rad: f32,
    /// Width of the servo's pulse in microseconds; `None`: no pulse, and the servo lets go.
    pub servo_pulse_us: Option<f32>,
    /// Shutter line: true while it is held.
    pub shutter: bool,
    /// Brightness of the light, 0 to 1.
    pub light_level: f32,
    /// The highest forward speed allowed; `None` outside a scan, where the board makes no claim.
    pub speed_limit_mps: Option<f32>,
    /// Where the vehicle is; `None` if that cannot be solved.
    pub centring: Option<CentringStatus>,
    /// Figures for people.
    pub display: Display,
    /// To be appended to the log, in this order.
    pub entries: heapless::Vec<Entry, MAX_ENTRIES>,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn special_values_are_decoded_per_family() {
        let rows = [
            (0, [RangeReading::TooClose, RangeReading::CannotMeasure, RangeReading::TooFar]),
            (1, [RangeReading::CannotMeasure, RangeReading::CannotMeasure, RangeReading::Measured(0.001)]),
            (200, [RangeReading::Measured(0.2), RangeReading::Measured(0.2), RangeReading::TooClose]),
            (3000, [RangeReading::Measured(3.0); 3]),
            (0xFFFF, [RangeReading::TooFar, RangeReading::CannotMeasure, RangeReading::Disconnected]),
        ];
        for (raw_mm, expected) in rows {
            let families = [RangeFamily::Evo, RangeFamily::One, RangeFamily::OneHub];
            assert_eq!(families.map(|family| RangeReading::from_raw(family, raw_mm)), expected, "raw {raw_mm}");
            for family in families {
                let reading = RangeReading::from_raw(family, raw_mm);
                assert_eq!(RangeReading::from_raw(family, reading.to_raw(family)), reading, "{family:?} {raw_mm}");
            }
        }
    }
}
