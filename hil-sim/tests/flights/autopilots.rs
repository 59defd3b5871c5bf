//! Whole flights under autopilots by name: how the limit fared in each mode, and what was seen of the wall.

use std::fmt::Write as _;

use adit_hil_sim::autopilot::Kind;
use adit_hil_sim::card::log_bytes;
use adit_hil_sim::check::{BoundTable, check};
use adit_hil_sim::config::{ModeName, Simulation};
use adit_hil_sim::flight::{Account, Flight, Linked, Outcome, fly_board};
use adit_hil_sim::peer::Peer;
use adit_protocol::mavlink::{FrameDecoder, Incoming, Sender};
use adit_protocol::mission::Mission;
use adit_protocol::record::Mode;
use rayon::prelude::*;

const SEED: u64 = 7;

/// Radius and length of pipes: in the first the limit is below 0.1 m/s, in the second every autopilot can be held to it.
const PIPES_M: [[f64; 2]; 2] = [[1.5, 4.0], [4.0, 10.0]];

/// A pipe like the demo's, in still air, with a camera without fault.
fn pipe([radius_m, length_m]: [f64; 2]) -> (Mission, Simulation) {
    let text = crate::common::mission_text("demo.toml")
        .replace("length_m = 10.0", &format!("length_m = {length_m:.1}"))
        .replace("radius_m = 1.5", &format!("radius_m = {radius_m:.1}"));
    let mut simulation = Simulation::from_mission(&text).expect("a simulation");
    simulation.wind.gust_sigma_mps2 = [0.0; 3];
    simulation.shutter.missed_share = 0.0;
    simulation.shutter.double_share = 0.0;
    (Mission::from_toml(&text).expect("a mission"), simulation)
}

fn flown(pipe_m: [f64; 2], kind: Kind, mode: &str) -> (Flight, Account) {
    let (mission, mut simulation) = pipe(pipe_m);
    simulation.autopilot.mode = Some(ModeName::try_from(mode.to_owned()).expect("a mode"));
    let mut board = Linked::new(kind, &mission.parameters(), &simulation).expect("this autopilot's mode");
    let flight = fly_board(&mut board, &mission, &simulation, SEED).expect("flies");
    (flight, board.account())
}

const FLIGHTS: [(Kind, &str); 10] = [
    (Kind::ArduPilot46, "auto"),
    (Kind::ArduPilot46, "guided"),
    (Kind::ArduPilot46, "loiter"),
    (Kind::ArduPilot46, "alt-hold"),
    (Kind::ArduPilot47, "auto"),
    (Kind::ArduPilot47, "loiter"),
    (Kind::Px4, "mission"),
    (Kind::Px4, "position"),
    (Kind::Px4, "offboard"),
    (Kind::Px4Development, "position-slow"),
];

/// The limit and the true speed, on average over the scan without its first seconds.
fn means(flight: &Flight) -> (f64, f64) {
    let limited = flight.moments.iter().filter_map(|moment| {
        let limit_mps = f64::from(moment.limit_mps.filter(|_| moment.mode == Mode::Scanning)?);
        Some([limit_mps, moment.vehicle.velocity_mps.x])
    });
    let settled: Vec<[f64; 2]> = limited.skip(600).collect();
    let mean = |index: usize| settled.iter().map(|moment| moment[index]).sum::<f64>() / settled.len() as f64;
    (mean(0), mean(1))
}

#[test]
fn flights_under_named_autopilots_give_the_figures_on_record() {
    let heads = ["limit", "flown", "requested", "enforced", "ineffective", "not possible", "saves", "seen twice"];
    let mut table = format!("{:5} {:15} {:13} {:>5}", "pipe", "autopilot", "mode", "s");
    for head in heads {
        let _ = write!(table, " {head:>5}");
    }
    for pipe_m in PIPES_M {
        let (mission, _) = pipe(pipe_m);
        let mut bounds = BoundTable::new(&mission).expect("a profile");
        let flights: Vec<(Flight, Account)> =
            FLIGHTS.into_par_iter().map(|(kind, mode)| flown(pipe_m, kind, mode)).collect();
        for ((kind, mode), (flight, account)) in FLIGHTS.into_iter().zip(&flights) {
            let report = check(flight, &log_bytes(flight).expect("a log"), &mission, &mut bounds);
            assert_eq!(report.violations, [], "{} {mode}", kind.name());
            assert!(account.changed.is_empty(), "{} {mode}: {:?}", kind.name(), account.changed);
            assert_eq!(flight.outcome, Outcome::Completed);
            let (limit_mps, speed_mps) = means(flight);
            let _ = write!(table, "\n{:3.1} m {:15} {mode:13} {:5.1}", pipe_m[0], kind.name(), flight.duration_s());
            let _ = write!(table, " {limit_mps:5.2} {speed_mps:5.2}");
            for (head, claimed_s) in heads.iter().skip(2).zip(account.claimed_s) {
                let _ = write!(table, " {claimed_s:width$.1}", width = head.len());
            }
            let _ = write!(table, " {:5} {:9.1}%", account.saves, report.figures.seen_twice_percent);
        }
    }
    insta::assert_snapshot!(table);
}

#[test]
fn a_mode_that_the_autopilot_has_not_is_refused_with_those_that_it_has() {
    let (mission, mut simulation) = pipe(PIPES_M[0]);
    simulation.autopilot.mode = ModeName::try_from("loiter".to_owned()).ok();
    let refusal = Linked::new(Kind::Px4, &mission.parameters(), &simulation).err().map(|error| error.to_string());
    assert!(refusal.is_some_and(|words| words.starts_with("PX4 has no mode LOITER; it has ALTITUDE")));
}

/// Listens until the vehicle goes; returns whose heartbeats came, and the answers to its questions.
fn ground_station(mut peer: Peer) -> (Vec<[u8; 2]>, Vec<[u8; 2]>) {
    let (mut sender, mut decoder) = (Sender::new(255, 1), FrameDecoder::default());
    let (mut alive, mut answered) = (Vec::new(), Vec::new());
    while let Ok(bytes) = peer.read() {
        for frame in bytes.into_iter().filter_map(|byte| decoder.push(byte)) {
            let from = [frame.system, frame.component];
            match Incoming::read(&frame) {
                Some(Incoming::Heartbeat { .. }) if !alive.contains(&from) => {
                    alive.push(from);
                    // AUTOPILOT_VERSION, please.
                    let question = sender.command(from, 512, 0, &[148.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
                    if peer.write(&question).is_err() {
                        break;
                    }
                }
                Some(Incoming::Version { .. }) if !answered.contains(&from) => answered.push(from),
                _ => {}
            }
        }
        std::thread::yield_now();
    }
    alive.sort_unstable();
    answered.sort_unstable();
    (alive, answered)
}

#[test]
fn a_ground_station_sees_autopilot_board_and_camera_side_by_side_and_each_answers() {
    let port = {
        let probe = std::net::TcpListener::bind("127.0.0.1:0").expect("binds");
        probe.local_addr().expect("has one").port()
    };
    let (mission, simulation) = pipe(PIPES_M[0]);
    let vehicle = Peer::open(&format!("tcpin:127.0.0.1:{port}").parse().expect("a connection")).expect("opens");
    let ground = Peer::open(&format!("tcpout:127.0.0.1:{port}").parse().expect("a connection")).expect("connects");
    let station = std::thread::spawn(move || ground_station(ground));
    let mut board =
        Linked::new(Kind::ArduPilot46, &mission.parameters(), &simulation).expect("Auto").watched_by(vehicle);
    let flight = fly_board(&mut board, &mission, &simulation, SEED).expect("flies");
    assert_eq!(flight.outcome, Outcome::Completed);
    drop(board);
    let (alive, answered) = station.join().expect("ends");
    assert_eq!(alive, [[1, 1], [1, 100], [1, 191]]);
    assert_eq!(answered, alive);
}
