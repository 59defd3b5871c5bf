//! A failing case with everything left out that it does not need.

use std::panic::{AssertUnwindSafe, catch_unwind, set_hook, take_hook};

use crate::operation::{Case, Operation};
use crate::rig::{Broken, run};

/// Runs a case; a panic breaks a rule like any other.
pub(crate) fn tried(case: &Case) -> Result<(), Broken> {
    catch_unwind(AssertUnwindSafe(|| run(case))).unwrap_or_else(|panic| {
        let words = panic.downcast_ref::<String>().cloned();
        Err(format!(
            "panic: {}",
            words.or(panic.downcast_ref().map(|words: &&str| (*words).into())).unwrap_or_default()
        ))
    })
}

/// The smallest case that is found to fail as well, and how.
pub(crate) fn minimised(case: &Case) -> (Case, Broken) {
    // A panic is told once, not for every trial.
    let hook = take_hook();
    set_hook(Box::new(|_| {}));
    let mut least = case.clone();
    let mut stretch = least.operations.len();
    while stretch > 0 {
        let mut at = 0;
        while at < least.operations.len() {
            let mut fewer = least.clone();
            fewer.operations.drain(at..(at + stretch).min(fewer.operations.len()));
            if tried(&fewer).is_err() {
                least = fewer;
            } else {
                at += stretch;
            }
        }
        stretch /= 2;
    }
    let broken = tried(&least).err().unwrap_or_default();
    set_hook(hook);
    (least, broken)
}

/// What to do about a failing case, in words.
pub(crate) fn report(case: &Case, seed: u64) -> String {
    let (least, broken) = minimised(case);
    let hex = least.write().iter().fold(String::new(), |hex, byte| format!("{hex}{byte:02x}"));
    let operations: Vec<String> = least.operations.iter().map(|one: &Operation| format!("  {one:02x?}")).collect();
    format!(
        "{broken}\nseed {seed}, {:?}\n{}\nreproduce: echo {hex} | xxd -r -p > firmware/tests/fuzz/corpus/NAME.bin && \
         cargo test -p adit-firmware --test fuzz corpus",
        least.setup,
        operations.join("\n")
    )
}
