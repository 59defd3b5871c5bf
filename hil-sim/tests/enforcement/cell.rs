//! One cell of the matrix: one autopilot in one mode with one trouble.

use adit_hil_sim::autopilot::wire::{STATUSTEXT, Wire, WireFault};
use adit_hil_sim::autopilot::{Kind, NamedAutopilot};
use adit_protocol::mavlink::{FrameDecoder, Incoming};
use adit_protocol::parameters::Parameters;
use adit_protocol::record::Mode;
use adit_protocol::telemetry::Enforcement;

use crate::board_side::BoardSide;
use crate::course::{END_S, LIMITS, STEP_S, Timed, Trouble, limit_index};
use crate::facts::{another_mode, is_possible};
use crate::judge::{Judge, Now};
use crate::vehicle::{AXIS_YAW_RAD, Vehicle};

/// What the pilot wants, always.
const WISH_MPS: f64 = 1.5;
/// How fast the board leads, where it does.
const LEAD_MPS: f32 = 0.8;
/// The average speed at a limit is taken over the last of it.
const AVERAGED_S: f64 = 5.0;
/// One way on a usual line.
const DELAY_S: f64 = 0.02;
const SEED: u64 = 7;

/// The cell.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Cell {
    pub(crate) kind: Kind,
    pub(crate) mode: &'static str,
    /// Does the board lead the vehicle?
    pub(crate) leads: bool,
    pub(crate) trouble: Timed,
    /// One way on the line.
    pub(crate) delay_s: f64,
    /// Of gusts and noise.
    pub(crate) seed: u64,
}

/// What came of one limit.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Leg {
    /// What the board claimed at its end; a board that is off claims nothing.
    pub(crate) claim: Enforcement,
    /// How fast the vehicle truly was in its last seconds, on average.
    pub(crate) flown_mps: f64,
    /// The longest time above it, in one stretch.
    pub(crate) over_s: f64,
}

/// What came of it.
#[derive(Clone, Debug)]
pub(crate) struct Found {
    pub(crate) judge: Judge,
    /// Under each limit.
    pub(crate) legs: [Leg; LIMITS.len()],
    /// Changes of parameters that wear the autopilot's memory.
    pub(crate) saves: u32,
}

/// An autopilot whose owner has set it up for a tunnel: no mission flies faster than its pilot.
fn autopilot(kind: Kind) -> NamedAutopilot {
    let autopilot = NamedAutopilot::new(kind);
    match kind {
        Kind::ArduPilot46 => autopilot.with("WPNAV_SPEED", 150.0),
        Kind::ArduPilot47 => autopilot.with("WP_SPD", 1.5),
        Kind::Px4 | Kind::Px4Development => autopilot.with("MPC_XY_CRUISE", 1.5),
    }
}

/// What may be worse than the trouble of the cell, to see that it is noticed.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Sabotage {
    /// Nothing that limits the speed has any effect.
    pub(crate) ignores_all: bool,
    /// The board's memory keeps nothing.
    pub(crate) forgets: bool,
    /// The words of the board get lost.
    pub(crate) mutes: bool,
}

/// Listens at the board's end for the mode.
#[derive(Default)]
struct Listener {
    decoder: FrameDecoder,
    mode: Option<u32>,
}

impl Listener {
    fn hear(&mut self, bytes: &[u8]) {
        for frame in bytes.iter().filter_map(|byte| self.decoder.push(*byte)) {
            if let Some(Incoming::Heartbeat { custom_mode, .. }) = Incoming::read(&frame) {
                self.mode = Some(custom_mode);
            }
        }
    }
}

impl Cell {
    /// A cell of the matrix.
    pub(crate) fn usual(kind: Kind, mode: &'static str, trouble: Trouble) -> Self {
        Self { kind, mode, leads: false, trouble: Timed::usual(trouble), delay_s: DELAY_S, seed: SEED }
    }

    /// Flies it.
    pub(crate) fn fly(&self) -> Found {
        self.fly_with(Sabotage::default())
    }

    /// Flies it, with something worse than its trouble.
    pub(crate) fn fly_with(&self, sabotage: Sabotage) -> Found {
        let Self { kind, trouble, .. } = *self;
        let mut faults = trouble.wire();
        if sabotage.ignores_all {
            faults.push(WireFault::Ignored { count: u32::MAX });
        }
        if sabotage.mutes {
            faults.push(WireFault::Lost { message: STATUSTEXT, count: u32::MAX });
        }
        let mut parameters = Parameters::default();
        parameters.link.axis_yaw_rad = Some(AXIS_YAW_RAD as f32);
        parameters.link.lead_mps = if self.leads { LEAD_MPS } else { 0.0 };
        let mut board = BoardSide::new(&parameters, sabotage.forgets);
        let mut autopilot = autopilot(kind);
        let before = autopilot.parameters();
        let (mut wire, mut vehicle) = (Wire::new(self.delay_s, &faults), Vehicle::new(self.seed));
        let (mut judge, mut listener) = (Judge::default(), Listener::default());
        let mut legs = [Leg::default(); LIMITS.len()];
        for step in 0..(END_S / STEP_S).round() as u32 {
            let now_s = f64::from(step) * STEP_S;
            let is_now = |at_s: Option<f64>| at_s.is_some_and(|at_s| (at_s - now_s).abs() < 0.5 * STEP_S);
            let mode = if trouble.is_away(now_s) { another_mode(kind, self.mode) } else { self.mode };
            autopilot.set_mode(kind.mode(mode).expect("a mode of this autopilot"));
            if is_now(trouble.autopilot_reset_s()) {
                autopilot.reboot(now_s);
            }
            if is_now(trouble.board_reset_s()) {
                board.reset(now_s);
            }

            let arrives = wire.at_board(now_s);
            let limit_mps = limit_index(now_s).map(|index| LIMITS[index].1);
            let board_mode = if limit_mps.is_some() { Mode::Scanning } else { Mode::Ready };
            let said = board.step(now_s, &arrives, board_mode, limit_mps);
            wire.from_board(now_s, &said);
            let heard = wire.at_autopilot(now_s);
            autopilot.hear(now_s, &heard);
            wire.from_autopilot(now_s, &autopilot.say(now_s, &vehicle.seen()));
            vehicle.step(autopilot.aim_mps(now_s, WISH_MPS), STEP_S);

            let is_linked = !wire.is_cut(now_s) && board.is_up(now_s) && autopilot.is_up(now_s);
            listener.hear(&arrives);
            if !is_linked {
                listener.mode = None;
            }
            let now = Now {
                at_s: now_s,
                is_linked,
                is_known: listener.mode == Some(autopilot.mode()),
                limit_mps,
                is_possible: limit_mps.is_some_and(|limit_mps| is_possible(kind, mode, self.leads, limit_mps)),
                true_speed_mps: vehicle.speed_mps,
                claim: board.claims(),
            };
            judge.look(&now, &heard, STEP_S);
            if let Some(index) = limit_index(now_s) {
                let leg = &mut legs[index];
                leg.claim = if board.is_up(now_s) { board.claims() } else { leg.claim };
                let is_late = limit_index(now_s + AVERAGED_S) != Some(index);
                leg.flown_mps += if is_late { vehicle.speed_mps * STEP_S / AVERAGED_S } else { 0.0 };
                leg.over_s = leg.over_s.max(judge.over_s);
            }
        }
        for (name, value) in autopilot.parameters() {
            if before[name] != value {
                judge.complaints.push(format!("the end: {name} is {value} and was {}", before[name]));
            }
        }
        let must_hold = LIMITS.iter().all(|(_, limit_mps)| is_possible(kind, self.mode, self.leads, *limit_mps));
        if must_hold && trouble.trouble == Trouble::Nothing && !judge.was_enforced {
            judge.complaints.push("the end: it was never said that the limit holds".to_owned());
        }
        Found { judge, legs, saves: autopilot.saves() }
    }
}
