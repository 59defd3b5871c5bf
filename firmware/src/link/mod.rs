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
//! | text | both | changes of mode and of the limit's enforcement, and whatever [`Link::say`] was told |
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
mod speed;
mod vehicle;

use adit_protocol::mavlink::{
    AUTOPILOT_COMPONENT, BOARD_COMPONENT, CAMERA_COMPONENT, CameraReport, Counters, Encoding, FrameDecoder, Incoming,
    Key, OutFrame, RawFrame, Sender, Severity, SignatureError, Signer, Streams, TEXT_BYTES, Target, Value,
    VersionReport, command, message,
};
use adit_protocol::parameters::Parameters;
use adit_protocol::record::{Entry, Mode};
use adit_protocol::telemetry::{Enforcement, TAG_KIND, tunnelled};
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
use commands::{Commands, Reply};
use enforce::{Ask, Cause, Enforcer, Situation, is_due};
use files::LogServer;
use guard::{Guard, Refused};
use hold::HoldAsk;
use lines::Line;
use modes::Row;
use params::{Change, ParameterServer};
use report::{Report, Speed};
use vehicle::Vehicle;

/// Rate of the service port.
pub const SERVICE_BAUD: u32 = 921_600;
/// The controller counts as stalled after this.
const STALLED_S: f32 = 1.0;
const HEARTBEAT_S: f32 = 1.0;
/// Bytes of one frame come without a pause: after one this long its end will not come.
const SILENCE_S: f32 = 0.1;
/// The time of the newest signature is kept this often; the memory does not wear.
const KEEP_STREAMS_S: f32 = 1.0;
/// The same words about the limit come no more often than this.
const SAY_AGAIN_S: f32 = 5.0;
/// Words about refused requests come no more often than this.
const SAY_REFUSED_S: f32 = 10.0;
/// The autopilot is asked for what it does not send this often.
const WISH_S: f32 = 5.0;
/// What is wished for: the version once, then messages with their intervals in microseconds. The mode comes with the heartbeat.
const WISHES: [(u32, f32); 5] = [
    (message::VERSION, 0.0),
    (0, 500_000.0),
    (message::ATTITUDE, 50_000.0),
    (message::LOCAL_POSITION, 50_000.0),
    (message::HEAD_UP, 200_000.0),
];
/// How the board leads the vehicle back to the axis: speed per metre of offset, and at most.
const CENTRE_PER_S: f32 = 0.4;
const CENTRE_MPS: f32 = 0.15;

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

    fn hear(&mut self, now_us: u64, port: Port, frame: &RawFrame) {
        let Some(incoming) = Incoming::read(frame) else { return };
        match incoming {
            Incoming::Command { .. }
            | Incoming::ParameterSet { .. }
            | Incoming::ParameterRead { .. }
            | Incoming::ParameterList { .. }
            | Incoming::SetupSigning { .. }
            | Incoming::LogList { .. }
            | Incoming::LogRequest { .. }
            | Incoming::LogEnd { .. }
            | Incoming::TimeSync { .. } => self.serve(now_us, port, frame, incoming),
            _ if port == Port::Autopilot
                && self.vehicle.is_from_autopilot(frame)
                && (!self.signed_telemetry || self.guard.check(now_us, frame).is_ok()) =>
            {
                self.follow(now_us, frame, &incoming);
            }
            _ => {}
        }
    }

    /// Takes what the autopilot tells.
    fn follow(&mut self, now_us: u64, frame: &RawFrame, incoming: &Incoming) {
        match incoming {
            Incoming::CommandAck { command: number, result, target } => {
                let for_us = *target == [0, 0] || *target == [self.board.system, BOARD_COMPONENT];
                if *number == command::CHANGE_SPEED && for_us {
                    self.enforcer.hear_answer(*result);
                }
            }
            Incoming::ParameterValue { name: Some(name), value, .. } => {
                let parameter = LimitParameter::named(name);
                if let Some((parameter, value)) = parameter.zip(Value::read(*value, self.encoding())) {
                    self.enforcer.hear_parameter(parameter, value.real());
                }
            }
            _ => self.vehicle.hear(now_us, frame, incoming),
        }
        if self.vehicle.take_began_anew() {
            self.enforcer.begin_anew();
            self.wished_us = None;
        }
        if let Some(system) = self.vehicle.system {
            (self.board.system, self.camera.system) = (system, system);
        }
    }

    /// How whole numbers lie in the values of this system's parameters.
    fn encoding(&self) -> Encoding {
        Encoding::of(self.vehicle.mode.map(|(autopilot, _)| autopilot))
    }

    /// Whether a message is for the board, or for its camera.
    fn is_for_us(&self, [system, component]: Target) -> bool {
        system == self.board.system && (component == BOARD_COMPONENT || component == CAMERA_COMPONENT)
    }

    /// Answers a question or does what is wanted, if whoever wants it may.
    fn serve(&mut self, now_us: u64, port: Port, frame: &RawFrame, incoming: Incoming) {
        let everybody = |target: Target| target == [0, 0] || target == [self.board.system, 0];
        let from = [frame.system, frame.component];
        let scans = self.is_scanning();
        let credentials = self.guard.credentials(now_us, port, frame);
        match incoming {
            Incoming::TimeSync { answered_ns: 0, asked_ns } if self.guard.has_room(now_us) => {
                self.commands.reply(port, Reply::TimeSync { asked_ns });
            }
            Incoming::ParameterList { target }
                if (self.is_for_us(target) || everybody(target)) && self.guard.has_room(now_us) =>
            {
                self.parameters.list(port);
            }
            Incoming::ParameterRead { target, index, name }
                if self.is_for_us(target) && self.guard.has_room(now_us) =>
            {
                self.parameters.read(port, index, name.as_ref());
            }
            Incoming::ParameterSet { target, name, value }
                if self.is_for_us(target) && self.admits(now_us, frame, credentials) =>
            {
                let change = self.parameters.set(port, name.as_ref(), value, self.encoding(), !scans);
                self.say_change(change, name.as_deref().unwrap_or("?"), scans);
            }
            Incoming::LogList { target, .. } if self.is_for_us(target) && !scans && self.guard.has_room(now_us) => {
                self.logs.list(port);
            }
            Incoming::LogRequest { target, id, offset, count }
                if self.is_for_us(target) && !scans && self.guard.has_room(now_us) =>
            {
                self.logs.read(port, id, offset, count);
            }
            Incoming::LogEnd { target } if self.is_for_us(target) => self.logs.end(),
            Incoming::SetupSigning { target, key, time } if self.is_for_us(target) => {
                self.change_key(now_us, port, key, time);
            }
            Incoming::Command { target: target @ [_, component], command: number, confirmation, parameters }
                if self.is_for_us(target) =>
            {
                let is_question = commands::is_question(number);
                if is_question && self.guard.has_room(now_us) || !is_question && self.admits(now_us, frame, credentials)
                {
                    let order = commands::Order { port, from, component, command: number, confirmation, parameters };
                    if self.commands.obey(now_us, self.mode, order, &mut self.captures) == Some(Command::Arm) {
                        self.vehicle.latch_axis(now_us);
                    }
                }
            }
            _ => {}
        }
    }

    fn is_scanning(&self) -> bool {
        matches!(self.mode, Mode::SelfTest | Mode::Scanning | Mode::Degraded)
    }

    /// Whether a request may have an effect; who may not is named to the pilot, now and then.
    fn admits(&mut self, now_us: u64, frame: &RawFrame, credentials: Result<(), SignatureError>) -> bool {
        match self.guard.admits(now_us, credentials) {
            Ok(()) => true,
            Err(Refused::Signature(error)) => {
                if is_due(&mut self.refused_us, now_us, SAY_REFUSED_S) {
                    let (system, component) = (frame.system, frame.component);
                    let why = match error {
                        SignatureError::Unsigned => "unsigned",
                        SignatureError::Wrong => "wrong key",
                        SignatureError::Replayed => "sent before",
                        SignatureError::Late | SignatureError::Beyond => "wrong time",
                    };
                    self.report
                        .say_words(Severity::Warning, format_args!("refused request of {system}/{component}: {why}"));
                }
                false
            }
            Err(Refused::Flood) => false,
        }
    }

    fn say_change(&mut self, change: Change, name: &str, scans: bool) {
        if change == Change::Refused {
            let why = if scans { "not while scanning" } else { "value refused" };
            self.report.say_words(Severity::Warning, format_args!("{name}: {why}"));
        }
    }

    /// A key is given or taken by whoever has the board in hand, while it rests.
    fn change_key(&mut self, now_us: u64, port: Port, key: Key, time: u64) {
        let rests = matches!(self.mode, Mode::Boot | Mode::Idle | Mode::Fault);
        if port != Port::Service || !rests {
            self.report.say_words(Severity::Warning, format_args!("key refused: TELEM2 only, and at rest"));
            return;
        }
        let key = (key.0 != [0; 32]).then_some(key);
        let words = if key.is_some() { "key installed" } else { "key removed" };
        // Several frames of one moment run ahead of the clock: what is signed from now on comes after them.
        for signer in [self.board.signer, self.camera.signer].into_iter().flatten() {
            self.guard.set_time(now_us, signer.time);
        }
        self.guard.set_key(key, time, now_us);
        self.arm_senders();
        self.key_changed = true;
        self.report.say_words(Severity::Info, format_args!("{words}"));
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
        self.captures.note_entry(entry);
    }

    /// Tells the pilot. What does not fit is dropped: the first trouble tells most.
    pub fn say(&mut self, severity: Severity, text: heapless::String<TEXT_BYTES>) {
        self.report.say(severity, text);
    }

    /// A change in how far the limit is in force is news.
    fn say_enforcement(&mut self, now_us: u64, row: Option<Row>, outputs: &Outputs, vehicle: &VehicleView) {
        let mode = row.map_or("", |row| row.name);
        let (state, cause) = self.enforcer.state();
        let news = (state, cause, mode);
        if matches!(state, Enforcement::Idle | Enforcement::Requested) {
            // Being asked is no news, but what comes after is, even if it was said before.
            if state == Enforcement::Idle {
                self.said = None;
            }
            return;
        }
        if self
            .said
            .is_some_and(|(said, at_us)| said == news && (cause.is_none() || !has_passed(at_us, now_us, SAY_AGAIN_S)))
        {
            return;
        }
        self.said = Some((news, now_us));
        let limit = Speed(outputs.speed_limit_mps.unwrap_or_default());
        let speed = Speed(vehicle.speed_mps.map_or(0.0, ComplexField::abs));
        let report = &mut self.report;
        match cause {
            None => report.say_words(Severity::Info, format_args!("limit {limit} m/s in force in {mode}")),
            Some(Cause::NoAutopilot) => {
                report.say_words(Severity::Warning, format_args!("limit {limit} m/s: no autopilot heard"));
            }
            Some(Cause::Mode) => {
                report.say_words(Severity::Warning, format_args!("{mode} takes no limit: keep below {limit} m/s"));
            }
            Some(Cause::Floor) => {
                let floor = Speed(row.map_or(0.0, |row| row.floor_mps));
                report.say_words(Severity::Warning, format_args!("{mode} takes {floor} at least: keep below {limit}"));
            }
            Some(Cause::Refused(refusal)) => {
                let why = match refusal {
                    hold::Refusal::Unknown => "has no speed parameter",
                    hold::Refusal::Ambiguous => "has two speed parameters",
                    hold::Refusal::Implausible => "speed parameter odd",
                    hold::Refusal::NotKept => "FRAM keeps no value",
                };
                report.say_words(Severity::Warning, format_args!("{mode}: {why}, keep below {limit} m/s"));
            }
            Some(Cause::Denied) => {
                report.say_words(Severity::Error, format_args!("autopilot refuses {limit} m/s in {mode}"));
            }
            Some(Cause::TooFast) => {
                report.say_words(Severity::Error, format_args!("TOO FAST: {speed} m/s, limit {limit} ignored"));
            }
        }
    }

    /// The next frame that is due, and where it goes.
    pub fn next_frame(&mut self, now_us: u64) -> Option<(Ports, OutFrame)> {
        let time = self.guard.time(now_us);
        for sender in [&mut self.board, &mut self.camera] {
            if let Some(signer) = &mut sender.signer {
                signer.set_time(time);
            }
        }
        let (ports, frame) = self.urgent(now_us).or_else(|| self.patient(now_us))?;
        for port in [Port::Autopilot, Port::Service] {
            if ports.contains(port)
                && let Some(line) = self.lines.get_mut(port as usize)
            {
                line.take(&frame);
            }
        }
        Some((ports, frame))
    }

    fn steps(&self, now_us: u64) -> bool {
        self.stepped_us.is_some_and(|stepped_us| !has_passed(stepped_us, now_us, STALLED_S))
    }

    /// What does not wait for room on the line.
    fn urgent(&mut self, now_us: u64) -> Option<(Ports, OutFrame)> {
        if let Some((port, reply)) = self.commands.take_reply() {
            return Some((Ports::One(port), self.reply(now_us, reply)));
        }
        let steps = self.steps(now_us);
        if steps && is_due(&mut self.heartbeat_us, now_us, HEARTBEAT_S) {
            return Some((Ports::Both, self.board.heartbeat(self.mode)));
        }
        if steps && is_due(&mut self.camera_heartbeat_us, now_us, HEARTBEAT_S) {
            return Some((
                Ports::Both,
                self.camera.camera_heartbeat(matches!(self.mode, Mode::Scanning | Mode::Degraded)),
            ));
        }
        if steps && let Some(ask) = self.enforcer.next_ask(now_us) {
            return Some((Ports::One(Port::Autopilot), self.ask(now_us, ask)));
        }
        if steps && let Some(frame) = self.wish(now_us) {
            return Some((Ports::One(Port::Autopilot), frame));
        }
        // A board that has never stepped has nothing to say.
        self.stepped_us?;
        if let Some((severity, text)) = self.report.take_notice() {
            return Some((Ports::Both, self.board.text(severity, &text)));
        }
        if let Some(capture) = self.captures.take_trigger() {
            return Some((Ports::Both, self.camera.camera_trigger(now_us, capture.wrapping_sub(1))));
        }
        let report = self.captures.take_report()?;
        Some((Ports::Both, self.camera.image_captured(&report)))
    }

    /// What waits for room on the line.
    fn patient(&mut self, now_us: u64) -> Option<(Ports, OutFrame)> {
        let [autopilot, service] = &mut self.lines;
        let rooms = [autopilot.has_room(now_us), service.has_room(now_us)];
        let has_room = |port: Port| rooms.get(port as usize).copied().unwrap_or_default();
        if let Some(port) = self.parameters.next_port().filter(|port| has_room(*port)) {
            let encoding = self.encoding();
            return self.parameters.next_frame(&mut self.board, encoding).map(|frame| (Ports::One(port), frame));
        }
        if has_room(Port::Autopilot) && self.steps(now_us) {
            if let Some(payload) = self.captures.take_tag().and_then(|tag| tunnelled(&tag)) {
                return Some((Ports::Both, self.board.tunnel([0, 0], TAG_KIND, &payload)));
            }
            if let Some(frame) = self.report.next_frame(now_us, &mut self.board) {
                return Some((Ports::Both, frame));
            }
        }
        if self.is_scanning() {
            self.logs.end();
        }
        let port = self.logs.next_port().filter(|port| has_room(*port))?;
        self.logs.next_frame(&mut self.board).map(|frame| (Ports::One(port), frame))
    }

    fn reply(&mut self, now_us: u64, reply: Reply) -> OutFrame {
        let time_ms = (now_us / 1000) as u32;
        let scans = self.is_scanning();
        match reply {
            Reply::Ack { component, number, result, to } => {
                let sender = if component == CAMERA_COMPONENT { &mut self.camera } else { &mut self.board };
                sender.command_ack(number, result, to)
            }
            Reply::TimeSync { asked_ns } => self.board.time_sync(now_us.cast_signed() * 1000, asked_ns),
            Reply::Version { component } => {
                let report = VersionReport { encoding: self.encoding(), ..self.version };
                let sender = if component == CAMERA_COMPONENT { &mut self.camera } else { &mut self.board };
                sender.version(&report)
            }
            Reply::CameraInformation => self.camera.camera_information(time_ms, &self.camera_report),
            Reply::CameraSettings => self.camera.camera_settings(time_ms),
            Reply::Storage => self.camera.storage_information(time_ms),
            Reply::CaptureStatus => self.camera.capture_status(time_ms, scans.then_some(self.period_s)),
        }
    }

    fn ask(&mut self, now_us: u64, ask: Ask) -> OutFrame {
        let to = [self.board.system, AUTOPILOT_COMPONENT];
        match ask {
            Ask::ChangeSpeed(speed_mps, confirmation) => self.board.change_speed(to, confirmation, speed_mps),
            Ask::VelocityLimits(limit_mps) => self.board.velocity_limits(to, limit_mps),
            Ask::Lead(limit_mps) => {
                let forward_mps = self.lead_mps.min(limit_mps);
                let [right_mps, down_mps] =
                    self.offset_m.map(|offset_m| (-CENTRE_PER_S * offset_m).clamp(-CENTRE_MPS, CENTRE_MPS));
                let (sin, cos) = ComplexField::sin_cos(self.vehicle.axis_yaw_rad().unwrap_or_default());
                let velocity_mps = [forward_mps * cos - right_mps * sin, forward_mps * sin + right_mps * cos, down_mps];
                self.board.velocity_setpoint(to, (now_us / 1000) as u32, velocity_mps)
            }
            Ask::Hold(HoldAsk::Read(parameter)) => self.board.parameter_read(to, parameter.name()),
            Ask::Hold(HoldAsk::Write(parameter, value)) => {
                self.board.parameter_set(to, parameter.name(), Value::Real(value).write(Encoding::Cast))
            }
        }
    }

    /// Asks the autopilot for what it does not send, one after the other.
    fn wish(&mut self, now_us: u64) -> Option<OutFrame> {
        let (version_known, quiet) = (self.vehicle.version.is_some(), self.vehicle.is_quiet(now_us));
        if self.wish == 0 {
            let first = self.wished_us.is_none();
            let wanted = self.vehicle.is_alive(now_us) && (first || quiet || !version_known);
            if !wanted || !is_due(&mut self.wished_us, now_us, WISH_S) {
                return None;
            }
        }
        let number = if self.wish == 0 { command::REQUEST_MESSAGE } else { command::SET_MESSAGE_INTERVAL };
        let (message, interval_us) = *WISHES.get(self.wish)?;
        // What comes anyway keeps its rate; only the heartbeat, which tells the mode, is wished for in any case.
        self.wish = if self.wish == 0 || quiet { (self.wish + 1) % WISHES.len() } else { 0 };
        let to = [self.board.system, AUTOPILOT_COMPONENT];
        Some(self.board.command(to, number, 0, &[message as f32, interval_us, 0.0, 0.0, 0.0, 0.0, 0.0]))
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
