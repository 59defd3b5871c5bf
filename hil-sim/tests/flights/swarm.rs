//! Many seeds with faults and without photos: nothing that must hold is ever broken, and nothing panics.

use std::panic::catch_unwind;

use adit_hil_sim::card::log_bytes;
use adit_hil_sim::check::{BoundTable, Report, check};
use adit_hil_sim::config::Simulation;
use adit_hil_sim::flight::fly;
use adit_protocol::mission::Mission;
use rayon::prelude::*;

const SEEDS: u64 = 50;

fn judge(mission: &Mission, simulation: &Simulation, bounds: &BoundTable, seed: u64) -> Report {
    let flight = fly(mission, simulation, seed).expect("the mission flies");
    let log = log_bytes(&flight).expect("entries fit their frames");
    check(&flight, &log, mission, &mut bounds.clone())
}

#[test]
fn fifty_seeds_with_faults_break_no_rule() {
    let (mission, simulation) = crate::common::mission("swarm.toml");
    let mut bounds = BoundTable::new(&mission).expect("a profile");
    bounds.fill(0.2);
    let failures: Vec<String> = (1..=SEEDS)
        .into_par_iter()
        .filter_map(|seed| {
            let command =
                format!("cargo run -p adit-hil-sim -- fly hil-sim/missions/swarm.toml --out /tmp/seed-{seed} --seed {seed} --no-photos");
            match catch_unwind(|| judge(&mission, &simulation, &bounds, seed)) {
                Ok(report) if report.violations.is_empty() => None,
                Ok(report) => {
                    let first: Vec<_> = report.violations.iter().take(3).collect();
                    Some(format!("seed {seed}: {} rules broken, first {first:?}\n  {command}", report.violations.len()))
                }
                Err(_) => Some(format!("seed {seed}: panic\n  {command}")),
            }
        })
        .collect();
    assert!(failures.is_empty(), "{} of {SEEDS} seeds failed:\n{}", failures.len(), failures.join("\n"));
}
