//! What has happened how often: a fuzzer that never gets to a place finds nothing there.

use std::cell::RefCell;
use std::collections::BTreeMap;

thread_local! {
    static COUNTS: RefCell<BTreeMap<&'static str, u64>> = const { RefCell::new(BTreeMap::new()) };
}

/// Everything that a run has to get to.
pub(crate) const PLACES: [&str; 24] = [
    "answered: command",
    "answered: parameter",
    "asked: lead",
    "asked: parameter given back",
    "asked: parameter lowered",
    "asked: speed",
    "asked: velocity limits",
    "did: command",
    "did: command that was signed",
    "did: readdressing",
    "did: restart",
    "enforcement: Enforced",
    "enforcement: Idle",
    "enforcement: Ineffective",
    "enforcement: NotPossible",
    "enforcement: Requested",
    "kept: borrowed",
    "kept: key",
    "kept: parameters",
    "kept: returned",
    "kept: streams",
    "sent: log data",
    "sent: tunnel",
    "settled: told what is kept",
];

/// It has happened once more.
pub(crate) fn count(place: &'static str) {
    COUNTS.with_borrow_mut(|counts| *counts.entry(place).or_default() += 1);
}

/// How often each place was come to by this thread.
pub(crate) fn counts() -> Vec<(&'static str, u64)> {
    COUNTS.with_borrow(|counts| PLACES.iter().map(|place| (*place, counts.get(place).copied().unwrap_or(0))).collect())
}
