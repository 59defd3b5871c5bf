//! A parameter of the autopilot, borrowed: read, its value kept over a loss of power, written, watched, given back.
//!
//! Every write of a parameter is permanent on both autopilots, so the old value must be safe before the first write, and is
//! given back when no limit stands any more; after a reset of the board in between as well. Nothing is written that is larger
//! than the old value: so when the autopilot is found with more than that, somebody else has changed it, and it is left alone.
//!
//! | stage | asks | until | then |
//! |---|---|---|---|
//! | Free | - | a limit stands | Reading, or Holding if an old value is still kept |
//! | Reading | each of the possible names, three times | one has answered and the others had their chance | Keeping; none, or two: Refused |
//! | Keeping | that the old value be kept | it is | Holding |
//! | Holding | the value, until it is confirmed; then every 5 s what it is | no limit stands | Returning |
//! | Returning | what it is; the old value, until it is confirmed | it is, or it is larger | Free |

use serde::{Deserialize, Serialize};

use super::Keep;
use super::modes::{LimitParameter, Way};
use crate::time::has_passed;

/// An answer takes a few milliseconds; a lost question is asked again after this.
const ASK_S: f32 = 0.4;
/// So often a name is tried before the autopilot counts as not knowing it.
const TRIES: u8 = 3;
/// A value that is confirmed is looked up again after this.
const WATCH_S: f32 = 5.0;
/// Lower values are written no more often than this.
const LOWER_S: f32 = 0.4;
/// Higher values are written no more often than this, and only if they are higher by [`HIGHER_SHARE`]: writes wear memory.
const HIGHER_S: f32 = 5.0;
const HIGHER_SHARE: f32 = 1.1;
/// Changes below this share are not worth a write.
const SAME_SHARE: f32 = 0.01;

/// The old value of a parameter that the board has changed.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Borrowed {
    /// Which.
    pub parameter: LimitParameter,
    /// Its value before, in its own unit.
    pub value: f32,
}

/// Why a parameter cannot be used.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Refusal {
    /// None of the names is known.
    Unknown,
    /// Two names are known: which of them counts, and in which unit, is anybody's guess.
    Ambiguous,
    /// The value cannot be in the unit that the name stands for.
    Implausible,
    /// The board's memory does not keep the old value.
    NotKept,
}

/// What is to be asked of the autopilot.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum HoldAsk {
    /// What is its value?
    Read(LimitParameter),
    /// Make it this, in its own unit.
    Write(LimitParameter, f32),
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Stage {
    Free,
    Reading { way: Way, tries: u8, answers: [Option<f32>; 2] },
    Keeping { asked: bool },
    Holding { wanted: f32, confirmed: bool, written_us: Option<u64> },
    Returning { present: Option<f32> },
    Refused { way: Way, refusal: Refusal },
}

/// The parameter.
#[derive(Clone, Debug)]
pub(super) struct Hold {
    stage: Stage,
    borrowed: Option<Borrowed>,
    /// Does the memory hold what `borrowed` says?
    kept: bool,
    asked_us: Option<u64>,
}

impl Hold {
    /// With what a run before has left to be given back.
    pub(super) fn new(borrowed: Option<Borrowed>) -> Self {
        let stage = if borrowed.is_some() { Stage::Returning { present: None } } else { Stage::Free };
        Self { stage, borrowed, kept: true, asked_us: None }
    }

    /// Why the parameter cannot be used.
    pub(super) fn refusal(&self) -> Option<Refusal> {
        match self.stage {
            Stage::Refused { refusal, .. } => Some(refusal),
            _ => None,
        }
    }

    /// What must be kept over a loss of power and is not yet.
    pub(super) fn take_keep(&mut self) -> Option<Keep> {
        if self.kept {
            return None;
        }
        if let Stage::Keeping { asked } = &mut self.stage
            && core::mem::replace(asked, true)
        {
            return None;
        }
        Some(Keep::Borrowed(self.borrowed))
    }

    /// It is kept, or cannot be.
    pub(super) fn kept(&mut self, ok: bool) {
        if self.stage == (Stage::Keeping { asked: false }) {
            // The answer is to a value given back before: this one was not handed out yet.
            return;
        }
        self.kept = ok || !matches!(self.stage, Stage::Keeping { .. });
        if let Stage::Keeping { .. } = self.stage
            && let Some(borrowed) = self.borrowed
        {
            self.asked_us = None;
            if ok {
                self.stage = Stage::Holding { wanted: borrowed.value, confirmed: true, written_us: None };
            } else {
                let way = if borrowed.parameter == LimitParameter::VelocityManual {
                    Way::ManualParameter
                } else {
                    Way::LoiterParameter
                };
                self.borrowed = None;
                self.kept = true;
                self.stage = Stage::Refused { way, refusal: Refusal::NotKept };
            }
        }
    }

    /// The autopilot has begun anew: what was asked is lost, and its parameters are to be looked at again.
    pub(super) fn begin_anew(&mut self) {
        self.asked_us = None;
        match &mut self.stage {
            Stage::Holding { confirmed, .. } => *confirmed = false,
            Stage::Refused { .. } => self.stage = Stage::Free,
            Stage::Reading { tries, .. } => *tries = 0,
            _ => {}
        }
    }

    /// A limit is wanted in this way; `None` if none is wanted any more.
    pub(super) fn want(&mut self, now_us: u64, wanted: Option<(Way, f32)>) {
        let Some((way, limit_mps)) = wanted.filter(|(way, _)| !LimitParameter::of(*way).is_empty()) else {
            // Another mode of the same scan may take its limit in another way; the parameter stays until the scan's end.
            if wanted.is_none() {
                self.give_back();
            }
            return;
        };
        match self.stage {
            Stage::Free | Stage::Returning { .. } => self.begin(way),
            Stage::Refused { way: refused, .. } if refused != way => self.begin(way),
            _ => {}
        }
        if let (Stage::Holding { wanted, confirmed, written_us }, Some(borrowed)) = (&mut self.stage, self.borrowed) {
            let target = (limit_mps / borrowed.parameter.unit_mps()).min(borrowed.value);
            let since = |pause_s| written_us.is_none_or(|at_us| has_passed(at_us, now_us, pause_s));
            let lower = target < *wanted * (1.0 - SAME_SHARE) && since(LOWER_S);
            let higher = target > *wanted * HIGHER_SHARE && since(HIGHER_S);
            if lower || higher {
                (*wanted, *confirmed) = (target, false);
                self.asked_us = None;
            }
        }
    }

    fn begin(&mut self, way: Way) {
        self.asked_us = None;
        self.stage = match self.borrowed {
            Some(borrowed) if LimitParameter::of(way).contains(&borrowed.parameter) => {
                Stage::Holding { wanted: borrowed.value, confirmed: false, written_us: None }
            }
            // What belongs to another autopilot is given back first.
            Some(_) => Stage::Returning { present: None },
            None => Stage::Reading { way, tries: 0, answers: [None; 2] },
        };
    }

    fn give_back(&mut self) {
        match self.stage {
            Stage::Holding { .. } => {
                self.stage = Stage::Returning { present: None };
                self.asked_us = None;
            }
            Stage::Reading { .. } | Stage::Refused { .. } => self.stage = Stage::Free,
            Stage::Free | Stage::Returning { .. } | Stage::Keeping { .. } => {}
        }
    }

    /// The autopilot tells a value.
    pub(super) fn hear(&mut self, parameter: LimitParameter, value: f32) {
        match &mut self.stage {
            Stage::Reading { way, answers, .. } => {
                let place = LimitParameter::of(*way).iter().position(|one| *one == parameter);
                if let Some(answer) = place.and_then(|place| answers.get_mut(place)) {
                    *answer = Some(value);
                }
            }
            Stage::Holding { wanted, confirmed, .. }
                if self.borrowed.is_some_and(|borrowed| borrowed.parameter == parameter) =>
            {
                *confirmed = is_same(value, *wanted);
            }
            Stage::Returning { present } if self.borrowed.is_some_and(|borrowed| borrowed.parameter == parameter) => {
                *present = Some(value);
                if self.borrowed.is_some_and(|borrowed| is_same(value, borrowed.value) || value > borrowed.value) {
                    self.borrowed = None;
                    self.kept = false;
                    self.stage = Stage::Free;
                } else {
                    self.asked_us = None;
                }
            }
            _ => {}
        }
    }

    /// The next question, if one is due.
    pub(super) fn next_ask(&mut self, now_us: u64) -> Option<HoldAsk> {
        let is_watching = matches!(self.stage, Stage::Holding { confirmed: true, .. });
        let pause_s = if is_watching { WATCH_S } else { ASK_S };
        if self.asked_us.is_some_and(|at_us| !has_passed(at_us, now_us, pause_s)) {
            return None;
        }
        let ask = match &mut self.stage {
            Stage::Reading { way, tries, answers } => {
                let (way, tries_so_far, answers) = (*way, *tries, *answers);
                let names = LimitParameter::of(way);
                if tries_so_far >= TRIES * names.len() as u8 {
                    self.conclude(way, answers);
                    return None;
                }
                *tries += 1;
                // Both names in turn, close together.
                HoldAsk::Read(names.get(usize::from(tries_so_far) % names.len()).copied()?)
            }
            Stage::Holding { wanted, confirmed, written_us } => {
                let parameter = self.borrowed?.parameter;
                if *confirmed {
                    HoldAsk::Read(parameter)
                } else {
                    *written_us = Some(now_us);
                    HoldAsk::Write(parameter, *wanted)
                }
            }
            Stage::Returning { present } => {
                let borrowed = self.borrowed?;
                match present {
                    None => HoldAsk::Read(borrowed.parameter),
                    Some(_) => HoldAsk::Write(borrowed.parameter, borrowed.value),
                }
            }
            Stage::Free | Stage::Keeping { .. } | Stage::Refused { .. } => return None,
        };
        self.asked_us = Some(now_us);
        // The second name need not wait for the first one's answer.
        if matches!(self.stage, Stage::Reading { tries, .. } if tries % 2 == 1 && self.has_two_names()) {
            self.asked_us = None;
        }
        Some(ask)
    }

    fn has_two_names(&self) -> bool {
        matches!(self.stage, Stage::Reading { way, .. } if LimitParameter::of(way).len() == 2)
    }

    /// All names had their chance.
    fn conclude(&mut self, way: Way, answers: [Option<f32>; 2]) {
        let mut found = LimitParameter::of(way).iter().zip(answers).filter_map(|(name, answer)| Some((*name, answer?)));
        let refused = |refusal| Stage::Refused { way, refusal };
        self.stage = match (found.next(), found.next()) {
            (None, _) => refused(Refusal::Unknown),
            (Some(_), Some(_)) => refused(Refusal::Ambiguous),
            (Some((parameter, value)), None) if parameter.is_plausible(value) => {
                self.borrowed = Some(Borrowed { parameter, value });
                self.kept = false;
                Stage::Keeping { asked: false }
            }
            (Some(_), None) => refused(Refusal::Implausible),
        };
        self.asked_us = None;
    }
}

fn is_same(one: f32, other: f32) -> bool {
    (one - other).abs() <= 1e-3 * other.abs()
}

#[cfg(test)]
mod tests {
    use super::*;

    const LOITER: Way = Way::LoiterParameter;

    /// Answers reads with what the autopilot has, and takes writes.
    fn run(
        hold: &mut Hold,
        autopilot: &mut [(LimitParameter, f32)],
        wanted: Option<(Way, f32)>,
        from_s: u64,
        to_s: u64,
    ) -> usize {
        let mut writes = 0;
        for now_us in (from_s * 1_000_000..to_s * 1_000_000).step_by(10_000) {
            hold.want(now_us, wanted);
            if hold.take_keep().is_some() {
                hold.kept(true);
            }
            let (parameter, written) = match hold.next_ask(now_us) {
                None => continue,
                Some(HoldAsk::Read(parameter)) => (parameter, None),
                Some(HoldAsk::Write(parameter, value)) => (parameter, Some(value)),
            };
            if let Some((_, value)) = autopilot.iter_mut().find(|(one, _)| *one == parameter) {
                *value = written.unwrap_or(*value);
                writes += usize::from(written.is_some());
                hold.hear(parameter, *value);
            }
        }
        writes
    }

    #[test]
    fn a_value_is_borrowed_in_its_own_unit_and_given_back() {
        for (parameter, old, expected) in
            [(LimitParameter::LoiterCentimetres, 1250.0, 30.0), (LimitParameter::LoiterMetres, 12.5, 0.3)]
        {
            let (mut hold, mut autopilot) = (Hold::new(None), [(parameter, old)]);
            assert_eq!(run(&mut hold, &mut autopilot, Some((LOITER, 0.3)), 0, 10), 1);
            assert!((autopilot[0].1 - expected).abs() < 1e-4, "{parameter:?}: {}", autopilot[0].1);
            assert_eq!(run(&mut hold, &mut autopilot, None, 10, 20), 1);
            assert_eq!(autopilot[0].1, old);
            assert_eq!(hold.borrowed, None);
        }
    }

    #[test]
    fn nothing_is_written_before_the_old_value_is_kept() {
        let mut hold = Hold::new(None);
        for now_us in (0..5_000_000).step_by(10_000) {
            hold.want(now_us, Some((LOITER, 0.3)));
            match hold.next_ask(now_us) {
                Some(HoldAsk::Read(LimitParameter::LoiterMetres)) => hold.hear(LimitParameter::LoiterMetres, 12.5),
                Some(HoldAsk::Write(..)) => panic!("written at {now_us} us"),
                _ => {}
            }
        }
        let kept = Borrowed { parameter: LimitParameter::LoiterMetres, value: 12.5 };
        assert_eq!(hold.take_keep(), Some(Keep::Borrowed(Some(kept))));
        hold.kept(false);
        assert_eq!(hold.refusal(), Some(Refusal::NotKept));
        assert_eq!(hold.next_ask(9_000_000), None);
    }

    #[test]
    fn an_answer_for_the_value_before_does_not_count_for_this_one() {
        let parameter = LimitParameter::LoiterMetres;
        let mut hold = Hold::new(Some(Borrowed { parameter, value: 12.5 }));
        hold.hear(parameter, 12.5);
        assert_eq!(hold.take_keep(), Some(Keep::Borrowed(None)), "it is given back");
        for now_us in (0..5_000_000).step_by(10_000) {
            hold.want(now_us, Some((LOITER, 0.3)));
            if hold.next_ask(now_us) == Some(HoldAsk::Read(parameter)) {
                hold.hear(parameter, 10.0);
            }
        }
        hold.kept(true);
        hold.want(5_000_000, Some((LOITER, 0.3)));
        assert_eq!(hold.next_ask(5_000_000), None, "nothing is written yet");
        assert_eq!(hold.take_keep(), Some(Keep::Borrowed(Some(Borrowed { parameter, value: 10.0 }))));
    }

    #[test]
    fn two_names_or_none_or_another_unit_are_refused() {
        use LimitParameter::{LoiterCentimetres, LoiterMetres};
        let cases: [(&mut [(LimitParameter, f32)], Refusal); 3] = [
            (&mut [(LoiterCentimetres, 1250.0), (LoiterMetres, 12.5)], Refusal::Ambiguous),
            (&mut [], Refusal::Unknown),
            (&mut [(LoiterMetres, 1250.0)], Refusal::Implausible),
        ];
        for (autopilot, refusal) in cases {
            let mut hold = Hold::new(None);
            assert_eq!(run(&mut hold, autopilot, Some((LOITER, 0.3)), 0, 5), 0);
            assert_eq!(hold.refusal(), Some(refusal));
        }
    }

    #[test]
    fn what_a_run_before_left_is_given_back_unless_somebody_raised_it() {
        let parameter = LimitParameter::LoiterCentimetres;
        for (found, expected) in [(30.0, 1250.0), (1500.0, 1500.0), (1250.0, 1250.0)] {
            let mut hold = Hold::new(Some(Borrowed { parameter, value: 1250.0 }));
            let mut autopilot = [(parameter, found)];
            run(&mut hold, &mut autopilot, None, 0, 5);
            assert_eq!((autopilot[0].1, hold.borrowed), (expected, None));
        }
    }

    #[test]
    fn a_scan_after_a_reset_does_not_take_the_lowered_value_for_the_old_one() {
        let parameter = LimitParameter::VelocityManual;
        let mut hold = Hold::new(Some(Borrowed { parameter, value: 10.0 }));
        let mut autopilot = [(parameter, 0.25)];
        run(&mut hold, &mut autopilot, Some((Way::ManualParameter, 0.4)), 0, 5);
        assert_eq!(autopilot[0].1, 0.4);
        run(&mut hold, &mut autopilot, None, 5, 10);
        assert_eq!(autopilot[0].1, 10.0);
    }

    #[test]
    fn what_others_change_is_changed_back_and_writes_are_few() {
        let parameter = LimitParameter::VelocityManual;
        let (mut hold, mut autopilot) = (Hold::new(None), [(parameter, 10.0)]);
        let way = Way::ManualParameter;
        assert_eq!(run(&mut hold, &mut autopilot, Some((way, 0.4)), 0, 20), 1);
        autopilot[0].1 = 5.0;
        assert_eq!(run(&mut hold, &mut autopilot, Some((way, 0.4)), 20, 40), 1);
        assert_eq!(autopilot[0].1, 0.4);
        // A limit that wanders upwards is not followed at every step.
        let mut writes = 0;
        for second in 40..60 {
            let limit_mps = 0.4 + 0.01 * (second - 40) as f32;
            writes += run(&mut hold, &mut autopilot, Some((way, limit_mps)), second, second + 1);
        }
        assert!((1..=4).contains(&writes), "{writes} writes");
    }
}
