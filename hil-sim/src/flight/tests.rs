//! The loop with a board of a few lines, so that what fails here is the world's fault.

use super::*;
use crate::flight::stand_in::{Metronome, mission};

fn flown(simulation: &Simulation, seed: u64) -> Flight {
    let mission = Mission::from_toml(&mission(2.0)).expect("a mission");
    let mut board = Metronome { limit_mps: 0.1, ..Metronome::default() };
    fly_board(&mut board, &mission, simulation, seed).expect("a flight")
}

fn calm() -> Simulation {
    let mut simulation = Simulation::default();
    simulation.wind.gust_sigma_mps2 = [0.0; 3];
    simulation.shutter.missed_share = 0.0;
    simulation.shutter.double_share = 0.0;
    simulation
}

#[test]
fn the_vehicle_flies_the_tunnel_at_the_limit_and_stays_near_the_axis() {
    let flight = flown(&calm(), 1);
    assert_eq!(flight.outcome, Outcome::Completed);
    let flying: Vec<&Moment> = flight.moments.iter().filter(|moment| moment.mode == Mode::Scanning).collect();
    let mean_mps = 2.0 / (flying.len() as f64 * 0.005);
    assert!((0.07..0.1).contains(&mean_mps), "mean speed {mean_mps} m/s under a limit of 0.1 m/s");
    let worst_m = flying.iter().map(|moment| moment.vehicle.position_m.yz().norm()).fold(0.0, f64::max);
    assert!((0.01..0.3).contains(&worst_m), "largest offset {worst_m} m");
}

#[test]
fn a_good_camera_takes_one_photo_per_press_with_the_shaft_at_rest() {
    let flight = flown(&calm(), 2);
    assert_eq!(flight.exposures.len(), flight.presses_s.len());
    for (exposure, press_s) in flight.exposures.iter().zip(&flight.presses_s) {
        let latency_s = exposure.time_s - press_s;
        assert!((0.1..0.3).contains(&latency_s), "latency {latency_s} s");
        assert!(exposure.angular_velocity_rad_per_s.norm() < 0.6);
        assert!(exposure.velocity_mps.norm() < 0.4);
    }
}

#[test]
fn the_camera_looks_where_the_shaft_points() {
    let flight = flown(&calm(), 3);
    for exposure in &flight.exposures {
        let looks = exposure.tunnel_from_cam * nalgebra::Vector3::z();
        let points = adit_geometry::rig::outward(exposure.shaft_rad);
        assert!(looks.angle(&points) < 6_f64.to_radians(), "{} degrees", looks.angle(&points).to_degrees());
    }
}

#[test]
fn an_autopilot_that_ignores_the_limit_is_faster_than_it() {
    let mut simulation = calm();
    simulation.faults = vec![crate::faults::Fault { kind: FaultKind::LimitIgnored, at_s: 0.0, for_s: None }];
    let flight = flown(&simulation, 1);
    let fastest = flight.moments.iter().map(|moment| moment.vehicle.velocity_mps.x).fold(0.0, f64::max);
    assert!(fastest > 0.4, "fastest {fastest} m/s");
}

#[test]
fn power_loss_ends_the_flight_of_the_board_but_not_the_photo_under_way() {
    let mut simulation = calm();
    simulation.faults = vec![crate::faults::Fault { kind: FaultKind::PowerLoss, at_s: 10.65, for_s: None }];
    let flight = flown(&simulation, 1);
    assert_eq!(flight.outcome, Outcome::PowerLost);
    assert!(flight.duration_s() < 10.66);
    assert!(flight.exposures.last().expect("photos").time_s > 10.65);
}

#[test]
fn the_same_seed_makes_the_same_flight() {
    let (one, two, other) = (flown(&Simulation::default(), 5), flown(&Simulation::default(), 5), flown(&calm(), 6));
    assert_eq!(one.exposures, two.exposures);
    assert_eq!(one.moments, two.moments);
    assert_ne!(one.exposures, other.exposures);
}

/// From the moment the shaft leaves the angle of one photo until it is at that of the next for good, within a degree.
fn turn_times_s(flight: &Flight) -> Vec<f64> {
    let mut times_s = Vec::new();
    for (earlier, later) in flight.exposures.iter().zip(flight.exposures.iter().skip(1)) {
        let between = || {
            let until = |moment: &&Moment| (earlier.time_s..later.time_s).contains(&moment.time_s);
            flight.moments.iter().filter(until)
        };
        let away = |moment: &Moment, from: &Exposure| (moment.shaft_rad - from.shaft_rad).abs() > 1_f64.to_radians();
        let left = between().find(|moment| away(moment, earlier));
        let arrived = between().rfind(|moment| away(moment, later));
        if let (Some(left), Some(arrived)) = (left, arrived) {
            times_s.push(arrived.time_s - left.time_s);
        }
    }
    times_s
}

#[test]
fn the_boards_own_loop_turns_by_a_step_in_a_quarter_of_a_second_whatever_the_servo() {
    let mission = Mission::from_toml(&mission(2.0)).expect("a mission");
    for seed in 1..=20 {
        let flight = fly(&mission, &calm(), seed).expect("a flight");
        assert_eq!(flight.outcome, Outcome::Completed, "seed {seed}");
        let longest_s = turn_times_s(&flight).into_iter().fold(0.0, f64::max);
        assert!((0.15..0.27).contains(&longest_s), "seed {seed}: a turn took {longest_s} s");
        for (earlier, later) in flight.exposures.iter().zip(flight.exposures.iter().skip(1)) {
            let step_deg = (later.shaft_rad - earlier.shaft_rad).to_degrees();
            assert!((step_deg - 36.0).abs() < 1.0, "seed {seed}: a step of {step_deg} degrees");
        }
    }
}

#[test]
fn a_flight_that_loses_its_encoder_goes_on_turning_and_knows_each_step_to_a_degree() {
    let mission = Mission::from_toml(&mission(4.0)).expect("a mission");
    let mut simulation = calm();
    simulation.faults = vec![crate::faults::Fault { kind: FaultKind::EncoderSilent, at_s: 15.0, for_s: None }];
    for seed in 1..=10 {
        let flight = fly(&mission, &simulation, seed).expect("a flight");
        assert_eq!(flight.outcome, Outcome::Completed, "seed {seed}");
        let blind: Vec<f64> = flight
            .exposures
            .iter()
            .filter(|exposure| exposure.time_s > 16.0)
            .map(|exposure| exposure.shaft_rad)
            .collect();
        let (Some(first), Some(last)) = (blind.first(), blind.last()) else { panic!("no photos") };
        let step_deg = (last - first).to_degrees() / (blind.len() - 1) as f64;
        assert!(blind.len() > 10 && (step_deg - 36.0).abs() < 1.0, "seed {seed}: {step_deg} degrees per step");
    }
}
