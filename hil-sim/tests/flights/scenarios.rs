//! Named scenarios as a table of physical numbers, so that a change of behaviour is a readable difference.

use std::fmt::Write as _;

use adit_hil_sim::card::log_bytes;
use adit_hil_sim::check::{BoundTable, Report, centring_error_mm, check};
use adit_hil_sim::config::Simulation;
use adit_hil_sim::faults::{BeamName, Fault, FaultKind};
use adit_hil_sim::flight::{Outcome, fly};
use adit_hil_sim::sensors::range::RangeDefect;
use adit_protocol::mission::Mission;

const SEED: u64 = 7;

/// The demo's pipe with still air and a camera without fault.
fn calm() -> Simulation {
    let (_, mut simulation) = crate::common::mission("demo.toml");
    simulation.wind.gust_sigma_mps2 = [0.0; 3];
    simulation.shutter.missed_share = 0.0;
    simulation.shutter.double_share = 0.0;
    simulation
}

fn with_fault(kind: FaultKind, at_s: f64, for_s: Option<f64>) -> Simulation {
    Simulation { faults: vec![Fault { kind, at_s, for_s }], ..calm() }
}

fn flown(mission: &Mission, simulation: &Simulation, bounds: &mut BoundTable) -> Report {
    let flight = fly(mission, simulation, SEED).expect("the mission flies");
    let log = log_bytes(&flight).expect("entries fit their frames");
    check(&flight, &log, mission, bounds)
}

fn scenarios() -> Vec<(&'static str, Simulation)> {
    let gusty = {
        let mut simulation = calm();
        simulation.wind.gust_sigma_mps2 = [0.2, 0.35, 0.3];
        simulation
    };
    let misses = {
        let mut simulation = calm();
        simulation.shutter.missed_share = 0.05;
        simulation
    };
    let up_dead = FaultKind::Range { beam: BeamName::Up, defect: RangeDefect::Dead };
    vec![
        ("calm", calm()),
        ("gusty", gusty),
        ("up sensor dead", with_fault(up_dead, 20.0, None)),
        ("camera misses 5 %", misses),
        ("servo stalls 3 s", with_fault(FaultKind::ServoStall, 30.0, Some(3.0))),
        ("encoder silent 4 s", with_fault(FaultKind::EncoderSilent, 30.0, Some(4.0))),
        ("limit ignored 5 s", with_fault(FaultKind::LimitIgnored, 30.0, Some(5.0))),
        ("camera deaf", with_fault(FaultKind::CameraDeaf, 0.0, None)),
        ("power lost", with_fault(FaultKind::PowerLoss, 40.0, None)),
    ]
}

#[test]
fn named_scenarios_give_the_figures_on_record() {
    let (mission, _) = crate::common::mission("demo.toml");
    let mut bounds = BoundTable::new(&mission).expect("a profile");
    let mut table = String::from(
        "scenario             outcome    time_s dist_m press photo missed tags conf  centr_mm offs_mm limit_% step_% time_ms shaft_deg once_% twice_%\n",
    );
    for (name, simulation) in scenarios() {
        let Report { violations, figures } = flown(&mission, &simulation, &mut bounds);
        assert!(violations.is_empty(), "{name}: {:?}", &violations[..violations.len().min(3)]);
        let _ = writeln!(
            table,
            "{name:20} {:10} {:6.0} {:6.1} {:5} {:5} {:6} {:4} {:4} {:9.0} {:7.0} {:7.0} {:6.0} {:7.0} {:9.2} {:6.1} {:7.1}",
            format!("{:?}", figures.outcome),
            figures.duration_s,
            figures.distance_m,
            figures.presses,
            figures.photos,
            figures.missed,
            figures.tags,
            figures.confirmed,
            figures.centring_error_mm,
            figures.offset_mm,
            figures.limit_use * 100.0,
            figures.longest_step * 100.0,
            figures.tag_time_error_ms,
            figures.tag_shaft_error_deg,
            figures.seen_once_percent,
            figures.seen_twice_percent,
        );
    }
    insta::assert_snapshot!(table);
}

#[test]
fn calm_air_leaves_no_hole() {
    let (mut mission, _) = crate::common::mission("underpass.toml");
    let report = flown(&mission, &calm(), &mut BoundTable::new(&mission).expect("a profile"));
    assert_eq!(report.violations, []);
    assert_eq!(report.figures.outcome, Outcome::Completed);
    assert_eq!(report.figures.seen_once_percent, 100.0);

    mission = crate::common::mission("demo.toml").0;
    let report = flown(&mission, &calm(), &mut BoundTable::new(&mission).expect("a profile"));
    assert_eq!(report.violations, []);
    assert_eq!(report.figures.outcome, Outcome::Completed);
    assert_eq!(report.figures.seen_once_percent, 100.0);
}

#[test]
fn range_noise_and_gusts_set_the_centring_error() {
    let (mut mission, _) = crate::common::mission("demo.toml");
    mission.flight.length_m = 3.0;
    let mut table =
        String::from("centring error in mm (root mean square)\nnoise_mm  gust 0.0  gust 0.2  gust 0.4 m/s2\n");
    for noise_mm in [2.0, 10.0, 30.0] {
        let _ = write!(table, "{noise_mm:8.0}");
        for gust_mps2 in [0.0, 0.2, 0.4] {
            let mut simulation = calm();
            simulation.wind.gust_sigma_mps2 = [gust_mps2; 3];
            simulation.ranges.noise_sigma_m = noise_mm / 1000.0;
            let flight = fly(&mission, &simulation, SEED).expect("the mission flies");
            let _ = write!(table, "{:10.0}", centring_error_mm(&flight));
        }
        table.push('\n');
    }
    insta::assert_snapshot!(table);
}
