//! What goes out, and when: the first that is due.

use adit_protocol::mavlink::{
    AUTOPILOT_COMPONENT, CAMERA_COMPONENT, Encoding, OutFrame, Value, VersionReport, command, message,
};
use adit_protocol::record::Mode;
use adit_protocol::telemetry::{TAG_KIND, tunnelled};
use nalgebra::ComplexField;

use super::commands::Reply;
use super::enforce::{Ask, is_due};
use super::hold::HoldAsk;
use super::{Link, Port, Ports};
use crate::time::has_passed;

/// The controller counts as stalled after this.
const STALLED_S: f32 = 1.0;
const HEARTBEAT_S: f32 = 1.0;
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

impl Link {
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
