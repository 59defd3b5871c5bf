//! What comes in, and who may have it done.

use adit_protocol::mavlink::{
    BOARD_COMPONENT, CAMERA_COMPONENT, Incoming, Key, RawFrame, Severity, SignatureError, Target, Value, command,
};
use adit_protocol::record::Mode;

use super::commands::{self, Reply};
use super::enforce::is_due;
use super::guard::Refused;
use super::modes::LimitParameter;
use super::params::Change;
use super::{Link, Port};
use crate::io::Command;

/// Words about refused requests come no more often than this.
const SAY_REFUSED_S: f32 = 10.0;

impl Link {
    pub(super) fn hear(&mut self, now_us: u64, port: Port, frame: &RawFrame) {
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
}
