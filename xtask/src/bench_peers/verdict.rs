//! What must hold of the table (issue 5), judged by its figures.

use serde::Serialize;
use serde_json::Value;

use super::bal::OPTIMUM;
use super::outcome::{Outcome, Who};
use super::sets::{LONG, SHORT};

/// Largest errors on the samples: position aligned and absolute, in millimetres.
const SAMPLES: [(&str, f64, f64); 3] =
    [("cylinder-brick-spiral", 0.3, 2.0), ("cylinder-concrete-spiral", 0.5, 2.0), ("underpass-spiral", 0.5, 2.0)];
/// The set whose wall is not its section, the largest aligned error on it, and the largest share of the peer's.
const IMPERFECT: (&str, f64, f64) = ("imperfect", 1.5, 1.0 / 3.0);
/// So many times faster than the peer.
const FASTER: f64 = 30.0;
/// Ten times the photos: time and memory against the short set.
const GROWTH: (f64, f64) = (11.0, 1.2);
/// Relative distance from the optimum of the BAL problem.
const BAL_WITHIN: f64 = 1e-4;

/// One thing that must hold.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub(super) struct Verdict {
    pub(super) must_hold: String,
    pub(super) found: String,
    /// `None` where a figure is missing.
    pub(super) holds: Option<bool>,
}

impl Verdict {
    fn at_most(what: &str, found: Option<f64>, limit: f64, unit: &str) -> Self {
        Self {
            must_hold: format!("{what} at most {} {unit}", (limit * 1e3).round() / 1e3).trim_end().to_owned(),
            found: found
                .map_or_else(|| "not measured".to_owned(), |found| format!("{found:.3} {unit}").trim_end().to_owned()),
            holds: found.map(|found| found <= limit),
        }
    }
}

/// All verdicts that the measured sets allow.
pub(super) fn verdicts(outcomes: &[Outcome], bal: Option<&Value>) -> Vec<Verdict> {
    let mut verdicts = Vec::new();
    let find = |set: &str, who: Who| outcomes.iter().find(|outcome| outcome.set == set && outcome.who == who);
    for ours in outcomes.iter().filter(|outcome| outcome.who == Who::Ours) {
        let set = &ours.set;
        verdicts.push(Verdict {
            must_hold: format!("{set}: all {} photos registered", ours.photos),
            found: ours.accuracy.registered.to_string(),
            holds: Some(ours.accuracy.registered == ours.photos),
        });
        if let Some((_, aligned, absolute)) = SAMPLES.iter().find(|(name, ..)| name == set) {
            verdicts.push(Verdict::at_most(&format!("{set}: aligned"), ours.accuracy.aligned_mm, *aligned, "mm"));
            verdicts.push(Verdict::at_most(&format!("{set}: absolute"), ours.accuracy.absolute_mm, *absolute, "mm"));
        }
        if set == IMPERFECT.0 {
            verdicts.push(Verdict::at_most(&format!("{set}: aligned"), ours.accuracy.aligned_mm, IMPERFECT.1, "mm"));
        }
        let Some(peer) = find(set, Who::Peer) else { continue };
        if set == IMPERFECT.0 {
            let share = ours.accuracy.aligned_mm.zip(peer.accuracy.aligned_mm).map(|(ours, peer)| ours / peer);
            verdicts.push(Verdict::at_most(
                &format!("{set}: share of the peer's aligned error"),
                share,
                IMPERFECT.2,
                "",
            ));
        }
        let ratio = peer.total_s / ours.total_s;
        let apart = if peer.run == ours.run { String::new() } else { format!(", peer timed {}", peer.run) };
        verdicts.push(Verdict {
            must_hold: format!("{set}: at least {FASTER} times faster than the peer"),
            found: format!("{ratio:.1}{apart}"),
            holds: Some(ratio >= FASTER),
        });
    }
    if let Some((short, long)) = find(SHORT, Who::Ours).zip(find(LONG, Who::Ours)) {
        let (time, memory) = (long.total_s / short.total_s, long.peak_mib / short.peak_mib);
        verdicts.push(Verdict::at_most(&format!("{LONG}: time against {SHORT}"), Some(time), GROWTH.0, "times"));
        verdicts.push(Verdict::at_most(&format!("{LONG}: memory against {SHORT}"), Some(memory), GROWTH.1, "times"));
    }
    if let Some(bal) = bal {
        let off = bal["ours"]["final_cost"].as_f64().map(|cost| (cost / OPTIMUM - 1.0).abs());
        verdicts.push(Verdict {
            must_hold: format!("BAL: final cost within {BAL_WITHIN} of {OPTIMUM}, relatively"),
            found: off.map_or_else(|| "not measured".to_owned(), |off| format!("{off:.1e} off")),
            holds: off.map(|off| off <= BAL_WITHIN),
        });
    }
    verdicts
}

#[cfg(test)]
mod tests {
    use super::super::outcome::Accuracy;
    use super::*;

    fn outcome(set: &str, who: Who, aligned_mm: f64, total_s: f64) -> Outcome {
        let accuracy = Accuracy { registered: 50, aligned_mm: Some(aligned_mm), ..Accuracy::default() };
        Outcome {
            set: set.to_owned(),
            who,
            photos: 50,
            accuracy,
            stages_s: Vec::new(),
            total_s,
            peak_mib: 100.0,
            key: String::new(),
            run: "today".to_owned(),
        }
    }

    fn holds(outcomes: &[Outcome], what: &str) -> Option<bool> {
        verdicts(outcomes, None).iter().find(|verdict| verdict.must_hold.contains(what)).expect("judged").holds
    }

    #[test]
    fn limits_are_judged_on_both_sides_of_them() {
        let pair = |ours_mm, peer_mm, ours_s, peer_s| {
            [outcome("imperfect", Who::Ours, ours_mm, ours_s), outcome("imperfect", Who::Peer, peer_mm, peer_s)]
        };
        assert_eq!(holds(&pair(1.0, 4.0, 1.0, 31.0), "share"), Some(true));
        assert_eq!(holds(&pair(1.0, 2.0, 1.0, 31.0), "share"), Some(false));
        assert_eq!(holds(&pair(1.6, 9.0, 1.0, 31.0), "aligned at most"), Some(false));
        assert_eq!(holds(&pair(1.0, 4.0, 1.0, 29.0), "faster"), Some(false));
        assert_eq!(holds(&pair(1.0, 4.0, 1.0, 31.0), "faster"), Some(true));
    }

    #[test]
    fn a_figure_that_is_missing_is_no_pass() {
        let sample = outcome("underpass-spiral", Who::Ours, 0.4, 1.0);
        assert_eq!(holds(std::slice::from_ref(&sample), "aligned"), Some(true));
        assert_eq!(holds(&[sample], "absolute"), None);
    }

    #[test]
    fn a_ratio_of_two_runs_says_so() {
        let mut peer = outcome("brick", Who::Peer, 1.0, 90.0);
        peer.run = "yesterday".to_owned();
        let all = verdicts(&[outcome("brick", Who::Ours, 0.1, 1.0), peer], None);
        assert!(all.iter().any(|verdict| verdict.found.contains("peer timed yesterday")), "{all:?}");
    }

    #[test]
    fn ten_times_the_photos_may_take_eleven_times_the_time() {
        let growth = |long_s| [outcome(SHORT, Who::Ours, 1.0, 10.0), outcome(LONG, Who::Ours, 1.0, long_s)];
        assert_eq!(holds(&growth(109.0), "time against"), Some(true));
        assert_eq!(holds(&growth(111.0), "time against"), Some(false));
    }
}
