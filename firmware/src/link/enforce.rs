//! The speed limit on its way to the autopilot, and whether it is obeyed.
//!
//! The mode's [row](super::modes) says how the limit is set; the measured speed says whether it is in force, never an answer:
//! PX4 accepts commands that it then ignores.
//!
//! | state | when |
//! |---|---|
//! | Requested | asked, and the vehicle has not been seen to fly at the limit yet |
//! | Enforced | it has been seen between [`PRESSING_SHARE`] of the limit and the limit for [`PROOF_S`] since mode or limit changed much |
//! | Ineffective | it has been faster for [`REACTION_S`], or the autopilot refuses |
//! | `NotPossible` | no autopilot, no way in this mode, a limit below the mode's floor, a parameter that cannot be borrowed |
//!
//! What is asked is repeated every second, for whoever lost it (a lost message, a change of mode, an autopilot that began
//! anew), and twice as often while the vehicle is too fast. A parameter whose effect overshoots is asked for with a share of
//! the limit that shrinks with every excess that braking does not end, and grows again while the vehicle stays far below.

use adit_protocol::mavlink::CommandResult;
use adit_protocol::telemetry::Enforcement;

use super::hold::{Borrowed, Hold, HoldAsk, Refusal};
use super::modes::{LimitParameter, Row, Way};
use super::{Keep, Timed};
use crate::time::has_passed;

/// From a change of limit or mode to the vehicle flying no faster, message losses and braking included.
pub const REACTION_S: f32 = 3.0;
/// The vehicle is too fast above the limit by this share and [`TOLERANCE_MPS`].
const TOLERANCE_SHARE: f32 = 0.05;
const TOLERANCE_MPS: f32 = 0.03;
/// It flies at the limit from this share of it on.
const PRESSING_SHARE: f32 = 0.7;
/// For so long, and the limit is proven to be in force.
const PROOF_S: f32 = 1.5;
/// A limit that changes by this share has to be proven again.
const CHANGE_SHARE: f32 = 0.3;
const REPEAT_S: f32 = 1.0;
const REPEAT_FAST_S: f32 = 0.5;
/// Commands for a new limit come no closer than this.
const PAUSE_S: f32 = 0.2;
/// Changes of the limit that are worth a command.
const CHANGE_MPS: f32 = 0.01;
/// An excess shorter than this is a gust.
const GUST_S: f32 = 0.5;
/// The share of the limit that a stick's full speed is set to at first: it overshoots (`ArduPilot` #17747).
const STICK_SHARE: f32 = 0.85;
/// And at last.
const LEAST_SHARE: f32 = 0.4;
/// The share changes no more often than this: the vehicle must have had time to follow.
const SHARE_S: f32 = 1.0;
/// It shrinks by no less than this at a time,
const SHRINK: f32 = 0.8;
/// and grows by this.
const GROW: f32 = 1.08;
/// A vehicle whose speed has fallen by this within [`TREND_S`] is braking.
const BRAKING_MPS: f32 = 0.02;
const TREND_S: f32 = 0.4;
/// Setpoints of velocity expire after 3 s in `ArduPilot`.
const LEAD_S: f32 = 0.2;

/// What the enforcement looks at.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Situation {
    /// The limit, if one stands.
    pub(super) limit_mps: Option<f32>,
    /// How the autopilot's mode takes it; `None` without an autopilot.
    pub(super) row: Option<Row>,
    /// Measured along the axis, without its sign.
    pub(super) speed_mps: Option<f32>,
    /// Does the board lead the vehicle, if the mode follows?
    pub(super) leads: bool,
}

/// What is to be asked of the autopilot.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Ask {
    /// `DO_CHANGE_SPEED`; so many went unanswered before.
    ChangeSpeed(f32, u8),
    /// `SET_VELOCITY_LIMITS`.
    VelocityLimits(f32),
    /// A velocity along the axis, no faster than this.
    Lead(f32),
    /// A parameter.
    Hold(HoldAsk),
}

/// Why a limit is not in force.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Cause {
    /// Nobody is heard.
    NoAutopilot,
    /// This mode takes none.
    Mode,
    /// The limit is lower than this mode takes.
    Floor,
    /// The parameter cannot be borrowed.
    Refused(Refusal),
    /// The autopilot says no.
    Denied,
    /// The vehicle flies faster.
    TooFast,
}

/// The enforcement.
#[derive(Clone, Debug)]
pub(super) struct Enforcer {
    hold: Hold,
    situation: Option<Situation>,
    /// The mode's name, to notice its change.
    mode: Option<&'static str>,
    command: Timed<f32>,
    unanswered: u8,
    denied: bool,
    limits_us: Option<u64>,
    lead_us: Option<u64>,
    share: f32,
    share_us: Option<u64>,
    judge: Judge,
}

/// What the measured speed has shown.
#[derive(Clone, Copy, Debug, Default)]
struct Judge {
    last_us: Option<u64>,
    over_since_us: Option<u64>,
    within_since_us: Option<u64>,
    proof_s: f32,
    /// The limit that the proof is for.
    proven_mps: f32,
    too_fast: bool,
    /// The speed a moment ago, and whether it has fallen since the one before.
    trend: Timed<f32>,
    brakes: bool,
}

impl Enforcer {
    pub(super) fn new(borrowed: Option<Borrowed>) -> Self {
        Self {
            hold: Hold::new(borrowed),
            situation: None,
            mode: None,
            command: None,
            unanswered: 0,
            denied: false,
            limits_us: None,
            lead_us: None,
            share: STICK_SHARE,
            share_us: None,
            judge: Judge::default(),
        }
    }

    /// What must be kept over a loss of power before the autopilot's parameter is touched.
    pub(super) fn take_keep(&mut self) -> Option<Keep> {
        self.hold.take_keep()
    }

    /// It is kept, or cannot be.
    pub(super) fn kept(&mut self, ok: bool) {
        self.hold.kept(ok);
    }

    /// The autopilot has begun anew: it has forgotten what it was told.
    pub(super) fn begin_anew(&mut self) {
        self.command = None;
        self.limits_us = None;
        self.hold.begin_anew();
    }

    /// The autopilot answers `DO_CHANGE_SPEED`.
    pub(super) fn hear_answer(&mut self, result: u8) {
        // 5 is under way.
        let refusals = [
            CommandResult::TemporarilyRejected,
            CommandResult::Denied,
            CommandResult::Unsupported,
            CommandResult::Failed,
        ];
        self.denied = refusals.iter().any(|refusal| *refusal as u8 == result);
        self.unanswered = 0;
    }

    /// The autopilot tells a parameter.
    pub(super) fn hear_parameter(&mut self, parameter: LimitParameter, value: f32) {
        self.hold.hear(parameter, value);
    }

    /// Takes the situation of this moment.
    pub(super) fn look(&mut self, now_us: u64, situation: Situation) {
        let mode = situation.row.map(|row| row.name);
        let begins = situation.limit_mps.is_some() && self.limit_mps().is_none();
        if mode != self.mode || begins {
            self.mode = mode;
            (self.command, self.limits_us, self.denied, self.unanswered) = (None, None, false, 0);
            self.judge = Judge::default();
        }
        if begins {
            self.share = STICK_SHARE;
        }
        self.situation = Some(situation);
        match situation.limit_mps {
            Some(limit_mps) => self.judge.look(now_us, limit_mps, situation.speed_mps),
            None => self.judge = Judge::default(),
        }
        self.adapt_share(now_us, situation);
        let wanted = situation.limit_mps.map(|limit_mps| {
            let (way, floor_mps) = situation.row.map_or((Way::None, 0.0), |row| (row.way, row.floor_mps));
            let share = if way == Way::LoiterParameter { self.share } else { self.share / STICK_SHARE };
            (way, (limit_mps * share).max(floor_mps))
        });
        self.hold.want(now_us, wanted);
    }

    /// Asks for less where the vehicle overshoots what it was told, and for more again where it stays far below.
    fn adapt_share(&mut self, now_us: u64, situation: Situation) {
        let Some((limit_mps, speed_mps)) = situation.limit_mps.zip(situation.speed_mps) else { return };
        if self.share_us.is_some_and(|at_us| !has_passed(at_us, now_us, SHARE_S)) {
            return;
        }
        let overshoots = self.judge.is_over_for(now_us, GUST_S) && self.judge.within_since_us.is_none();
        if overshoots && !self.judge.brakes && speed_mps > 0.0 {
            self.share = (self.share * (limit_mps / speed_mps).clamp(SHRINK, 1.0)).max(LEAST_SHARE);
            self.share_us = Some(now_us);
        } else if self.judge.is_within_for(now_us, 2.0 * SHARE_S) && speed_mps < limit_mps * PRESSING_SHARE {
            self.share = (self.share * GROW).min(STICK_SHARE);
            self.share_us = Some(now_us);
        }
    }

    fn limit_mps(&self) -> Option<f32> {
        self.situation.and_then(|situation| situation.limit_mps)
    }

    /// How far the limit is in force, and why it is not.
    pub(super) fn state(&self) -> (Enforcement, Option<Cause>) {
        let Some((limit_mps, situation)) = self.limit_mps().zip(self.situation) else {
            return (Enforcement::Idle, None);
        };
        let not_possible = |cause| (Enforcement::NotPossible, Some(cause));
        let Some(row) = situation.row else { return not_possible(Cause::NoAutopilot) };
        let leads = row.follows && situation.leads;
        if row.way == Way::None {
            return not_possible(Cause::Mode);
        }
        if limit_mps < row.floor_mps && !leads {
            return not_possible(Cause::Floor);
        }
        if let Some(refusal) = self.hold.refusal().filter(|_| !LimitParameter::of(row.way).is_empty()) {
            return not_possible(Cause::Refused(refusal));
        }
        if self.judge.too_fast {
            return (Enforcement::Ineffective, Some(Cause::TooFast));
        }
        if self.denied && row.way == Way::Command {
            return (Enforcement::Ineffective, Some(Cause::Denied));
        }
        if self.judge.proof_s >= PROOF_S { (Enforcement::Enforced, None) } else { (Enforcement::Requested, None) }
    }

    /// Is a limit asked for, or something to be given back?
    pub(super) fn next_ask(&mut self, now_us: u64) -> Option<Ask> {
        let situation = self.situation?;
        // Without an autopilot there is nobody to ask.
        let row = situation.row?;
        if let Some(limit_mps) = situation.limit_mps {
            let told_mps = limit_mps.max(row.floor_mps);
            if situation.leads && row.follows && is_due(&mut self.lead_us, now_us, LEAD_S) {
                return Some(Ask::Lead(limit_mps));
            }
            if row.way == Way::Command && self.command_is_due(now_us, told_mps) {
                let unanswered = self.unanswered;
                self.unanswered = self.unanswered.saturating_add(1);
                self.command = Some((told_mps, now_us));
                return Some(Ask::ChangeSpeed(told_mps, unanswered));
            }
            if row.velocity_limits && is_due(&mut self.limits_us, now_us, REPEAT_S) {
                return Some(Ask::VelocityLimits(told_mps));
            }
        }
        self.hold.next_ask(now_us).map(Ask::Hold)
    }

    fn command_is_due(&self, now_us: u64, told_mps: f32) -> bool {
        let Some((before_mps, at_us)) = self.command else { return true };
        let changed = (before_mps - told_mps).abs() >= CHANGE_MPS;
        let over = self.judge.is_over_for(now_us, GUST_S);
        let pause_s = match (changed, over) {
            (true, _) => PAUSE_S,
            (false, true) => REPEAT_FAST_S,
            (false, false) => REPEAT_S,
        };
        has_passed(at_us, now_us, pause_s)
    }
}

impl Judge {
    fn look(&mut self, now_us: u64, limit_mps: f32, speed_mps: Option<f32>) {
        let before_us = self.last_us.replace(now_us);
        if (self.proven_mps - limit_mps).abs() > CHANGE_SHARE * self.proven_mps {
            (self.proven_mps, self.proof_s) = (limit_mps, 0.0);
        }
        let Some(speed_mps) = speed_mps else {
            // What is not measured proves nothing, and accuses nobody.
            (self.over_since_us, self.within_since_us) = (None, None);
            return;
        };
        let (before_mps, at_us) = *self.trend.get_or_insert((speed_mps, now_us));
        if has_passed(at_us, now_us, TREND_S) {
            self.brakes = speed_mps < before_mps - BRAKING_MPS;
            self.trend = Some((speed_mps, now_us));
        }
        if speed_mps > limit_mps * (1.0 + TOLERANCE_SHARE) + TOLERANCE_MPS {
            self.over_since_us.get_or_insert(now_us);
            self.within_since_us = None;
            if self.is_over_for(now_us, REACTION_S) {
                (self.too_fast, self.proof_s) = (true, 0.0);
            }
            return;
        }
        let within_since_us = *self.within_since_us.get_or_insert(now_us);
        // A gust's end does not excuse what came before it.
        if has_passed(within_since_us, now_us, GUST_S) {
            self.over_since_us = None;
            self.too_fast = false;
        }
        if speed_mps >= limit_mps * PRESSING_SHARE
            && let Some(before_us) = before_us
        {
            self.proof_s += crate::time::seconds(before_us, now_us).min(0.1);
        }
    }

    fn is_within_for(&self, now_us: u64, duration_s: f32) -> bool {
        self.within_since_us.is_some_and(|since_us| has_passed(since_us, now_us, duration_s))
    }

    fn is_over_for(&self, now_us: u64, duration_s: f32) -> bool {
        self.over_since_us.is_some_and(|since_us| has_passed(since_us, now_us, duration_s))
    }
}

/// Whether the period since the last time is over; then this is the last time.
pub(super) fn is_due(last_us: &mut Option<u64>, now_us: u64, period_s: f32) -> bool {
    let due = last_us.is_none_or(|at_us| has_passed(at_us, now_us, period_s));
    if due {
        *last_us = Some(now_us);
    }
    due
}
