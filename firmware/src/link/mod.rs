//! The link, without its wires: what comes in becomes inputs, what the board wants becomes frames.
//!
//! Two ports: the autopilot's, with ground stations behind it, and a service port for a cable. In: the vehicle ([`vehicle`]),
//! commands, questions. Out, the first that is due:
//!
//! | message | to | when |
//! |---|---|---|
//! | answer to a command, what it asked for | who asked | at once |
//! | heartbeats, of the board and of its camera | both | once a second and when the mode changes, while the controller steps |
//! | the speed limit, and what it needs ([`enforce`]) | autopilot | on change; every second while a limit stands |
//! | wish for attitude, place and heartbeats | autopilot | when it is heard and they are not; every 5 s |
//! | text | both | changes of mode and of the limit's enforcement, failures, and whatever [`Link::say`] was told |
//! | `CAMERA_TRIGGER`, `CAMERA_IMAGE_CAPTURED` | both | at the shutter's command, and when the capture's fate is known |
//! | parameters | who asked | as the line has room ([`lines`]) |
//! | tags and telemetry (`TUNNEL`), ranges, figures ([`report`]) | both | in turn, as the line has room |
//! | logs | who asked | as the line has room |
//!
//! A board that stalls falls silent, but for answers. What must outlive the power is handed out by [`Link::take_keep`].

mod camera;
mod commands;
mod enforce;
mod files;
mod guard;
mod hold;
mod lines;
mod modes;
mod params;
mod report;
mod send;
mod serve;
mod speed;
mod vehicle;
mod words;

use adit_protocol::mavlink::{
    BOARD_COMPONENT, CAMERA_COMPONENT, CameraReport, Counters, Encoding, FrameDecoder, Key, Sender, Severity, Signer,
    Streams, TEXT_BYTES, VersionReport,
};
use adit_protocol::parameters::Parameters;
use adit_protocol::record::{Entry, Event, EventKind, FAILED, Mode};
use adit_protocol::telemetry::Enforcement;
use nalgebra::ComplexField;

pub use enforce::REACTION_S;
pub use files::{LogAnswer, LogBytes, LogList, LogWish, MAX_LOGS, READ_BYTES};
pub use hold::Borrowed;
pub use lines::{Port, Ports};
pub use modes::LimitParameter;
pub use vehicle::VehicleView;

use crate::io::{Command, Outputs, RangeReading};
use crate::time::has_passed;
use camera::Captures;
use commands::Commands;
use enforce::{Cause, Enforcer, Situation, is_due};
use files::LogServer;
use guard::Guard;
use lines::Line;
use params::ParameterServer;
use report::Report;
use vehicle::Vehicle;

/// Rate of the service port.
pub const SERVICE_BAUD: u32 = 921_600;
/// Bytes of one frame come without a pause: after one this long its end will not come.
const SILENCE_S: f32 = 0.1;
/// The time of the newest signature is kept this often; the memory does not wear.
const KEEP_STREAMS_S: f32 = 1.0;

/// What was said at some time.
type Timed<T> = Option<(T, u64)>;

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

/// What the link must know from before the board's start.
#[derive(Clone, Debug, Default)]
pub struct Memory {
    /// A value of the autopilot that was not given back yet.
    pub borrowed: Option<Borrowed>,
    /// The key.
    pub key: Option<Key>,
    /// Whose signatures were heard when.
    pub streams: Streams,
}

/// What must outlive the power.
#[derive(Clone, Debug, PartialEq)]
#[expect(clippy::large_enum_variant, reason = "no allocation here, and one is there at a time")]
pub enum Keep {
    /// A value of the autopilot that is to be given back.
    Borrowed(Option<Borrowed>),
    /// The key.
    Key(Option<Key>),
    /// Whose signatures were heard when.
    Streams(Streams),
    /// Parameters for the next start.
    Parameters(Parameters),
}

/// Kinds of [`Keep`] whose end somebody waits for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Keeping {
    Borrowed,
    Parameters,
    Other,
}

/// The link.
#[derive(Clone, Debug)]
pub struct Link {
    decoders: [FrameDecoder; 2],
    heard_us: [u64; 2],
    lines: [Line; 2],
    board: Sender,
    camera: Sender,
    camera_report: CameraReport,
    version: VersionReport,
    period_s: f32,
    signed_telemetry: bool,
    lead_mps: f32,
    vehicle: Vehicle,
    guard: Guard,
    enforcer: Enforcer,
    parameters: ParameterServer,
    captures: Captures,
    commands: Commands,
    logs: LogServer,
    report: Report,
    keeping: Option<Keeping>,
    key_changed: bool,
    stepped_us: Option<u64>,
    mode: Mode,
    offset_m: [f32; 2],
    heartbeat_us: Option<u64>,
    camera_heartbeat_us: Option<u64>,
    streams_us: Option<u64>,
    refused_us: Option<u64>,
    said: Timed<(Enforcement, Option<Cause>, &'static str)>,
    wish: usize,
    wished_us: Option<u64>,
}

impl Link {
    /// A link on which nothing was heard yet. `uid` is a number that no other board has.
    pub fn new(parameters: &Parameters, memory: Memory, uid: u64) -> Self {
        let mut streams = memory.streams;
        // What was heard after the last time that this was kept may not be heard again.
        streams.skip((2.0 * KEEP_STREAMS_S) as u64 * adit_protocol::mavlink::signing::UNITS_PER_S);
        // Number 1 is what every autopilot leaves the factory with.
        let mut link = Self {
            decoders: [FrameDecoder::default(), FrameDecoder::default()],
            heard_us: [0; 2],
            lines: [Line::new(Port::Autopilot, parameters.link.baud), Line::new(Port::Service, SERVICE_BAUD)],
            board: Sender::new(1, BOARD_COMPONENT),
            camera: Sender::new(1, CAMERA_COMPONENT),
            camera_report: CameraReport {
                size_px: [parameters.camera.width_px, parameters.camera.height_px].map(|side| side as u16),
                focal_px: parameters.camera.focal_px.first().copied().unwrap_or_default(),
            },
            version: VersionReport { version: VERSION, encoding: Encoding::Bytewise, uid },
            period_s: parameters.speed.image_period_s,
            signed_telemetry: parameters.link.signed_telemetry,
            lead_mps: parameters.link.lead_mps,
            vehicle: Vehicle::new(&parameters.link),
            guard: Guard::new(memory.key, streams),
            enforcer: Enforcer::new(memory.borrowed),
            parameters: ParameterServer::new(parameters),
            captures: Captures::new(parameters.shutter.wiring),
            commands: Commands::default(),
            logs: LogServer::default(),
            report: Report::new([parameters.ranges.min_m, parameters.ranges.max_m]),
            keeping: None,
            key_changed: false,
            stepped_us: None,
            mode: Mode::Boot,
            offset_m: [0.0; 2],
            heartbeat_us: None,
            camera_heartbeat_us: None,
            streams_us: None,
            refused_us: None,
            said: None,
            wish: 0,
            wished_us: None,
        };
        link.arm_senders();
        link
    }

    /// Signs with the key, if there is one.
    fn arm_senders(&mut self) {
        let signer = self.guard.key().map(|key| Signer { key, link: 0, time: 0 });
        (self.board.signer, self.camera.signer) = (signer, signer);
    }

    /// What came in so far on a port.
    pub fn counters(&self, port: Port) -> Counters {
        self.decoders.get(port as usize).map(FrameDecoder::counters).unwrap_or_default()
    }

    /// How far the speed limit is in force.
    pub fn enforcement(&self) -> Enforcement {
        self.enforcer.state().0
    }

    /// What is known of the vehicle.
    pub fn vehicle(&self, now_us: u64) -> VehicleView {
        self.vehicle.view(now_us)
    }

    /// The next command; each is given once.
    pub fn take_command(&mut self) -> Option<Command> {
        self.commands.take_command()
    }

    /// The next change of a sensor's address; each is given once.
    pub fn take_readdressing(&mut self) -> Option<Readdressing> {
        self.commands.take_readdressing()
    }

    /// Whether somebody wants the board to start anew.
    pub fn take_restart(&mut self) -> bool {
        self.commands.take_restart()
    }

    /// What is wanted from the card; to be answered by [`Link::hear_logs`].
    pub fn take_log_wish(&mut self) -> Option<LogWish> {
        self.logs.take_wish()
    }

    /// The card's answer.
    pub fn hear_logs(&mut self, wish: LogWish, answer: LogAnswer) {
        self.logs.hear(wish, answer);
    }

    /// Takes bytes off a port's wire. To be called with none now and then: a frame whose end does not come is given up.
    pub fn receive(&mut self, now_us: u64, port: Port, bytes: &[u8]) {
        let Some(heard_us) = self.heard_us.get_mut(port as usize) else { return };
        let silent = has_passed(*heard_us, now_us, SILENCE_S);
        if !bytes.is_empty() {
            *heard_us = now_us;
        }
        while silent && let Some(frame) = self.decoders.get_mut(port as usize).and_then(FrameDecoder::resynchronise) {
            self.hear(now_us, port, &frame);
        }
        for byte in bytes {
            let frame = self.decoders.get_mut(port as usize).and_then(|decoder| decoder.push(*byte));
            if let Some(frame) = frame {
                self.hear(now_us, port, &frame);
            }
        }
    }

    /// How whole numbers lie in the values of this system's parameters.
    fn encoding(&self) -> Encoding {
        Encoding::of(self.vehicle.mode.map(|(autopilot, _)| autopilot))
    }

    fn is_scanning(&self) -> bool {
        matches!(self.mode, Mode::SelfTest | Mode::Scanning | Mode::Degraded)
    }

    /// The next thing that must outlive the power; nothing more until [`Link::kept`] was called.
    pub fn take_keep(&mut self, now_us: u64) -> Option<Keep> {
        if self.keeping.is_some() {
            return None;
        }
        let (keeping, keep) = if let Some(keep) = self.enforcer.take_keep() {
            (Keeping::Borrowed, keep)
        } else if core::mem::take(&mut self.key_changed) {
            (Keeping::Other, Keep::Key(self.guard.key()))
        } else if let Some(parameters) = self.parameters.take_keep() {
            (Keeping::Parameters, Keep::Parameters(parameters))
        } else if self.guard.key().is_some() && is_due(&mut self.streams_us, now_us, KEEP_STREAMS_S) {
            (Keeping::Other, Keep::Streams(self.guard.streams(now_us)))
        } else {
            return None;
        };
        self.keeping = Some(keeping);
        Some(keep)
    }

    /// It is kept, or cannot be.
    pub fn kept(&mut self, ok: bool) {
        match self.keeping.take() {
            Some(Keeping::Borrowed) => self.enforcer.kept(ok),
            Some(Keeping::Parameters) => {
                self.parameters.kept(ok);
                let (severity, words) = if ok {
                    (Severity::Info, "parameters kept, in force after a restart")
                } else {
                    (Severity::Error, "FRAM does not keep the parameters")
                };
                self.report.say_words(severity, format_args!("{words}"));
            }
            Some(Keeping::Other) | None => {}
        }
    }

    /// Notes what the controller wants and what it saw.
    pub fn note(&mut self, now_us: u64, outputs: &Outputs, ranges_m: [Option<f32>; 4], diagnosis: Diagnosis) {
        if self.stepped_us.is_some() && self.mode != outputs.mode {
            self.report.announce(outputs.mode);
            self.heartbeat_us = None;
        }
        (self.stepped_us, self.mode) = (Some(now_us), outputs.mode);
        let offset_m = outputs.centring.map(|centring| centring.offset_m);
        // What is no place leads nowhere.
        self.offset_m = offset_m.filter(|offset_m| offset_m.iter().all(ComplexField::is_finite)).unwrap_or_default();
        self.captures.note_commanded(outputs.display.captures);
        let vehicle = self.vehicle.view(now_us);
        let version = self.vehicle.version;
        let mode = self.vehicle.mode.filter(|_| vehicle.alive);
        let row = mode.map(|(autopilot, mode)| modes::row(autopilot, version, mode));
        self.enforcer.look(
            now_us,
            Situation {
                limit_mps: outputs.speed_limit_mps.filter(ComplexField::is_finite).map(|limit| limit.max(0.0)),
                row,
                speed_mps: vehicle.speed_mps.map(ComplexField::abs),
                leads: self.lead_mps > 0.0 && matches!(outputs.mode, Mode::Scanning | Mode::Degraded),
            },
        );
        self.say_enforcement(now_us, row, outputs, &vehicle);
        self.report.note(now_us, outputs, ranges_m, &vehicle, self.enforcer.state().0, diagnosis);
    }

    /// Notes what goes into the log.
    pub fn note_entry(&mut self, entry: &Entry) {
        if let Entry::Event(Event { kind: EventKind::Failed(failure), .. }) = entry {
            self.report.say_words(Severity::Error, format_args!("{FAILED}{}", failure.word()));
        }
        self.captures.note_entry(entry);
    }

    /// Tells the pilot. What does not fit is dropped: the first trouble tells most.
    pub fn say(&mut self, severity: Severity, text: heapless::String<TEXT_BYTES>) {
        self.report.say(severity, text);
    }
}

/// Readings as the display wants them, in the order of [`Beam::ALL`](adit_protocol::beams::Beam::ALL).
pub fn measured_m(readings: [RangeReading; 4]) -> [Option<f32>; 4] {
    readings.map(|reading| match reading {
        RangeReading::Measured(range_m) => Some(range_m),
        _ => None,
    })
}

/// What was said, unless it is older than this.
fn fresh<T: Copy>(said: Timed<T>, now_us: u64, stale_s: f32) -> Option<T> {
    said.filter(|(_, at_us)| !has_passed(*at_us, now_us, stale_s)).map(|(value, _)| value)
}

/// Major, minor, patch.
const VERSION: [u8; 3] = [
    digits(env!("CARGO_PKG_VERSION_MAJOR")),
    digits(env!("CARGO_PKG_VERSION_MINOR")),
    digits(env!("CARGO_PKG_VERSION_PATCH")),
];

const fn digits(text: &str) -> u8 {
    let mut bytes = text.as_bytes();
    let mut value = 0;
    while let [digit, rest @ ..] = bytes {
        value = value * 10 + (*digit - b'0');
        bytes = rest;
    }
    value
}

#[cfg(test)]
mod tests;
