//! The matrix as tables of physical numbers, one for each autopilot.

use std::fmt::Write as _;

use adit_hil_sim::autopilot::Kind;
use adit_hil_sim::seed::{Random, Stream};
use adit_protocol::telemetry::Enforcement;
use rayon::prelude::*;

use crate::cell::{Cell, Found, Leg, Sabotage};
use crate::course::{LIMITS, Timed, Trouble};

/// Every mode of an autopilot, and Guided once more, led by the board.
fn cells(kind: Kind) -> Vec<Cell> {
    let led = kind.mode("GUIDED").map(|_| ("GUIDED", true));
    let modes = kind.modes().iter().map(|(_, mode)| (*mode, false)).chain(led);
    modes
        .flat_map(|(mode, leads)| Trouble::ALL.map(|trouble| Cell { leads, ..Cell::usual(kind, mode, trouble) }))
        .collect()
}

fn words(claim: Enforcement) -> &'static str {
    match claim {
        Enforcement::Idle => "-",
        Enforcement::Requested => "requested",
        Enforcement::Enforced => "enforced",
        Enforcement::Ineffective => "ineffective",
        Enforcement::NotPossible => "not possible",
    }
}

fn row(table: &mut String, cell: &Cell, found: &Found) {
    let mode = if cell.leads { format!("{}, led", cell.mode) } else { cell.mode.to_owned() };
    let (trouble, saves) = (cell.trouble.trouble.name(), found.saves);
    let _ = write!(table, "{mode:14} {trouble:18}");
    for Leg { claim, flown_mps, over_s } in found.legs {
        // A hover in gusts is neither forwards nor backwards.
        let flown_mps = if flown_mps.abs() < 0.05 { 0.0 } else { flown_mps };
        let _ = write!(table, "  {flown_mps:4.2} {over_s:4.2} {:12}", words(claim));
    }
    let told = found.judge.told_after_s.map_or("-".to_owned(), |after_s| format!("{after_s:.2}"));
    let _ = writeln!(table, " {told:>6} {saves:>5}");
}

fn matrix(kind: Kind) {
    let flown: Vec<(Cell, Found)> = cells(kind).into_par_iter().map(|cell| (cell, cell.fly())).collect();
    let mut table = format!("{:33}", "mode           trouble");
    for (_, limit_mps) in LIMITS {
        let _ = write!(table, "  {:22}", format!("at {limit_mps:.2} m/s"));
    }
    let _ = write!(table, " told s saves\n{:33}", "");
    for _ in LIMITS {
        let _ = write!(table, "  {:22}", " m/s over s");
    }
    table.truncate(table.trim_end().len());
    table.push('\n');
    let mut complaints = String::new();
    for (cell, found) in &flown {
        row(&mut table, cell, found);
        for complaint in &found.judge.complaints {
            let _ =
                writeln!(complaints, "{} {} ({}): {complaint}", kind.name(), cell.mode, cell.trouble.trouble.name());
        }
    }
    assert!(complaints.is_empty(), "{complaints}\n{table}");
    let name = kind.name().replace([' ', '.'], "-").to_lowercase();
    insta::assert_snapshot!(name, table);
}

#[test]
fn ardupilot_4_6_is_held_to_the_limit_or_the_pilot_is_told() {
    matrix(Kind::ArduPilot46);
}

#[test]
fn ardupilot_4_7_is_held_to_the_limit_or_the_pilot_is_told() {
    matrix(Kind::ArduPilot47);
}

#[test]
fn px4_is_held_to_the_limit_or_the_pilot_is_told() {
    matrix(Kind::Px4);
}

#[test]
fn px4_of_the_development_dialect_is_held_to_the_limit_or_the_pilot_is_told() {
    matrix(Kind::Px4Development);
}

/// What is complained of in a cell that is sabotaged.
fn complaints(kind: Kind, mode: &'static str, trouble: Trouble, sabotage: Sabotage) -> String {
    Cell::usual(kind, mode, trouble).fly_with(sabotage).judge.complaints.join("; ")
}

#[test]
fn a_limit_without_any_effect_is_noticed_and_the_board_does_not_claim_otherwise() {
    let sabotage = Sabotage { ignores_all: true, ..Sabotage::default() };
    for (kind, mode) in [(Kind::ArduPilot46, "AUTO"), (Kind::ArduPilot47, "LOITER"), (Kind::Px4, "MISSION")] {
        let found = Cell::usual(kind, mode, Trouble::Nothing).fly_with(sabotage);
        assert!(found.judge.complaints[0].contains("above the limit for too long"), "{:?}", found.judge.complaints);
        let honest = |leg: &Leg| matches!(leg.claim, Enforcement::Ineffective | Enforcement::NotPossible);
        assert!(found.legs.iter().all(honest), "{} {mode}: {:?}", kind.name(), found.legs);
    }
}

#[test]
fn a_parameter_that_is_not_given_back_is_noticed() {
    let sabotage = Sabotage { forgets: true, ..Sabotage::default() };
    for (kind, mode, name) in [(Kind::ArduPilot46, "LOITER", "LOIT_SPEED"), (Kind::Px4, "POSITION", "MPC_VEL_MANUAL")] {
        let found = complaints(kind, mode, Trouble::BoardResetAtEnd, sabotage);
        assert!(found.contains(name), "{found}");
    }
}

#[test]
fn a_pilot_who_is_not_told_is_noticed() {
    let sabotage = Sabotage { mutes: true, ..Sabotage::default() };
    let found = complaints(Kind::ArduPilot46, "ALT_HOLD", Trouble::Nothing, sabotage);
    assert!(found.contains("nobody was told"), "{found}");
}

/// How many flights.
const SWARM: u64 = 600;

#[test]
fn a_swarm_of_troubles_at_any_time_breaks_no_rule() {
    let broken: Vec<String> = (0..SWARM)
        .into_par_iter()
        .filter_map(|seed| {
            let cell = any(seed);
            let complaints = cell.fly().judge.complaints;
            (!complaints.is_empty()).then(|| format!("{cell:?}: {}", complaints.join("; ")))
        })
        .collect();
    assert!(broken.is_empty(), "{} of {SWARM}:\n{}", broken.len(), broken.join("\n"));
}

/// A cell that depends on its seed only.
fn any(seed: u64) -> Cell {
    let mut random = Random::new(seed, Stream::Faults);
    let kind = Kind::ALL[random.index(Kind::ALL.len())];
    let modes = kind.modes();
    let mode = modes[random.index(modes.len())].1;
    let trouble = Trouble::ALL[random.index(Trouble::ALL.len())];
    let leads = mode == "GUIDED" && random.chance(0.5);
    let trouble = Timed::any(trouble, &mut random);
    Cell { kind, mode, leads, trouble, delay_s: random.uniform(0.0, 0.15), seed }
}
