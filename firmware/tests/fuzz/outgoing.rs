//! Rules for what goes out: who we are, and what an autopilot may be asked for.

use std::collections::BTreeMap;

use adit_firmware::link::{Borrowed, LimitParameter};
use adit_protocol::mavlink::{Incoming, RawFrame, RawValue};
use adit_protocol::record::Mode;
use adit_protocol::telemetry::Tunnelled;

use crate::census::count;
use crate::rig::{Broken, one_frame};
use crate::wire::signed_at;

/// The highest floor of each way to ask: a lower limit is asked for as this (`firmware/src/link/modes.rs`, the table).
const COMMAND_FLOOR_MPS: f32 = 0.1;
const PARAMETER_FLOOR_MPS: f32 = 0.3;
/// How fast the board leads the vehicle back to the axis at most.
const CENTRE_MPS: f32 = 0.15;
/// Of single precision.
const SLACK: f32 = 1.0001;

/// What is known of what may go out.
pub(crate) struct Outgoing {
    key: Option<[u8; 32]>,
    /// Time of each component's last signature.
    signed: BTreeMap<u8, u64>,
    systems: Vec<u8>,
    /// What the board's memory says is borrowed.
    borrowed: Option<Borrowed>,
    leads: bool,
    mode: Mode,
    limit_mps: Option<f32>,
    /// The highest limit so far.
    highest_mps: f32,
    /// Values of parameters, by index, since they are wanted.
    told: Option<BTreeMap<u16, RawValue>>,
}

fn rule(holds: bool, words: impl FnOnce() -> Broken) -> Result<(), Broken> {
    if holds { Ok(()) } else { Err(words()) }
}

impl Outgoing {
    pub(crate) fn new(key: Option<[u8; 32]>, borrowed: Option<Borrowed>, leads: bool) -> Self {
        Self {
            key,
            signed: BTreeMap::new(),
            systems: vec![1],
            borrowed,
            leads,
            mode: Mode::Boot,
            limit_mps: None,
            highest_mps: 0.0,
            told: None,
        }
    }

    /// An autopilot of this system was heard.
    pub(crate) fn know(&mut self, system: u8) {
        if !self.systems.contains(&system) {
            self.systems.push(system);
        }
    }

    /// Systems that the board may count itself to.
    pub(crate) fn systems(&self) -> Vec<u8> {
        self.systems.clone()
    }

    /// What is said must be signed with this from now on; `None` if that is not known, or nothing must.
    pub(crate) fn sign_with(&mut self, key: Option<[u8; 32]>) {
        self.key = key;
    }

    /// The memory holds this now.
    pub(crate) fn keep(&mut self, borrowed: Option<Borrowed>) {
        self.borrowed = borrowed;
    }

    /// The controller wants this.
    pub(crate) fn note(&mut self, mode: Mode, limit_mps: Option<f32>) {
        self.mode = mode;
        self.limit_mps = limit_mps.filter(|limit| limit.is_finite()).map(|limit| limit.max(0.0));
        self.highest_mps = self.highest_mps.max(self.limit_mps.unwrap_or_default());
    }

    /// From now on values of parameters are written down.
    pub(crate) fn tell_all(&mut self) {
        self.told = Some(BTreeMap::new());
    }

    /// The last value of each parameter.
    pub(crate) fn told(&self) -> BTreeMap<u16, RawValue> {
        self.told.clone().unwrap_or_default()
    }

    /// Holds a frame against the rules.
    pub(crate) fn check(&mut self, to_autopilot: bool, bytes: &[u8]) -> Result<(), Broken> {
        let frame = one_frame(bytes).ok_or_else(|| format!("no frame: {bytes:02x?}"))?;
        rule(self.systems.contains(&frame.system) && [191, 100].contains(&frame.component), || {
            format!("message {} from {}/{}", frame.message, frame.system, frame.component)
        })?;
        if let Some(key) = self.key {
            let time = signed_at(&key, bytes).ok_or_else(|| format!("message {} is not signed", frame.message))?;
            let before = self.signed.insert(frame.component, time);
            rule(before.is_none_or(|before| before < time), || format!("signed at {time} after {before:?}"))?;
        }
        match Incoming::read(&frame) {
            Some(Incoming::Tunnel { kind, payload, .. }) => {
                count("sent: tunnel");
                rule(Tunnelled::read(kind, &payload).is_some(), || format!("tunnel {kind}: {payload:02x?}"))
            }
            Some(Incoming::ParameterValue { value, index, .. }) => {
                count("answered: parameter");
                if let Some(told) = &mut self.told {
                    told.insert(index, value);
                }
                Ok(())
            }
            Some(Incoming::ParameterSet { target: [_, 1], name: Some(name), value }) => {
                rule(to_autopilot, || "a parameter for the autopilot at the wrong port".into())?;
                self.check_parameter(&name, value)
            }
            _ => self.check_limit(&frame),
        }
    }

    fn check_parameter(&self, name: &str, value: RawValue) -> Result<(), Broken> {
        let value = f32::from_le_bytes(value.bytes);
        let words = || format!("{name} = {value}, limit at most {}, kept {:?}", self.highest_mps, self.borrowed);
        let Some(borrowed) = self.borrowed.filter(|borrowed| borrowed.parameter.name() == name) else {
            return Err(words());
        };
        let unit_mps = if borrowed.parameter == LimitParameter::LoiterCentimetres { 0.01 } else { 1.0 };
        let most = self.highest_mps.max(PARAMETER_FLOOR_MPS) * SLACK / unit_mps;
        let is_old = value == borrowed.value;
        count(if is_old { "asked: parameter given back" } else { "asked: parameter lowered" });
        let sound = value > 0.0 && value <= borrowed.value && (value <= most || is_old);
        rule(sound, words)
    }

    fn check_limit(&self, frame: &RawFrame) -> Result<(), Broken> {
        let words = |asked: &[f32]| format!("asked for {asked:?} m/s with a limit of {:?}", self.limit_mps);
        let within = |asked: f32, floor_mps: f32| {
            let limit_mps = self.limit_mps.map(|limit| limit.max(floor_mps));
            limit_mps.is_some_and(|limit_mps| asked.is_finite() && asked >= 0.0 && asked <= limit_mps)
        };
        match frame.message {
            // COMMAND_LONG, of which DO_CHANGE_SPEED is one.
            76 if frame.u16(28) == 178 => {
                count("asked: speed");
                rule(within(frame.f32(4), COMMAND_FLOOR_MPS), || words(&[frame.f32(4)]))
            }
            // SET_VELOCITY_LIMITS.
            354 => {
                count("asked: velocity limits");
                rule(within(frame.f32(0), PARAMETER_FLOOR_MPS), || words(&[frame.f32(0)]))
            }
            // COMMAND_ACK.
            77 => {
                count("answered: command");
                Ok(())
            }
            // LOG_DATA.
            120 => {
                count("sent: log data");
                Ok(())
            }
            // SET_POSITION_TARGET_LOCAL_NED: its velocity.
            84 => {
                count("asked: lead");
                let velocity_mps @ [north, east, down] = [frame.f32(16), frame.f32(20), frame.f32(24)];
                let scans = matches!(self.mode, Mode::Scanning | Mode::Degraded);
                let most_mps = self.limit_mps.unwrap_or(f32::NAN).min(0.4).hypot(CENTRE_MPS) * SLACK;
                let sound = north.hypot(east) <= most_mps && down.abs() <= CENTRE_MPS && self.leads && scans;
                rule(sound, || words(&velocity_mps))
            }
            _ => Ok(()),
        }
    }
}
