//! A flight of the image with faults in the world and on the board, and what is to be seen of it.

use std::path::Path;

use adit_emulator::{
    BoardFault, BoardFaultKind, EmulatedBoard, Pins, Report, Setup, keyed_fram, log_of, provisioned_fram,
};
use adit_firmware::io::{Inputs, Outputs};
use adit_hil_sim::command::MissionFile;
use adit_hil_sim::faults::{Fault, FaultKind};
use adit_hil_sim::flight::{Board, BoardError, Flight, fly_board};
use adit_hil_sim::plant::vehicle::VehicleState;
use adit_protocol::log::FlightLog;
use adit_protocol::mavlink::{FrameDecoder, Key};
use adit_protocol::parameters::Parameters;
use adit_protocol::record::{Event, EventKind};

const MISSION: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/missions/two-turns.toml");
const SEED: u64 = 5;

/// What is to happen, and for how long to watch.
#[derive(Default)]
pub(crate) struct Case {
    pub(crate) world: Vec<Fault>,
    pub(crate) board: Vec<BoardFault>,
    pub(crate) most_s: f64,
    /// The pilot's key; the board has it too.
    pub(crate) key: Option<[u8; 32]>,
    /// The board's inertial unit feels a vehicle on the ground until then; the simulated one hovers from the start.
    pub(crate) on_ground_until_s: f64,
}

/// A fault of the world from then to then.
pub(crate) fn world(kind: FaultKind, from_s: f64, to_s: f64) -> Fault {
    Fault { kind, at_s: from_s, for_s: Some(to_s - from_s) }
}

/// A fault of the board from then to then.
pub(crate) fn board(kind: BoardFaultKind, from_s: f64, to_s: f64) -> BoardFault {
    BoardFault { kind, at_s: from_s, for_s: Some(to_s - from_s) }
}

/// A flight and what it left.
pub(crate) struct Flown {
    pub(crate) flight: Flight,
    pub(crate) report: Report,
    pub(crate) log: FlightLog,
    /// The pins at each step, with its time.
    pub(crate) pins: Vec<(f64, Pins)>,
}

/// The emulated board, its pins noted at each step.
struct Watched {
    board: EmulatedBoard,
    pins: Vec<(f64, Pins)>,
    on_ground_until_s: f64,
}

impl Board for Watched {
    fn feel(&mut self, now_us: u64, vehicle: &VehicleState) {
        let mut felt = *vehicle;
        if now_us as f64 * 1e-6 < self.on_ground_until_s {
            felt.velocity_mps.fill(0.0);
            (felt.attitude_rad, felt.attitude_rate_rad_per_s) = ([0.0; 3], [0.0; 3]);
        }
        self.board.feel(now_us, &felt);
    }

    fn step(&mut self, now_us: u64, inputs: &Inputs) -> Result<Outputs, BoardError> {
        let outputs = self.board.step(now_us, inputs)?;
        self.pins.push((now_us as f64 * 1e-6, self.board.pins()));
        Ok(outputs)
    }
}

pub(crate) fn parameters() -> Parameters {
    mission().mission.parameters()
}

fn mission() -> MissionFile {
    MissionFile::read(Path::new(MISSION), Some(SEED)).expect("a mission")
}

/// Whether a file of the card is a flight log, by its 8.3 name.
pub(crate) fn is_log(name: &str) -> bool {
    Path::new(name).extension().is_some_and(|extension| extension == "LOG")
}

/// The image.
pub(crate) fn image() -> std::path::PathBuf {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../target/image/rotator.elf");
    assert!(path.exists(), "no {}; build it with: cargo xtask flash --build-only", path.display());
    path
}

/// Flies the case with the mission's parameters.
pub(crate) fn fly(case: &Case) -> Flown {
    fly_with(case, &parameters())
}

/// Flies the case with these parameters.
pub(crate) fn fly_with(case: &Case, parameters: &Parameters) -> Flown {
    let mut file = mission();
    file.simulation.faults.clone_from(&case.world);
    file.simulation.pilot.most_s = case.most_s;
    let fram = match case.key {
        Some(key) => keyed_fram(parameters, Key(key)),
        None => provisioned_fram(parameters),
    };
    let fram = fram.expect("parameters fit");
    let setup = Setup { fram, faults: case.board.clone(), key: case.key, ..Setup::new(SEED).expect("a card") };
    let board = EmulatedBoard::new(&image(), parameters, setup).expect("a board");
    let mut watched = Watched { board, pins: Vec::new(), on_ground_until_s: case.on_ground_until_s };
    let flight = fly_board(&mut watched, &file.mission, &file.simulation, SEED).expect("a flight");
    let report = watched.board.finish().expect("a report");
    assert_eq!(report.gaps, Vec::<String>::new(), "accesses that the emulator cannot answer");
    let log = FlightLog::from_bytes(&log_of(&report).expect("a log").bytes);
    Flown { flight, report, log, pins: watched.pins }
}

impl Flown {
    /// All events, those of later runs of the board included, with the time of their own run.
    pub(crate) fn events(&self) -> impl Iterator<Item = &Event> {
        self.log.sessions.iter().flat_map(|session| &session.events)
    }

    /// When the event first happened; fails if it never did.
    pub(crate) fn when(&self, kind: EventKind) -> f64 {
        let event = self.events().find(|event| event.kind == kind);
        let event = event.unwrap_or_else(|| panic!("never {kind:?} in {:#?}", self.events().collect::<Vec<_>>()));
        event.time_us as f64 * 1e-6
    }

    /// Fails unless the event happened within these seconds.
    pub(crate) fn expect(&self, kind: EventKind, from_s: f64, to_s: f64) {
        let at_s = self.when(kind);
        assert!((from_s..to_s).contains(&at_s), "{kind:?} at {at_s} s, expected between {from_s} s and {to_s} s");
    }

    /// Numbers of all captures, in the order in which they were written.
    pub(crate) fn captures(&self) -> Vec<u32> {
        self.log.sessions.iter().flat_map(|session| session.tags.iter().map(|tag| tag.capture)).collect()
    }

    /// Fails unless captures are numbered 1, 2, 3, ..., each once, at least so many, and the log is sound.
    pub(crate) fn expect_captures(&self, least: usize) {
        let captures = self.captures();
        let numbers: Vec<u32> = (1..=captures.len() as u32).collect();
        assert_eq!(captures, numbers);
        assert!(captures.len() >= least, "{} captures", captures.len());
        assert_eq!((self.log.damage.len(), self.log.conflicts.len()), (0, 0));
    }

    /// Every text that the pilot was sent.
    pub(crate) fn texts(&self) -> Vec<String> {
        let mut decoder = FrameDecoder::default();
        let frames = self.report.sent[0].iter().filter_map(|byte| decoder.push(*byte));
        // STATUSTEXT: severity, text.
        let texts = frames.filter(|frame| frame.message == 253).map(|frame| {
            let text = frame.bytes::<50>(1);
            String::from_utf8_lossy(&text).trim_end_matches('\0').to_owned()
        });
        texts.collect()
    }

    /// Fails unless the pilot was told something that contains these words.
    pub(crate) fn expect_text(&self, words: &str) {
        assert!(self.texts().iter().any(|text| text.contains(words)), "no {words:?} in {:?}", self.texts());
    }
}
