//! Hostile input for the link: bytes, frames, and everything that can happen between them, from a seed that is printed first.
//!
//! A case is a board from its start and a few dozen operations ([`operation`]): bytes at either port, time, steps of the
//! controller, answers of memory and card. Half of all cases are fresh ([`generate`]), half are changed ones of the corpus; what
//! is no frame is thrown away by the decoder, so most frames are sound in their CRC and odd in what they say ([`speech`]).
//! The bench ([`rig`]) holds every step against rules that it reckons for itself: no panic, no allocation, an end to what goes
//! out, nothing done for who may not command, no limit above the one that is wanted, nothing kept that cannot be built.
//!
//! A message or a chunk of bytes counts as one input. A test run takes [`INPUTS`]; `ADIT_FUZZ_INPUTS` and `ADIT_FUZZ_SEED` say
//! otherwise:
//!
//! ```text
//! ADIT_FUZZ_INPUTS=10000000 cargo test --release -p adit-firmware --test fuzz -- --nocapture
//! ```

mod allocations;
mod census;
mod dice;
mod ear;
mod generate;
mod minimise;
mod operation;
mod outgoing;
mod rig;
mod scenes;
mod speech;
mod wire;

use std::path::PathBuf;

use adit_firmware::link::Link;

use dice::Dice;
use operation::{Case, Operation};

/// Inputs of a test run: about a minute of one core in the development profile.
const INPUTS: u64 = 10_000_000;
/// The seed of a test run.
const SEED: u64 = 4;

fn folder() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("tests/fuzz/corpus")
}

/// The corpus by name.
fn corpus() -> Vec<(String, Case)> {
    let entries = std::fs::read_dir(folder()).expect("the corpus is there");
    let mut files: Vec<PathBuf> = entries.map(|entry| entry.expect("a file").path()).collect();
    files.sort();
    let read = |path: &PathBuf| Case::read(&std::fs::read(path).expect("a file can be read"));
    files.iter().map(|path| (path.display().to_string(), read(path))).collect()
}

fn number(variable: &str, otherwise: u64) -> u64 {
    std::env::var(variable).map_or(otherwise, |text| text.parse().expect("a whole number"))
}

#[test]
fn whatever_comes_in_no_rule_is_broken() {
    let (seed, inputs) = (number("ADIT_FUZZ_SEED", SEED), number("ADIT_FUZZ_INPUTS", INPUTS));
    println!("seed {seed}, {inputs} inputs");
    let corpus: Vec<Case> = corpus().into_iter().map(|(_, case)| case).collect();
    let (mut dice, mut fed, mut cases) = (Dice::new(seed), 0, 0_u64);
    while fed < inputs {
        let case = generate::case(&mut dice, &corpus);
        let sound = minimise::tried(&case).is_ok();
        assert!(sound, "case {cases}: {}", minimise::report(&case, seed));
        fed += case.operations.iter().filter(|operation| operation.is_input()).count() as u64;
        cases += 1;
    }
    println!("{fed} inputs in {cases} cases");
    for (place, count) in census::counts() {
        println!("{count:>10} {place}");
        // A run that was asked to be short may miss some.
        assert!(count > 0 || inputs < INPUTS, "never came to {place}");
    }
}

#[test]
fn no_case_of_the_corpus_breaks_a_rule() {
    let corpus = corpus();
    assert!(corpus.len() >= 24, "{} cases", corpus.len());
    for (name, case) in &corpus {
        assert!(!case.operations.is_empty(), "{name} is empty");
        assert_eq!(Case::read(&case.write()), *case, "{name}");
        assert!(minimise::tried(case).is_ok(), "{name}: {}", minimise::report(case, 0));
    }
}

#[test]
fn a_link_takes_a_known_piece_of_memory() {
    let bytes = size_of::<Link>();
    assert!(bytes <= rig::MAX_LINK_BYTES, "{bytes} bytes");
}

#[test]
fn an_allocation_is_counted() {
    assert_eq!(allocations::counted(|| vec![1_u8; 9]).1, 1);
    assert_eq!(allocations::counted(|| [1_u8; 9]).1, 0);
}

#[test]
fn the_decoder_takes_every_message_of_the_test_s_own_making() {
    let from = wire::From { address: [3, 1], sequence: 9 };
    for (message, _, length) in wire::MESSAGES {
        let seal = wire::Seal { key: rig::KEY, link: 1, time: 77 };
        let frames = [
            wire::frame_2(from, message, &vec![7; length], None),
            wire::frame_2(from, message, &vec![7; length], Some(seal)),
            wire::frame_1(from, message & 0xFF, &vec![7; length]),
        ];
        let known = if message < 256 { 3 } else { 2 };
        for frame in frames.iter().take(known) {
            let decoded = rig::one_frame(frame).unwrap_or_else(|| panic!("message {message}: {frame:02x?}"));
            assert_eq!((decoded.message, decoded.system, decoded.component), (message, 3, 1));
        }
        assert_eq!(wire::signed_at(&rig::KEY, &frames[1]), Some(77));
    }
}

#[test]
#[ignore = "writes the corpus anew: cargo test -p adit-firmware --test fuzz rebuild -- --ignored"]
fn rebuild_the_corpus() {
    for (name, case) in scenes::all() {
        assert!(case.operations.iter().any(Operation::is_input), "{name} says nothing");
        std::fs::write(folder().join(format!("{name}.bin")), case.write()).expect("a file can be written");
    }
}
