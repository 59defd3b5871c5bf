//! A link on the bench: operations go in, what comes out is held against rules that the bench reckons for itself.

use adit_firmware::io::{CentringStatus, Outputs};
use adit_firmware::link::{
    Borrowed, Diagnosis, Keep, LimitParameter, Link, LogAnswer, LogBytes, LogList, LogWish, Memory, Port, READ_BYTES,
};
use adit_protocol::beams::Beams;
use adit_protocol::mavlink::{FrameDecoder, Incoming, Key, Streams, Value};
use adit_protocol::parameters::{CaptureWiring, ParameterTable, Parameters};
use adit_protocol::record::{Entry, Event, EventKind, MissReason, Mode, TagUpdate};
use adit_protocol::tag::{CaptureState, CaptureTag, Ranges, TagFlags};
use adit_protocol::telemetry::{Enforcement, Tunnelled};

use crate::allocations::counted;
use crate::census::count;
use crate::ear::Ear;
use crate::operation::{Case, Operation, Setup};
use crate::outgoing::Outgoing;

/// The secret of boards with a key.
pub(crate) const KEY: [u8; 32] = [0x5A; 32];
/// The newest signature that a board has heard before its start.
pub(crate) const NEWEST: u64 = 35_000_000_000_000;
/// Frames at one instant: some 30 that do not wait, and what 0.1 s of both lines carry of frames of 13 bytes or more.
const MAX_FRAMES: usize = 750;
/// What the link may take of the board's memory.
pub(crate) const MAX_LINK_BYTES: usize = 8 * 1024;

const MODES: [Mode; 7] =
    [Mode::Boot, Mode::Idle, Mode::SelfTest, Mode::Ready, Mode::Scanning, Mode::Degraded, Mode::Fault];

/// A rule that was broken.
pub(crate) type Broken = String;

/// The bench.
pub(crate) struct Rig {
    link: Link,
    now_us: u64,
    ears: [Ear; 2],
    outgoing: Outgoing,
    table: ParameterTable,
    /// Handed out to be kept, and not answered.
    keeping: Option<Keep>,
    /// As the board's memory has them.
    kept: Parameters,
    changed: bool,
    wish: Option<LogWish>,
}

/// Runs a case to its end.
pub(crate) fn run(case: &Case) -> Result<(), Broken> {
    let mut rig = Rig::new(case.setup);
    for operation in &case.operations {
        rig.apply(operation)?;
    }
    rig.settle()
}

fn rule(holds: bool, words: impl FnOnce() -> Broken) -> Result<(), Broken> {
    if holds { Ok(()) } else { Err(words()) }
}

impl Rig {
    fn new(setup: Setup) -> Self {
        let mut parameters = Parameters::default();
        parameters.link.signed_telemetry = setup.has(Setup::SIGNED_TELEMETRY);
        parameters.link.lead_mps = if setup.has(Setup::LEADS) { 0.4 } else { 0.0 };
        parameters.link.axis_yaw_rad = setup.has(Setup::AXIS).then_some(0.5);
        parameters.shutter.wiring = [CaptureWiring::None, CaptureWiring::Busy, CaptureWiring::Confirm]
            [usize::from(setup.0 >> Setup::WIRING) % 3];
        let borrowed = match setup.0 >> Setup::BORROWED & 3 {
            0 => None,
            1 => Some(Borrowed { parameter: LimitParameter::LoiterCentimetres, value: 1250.0 }),
            2 => Some(Borrowed { parameter: LimitParameter::LoiterMetres, value: 12.5 }),
            _ => Some(Borrowed { parameter: LimitParameter::VelocityManual, value: 10.0 }),
        };
        let key = setup.has(Setup::KEY).then_some(KEY);
        let memory = Memory { borrowed, key: key.map(Key), streams: Streams::starting_at(NEWEST) };
        Self {
            link: Link::new(&parameters, memory, 7),
            now_us: 0,
            ears: [Ear::new(Port::Autopilot, key), Ear::new(Port::Service, None)],
            outgoing: Outgoing::new(key, borrowed, setup.has(Setup::LEADS)),
            table: ParameterTable::new(parameters.clone()),
            keeping: None,
            kept: parameters,
            changed: false,
            wish: None,
        }
    }

    fn apply(&mut self, operation: &Operation) -> Result<(), Broken> {
        match operation {
            Operation::Receive { port, bytes } => self.receive(*port, bytes)?,
            Operation::Wait { us } => self.now_us += us,
            Operation::Note { mode, limit, offset, captures } => self.note(*mode, *limit, *offset, *captures),
            Operation::Entry { kind, capture, state } => {
                self.link.note_entry(&entry(*kind, *capture, *state, self.now_us));
            }
            Operation::Drain => self.drain()?,
            Operation::Kept { ok } => self.answer_keep(*ok),
            Operation::Logs { kind, length } => self.answer_logs(*kind, *length),
            Operation::Set { index, whole, bits } => self.set(*index, *whole, *bits)?,
        }
        self.take_effects()
    }

    fn receive(&mut self, port: u8, bytes: &[u8]) -> Result<(), Broken> {
        let port = if port & 1 == 0 { Port::Autopilot } else { Port::Service };
        let (now_us, link) = (self.now_us, &mut self.link);
        let ((), allocations) = counted(|| link.receive(now_us, port, bytes));
        rule(allocations == 0, || format!("receive allocates {allocations} times"))?;
        let heard = self.ears[port as usize].hear(now_us, bytes)?;
        let (theirs, ours) = (link.counters(port), self.ears[port as usize].counters());
        rule(theirs == ours, || format!("{port:?} counts {theirs:?} instead of {ours:?}"))?;
        for frame in &heard {
            if port == Port::Autopilot && frame.component == 1 {
                self.outgoing.know(frame.system);
            }
            if let Some(Incoming::SetupSigning { .. }) = Incoming::read(frame)
                && port == Port::Service
            {
                // From here on the bench does not know who may command, and the key only when it is handed out to be kept.
                self.ears[0].forget_key();
                self.outgoing.sign_with(None);
            }
            if let Some(Incoming::Tunnel { kind, payload, .. }) = Incoming::read(frame) {
                let _ = Tunnelled::read(kind, &payload);
            }
        }
        Ok(())
    }

    fn note(&mut self, mode: u8, limit: Option<u32>, offset: Option<u32>, captures: u32) {
        let mode = MODES[usize::from(mode) % MODES.len()];
        let real = |bits: Option<u32>| bits.map(f32::from_bits);
        let mut outputs = Outputs { mode, speed_limit_mps: real(limit), ..Outputs::default() };
        outputs.centring = real(offset).map(|offset_m| CentringStatus {
            offset_m: [offset_m, -offset_m],
            sigma_m: [offset_m; 2],
            used: Beams::default(),
        });
        outputs.display.captures = captures;
        outputs.display.speed_mps = real(limit);
        outputs.display.water_level_m = real(offset);
        self.outgoing.note(mode, real(limit));
        let diagnosis = Diagnosis { step_us: captures, stack_bytes: captures };
        self.link.note(self.now_us, &outputs, [real(limit), real(offset), None, Some(1.5)], diagnosis);
        count(match self.link.enforcement() {
            Enforcement::Idle => "enforcement: Idle",
            Enforcement::Requested => "enforcement: Requested",
            Enforcement::Enforced => "enforcement: Enforced",
            Enforcement::Ineffective => "enforcement: Ineffective",
            Enforcement::NotPossible => "enforcement: NotPossible",
        });
    }

    /// Everything that is due now.
    fn drain(&mut self) -> Result<(), Broken> {
        for count in 0.. {
            let (now_us, link) = (self.now_us, &mut self.link);
            let (next, allocations) = counted(|| link.next_frame(now_us));
            rule(allocations == 0, || format!("next_frame allocates {allocations} times"))?;
            let Some((ports, bytes)) = next else { break };
            rule(count < MAX_FRAMES, || format!("more than {MAX_FRAMES} frames at one instant"))?;
            self.outgoing.check(ports.contains(Port::Autopilot), &bytes)?;
        }
        Ok(())
    }

    /// What the link hands out besides frames.
    fn take_effects(&mut self) -> Result<(), Broken> {
        let command = self.link.take_command();
        let readdressing = self.link.take_readdressing();
        let restart = self.link.take_restart();
        let effects = [command.is_some(), readdressing.is_some(), restart];
        for (place, _) in
            ["did: command", "did: readdressing", "did: restart"].iter().zip(effects).filter(|(_, did)| *did)
        {
            count(place);
        }
        let has_effect = effects.contains(&true);
        let [autopilot, service] = &mut self.ears;
        let may = autopilot.may_command() || service.may_command();
        rule(may || !has_effect, || {
            format!("{command:?} {readdressing:?} restart {restart}, and nobody who may has said so")
        })?;
        let trusted = [autopilot.settle(has_effect), service.settle(has_effect)].contains(&true);
        if self.keeping.is_none()
            && let Some(keep) = self.link.take_keep(self.now_us)
        {
            Self::check_keep(&keep, trusted)?;
            count(match keep {
                Keep::Borrowed(Some(_)) => "kept: borrowed",
                Keep::Borrowed(None) => "kept: returned",
                Keep::Key(_) => "kept: key",
                Keep::Streams(_) => "kept: streams",
                Keep::Parameters(_) => "kept: parameters",
            });
            if let Keep::Key(key) = keep {
                self.outgoing.sign_with(key.map(|key| key.0));
            }
            self.keeping = Some(keep);
        }
        if let Some(wish) = self.link.take_log_wish() {
            rule(self.wish.replace(wish).is_none(), || "two questions to the card at a time".into())?;
        }
        Ok(())
    }

    fn check_keep(keep: &Keep, trusted: bool) -> Result<(), Broken> {
        match keep {
            Keep::Parameters(parameters) => {
                rule(trusted, || "parameters changed by nobody who may".into())?;
                rule(parameters.profile.build().is_ok(), || format!("impossible {:?}", parameters.profile))?;
                within_bounds(&mut ParameterTable::new(parameters.clone()))
            }
            Keep::Key(_) => rule(trusted, || "a key changed by nobody who may".into()),
            Keep::Borrowed(Some(borrowed)) => {
                let plausible = borrowed.value.is_finite() && borrowed.value > 0.0;
                rule(plausible, || format!("borrowed {borrowed:?}"))
            }
            Keep::Borrowed(None) | Keep::Streams(_) => Ok(()),
        }
    }

    fn answer_keep(&mut self, ok: bool) {
        if ok {
            match &self.keeping {
                Some(Keep::Borrowed(borrowed)) => self.outgoing.keep(*borrowed),
                Some(Keep::Parameters(parameters)) => (self.kept, self.changed) = (parameters.clone(), true),
                _ => {}
            }
        }
        // An answer that nobody waits for is one as well.
        self.keeping = None;
        self.link.kept(ok);
    }

    fn answer_logs(&mut self, kind: u8, length: u16) {
        let wish = self.wish.take().unwrap_or(LogWish::List);
        let bytes = |count: usize| -> LogBytes { (0..count.min(READ_BYTES)).map(|at| at as u8).collect() };
        let list = || -> LogList { (0..length % 33).map(|at| (at.wrapping_mul(length), length.into())).collect() };
        let answer = match (kind % 5, wish) {
            (0, LogWish::List) | (3, LogWish::Read { .. }) => LogAnswer::List(list()),
            (0, LogWish::Read { .. }) | (3, LogWish::List) => LogAnswer::Read(bytes(READ_BYTES)),
            (1, _) => LogAnswer::Read(bytes(length.into())),
            (2, _) => LogAnswer::Read(LogBytes::new()),
            _ => {
                let wish = LogWish::Read { number: length, offset: u32::MAX };
                return self.link.hear_logs(wish, LogAnswer::Read(bytes(READ_BYTES)));
            }
        };
        self.link.hear_logs(wish, answer);
    }

    fn set(&mut self, index: u8, whole: bool, bits: u32) -> Result<(), Broken> {
        let value = if whole { Value::Whole(bits.cast_signed()) } else { Value::Real(f32::from_bits(bits)) };
        let before = self.table.clone();
        let table = &mut self.table;
        let (result, allocations) = counted(|| table.set(index.into(), value));
        rule(allocations == 0, || format!("a parameter allocates {allocations} times"))?;
        if result.is_err() {
            // The bits, because NaN is not the same as itself.
            return rule(format!("{:?}", self.table) == format!("{before:?}"), || {
                format!("{result:?} has changed something")
            });
        }
        let profile = &self.table.parameters().profile;
        rule(profile.build().is_ok(), || format!("{index} = {value:?} made {profile:?}"))?;
        within_bounds(&mut self.table)
    }

    /// When everything is kept, what the board tells is what it keeps.
    fn settle(mut self) -> Result<(), Broken> {
        for _ in 0..8 {
            self.now_us += 2_000_000;
            for port in 0..2 {
                while self.ears[usize::from(port)].is_waiting() {
                    self.receive(port, &[])?;
                }
            }
            if self.keeping.is_some() {
                self.answer_keep(true);
            }
            self.take_effects()?;
        }
        if !self.changed {
            return Ok(());
        }
        self.outgoing.tell_all();
        let encodings = [adit_protocol::mavlink::Encoding::Cast, adit_protocol::mavlink::Encoding::Bytewise];
        let mut sender = adit_protocol::mavlink::Sender::new(255, 190);
        for system in self.outgoing.systems() {
            self.receive(1, &sender.parameter_list([system, 191]))?;
        }
        for _ in 0..20 {
            self.now_us += 50_000;
            self.drain()?;
        }
        let mut kept = ParameterTable::new(self.kept.clone());
        for (index, value) in self.outgoing.told() {
            let (index, Some(row)) = (usize::from(index), ParameterTable::rows().get(usize::from(index))) else {
                continue;
            };
            // A size that the section's kind does not have is remembered until the board's end only.
            if row.name.starts_with("TUN_") && row.name != "TUN_SHAPE" {
                continue;
            }
            let expected = kept.get(index);
            // As numbers: minus zero is kept as zero.
            let same = encodings.iter().any(|encoding| Value::read(value, *encoding) == expected);
            count("settled: told what is kept");
            rule(same, || format!("{} is told as {value:?} and kept as {expected:?}", row.name))?;
        }
        Ok(())
    }
}

/// Each figure within its row's bounds; angles lose a little on their way to degrees.
fn within_bounds(table: &mut ParameterTable) -> Result<(), Broken> {
    for (index, row) in ParameterTable::rows().iter().enumerate() {
        let value = table.get(index).map_or(f32::NAN, Value::real);
        let slack = 1e-4 * (row.most.abs() + row.least.abs());
        let within = value >= row.least - slack && value <= row.most + slack;
        rule(within, || format!("{} = {value}, not within {} to {}", row.name, row.least, row.most))?;
    }
    Ok(())
}

fn entry(kind: u8, capture: u32, state: u8, time_us: u64) -> Entry {
    let state = [CaptureState::Commanded, CaptureState::Busy, CaptureState::Confirmed][usize::from(state) % 3];
    match kind % 3 {
        0 => Entry::Tag(CaptureTag {
            capture,
            state,
            time_us,
            shaft_rad: f32::from_bits(capture),
            ranges: Ranges::default(),
            range_head_m: Some(1.0),
            odometer_m: Some(f32::MAX),
            attitude_rad: Some([f32::NAN; 3]),
            offset_m: None,
            speed_mps: None,
            speed_limit_mps: None,
            flags: TagFlags(capture as u16),
        }),
        1 => Entry::TagUpdate(TagUpdate { capture, state, time_us }),
        _ => {
            let kind = EventKind::Missed { capture, reason: MissReason::NeverBusy, retry: false };
            Entry::Event(Event { time_us, kind })
        }
    }
}

/// A decoder that has to take these bytes as one frame and nothing else.
pub(crate) fn one_frame(bytes: &[u8]) -> Option<adit_protocol::mavlink::RawFrame> {
    let mut decoder = FrameDecoder::default();
    let mut frames = bytes.iter().filter_map(|byte| decoder.push(*byte));
    let frame = frames.next()?;
    (frames.next().is_none() && frame.wire() == bytes).then_some(frame)
}
