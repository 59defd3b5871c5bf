//! A world of a few lines: a circle, a servo without inertia, a camera that may miss, a vehicle that flies what it is allowed to.

use adit_firmware::controller::Controller;
use adit_firmware::io::{CameraStatus, Command, Inputs, Outputs, RangeReading, RangeSample};
use adit_protocol::beams::Beams;
use adit_protocol::parameters::{Parameters, SpeedBound};
use adit_protocol::record::{Entry, EventKind, Mode};
use adit_protocol::tag::CaptureTag;

/// 200 Hz.
pub(crate) const TICK_US: u64 = 5_000;
const TICK_S: f32 = 0.005;
/// Where the toy's servo stands: not quite where the board believes.
const NEUTRAL_US: f32 = 1503.0;

/// A small generator (Knuth's MMIX constants), so that a seed is all a test needs.
#[derive(Clone, Debug)]
pub(crate) struct Dice(pub u64);

impl Dice {
    /// Uniform in [0, 1).
    pub(crate) fn share(&mut self) -> f32 {
        self.0 = self.0.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (self.0 >> 40) as f32 / (1_u64 << 24) as f32
    }

    /// True in this share of all throws.
    pub(crate) fn chance(&mut self, share: f32) -> bool {
        self.share() < share
    }
}

/// What can go wrong.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Faults {
    /// Share of shutter presses that the camera does not notice.
    pub(crate) missed: f32,
    /// Share of photos that are not stored, though the camera was busy.
    pub(crate) unstored: f32,
    /// Does the shaft stand still?
    pub(crate) jammed: bool,
    /// Flies this much faster than allowed.
    pub(crate) push_mps: f32,
    /// Do the range sensors fall silent after this time?
    pub(crate) blind_after_s: Option<f32>,
}

/// The world.
pub(crate) struct Toy {
    pub(crate) controller: Controller,
    pub(crate) now_us: u64,
    pub(crate) offset_m: [f32; 2],
    pub(crate) x_m: f32,
    pub(crate) speed_mps: f32,
    pub(crate) shaft_rad: f32,
    pub(crate) faults: Faults,
    pub(crate) dice: Dice,
    pub(crate) outputs: Outputs,
    pub(crate) entries: Vec<Entry>,
    /// Place and shaft angle of each photo that was stored.
    pub(crate) photos: Vec<(f32, f32)>,
    /// Times at which the shutter was pressed.
    pub(crate) presses_us: Vec<u64>,
    shutter_was: bool,
    exposes_us: Option<u64>,
    busy_until_us: u64,
    will_store: bool,
    stored: u32,
    count: u32,
}

/// Parameters of a circle of 1.5 m with 10 images per turn.
pub(crate) fn parameters(bound: SpeedBound) -> Parameters {
    let profile = adit_geometry::profile::ProfileSpec::Circle { radius_m: 1.5 };
    let mut parameters = Parameters { profile, ..Parameters::default() };
    parameters.rig.images_per_turn = 10;
    parameters.speed.bound = bound;
    parameters.speed.offset_max_m = 0.3;
    parameters.ranges.frozen_s = 0.0;
    parameters
}

impl Toy {
    pub(crate) fn new(parameters: Parameters, seed: u64) -> Self {
        Self {
            controller: Controller::new(parameters),
            now_us: 0,
            offset_m: [0.05, -0.03],
            x_m: 0.0,
            speed_mps: 0.0,
            shaft_rad: 0.2,
            faults: Faults::default(),
            dice: Dice(seed),
            outputs: Outputs::default(),
            entries: Vec::new(),
            photos: Vec::new(),
            presses_us: Vec::new(),
            shutter_was: false,
            exposes_us: None,
            busy_until_us: 0,
            will_store: false,
            stored: 0,
            count: 0,
        }
    }

    /// Runs the camera, the shaft and the vehicle, and reads the sensors.
    pub(crate) fn inputs(&mut self) -> Inputs {
        let pressed = self.outputs.shutter && !self.shutter_was;
        self.shutter_was = self.outputs.shutter;
        if pressed {
            self.presses_us.push(self.now_us);
        }
        if pressed && self.now_us >= self.busy_until_us && !self.dice.chance(self.faults.missed) {
            self.exposes_us = Some(self.now_us + 180_000);
            self.busy_until_us = self.now_us + 700_000;
            self.will_store = !self.dice.chance(self.faults.unstored);
        }
        if self.exposes_us.is_some_and(|at_us| self.now_us >= at_us) {
            self.exposes_us = None;
            if self.will_store {
                self.photos.push((self.x_m, self.shaft_rad));
            }
        }
        let busy = self.now_us < self.busy_until_us;
        if !busy && self.exposes_us.is_none() && self.photos.len() as u32 > self.stored {
            self.stored = self.photos.len() as u32;
        }
        if let Some(pulse_us) = self.outputs.servo_pulse_us.filter(|_| !self.faults.jammed) {
            self.shaft_rad += (pulse_us - NEUTRAL_US) / 500.0 * 5.0 * TICK_S;
        }
        let allowed_mps = self.outputs.speed_limit_mps.unwrap_or(0.0);
        self.speed_mps += (allowed_mps - self.speed_mps) * TICK_S / 0.2;
        let speed_mps = self.speed_mps + self.faults.push_mps;
        self.x_m += speed_mps * TICK_S;
        self.count += 1;
        Inputs {
            ranges: self.ranges(),
            shaft_encoder_rad: Some(self.shaft_rad % core::f32::consts::TAU),
            odometer_m: Some(self.x_m),
            speed_mps: Some(speed_mps),
            camera: CameraStatus { busy, photos_stored: self.stored },
            autopilot_alive: true,
            command: match self.outputs.mode {
                Mode::Idle => Some(Command::Arm),
                Mode::Ready => Some(Command::Start),
                _ => None,
            },
            ..Inputs::default()
        }
    }

    fn ranges(&mut self) -> Beams<RangeSample> {
        let [y_m, z_m] = self.offset_m;
        let blind = self.faults.blind_after_s.is_some_and(|after_s| self.now_us as f32 * 1e-6 > after_s);
        let (half_chord_m, height_m) = ((2.25 - z_m * z_m).sqrt(), (2.25 - y_m * y_m).sqrt());
        let count = self.count;
        let mut sample = |range_m: f32| {
            let noisy_m = range_m + (self.dice.share() - 0.5) * 0.02;
            let reading = if blind { RangeReading::CannotMeasure } else { RangeReading::Measured(noisy_m) };
            RangeSample { reading, count }
        };
        Beams {
            up: sample(height_m + z_m),
            right: sample(half_chord_m - y_m),
            down: sample(height_m - z_m),
            left: sample(half_chord_m + y_m),
        }
    }

    /// Hands inputs to the controller and keeps what it wants.
    pub(crate) fn give(&mut self, inputs: &Inputs) {
        self.outputs = self.controller.step(self.now_us, inputs);
        self.entries.extend(self.outputs.entries.iter().copied());
        self.now_us += TICK_US;
    }

    /// Flies for so long.
    pub(crate) fn fly(&mut self, duration_s: f32) {
        for _ in 0..(duration_s / TICK_S) as u32 {
            let inputs = self.inputs();
            self.give(&inputs);
        }
    }

    pub(crate) fn tags(&self) -> Vec<CaptureTag> {
        self.entries.iter().filter_map(|entry| if let Entry::Tag(tag) = entry { Some(*tag) } else { None }).collect()
    }

    pub(crate) fn events(&self) -> Vec<EventKind> {
        let events = self.entries.iter();
        events.filter_map(|entry| if let Entry::Event(event) = entry { Some(event.kind) } else { None }).collect()
    }
}
