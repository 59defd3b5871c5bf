//! The scripted board: it answers as the board's documents say, written anew here.

use std::collections::VecDeque;
use std::sync::{Arc, Mutex};
use std::time::Duration;

use adit_protocol::connection::Connection;
use adit_protocol::mavlink::{
    CommandResult, Encoding, FrameDecoder, Incoming, Key, OutFrame, RawFrame, Sender, Severity, Signer, Streams, Value,
    VehicleBeat, VersionReport, command,
};
use adit_protocol::parameters::{ParameterTable, Parameters};
use adit_protocol::record::Mode;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use tokio::task::JoinHandle;
use tokio::time::interval;

use super::super::{Line, LineEvent, LinkError};

/// What a board is like.
#[derive(Clone, Debug)]
pub(crate) struct Script {
    pub(super) system: u8,
    pub(super) encoding: Encoding,
    /// Share of messages that are lost each way, repeated and delayed.
    pub(super) damage: f64,
    pub(super) logs: Vec<(u16, Vec<u8>)>,
    pub(super) key: Option<Key>,
    /// Its signing clock, which knows no calendar.
    pub(super) time: u64,
    /// Does it take keys?
    pub(super) is_service_port: bool,
    /// The log is cut here: the card fails.
    pub(super) log_end: usize,
}

impl Default for Script {
    fn default() -> Self {
        Self {
            system: 1,
            encoding: Encoding::Bytewise,
            damage: 0.0,
            logs: Vec::new(),
            key: None,
            time: 1000,
            is_service_port: true,
            log_end: usize::MAX,
        }
    }
}

/// What became of a board.
#[derive(Clone, Debug, Default)]
pub(super) struct Ledger {
    /// Commands other than questions, repeats left out.
    pub(super) obeyed: Vec<u16>,
    /// Log requests: offset and count.
    pub(super) log_requests: Vec<(u32, u32)>,
    pub(super) parameters: Option<Parameters>,
    pub(super) heartbeats: usize,
}

/// A board that runs.
pub(crate) struct ScriptedBoard {
    pub(super) ledger: Arc<Mutex<Ledger>>,
    task: JoinHandle<()>,
}

impl Drop for ScriptedBoard {
    fn drop(&mut self) {
        self.task.abort();
    }
}

impl ScriptedBoard {
    pub(super) async fn start(connection: &Connection, script: Script) -> Self {
        let line = loop {
            match Line::open(connection, Duration::from_secs(5)).await {
                Ok(line) => break line,
                // The one before it is about to leave the address.
                Err(LinkError::Open { source, .. }) if source.kind() == std::io::ErrorKind::AddrInUse => {
                    tokio::task::yield_now().await;
                }
                Err(error) => panic!("{error}"),
            }
        };
        let ledger = Arc::new(Mutex::new(Ledger::default()));
        let mut sender = Sender::new(script.system, 191);
        sender.signer = script.key.map(|key| Signer { key, link: 0, time: script.time });
        let brain = Brain {
            line,
            sender,
            autopilot: Sender::new(script.system, 1),
            table: ParameterTable::new(Parameters::default()),
            streams: Streams::default(),
            rng: ChaCha8Rng::seed_from_u64(7),
            delayed: VecDeque::new(),
            ledger: Arc::clone(&ledger),
            script,
        };
        Self { ledger, task: tokio::spawn(brain.run()) }
    }

    pub(super) fn ledger(&self) -> Ledger {
        self.ledger.lock().unwrap().clone()
    }
}

struct Brain {
    line: Line,
    sender: Sender,
    autopilot: Sender,
    table: ParameterTable,
    streams: Streams,
    rng: ChaCha8Rng,
    delayed: VecDeque<OutFrame>,
    ledger: Arc<Mutex<Ledger>>,
    script: Script,
}

impl Brain {
    async fn run(mut self) {
        let mut decoder = FrameDecoder::default();
        let mut beat = interval(Duration::from_millis(30));
        loop {
            tokio::select! {
                event = self.line.next() => match event {
                    Some(LineEvent::Bytes(bytes)) => {
                        for frame in bytes.iter().filter_map(|byte| decoder.push(*byte)).collect::<Vec<_>>() {
                            if !self.rng.random_bool(self.script.damage) {
                                self.hear(&frame);
                            }
                        }
                    }
                    Some(_) => decoder = FrameDecoder::default(),
                    None => return,
                },
                _ = beat.tick() => {
                    let autopilot = if self.script.encoding == Encoding::Cast { 3 } else { 12 };
                    let frame = self.autopilot.vehicle_heartbeat(VehicleBeat { autopilot, base_mode: 0, custom_mode: 0 });
                    self.say(frame);
                    let frame = self.sender.heartbeat(Mode::Idle);
                    self.say(frame);
                }
            }
        }
    }

    /// Sends a frame over a bad line.
    fn say(&mut self, frame: OutFrame) {
        let damage = self.script.damage;
        if self.rng.random_bool(damage) {
            return;
        }
        if self.rng.random_bool(damage / 2.0) {
            self.line.send(frame.to_vec());
        }
        if self.rng.random_bool(damage) {
            self.delayed.push_back(frame);
            return;
        }
        self.line.send(frame.to_vec());
        if let Some(late) = self.delayed.pop_front() {
            self.line.send(late.to_vec());
        }
    }

    fn text(&mut self, text: &str) {
        let frame = self.sender.text(Severity::Warning, &text.try_into().unwrap());
        self.say(frame);
    }

    /// Whether a request may have an effect.
    fn admits(&mut self, frame: &RawFrame) -> bool {
        let Some(key) = self.script.key else { return true };
        let is_believed = self.streams.accept(&key, frame).is_ok();
        if !is_believed {
            self.text("refused request of 255/190: unsigned");
        } else if let Some(signer) = &mut self.sender.signer {
            signer.set_time(self.streams.newest);
        }
        is_believed
    }

    fn hear(&mut self, frame: &RawFrame) {
        let (us, from) = ([self.script.system, 191], [frame.system, frame.component]);
        match Incoming::read(frame) {
            Some(Incoming::Heartbeat { .. }) => self.ledger.lock().unwrap().heartbeats += 1,
            Some(Incoming::Command { target, command, confirmation, parameters }) if target == us => {
                self.obey(from, command, confirmation, parameters[0]);
            }
            Some(Incoming::ParameterList { target }) if target == us => {
                for index in 0..ParameterTable::rows().len() {
                    self.tell(index);
                }
            }
            Some(Incoming::ParameterRead { target, index, name }) if target == us => {
                let by_name = || name.as_ref().and_then(|name| ParameterTable::find(name));
                if let Some(index) = usize::try_from(index).ok().or_else(by_name) {
                    self.tell(index);
                }
            }
            Some(Incoming::ParameterSet { target, name: Some(name), value }) if target == us && self.admits(frame) => {
                let Some(index) = ParameterTable::find(&name) else { return };
                let value = Value::read(value, self.script.encoding);
                if value.is_none_or(|value| self.table.set(index, value).is_err()) {
                    self.text(&format!("{name}: value refused"));
                }
                self.ledger.lock().unwrap().parameters = Some(self.table.parameters().clone());
                self.tell(index);
            }
            Some(Incoming::LogList { target, .. }) if target == us => self.list_logs(),
            Some(Incoming::LogRequest { target, id, offset, count }) if target == us => {
                self.send_log(id, offset, count);
            }
            Some(Incoming::SetupSigning { target, key, time }) if target == us => {
                if !self.script.is_service_port {
                    self.text("key refused: TELEM2 only, and at rest");
                    return;
                }
                let key = (key.0 != [0; 32]).then_some(key);
                self.script.key = key;
                self.sender.signer = key.map(|key| Signer { key, link: 0, time });
                self.text(if key.is_some() { "key installed" } else { "key removed" });
            }
            _ => {}
        }
    }

    fn obey(&mut self, from: [u8; 2], number: u16, confirmation: u8, first: f32) {
        if number == command::REQUEST_MESSAGE && first == 148.0 {
            let report = VersionReport { version: [0, 1, 2], encoding: self.script.encoding, uid: 0xABC };
            let frame = self.sender.version(&report);
            self.say(frame);
        } else if confirmation == 0 || self.ledger.lock().unwrap().obeyed.last() != Some(&number) {
            self.ledger.lock().unwrap().obeyed.push(number);
        }
        let result = if number == 9999 { CommandResult::Unsupported } else { CommandResult::Accepted };
        let frame = self.sender.command_ack(number, result, from);
        self.say(frame);
    }

    fn tell(&mut self, index: usize) {
        let rows = ParameterTable::rows();
        let Some(value) = self.table.get(index) else { return };
        let place = [index as u16, rows.len() as u16];
        let frame = self.sender.parameter_value(rows[index].name, value.write(self.script.encoding), place);
        self.say(frame);
    }

    fn list_logs(&mut self) {
        let logs: Vec<_> = self.script.logs.iter().map(|(number, bytes)| (*number, bytes.len() as u32)).collect();
        let (count, last) = (logs.len() as u16, logs.last().map_or(0, |(number, _)| *number));
        if logs.is_empty() {
            let frame = self.sender.log_entry([0, 0, 0], 0);
            self.say(frame);
        }
        for (number, bytes) in logs {
            let frame = self.sender.log_entry([number, count, last], bytes);
            self.say(frame);
        }
    }

    fn send_log(&mut self, id: u16, offset: u32, count: u32) {
        self.ledger.lock().unwrap().log_requests.push((offset, count));
        let logs = self.script.logs.clone();
        let bytes = logs.iter().find(|(number, _)| *number == id).map(|(_, bytes)| &bytes[..]).unwrap_or_default();
        let bytes = &bytes[..bytes.len().min(self.script.log_end)];
        let mut at = offset as usize;
        let until = (offset + count) as usize;
        while at < until {
            let piece = bytes.get(at..).unwrap_or_default();
            let piece = &piece[..piece.len().min(90).min(until - at)];
            let frame = self.sender.log_data(id, at as u32, piece);
            self.say(frame);
            at += piece.len();
            if piece.len() < 90 {
                return;
            }
        }
    }
}
