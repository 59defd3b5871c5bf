//! The checker finds what a bad board does.

use super::*;
use crate::card::log_bytes;
use crate::config::Simulation;
use crate::flight::fly_board;
use crate::flight::stand_in::{Metronome, mission};

/// The report on a board that allows `limit_mps`, takes photos and writes no tags.
fn judged(limit_mps: f32) -> Report {
    let mission = Mission::from_toml(&(mission(4.0) + "image_period_s = 1.0\n")).expect("a mission");
    let mut board = Metronome { limit_mps, ..Metronome::default() };
    let flight = fly_board(&mut board, &mission, &Simulation::default(), 3).expect("a flight");
    let log = log_bytes(&flight).expect("fits");
    check(&flight, &log, &mission, &mut BoundTable::new(&mission).expect("a profile"))
}

#[test]
fn photos_without_tags_are_found() {
    let report = judged(0.1);
    let untagged = report.violations.iter().filter(|violation| matches!(violation, Violation::PhotoWithoutTag { .. }));
    assert_eq!(untagged.count(), report.figures.photos - report.figures.surplus);
    assert_eq!(report.figures.seen_once_percent, 100.0);
}

#[test]
fn a_limit_above_the_bound_is_found_and_the_hole_is_seen() {
    // One photo a second from 1.5 m: the two-view bound is about 0.22 m per image.
    assert!(!judged(0.2).violations.iter().any(|violation| matches!(violation, Violation::LimitAboveBound { .. })));
    let report = judged(0.5);
    assert!(report.violations.iter().any(|violation| matches!(violation, Violation::LimitAboveBound { .. })));
    assert!(report.figures.limit_use > 1.5, "{}", report.figures.limit_use);
}

#[test]
fn a_limit_that_is_no_number_is_found() {
    let report = judged(f32::NAN);
    assert!(report.violations.iter().any(|violation| matches!(violation, Violation::LimitAbsurd { .. })));
}
