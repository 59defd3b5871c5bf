//! The vehicle as its autopilot tells it: who it is, its mode, how it lies, where it is along the tunnel.
//!
//! Frame: the autopilot counts north, east, down and yaw from north. The tunnel's axis lies at a yaw that is a parameter, or
//! the vehicle's own when it was armed; the odometer then counts from there.

use adit_geometry::angles::unwrap_near;
use adit_protocol::mavlink::{AUTOPILOT_COMPONENT, Autopilot, Incoming, NO_AUTOPILOT, RawFrame};
use adit_protocol::parameters::LinkParameters;
use nalgebra::{ComplexField, Quaternion, UnitQuaternion, Vector3};

use super::speed::Speedometer;
use super::{Timed, fresh};
use crate::io::Inputs;
use crate::time::has_passed;

/// An autopilot sends a heartbeat every second: two may be lost.
const ALIVE_S: f32 = 2.5;
/// Attitude comes 10 to 50 times a second.
const ATTITUDE_STALE_S: f32 = 0.5;
/// Place comes 5 to 50 times a second.
const PLACE_STALE_S: f32 = 1.0;
/// The vehicle's clock may seem to run backwards by this much: messages overtake each other.
const CLOCK_SLACK_MS: u32 = 1000;
/// `MAV_FRAME_LOCAL_NED`.
const LOCAL_NED: u8 = 1;
/// `MAV_FRAME_BODY_NED` and `MAV_FRAME_BODY_FRD`.
const BODY: [u8; 2] = [8, 12];

/// What the link knows of the vehicle at one moment.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct VehicleView {
    /// Has the autopilot's heartbeat been heard lately?
    pub alive: bool,
    /// Roll, pitch, yaw against the tunnel.
    pub attitude_rad: Option<[f32; 3]>,
    /// Distance along the axis.
    pub odometer_m: Option<f32>,
    /// Speed along the axis.
    pub speed_mps: Option<f32>,
}

impl VehicleView {
    /// Puts what is known into the inputs.
    pub fn fill(&self, inputs: &mut Inputs) {
        inputs.autopilot_alive = self.alive;
        inputs.attitude_rad = self.attitude_rad;
        inputs.odometer_m = self.odometer_m;
        inputs.speed_mps = self.speed_mps;
    }
}

/// The vehicle.
#[derive(Clone, Debug)]
pub(super) struct Vehicle {
    /// Its number, once its autopilot was heard.
    pub(super) system: Option<u8>,
    /// What its autopilot is, and the mode it is in.
    pub(super) mode: Option<(Autopilot, u32)>,
    /// Major and minor, once it has told.
    pub(super) version: Option<[u8; 2]>,
    heartbeat_us: Option<u64>,
    attitude: Timed<[f32; 3]>,
    /// North and east.
    place: Timed<[f32; 2]>,
    speed: Speedometer,
    resets: Option<u8>,
    /// When place and velocity came without their quality.
    local_us: Option<u64>,
    boot_ms: Option<u32>,
    began_anew: bool,
    axis_yaw_rad: Option<f32>,
    /// Place along the axis where the odometer is zero.
    zero_m: f32,
    latches_axis: bool,
}

impl Vehicle {
    pub(super) fn new(parameters: &LinkParameters) -> Self {
        let axis_yaw_rad = parameters.axis_yaw_rad.filter(ComplexField::is_finite);
        Self {
            system: None,
            mode: None,
            version: None,
            heartbeat_us: None,
            attitude: None,
            place: None,
            speed: Speedometer::default(),
            resets: None,
            local_us: None,
            boot_ms: None,
            began_anew: false,
            axis_yaw_rad,
            zero_m: 0.0,
            latches_axis: axis_yaw_rad.is_none(),
        }
    }

    /// Whether a frame comes from the autopilot that is followed; before one is, from any.
    pub(super) fn is_from_autopilot(&self, frame: &RawFrame) -> bool {
        frame.component == AUTOPILOT_COMPONENT && self.system.is_none_or(|system| system == frame.system)
    }

    /// Has the autopilot's heartbeat been heard lately?
    pub(super) fn is_alive(&self, now_us: u64) -> bool {
        self.heartbeat_us.is_some_and(|at_us| !has_passed(at_us, now_us, ALIVE_S))
    }

    /// Has attitude or place not come lately?
    pub(super) fn is_quiet(&self, now_us: u64) -> bool {
        fresh(self.attitude, now_us, ATTITUDE_STALE_S).is_none() || fresh(self.place, now_us, PLACE_STALE_S).is_none()
    }

    /// Whether the autopilot has begun anew, or come back, since this was asked last.
    pub(super) fn take_began_anew(&mut self) -> bool {
        core::mem::take(&mut self.began_anew)
    }

    /// Takes what the autopilot says of the vehicle.
    pub(super) fn hear(&mut self, now_us: u64, frame: &RawFrame, incoming: &Incoming) {
        match *incoming {
            Incoming::Heartbeat { autopilot, custom_mode, .. } if autopilot != NO_AUTOPILOT => {
                if !self.is_alive(now_us) {
                    // It may be another one.
                    (self.began_anew, self.version) = (true, None);
                }
                self.system = Some(frame.system);
                self.mode = Some((Autopilot::from(autopilot), custom_mode));
                self.heartbeat_us = Some(now_us);
            }
            Incoming::Attitude { angles_rad } if angles_rad.iter().all(ComplexField::is_finite) => {
                self.attitude = Some((angles_rad, now_us));
            }
            Incoming::LocalPosition { boot_ms, position_m, velocity_mps } => {
                self.began_anew |=
                    self.boot_ms.is_some_and(|before_ms| boot_ms.saturating_add(CLOCK_SLACK_MS) < before_ms);
                (self.boot_ms, self.local_us) = (Some(boot_ms), Some(now_us));
                self.move_to(now_us, position_m, velocity_mps);
            }
            // The estimate without its quality comes at the same time on most vehicles; then this one has only its quality to add.
            Incoming::Odometry { frame, child_frame, position_m, rotation, velocity_mps, resets, quality } => {
                if self.resets.replace(resets).is_some_and(|before| before != resets) || quality < 0 {
                    self.speed.doubt(now_us);
                }
                let velocity_mps =
                    if BODY.contains(&child_frame) { turned(rotation, velocity_mps) } else { velocity_mps };
                let known = frame == LOCAL_NED && (child_frame == LOCAL_NED || BODY.contains(&child_frame));
                let local_is_fresh = self.local_us.is_some_and(|at_us| !has_passed(at_us, now_us, PLACE_STALE_S));
                if known && quality >= 0 && !local_is_fresh {
                    self.move_to(now_us, position_m, velocity_mps);
                }
            }
            Incoming::Version { version: [major, minor, ..], .. } => self.version = Some([major, minor]),
            Incoming::HeadUp { ground_speed_mps } => self.speed.hear_head_up(now_us, ground_speed_mps),
            _ => {}
        }
    }

    fn move_to(&mut self, now_us: u64, [north_m, east_m, _]: [f32; 3], [north_mps, east_mps, _]: [f32; 3]) {
        if [north_m, east_m, north_mps, east_mps].iter().all(ComplexField::is_finite) {
            self.place = Some(([north_m, east_m], now_us));
            self.speed.hear_velocity(now_us, [north_mps, east_mps]);
        }
    }

    /// The axis is where the vehicle's nose points, and the odometer begins here.
    pub(super) fn latch_axis(&mut self, now_us: u64) {
        let attitude = fresh(self.attitude, now_us, ATTITUDE_STALE_S);
        if let Some([_, _, yaw_rad]) = attitude.filter(|_| self.latches_axis) {
            self.axis_yaw_rad = Some(yaw_rad);
            self.zero_m = fresh(self.place, now_us, PLACE_STALE_S).map_or(0.0, |place_m| along(place_m, yaw_rad));
        }
    }

    /// Yaw of the tunnel's axis.
    pub(super) fn axis_yaw_rad(&self) -> Option<f32> {
        self.axis_yaw_rad
    }

    /// What is known of the vehicle.
    pub(super) fn view(&self, now_us: u64) -> VehicleView {
        let axis_yaw_rad = self.axis_yaw_rad;
        let attitude = fresh(self.attitude, now_us, ATTITUDE_STALE_S);
        let place = fresh(self.place, now_us, PLACE_STALE_S).zip(axis_yaw_rad);
        VehicleView {
            alive: self.is_alive(now_us),
            // Before the axis is known the nose counts as pointing along it.
            attitude_rad: attitude.map(|[roll_rad, pitch_rad, yaw_rad]| {
                [roll_rad, pitch_rad, axis_yaw_rad.map_or(0.0, |axis_rad| unwrap_near(yaw_rad - axis_rad, 0.0))]
            }),
            odometer_m: place.map(|(place_m, yaw_rad)| along(place_m, yaw_rad) - self.zero_m),
            speed_mps: axis_yaw_rad.and_then(|yaw_rad| self.speed.along_mps(now_us, yaw_rad)),
        }
    }
}

/// A horizontal vector's part along the axis.
pub(super) fn along([north, east]: [f32; 2], axis_yaw_rad: f32) -> f32 {
    let (sin, cos) = ComplexField::sin_cos(axis_yaw_rad);
    north * cos + east * sin
}

/// A vector of the body in the frame that the body lies in by this rotation, w first.
fn turned([w, x, y, z]: [f32; 4], vector: [f32; 3]) -> [f32; 3] {
    let rotation = UnitQuaternion::from_quaternion(Quaternion::new(w, x, y, z));
    (rotation * Vector3::from(vector)).into()
}
