//! Whether the limit held, whether it was told where it cannot, and whether what was claimed was true.

use adit_protocol::mavlink::{BOARD_COMPONENT, FrameDecoder, Incoming};
use adit_protocol::telemetry::Enforcement;

/// From a change of limit, mode or line to a vehicle that is no faster: a lost heartbeat's second, two requests without
/// effect, braking.
pub(crate) const REACTION_S: f64 = 4.0;
/// A vehicle that is no faster than this is at its limit.
const TOLERANCE_SHARE: f64 = 0.05;
const TOLERANCE_MPS: f64 = 0.05;
/// Who cannot be held to a limit is told so within this, once the board can know.
const TELL_S: f64 = 1.0;
/// `MAV_SEVERITY_WARNING`: words that matter have this number or a lower one.
const WARNING: u8 = 4;

/// What is so in one step.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Now {
    pub(crate) at_s: f64,
    /// Line, board and autopilot are up.
    pub(crate) is_linked: bool,
    /// The board has heard of the mode that the autopilot is in.
    pub(crate) is_known: bool,
    pub(crate) limit_mps: Option<f64>,
    /// The facts say that the limit can be enforced.
    pub(crate) is_possible: bool,
    pub(crate) true_speed_mps: f64,
    pub(crate) claim: Enforcement,
}

/// What was found.
#[derive(Clone, Debug, Default)]
pub(crate) struct Judge {
    decoder: FrameDecoder,
    /// The time above the limit, in one stretch.
    pub(crate) over_s: f64,
    untold_since_s: Option<f64>,
    is_told: bool,
    /// The longest time until words came.
    pub(crate) told_after_s: Option<f64>,
    /// Was the limit ever said to be in force?
    pub(crate) was_enforced: bool,
    pub(crate) complaints: Vec<String>,
}

impl Judge {
    /// Looks at one step; `heard` is what the board says and arrives.
    pub(crate) fn look(&mut self, now: &Now, heard: &[u8], dt_s: f64) {
        let warned = self.is_warning(heard);
        self.look_at_speed(now, dt_s);
        self.look_at_words(now, warned);
        self.look_at_claim(now);
    }

    fn is_warning(&mut self, heard: &[u8]) -> bool {
        let mut is_warning = false;
        for frame in heard.iter().filter_map(|byte| self.decoder.push(*byte)) {
            let warns = matches!(Incoming::read(&frame), Some(Incoming::Text { severity, .. }) if severity <= WARNING);
            is_warning |= warns && frame.component == BOARD_COMPONENT;
        }
        is_warning
    }

    fn look_at_speed(&mut self, now: &Now, dt_s: f64) {
        let over = now
            .limit_mps
            .is_some_and(|limit_mps| now.true_speed_mps > limit_mps * (1.0 + TOLERANCE_SHARE) + TOLERANCE_MPS);
        self.over_s = if over && now.is_linked && now.is_possible { self.over_s + dt_s } else { 0.0 };
        if self.over_s > REACTION_S && self.over_s - dt_s <= REACTION_S {
            self.complain(now, "above the limit for too long");
        }
    }

    fn look_at_words(&mut self, now: &Now, warned: bool) {
        if now.limit_mps.is_none() || now.is_possible || !now.is_linked {
            (self.untold_since_s, self.is_told) = (None, false);
            return;
        }
        self.is_told |= warned;
        if !now.is_known {
            return;
        }
        let since_s = *self.untold_since_s.get_or_insert(now.at_s);
        let waited_s = now.at_s - since_s;
        if self.is_told {
            // The first words count.
            if self.untold_since_s.replace(f64::INFINITY) != Some(f64::INFINITY) {
                self.told_after_s = Some(self.told_after_s.unwrap_or(0.0).max(waited_s));
            }
        } else if waited_s > TELL_S {
            self.complain(now, "nobody was told that the limit cannot be enforced");
            self.is_told = true;
        }
    }

    fn look_at_claim(&mut self, now: &Now) {
        if now.claim != Enforcement::Enforced {
            return;
        }
        self.was_enforced = true;
        if now.is_known && now.is_linked && !now.is_possible && now.limit_mps.is_some() {
            self.complain(now, "claims to enforce what cannot be");
        }
        if self.over_s > REACTION_S {
            self.complain(now, "claims to enforce what is not so");
        }
    }

    fn complain(&mut self, now: &Now, what: &str) {
        // Once is enough.
        if !self.complaints.iter().any(|said| said.ends_with(what)) {
            self.complaints.push(format!("{:.2} s: {what}", now.at_s));
        }
    }
}
