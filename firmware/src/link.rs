//! The link to the autopilot, without its wire: what it says becomes inputs, what the board wants becomes frames.
//!
//! In: the autopilot's heartbeat (its system number is taken from the first), attitude, place and velocity; commands to our
//! component. Out, the first that is due:
//!
//! | message | when |
//! |---|---|
//! | answer to a command | at once |
//! | heartbeat | once a second and when the mode changes, but only while the controller steps: a stalled board falls silent |
//! | `DO_CHANGE_SPEED` | when the limit has changed by 1 cm/s, at most 5 times a second; once a second while a limit stands |
//! | text | changes of mode, and whatever [`Link::say`] was told |
//! | `DISTANCE_SENSOR` | each of the four 5 times a second |
//! | `NAMED_VALUE_FLOAT` | a figure every 50 ms in turn, each name about twice a second |
//!
//! Whether the autopilot obeys the speed is not judged here yet; facts differ between autopilots and modes.
//!
//! Frame: the autopilot counts north, east, down and yaw from north. The tunnel's axis lies at a yaw that is a parameter, or
//! the vehicle's own when it was armed; the odometer then counts from there.

use adit_geometry::angles::unwrap_near;
use adit_protocol::beams::Beam;
use adit_protocol::mavlink::{
    AUTOPILOT_COMPONENT, BOARD_COMPONENT, CommandResult, Counters, FrameDecoder, Incoming, NO_AUTOPILOT, OutFrame,
    RangeReport, RawFrame, Sender, Severity, TEXT_BYTES, Target, command,
};
use adit_protocol::parameters::Parameters;
use adit_protocol::record::Mode;
use nalgebra::ComplexField;

use crate::io::{Command, Inputs, Outputs, RangeReading};
use crate::time::has_passed;

/// An autopilot sends a heartbeat every second: two may be lost.
const ALIVE_S: f32 = 2.5;
/// Attitude comes 10 to 50 times a second.
const ATTITUDE_STALE_S: f32 = 0.5;
/// Place and velocity come 5 to 50 times a second.
const POSITION_STALE_S: f32 = 1.0;
/// A command that is repeated within this is the same one.
const REPEATED_S: f32 = 1.0;
/// Addresses that the I2C specification does not keep for itself.
const ADDRESS_MIN: u8 = 0x08;
const ADDRESS_MAX: u8 = 0x77;
/// The controller counts as stalled after this.
const STALLED_S: f32 = 1.0;
const HEARTBEAT_S: f32 = 1.0;
const LIMIT_REPEAT_S: f32 = 1.0;
const LIMIT_PAUSE_S: f32 = 0.2;
/// Changes of the limit that are worth a command.
const LIMIT_CHANGE_MPS: f32 = 0.01;
const RANGE_S: f32 = 0.05;
const FIGURE_S: f32 = 0.05;
/// Figures of the display, in turn; a name has ten letters at most.
const FIGURES: [&str; 9] = ["off_y", "off_z", "limit", "speed", "captures", "missed", "water", "step_us", "stack_b"];

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

/// A range sensor's new address on I2C.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Readdressing {
    /// Where it is.
    pub from: u8,
    /// Where it shall be.
    pub to: u8,
}

/// Figures about the board itself, for the display.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Diagnosis {
    /// The longest step of the controller, in microseconds.
    pub step_us: u32,
    /// The deepest the stack has been.
    pub stack_bytes: u32,
}

/// What was said at some time.
type Timed<T> = Option<(T, u64)>;

/// The link.
#[derive(Clone, Debug)]
pub struct Link {
    decoder: FrameDecoder,
    sender: Sender,
    /// The vehicle's number, once its autopilot was heard.
    system: Option<u8>,
    heartbeat_us: Option<u64>,
    attitude: Timed<[f32; 3]>,
    /// North and east, and the velocity so.
    position: Timed<([f32; 2], [f32; 2])>,
    axis_yaw_rad: Option<f32>,
    /// Place along the axis where the odometer is zero.
    zero_m: f32,
    latches_axis: bool,
    command: Option<Command>,
    readdressing: Option<Readdressing>,
    last_command: Timed<u16>,
    answers: heapless::Deque<(u16, CommandResult, Target), 4>,
    notices: heapless::Deque<(Severity, heapless::String<TEXT_BYTES>), 4>,
    shown: Shown,
    due: Due,
    limits_m: [f32; 2],
}

/// The newest of what is to be shown.
#[derive(Clone, Copy, Debug, Default)]
struct Shown {
    stepped_us: Option<u64>,
    mode: Mode,
    limit_mps: Option<f32>,
    ranges_m: [Option<f32>; 4],
    figures: [Option<f32>; FIGURES.len()],
}

/// When what was sent last, and whose turn it is.
#[derive(Clone, Copy, Debug, Default)]
struct Due {
    heartbeat_us: Option<u64>,
    limit: Timed<f32>,
    range_us: Option<u64>,
    range: usize,
    figure_us: Option<u64>,
    figure: usize,
}

impl Link {
    /// A link on which nothing was heard yet.
    pub fn new(parameters: &Parameters) -> Self {
        let axis_yaw_rad = parameters.link.axis_yaw_rad.filter(ComplexField::is_finite);
        Self {
            decoder: FrameDecoder::default(),
            // Number 1 is what every autopilot leaves the factory with.
            sender: Sender::new(1, BOARD_COMPONENT),
            system: None,
            heartbeat_us: None,
            attitude: None,
            position: None,
            axis_yaw_rad,
            zero_m: 0.0,
            latches_axis: axis_yaw_rad.is_none(),
            command: None,
            readdressing: None,
            last_command: None,
            answers: heapless::Deque::new(),
            notices: heapless::Deque::new(),
            shown: Shown::default(),
            due: Due::default(),
            limits_m: [parameters.ranges.min_m, parameters.ranges.max_m],
        }
    }

    /// What came in so far.
    pub fn counters(&self) -> Counters {
        self.decoder.counters()
    }

    /// Takes bytes off the wire.
    pub fn receive(&mut self, now_us: u64, bytes: &[u8]) {
        for byte in bytes {
            if let Some(frame) = self.decoder.push(*byte)
                && let Some(incoming) = Incoming::read(&frame)
            {
                self.hear(now_us, &frame, incoming);
            }
        }
    }

    fn hear(&mut self, now_us: u64, frame: &RawFrame, incoming: Incoming) {
        let from_autopilot =
            frame.component == AUTOPILOT_COMPONENT && self.system.is_none_or(|system| system == frame.system);
        match incoming {
            Incoming::Heartbeat { autopilot, .. } if from_autopilot && autopilot != NO_AUTOPILOT => {
                self.system = Some(frame.system);
                self.sender.system = frame.system;
                self.heartbeat_us = Some(now_us);
            }
            Incoming::Attitude { angles_rad } if from_autopilot && angles_rad.iter().all(ComplexField::is_finite) => {
                self.attitude = Some((angles_rad, now_us));
            }
            Incoming::LocalPosition { position_m: [north_m, east_m, _], velocity_mps: [vn_mps, ve_mps, _], .. }
                if from_autopilot && [north_m, east_m, vn_mps, ve_mps].iter().all(ComplexField::is_finite) =>
            {
                self.position = Some((([north_m, east_m], [vn_mps, ve_mps]), now_us));
            }
            // Arming is also the autopilot's business: what is for everybody is for it.
            Incoming::Command { target, command, confirmation, parameters }
                if target == [self.system.unwrap_or(1), BOARD_COMPONENT] =>
            {
                self.obey(now_us, [frame.system, frame.component], command, confirmation, &parameters);
            }
            _ => {}
        }
    }

    fn obey(&mut self, now_us: u64, from: Target, number: u16, confirmation: u8, parameters: &[f32; 7]) {
        let [first, second, ..] = *parameters;
        let readdressing = readdressing(first, second)
            .filter(|_| number == command::READDRESS && matches!(self.shown.mode, Mode::Idle | Mode::Fault));
        let wanted = match number {
            command::ARM_DISARM if first == 1.0 => Some(Command::Arm),
            command::ARM_DISARM if first == 0.0 => Some(Command::Disarm),
            command::START_CAPTURE => Some(Command::Start),
            command::STOP_CAPTURE => Some(Command::Stop),
            _ => None,
        };
        let known = wanted.is_some() || readdressing.is_some();
        let result = if known { CommandResult::Accepted } else { CommandResult::Unsupported };
        // Who gets no answer asks again.
        let _ = self.answers.push_back((number, result, from));
        let repeated = self
            .last_command
            .is_some_and(|(last, at_us)| confirmation > 0 && last == number && !has_passed(at_us, now_us, REPEATED_S));
        self.last_command = Some((number, now_us));
        if repeated {
            return;
        }
        self.readdressing = readdressing.or(self.readdressing);
        if wanted == Some(Command::Arm) {
            self.latch_axis(now_us);
        }
        self.command = wanted.or(self.command);
    }

    /// The axis is where the vehicle's nose points, and the odometer begins here.
    fn latch_axis(&mut self, now_us: u64) {
        let attitude = fresh(self.attitude, now_us, ATTITUDE_STALE_S);
        if let Some([_, _, yaw_rad]) = attitude.filter(|_| self.latches_axis) {
            self.axis_yaw_rad = Some(yaw_rad);
            self.zero_m = 0.0;
            self.zero_m =
                fresh(self.position, now_us, POSITION_STALE_S).map_or(0.0, |(place_m, _)| along(place_m, yaw_rad));
        }
    }

    /// The next command; each is given once.
    pub fn take_command(&mut self) -> Option<Command> {
        self.command.take()
    }

    /// The next change of a sensor's address; each is given once.
    pub fn take_readdressing(&mut self) -> Option<Readdressing> {
        self.readdressing.take()
    }

    /// What is known of the vehicle.
    pub fn vehicle(&self, now_us: u64) -> VehicleView {
        let axis_yaw_rad = self.axis_yaw_rad;
        let attitude = fresh(self.attitude, now_us, ATTITUDE_STALE_S);
        let position = fresh(self.position, now_us, POSITION_STALE_S).zip(axis_yaw_rad);
        VehicleView {
            alive: self.heartbeat_us.is_some_and(|at_us| !has_passed(at_us, now_us, ALIVE_S)),
            // Before the axis is known the nose counts as pointing along it.
            attitude_rad: attitude.map(|[roll_rad, pitch_rad, yaw_rad]| {
                [roll_rad, pitch_rad, axis_yaw_rad.map_or(0.0, |axis_rad| unwrap_near(yaw_rad - axis_rad, 0.0))]
            }),
            odometer_m: position.map(|((place_m, _), yaw_rad)| along(place_m, yaw_rad) - self.zero_m),
            speed_mps: position.map(|((_, velocity_mps), yaw_rad)| along(velocity_mps, yaw_rad)),
        }
    }

    /// Notes what the controller wants and what it saw.
    pub fn note(&mut self, now_us: u64, outputs: &Outputs, ranges_m: [Option<f32>; 4], diagnosis: Diagnosis) {
        if self.shown.stepped_us.is_some() && self.shown.mode != outputs.mode {
            self.announce(outputs.mode);
            self.due.heartbeat_us = None;
        }
        let display = &outputs.display;
        let [offset_y_m, offset_z_m] = outputs.centring.map_or([None; 2], |centring| centring.offset_m.map(Some));
        self.shown = Shown {
            stepped_us: Some(now_us),
            mode: outputs.mode,
            limit_mps: outputs.speed_limit_mps.filter(ComplexField::is_finite).map(|limit| limit.max(0.0)),
            ranges_m,
            figures: [
                offset_y_m,
                offset_z_m,
                outputs.speed_limit_mps,
                display.speed_mps,
                Some(display.captures as f32),
                Some(display.missed as f32),
                display.water_level_m,
                Some(diagnosis.step_us as f32),
                Some(diagnosis.stack_bytes as f32),
            ],
        };
    }

    /// Tells the pilot. What does not fit is dropped: the first trouble tells most.
    pub fn say(&mut self, severity: Severity, text: heapless::String<TEXT_BYTES>) {
        let _ = self.notices.push_back((severity, text));
    }

    fn announce(&mut self, mode: Mode) {
        let (severity, words) = match mode {
            Mode::Boot => (Severity::Info, "rotator: starting"),
            Mode::Idle => (Severity::Info, "rotator: idle"),
            Mode::SelfTest => (Severity::Info, "rotator: self-test"),
            Mode::Ready => (Severity::Info, "rotator: ready"),
            Mode::Scanning => (Severity::Info, "rotator: scanning"),
            Mode::Degraded => (Severity::Warning, "rotator: scanning, degraded"),
            Mode::Fault => (Severity::Error, "rotator: fault, no photos"),
        };
        if let Ok(text) = heapless::String::try_from(words) {
            self.say(severity, text);
        }
    }

    /// The next frame that is due.
    pub fn next_frame(&mut self, now_us: u64) -> Option<OutFrame> {
        if let Some((number, result, to)) = self.answers.pop_front() {
            return Some(self.sender.command_ack(number, result, to));
        }
        let stepped_us = self.shown.stepped_us?;
        let steps = !has_passed(stepped_us, now_us, STALLED_S);
        if steps && is_due(&mut self.due.heartbeat_us, now_us, HEARTBEAT_S) {
            return Some(self.sender.heartbeat(self.shown.mode));
        }
        if let Some(speed_mps) = self.limit_due(now_us).filter(|_| steps) {
            return Some(self.sender.change_speed([self.sender.system, AUTOPILOT_COMPONENT], 0, speed_mps));
        }
        if let Some((severity, text)) = self.notices.pop_front() {
            return Some(self.sender.text(severity, &text));
        }
        if !steps {
            return None;
        }
        self.range_due(now_us).or_else(|| self.figure_due(now_us))
    }

    /// The limit, if the autopilot is to be told.
    fn limit_due(&mut self, now_us: u64) -> Option<f32> {
        let limit_mps = self.shown.limit_mps?;
        let due = self.due.limit.is_none_or(|(sent_mps, at_us)| {
            let changed = (sent_mps - limit_mps).abs() >= LIMIT_CHANGE_MPS || sent_mps > 0.0 && limit_mps == 0.0;
            has_passed(at_us, now_us, if changed { LIMIT_PAUSE_S } else { LIMIT_REPEAT_S })
        });
        due.then(|| {
            self.due.limit = Some((limit_mps, now_us));
            limit_mps
        })
    }

    fn range_due(&mut self, now_us: u64) -> Option<OutFrame> {
        if !is_due(&mut self.due.range_us, now_us, RANGE_S) {
            return None;
        }
        let index = self.due.range;
        self.due.range = (index + 1) % Beam::ALL.len();
        let (beam, range_m) = (Beam::ALL.get(index).copied()?, self.shown.ranges_m.get(index).copied()??);
        Some(self.sender.range(millis(now_us), &RangeReport { beam, range_m, limits_m: self.limits_m }))
    }

    fn figure_due(&mut self, now_us: u64) -> Option<OutFrame> {
        if !is_due(&mut self.due.figure_us, now_us, FIGURE_S) {
            return None;
        }
        let index = self.due.figure;
        self.due.figure = (index + 1) % FIGURES.len();
        let (name, value) = (FIGURES.get(index)?, self.shown.figures.get(index).copied()??);
        Some(self.sender.named_value(millis(now_us), name, value))
    }
}

/// Readings as the display wants them, in the order of [`Beam::ALL`].
pub fn measured_m(readings: [RangeReading; 4]) -> [Option<f32>; 4] {
    readings.map(|reading| match reading {
        RangeReading::Measured(range_m) => Some(range_m),
        _ => None,
    })
}

/// Two addresses that a sensor may have, or `None`.
fn readdressing(from: f32, to: f32) -> Option<Readdressing> {
    let address = |value: f32| {
        let address = value as u8;
        (f32::from(address) == value && (ADDRESS_MIN..=ADDRESS_MAX).contains(&address)).then_some(address)
    };
    Some(Readdressing { from: address(from)?, to: address(to)? })
}

/// What was said, unless it is older than this.
fn fresh<T: Copy>(said: Timed<T>, now_us: u64, stale_s: f32) -> Option<T> {
    said.filter(|(_, at_us)| !has_passed(*at_us, now_us, stale_s)).map(|(value, _)| value)
}

/// Whether the period since the last time is over; then this is the last time.
fn is_due(last_us: &mut Option<u64>, now_us: u64, period_s: f32) -> bool {
    let due = last_us.is_none_or(|at_us| has_passed(at_us, now_us, period_s));
    if due {
        *last_us = Some(now_us);
    }
    due
}

/// A horizontal vector's part along the axis.
fn along([north, east]: [f32; 2], axis_yaw_rad: f32) -> f32 {
    let (sin, cos) = ComplexField::sin_cos(axis_yaw_rad);
    north * cos + east * sin
}

fn millis(now_us: u64) -> u32 {
    (now_us / 1000) as u32
}

#[cfg(test)]
mod tests;
