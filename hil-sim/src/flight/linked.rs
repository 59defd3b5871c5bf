//! The board's library at the end of a line: controller and link as in the image, and an autopilot by name at the other end.
//!
//! What the vehicle's estimator reports goes over MAVLink, as do the pilot's commands; the limit acts through the autopilot
//! only, as far as its mode lets it. A ground station may listen and speak: the autopilot passes frames on as
//! [`routing`](crate::autopilot::routing) says.

use std::collections::BTreeMap;
use std::time::{Duration, Instant};

use adit_firmware::controller::Controller;
use adit_firmware::io::{Command, Inputs, Outputs};
use adit_firmware::link::{Diagnosis, Link, Memory, Port, measured_m};
use adit_protocol::beams::Beam;
use adit_protocol::mavlink::{BOARD_COMPONENT, Sender, command};
use adit_protocol::parameters::Parameters;
use adit_protocol::telemetry::Enforcement;

use super::watcher::Watcher;
use super::{Board, BoardError, FlightError};
use crate::autopilot::wire::Wire;
use crate::autopilot::{Kind, NamedAutopilot, SYSTEM, Seen};
use crate::config::Simulation;
use crate::peer::Peer;

/// One way between board and autopilot.
const DELAY_S: f64 = 0.01;
/// Where the tunnel goes, from north: neither along an axis nor near a turn's end.
const AXIS_YAW_RAD: f64 = 0.7;
/// Flying time of a battery, and how often a ground station is told what is left.
const BATTERY_S: f64 = 900.0;
const BATTERY_PERIOD_S: f64 = 1.0;
/// The pilot's ground station: its system and `MAV_COMP_ID_MISSIONPLANNER`.
const GROUND: [u8; 2] = [255, 190];
/// A number that no other board has.
const UID: u64 = 1;

/// Board, line and autopilot.
pub struct Linked {
    controller: Controller,
    link: Link,
    /// The memory answers in the step after it was written.
    is_keeping: bool,
    wire: Wire,
    autopilot: NamedAutopilot,
    pilot: Sender,
    watcher: Option<Watcher>,
    /// The moment of the board's start, if the flight is to last as long as a real one.
    started: Option<Instant>,
    /// The autopilot's parameters as they were.
    before: BTreeMap<&'static str, f64>,
    claimed_s: [f64; 4],
    last_s: f64,
    battery_due_s: f64,
}

/// How the limit fared.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Account {
    /// While a limit stood, the board claimed for so long that it was requested, enforced, ineffective, not possible.
    pub claimed_s: [f64; 4],
    /// Changes that went to the autopilot's permanent memory.
    pub saves: u32,
    /// Parameters of the autopilot that were not given back.
    pub changed: Vec<String>,
}

impl Account {
    /// In a line, for people.
    pub fn text(&self) -> String {
        let [requested_s, enforced_s, ineffective_s, not_possible_s] = self.claimed_s;
        let Self { saves, changed, .. } = self;
        let kept = if changed.is_empty() { "all as before".to_owned() } else { format!("not as before: {changed:?}") };
        format!(
            "limit requested {requested_s:.1} s, enforced {enforced_s:.1} s, ineffective {ineffective_s:.1} s, not possible \
             {not_possible_s:.1} s; autopilot's parameters changed {saves} times, {kept}"
        )
    }
}

impl Linked {
    /// A board with this autopilot, which its owner has set up for the pilot's speed.
    ///
    /// # Errors
    /// [`FlightError::Mode`] if the autopilot has no such mode.
    pub fn new(kind: Kind, parameters: &Parameters, simulation: &Simulation) -> Result<Self, FlightError> {
        let usual = if matches!(kind, Kind::ArduPilot46 | Kind::ArduPilot47) { "AUTO" } else { "MISSION" };
        let mode = simulation.autopilot.mode.map_or(usual, |mode| mode.name());
        let Some(number) = kind.mode(mode) else {
            let known = kind.modes().iter().map(|(_, name)| *name).collect::<Vec<_>>().join(", ");
            return Err(FlightError::Mode { autopilot: kind.name(), mode, known });
        };
        let cruise_mps = simulation.pilot.cruise_mps as f32;
        let mut autopilot = NamedAutopilot::new(kind);
        autopilot = match kind {
            Kind::ArduPilot46 => autopilot.with("WPNAV_SPEED", cruise_mps * 100.0),
            Kind::ArduPilot47 => autopilot.with("WP_SPD", cruise_mps),
            Kind::Px4 | Kind::Px4Development => autopilot.with("MPC_XY_CRUISE", cruise_mps),
        };
        autopilot.set_mode(number);
        Ok(Self {
            controller: Controller::new(parameters.clone()),
            link: Link::new(parameters, Memory::default(), UID),
            is_keeping: false,
            wire: Wire::new(DELAY_S, &[]),
            before: autopilot.parameters(),
            autopilot,
            pilot: Sender::new(GROUND[0], GROUND[1]),
            watcher: None,
            started: None,
            claimed_s: [0.0; 4],
            last_s: 0.0,
            battery_due_s: 0.0,
        })
    }

    /// With a peer that sees the vehicle as a ground station does.
    #[must_use]
    pub fn watched_by(mut self, peer: Peer) -> Self {
        self.watcher = Some(Watcher::new(peer));
        self
    }

    /// A second lasts a second.
    #[must_use]
    pub fn in_real_time(mut self) -> Self {
        self.started = Some(Instant::now());
        self
    }

    /// How the limit fared so far.
    pub fn account(&self) -> Account {
        let now = self.autopilot.parameters();
        let changed = now.iter().filter(|(name, value)| self.before.get(*name) != Some(value));
        Account {
            claimed_s: self.claimed_s,
            saves: self.autopilot.saves(),
            changed: changed.map(|(name, _)| (*name).to_owned()).collect(),
        }
    }

    /// Carries what was said to whom it is for.
    fn carry(&mut self, now_s: f64, inputs: &Inputs) -> Result<(), BoardError> {
        let said = self.autopilot.say(now_s, seen(inputs).as_ref());
        self.wire.from_autopilot(now_s, &said);
        if let Some(order) = inputs.command {
            let frame = self.pilot.command([SYSTEM, BOARD_COMPONENT], number(order), 0, &parameters(order));
            self.wire.from_autopilot(now_s, &frame);
        }
        let heard = self.wire.at_autopilot(now_s);
        self.autopilot.hear(now_s, &heard);
        if let Some(watcher) = &mut self.watcher {
            let mut said = said;
            if now_s >= self.battery_due_s {
                self.battery_due_s += BATTERY_PERIOD_S;
                said.extend(self.autopilot.tell_battery((1.0 - now_s / BATTERY_S).max(0.0)));
            }
            watcher.tell(&said, &heard).map_err(BoardError::Peer)?;
            let asked = watcher.ask().map_err(BoardError::Peer)?;
            self.autopilot.hear(now_s, &asked.for_autopilot);
            self.wire.from_autopilot(now_s, &asked.for_board);
        }
        Ok(())
    }

    /// The link's part of a step that comes after the controller's.
    fn publish(&mut self, now_us: u64, now_s: f64, inputs: &Inputs, outputs: &Outputs) {
        for entry in &outputs.entries {
            self.link.note_entry(entry);
        }
        let readings = Beam::ALL.map(|beam| inputs.ranges.get(beam).reading);
        self.link.note(now_us, outputs, measured_m(readings), Diagnosis::default());
        if std::mem::take(&mut self.is_keeping) {
            self.link.kept(true);
        }
        self.is_keeping = self.link.take_keep(now_us).is_some();
        while let Some((ports, frame)) = self.link.next_frame(now_us) {
            if ports.contains(Port::Autopilot) {
                self.wire.from_board(now_s, &frame);
            }
        }
        let claim = match self.link.enforcement() {
            Enforcement::Idle => None,
            Enforcement::Requested => Some(0),
            Enforcement::Enforced => Some(1),
            Enforcement::Ineffective => Some(2),
            Enforcement::NotPossible => Some(3),
        };
        if let Some(claim) = claim {
            self.claimed_s[claim] += now_s - self.last_s;
        }
        self.last_s = now_s;
    }

    fn wait(&self, now_us: u64) {
        let ahead = self.started.and_then(|started| Duration::from_micros(now_us).checked_sub(started.elapsed()));
        if let Some(ahead) = ahead {
            std::thread::sleep(ahead);
        }
    }
}

impl Board for Linked {
    fn step(&mut self, now_us: u64, inputs: &Inputs) -> Result<Outputs, BoardError> {
        self.wait(now_us);
        let now_s = now_us as f64 * 1e-6;
        self.carry(now_s, inputs)?;
        let arrived = self.wire.at_board(now_s);
        self.link.receive(now_us, Port::Autopilot, &arrived);
        let mut inputs = *inputs;
        self.link.vehicle(now_us).fill(&mut inputs);
        inputs.command = self.link.take_command();
        let outputs = self.controller.step(now_us, &inputs);
        self.publish(now_us, now_s, &inputs, &outputs);
        Ok(outputs)
    }

    fn steer(&mut self, now_us: u64, wish_mps: f64) -> Option<f64> {
        Some(self.autopilot.aim_mps(now_us as f64 * 1e-6, wish_mps))
    }
}

/// What the vehicle's estimator tells its autopilot, if it tells anything.
fn seen(inputs: &Inputs) -> Option<Seen> {
    Some(Seen {
        attitude_rad: inputs.attitude_rad?.map(f64::from),
        place_m: f64::from(inputs.odometer_m?),
        speed_mps: f64::from(inputs.speed_mps?),
        axis_yaw_rad: AXIS_YAW_RAD,
    })
}

/// `MAV_CMD` of an order.
fn number(order: Command) -> u16 {
    match order {
        Command::Arm | Command::Disarm => command::ARM_DISARM,
        Command::Start => command::START_CAPTURE,
        Command::Stop => command::STOP_CAPTURE,
    }
}

fn parameters(order: Command) -> [f32; 7] {
    let first = if order == Command::Arm { 1.0 } else { 0.0 };
    [first, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]
}
