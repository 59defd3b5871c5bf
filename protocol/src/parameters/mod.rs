//! Everything the board must know before a flight: plain data without allocation, `f32`, SI.
//!
//! The mission file fills it on a host, the board keeps it in its memory, and every log starts with it. Each default
//! stands with its reason.

mod slot;
mod table;

use adit_geometry::camera::{Camera, Distortion};
use adit_geometry::profile::ProfileSpec;
use adit_geometry::rig::{ImageUp, Rig};
use serde::{Deserialize, Serialize};

pub use table::{ParameterTable, Row, SetError};

use crate::beams::Beams;

/// The board's parameters.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Parameters {
    /// The lining's nominal section.
    pub profile: ProfileSpec<f32>,
    /// The camera whose footprint the speed law uses.
    pub camera: Camera<f32>,
    /// How it sits on the shaft.
    pub rig: Rig<f32>,
    /// How fast the vehicle may go.
    pub speed: SpeedParameters,
    /// The shaft's servo and encoder.
    pub shaft: ShaftParameters,
    /// Camera trigger, its answer, and the light.
    pub shutter: ShutterParameters,
    /// The range sensors.
    pub ranges: RangeParameters,
    /// The link to the autopilot.
    pub link: LinkParameters,
    /// What is written to the log besides tags and events.
    pub log: LogParameters,
}

/// Which bound on the step per image the board enforces.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum SpeedBound {
    /// The paper's formula (worst edge of one image), with the smallest clearance as radius on profiles that are no circle.
    Paper,
    /// The exact bound: every point of the wall in at least one image.
    OneView,
    /// The exact bound: every point of the wall in at least two images.
    TwoViews,
}

/// How fast the vehicle may go.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct SpeedParameters {
    /// The bound in force.
    pub bound: SpeedBound,
    /// Share of the bound that is asked for, in (0, 1].
    pub margin: f32,
    /// Time from a change of the limit to the vehicle flying it.
    pub latency_s: f32,
    /// Never faster than this, whatever the bound says.
    pub max_speed_mps: f32,
    /// Largest allowed distance from the axis, sideways and vertically; beyond it the limit is zero.
    pub offset_max_m: f32,
    /// Time between two images before it has been measured.
    pub image_period_s: f32,
}

impl Default for SpeedParameters {
    fn default() -> Self {
        Self {
            // Two views are what a reconstruction needs.
            bound: SpeedBound::TwoViews,
            // Covers lining tolerances and attitude, which tilts the footprint by a few per cent.
            margin: 0.9,
            // Link, autopilot loop and the vehicle's braking at inspection speeds.
            latency_s: 0.5,
            // A hand can stop a vehicle at walking pace.
            max_speed_mps: 1.0,
            // A sixth of the paper's radius: pilots hold half of that by the display.
            offset_max_m: 0.5,
            // A HERO4 stores a photo in about a second; turning and settling overlap with it in part.
            image_period_s: 1.5,
        }
    }
}

/// The shaft's servo and encoder.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct ShaftParameters {
    /// Is an absolute encoder fitted? Without one, angles are the commanded ones after the time a turn takes.
    pub encoder: bool,
    /// The servo.
    pub servo: ServoParameters,
    /// Highest speed of the shaft: what the servo turns at [`ServoParameters::full_us`].
    pub slew_radps: f32,
    /// The shaft is still when the encoder stays within this of the commanded angle.
    pub settle_tolerance_rad: f32,
    /// How long it must stay there before the shutter is fired.
    pub settle_dwell_s: f32,
    /// After this a turn is called late, and the photo is taken where the shaft is (tag flag `shaft-moving`).
    pub turn_timeout_s: f32,
    /// Late turns in a row after which the shaft counts as stalled (mode Fault).
    pub late_turns_to_fault: u8,
}

impl Default for ShaftParameters {
    fn default() -> Self {
        Self {
            encoder: true,
            servo: ServoParameters::default(),
            // 60 degrees in 0.2 s, a common digital servo under load.
            slew_radps: 5.0,
            // 1 degree: the backlash of a geared servo.
            settle_tolerance_rad: 0.0175,
            // Several periods of the mount's swing, tens of hertz.
            settle_dwell_s: 0.1,
            // Three times an unhurried turn of 36 degrees.
            turn_timeout_s: 1.0,
            // One late turn is friction, five are a jammed shaft.
            late_turns_to_fault: 5,
        }
    }
}

/// A servo for continuous rotation: the pulse's width commands a speed, without end.
///
/// A servo that holds an angle cannot turn without end, as a spiral of photos must; so the board closes the loop over the
/// shaft's encoder itself.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct ServoParameters {
    /// Width of the pulse at which the shaft stands.
    pub neutral_us: f32,
    /// What is added to it for full speed; negative if the servo turns the other way round.
    pub full_us: f32,
    /// Highest acceleration asked for.
    pub acceleration_radps2: f32,
    /// Below this speed the servo does not move at all.
    pub slowest_radps: f32,
}

impl Default for ServoParameters {
    fn default() -> Self {
        Self {
            // The middle of every servo's range.
            neutral_us: 1500.0,
            // 1000 to 2000 microseconds is what every servo takes.
            full_us: 500.0,
            // Full speed in a tenth of a second: a light camera on a geared servo.
            acceleration_radps2: 30.0,
            // A fiftieth of full speed: the dead band around neutral.
            slowest_radps: 0.1,
        }
    }
}

/// What the camera tells the board over wires.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum CaptureWiring {
    /// Nothing (opto-coupler on the shutter button): captures stay `commanded`.
    None,
    /// A line that is active while the camera is busy.
    Busy,
    /// The busy line, and a count of photos stored.
    Confirm,
}

/// How the camera is fired.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Trigger {
    /// An opto-coupler on the shutter button.
    Contact,
    /// The connector on a HERO4's back, on I2C1; then the range sensors are on a Hub and there is no encoder. Experimental.
    HeroBus,
}

/// Camera trigger, its answer, and the light.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct ShutterParameters {
    /// How the camera is fired.
    pub trigger: Trigger,
    /// What the camera tells.
    pub wiring: CaptureWiring,
    /// Typical time from the shutter's command to the exposure's start (to be measured per camera).
    pub trigger_latency_s: f32,
    /// Longest time from the shutter's command to the exposure's start; the shaft stays still for it.
    pub trigger_latency_max_s: f32,
    /// Longest exposure.
    pub exposure_s: f32,
    /// How long the shutter line is held.
    pub pulse_s: f32,
    /// Does the busy line rise at the exposure's start (true), or when the button press is noticed (false)?
    pub busy_marks_exposure: bool,
    /// Shortest time between two shutter commands; a camera that is still writing ignores the second.
    pub min_interval_s: f32,
    /// Longest the camera may stay busy with one photo.
    pub busy_timeout_s: f32,
    /// Longest time from the shutter's command to the count of stored photos going up.
    pub confirm_timeout_s: f32,
    /// Longest time from the end of busy to the count of stored photos going up.
    pub confirm_grace_s: f32,
    /// How often a missed photo is repeated at the same angle.
    pub retries: u8,
    /// Captures missed in a row after which the camera counts as dead (mode Fault).
    pub misses_to_fault: u8,
    /// Brightness of the light during an exposure, 0 to 1.
    pub light_level: f32,
    /// How long before the shutter's command the light goes on.
    pub light_lead_s: f32,
}

impl Default for ShutterParameters {
    fn default() -> Self {
        Self {
            // The opto-coupler works with every camera and firmware.
            trigger: Trigger::Contact,
            wiring: CaptureWiring::None,
            // No maker documents it; 0.2 s is what autopilot developers assume for such cameras.
            trigger_latency_s: 0.2,
            // Twice the typical latency.
            trigger_latency_max_s: 0.4,
            // A lit wall at 3 m.
            exposure_s: 0.02,
            // A button press that every camera notices.
            pulse_s: 0.1,
            // Only a flash contact marks the exposure.
            busy_marks_exposure: false,
            // A HERO4 stores a 12 MP photo in about that time; only a busy line tells better.
            min_interval_s: 1.0,
            // Twice a slow card's time for 12 MP.
            busy_timeout_s: 3.0,
            // As long as the camera may be busy.
            confirm_timeout_s: 3.0,
            // The camera counts when it has written; a slow status poll lies between.
            confirm_grace_s: 0.5,
            // Two: a third failure is no accident.
            retries: 2,
            // Three angles in a row, each with two retries.
            misses_to_fault: 9,
            light_level: 1.0,
            // LED drivers reach their level within some tens of milliseconds.
            light_lead_s: 0.05,
        }
    }
}

/// Family of range sensor; decides what the special values of a reading mean.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum RangeFamily {
    /// `TeraRanger` Evo.
    Evo,
    /// `TeraRanger` One on I2C or UART.
    One,
    /// `TeraRanger` One on a Hub.
    OneHub,
}

/// How the range sensors are wired.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum RangeBus {
    /// Each on I2C, at an address of its own.
    I2c,
    /// All on a `TeraRanger` Hub, which talks by UART.
    Hub,
}

/// The range sensors.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct RangeParameters {
    /// Family of all of them.
    pub family: RangeFamily,
    /// Which of the four are fitted.
    pub fitted: Beams<bool>,
    /// Is a fifth fitted beside the camera?
    pub head_fitted: bool,
    /// How they are wired.
    pub bus: RangeBus,
    /// Where each is found: its I2C address (7 bits), or its channel on the Hub (0 to 7).
    pub port: Beams<u8>,
    /// Where the fifth is found.
    pub head_port: u8,
    /// Where each sits in the section, `[y, z]` in the body frame.
    pub lever_m: Beams<[f32; 2]>,
    /// Shortest range that is believed.
    pub min_m: f32,
    /// Longest range that is believed.
    pub max_m: f32,
    /// One standard deviation of a reading, the lining's roughness included.
    pub sigma_m: f32,
    /// A reading is stale when no new sample has come for this long.
    pub stale_s: f32,
    /// A sensor is frozen when its samples go on but the value has not moved for this long; 0 switches the check off.
    pub frozen_s: f32,
    /// Samples in a row that decode from zero after which the sensor is suspect (a dead bus reads zeros with a valid CRC).
    pub zero_run: u16,
    /// Change between two samples that no vehicle makes.
    pub jump_m: f32,
    /// Good samples in a row that clear a sensor's fault.
    pub good_run: u16,
}

impl Default for RangeParameters {
    fn default() -> Self {
        Self {
            family: RangeFamily::Evo,
            fitted: Beams { up: true, right: true, down: true, left: true },
            head_fitted: false,
            bus: RangeBus::I2c,
            // An Evo leaves the factory at 0x31; four on one bus are re-addressed upwards from there.
            port: Beams { up: 0x31, right: 0x32, down: 0x33, left: 0x34 },
            head_port: 0x35,
            lever_m: Beams::default(),
            // Evo 15m: 0.5 m to 15 m (maker's header files).
            min_m: 0.5,
            max_m: 15.0,
            // 2 cm: sensor noise and an uneven lining.
            sigma_m: 0.02,
            // Five samples at 10 Hz, the slowest rate in use.
            stale_s: 0.5,
            // A hovering vehicle moves by a millimetre well within two seconds.
            frozen_s: 2.0,
            // Half a second at 100 Hz.
            zero_run: 50,
            // 1 m between two samples is 10 m/s at the slowest rate in use.
            jump_m: 1.0,
            // As many good samples as it takes to rule out a flicker.
            good_run: 10,
        }
    }
}

/// The link to the autopilot.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct LinkParameters {
    /// Baud rate of TELEM1.
    pub baud: u32,
    /// Yaw of the tunnel's axis as the autopilot counts yaw; `None`: the vehicle's yaw when it is armed.
    pub axis_yaw_rad: Option<f32>,
    /// With a key: must the autopilot's attitude, place and speed be signed as well? Commands must be in any case.
    pub signed_telemetry: bool,
    /// The speed at which the board leads the vehicle along the tunnel while it scans in `ArduPilot`'s mode Guided, as far as
    /// the limit allows; 0 leaves that to others.
    pub lead_mps: f32,
}

impl Default for LinkParameters {
    fn default() -> Self {
        Self {
            // What both autopilots recommend for a companion computer.
            baud: 921_600,
            // A vehicle is armed where it will fly: nose down the tunnel.
            axis_yaw_rad: None,
            // Autopilots that sign do not always sign what they stream.
            signed_telemetry: false,
            // The pilot leads.
            lead_mps: 0.0,
        }
    }
}

/// What is written to the log besides tags and events.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct LogParameters {
    /// Time between two samples of centring and speed limit.
    pub sample_period_s: f32,
}

impl Default for LogParameters {
    fn default() -> Self {
        // Twice a second: 60 bytes each, 0.5 MB per hour.
        Self { sample_period_s: 0.5 }
    }
}

impl Default for Parameters {
    /// The paper's set-up: a circle of 3 m radius, 12 images per turn, a lens of 101 degrees around and 60 along.
    fn default() -> Self {
        Self {
            profile: ProfileSpec::Circle { radius_m: 3.0 },
            camera: Camera {
                width_px: 4000,
                height_px: 3000,
                // tan(101 / 2 deg) = 1.2131 and tan(60 / 2 deg) = 0.57735 on the plane z = 1.
                focal_px: [1648.7, 2598.1],
                centre_px: [2000.0, 1500.0],
                distortion: Distortion::BrownConrady([0.0; 5]),
            },
            rig: Rig {
                images_per_turn: 12,
                image_up: ImageUp::Forward,
                lever_radial_m: 0.0,
                lever_forward_m: 0.0,
                mount_rotvec_rad: [0.0; 3],
            },
            speed: SpeedParameters::default(),
            shaft: ShaftParameters::default(),
            shutter: ShutterParameters::default(),
            ranges: RangeParameters::default(),
            link: LinkParameters::default(),
            log: LogParameters::default(),
        }
    }
}
