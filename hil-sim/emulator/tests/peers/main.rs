//! Independent implementations of MAVLink against the flash image: pymavlink, MAVSDK and `MAVProxy`, through the pseudo-terminals
//! of an emulated board.
//!
//! `cargo xtask setup` installs them from `requirements.txt` to `target/peers`; where they are not, each test skips itself and
//! says so.

mod ground;

use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::{Mutex, MutexGuard, PoisonError};

use adit_emulator::{EmulatedBoard, Setup, provisioned_fram};
use adit_firmware::io::Outputs;
use adit_firmware::link::{Diagnosis, Link, Memory, Port};
use adit_hil_sim::command::MissionFile;
use adit_hil_sim::flight::fly_board;
use adit_protocol::mavlink::{Encoding, Incoming, Sender, Value, VehicleBeat};
use adit_protocol::parameters::{ParameterTable, Parameters};
use adit_protocol::record::Mode;

const SCRIPTS: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/peers");
const MISSION: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/missions/two-turns.toml");

fn target() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../target")
}

/// One board at a time: each keeps to the clock on the wall.
static TURN: Mutex<()> = Mutex::new(());

fn turn() -> MutexGuard<'static, ()> {
    // A test that failed has left nothing behind that another one needs.
    TURN.lock().unwrap_or_else(PoisonError::into_inner)
}

/// The peers' interpreter; `None`, with a word, where they are not installed.
fn python(test: &str) -> Option<PathBuf> {
    let python = target().join("peers/bin/python");
    if !python.exists() {
        eprintln!("{test} skipped: no {}; install it with: cargo xtask setup", python.display());
    }
    python.exists().then_some(python)
}

/// Runs a script to its end; fails with what it said.
fn run(python: &Path, script: &str, arguments: &[&str]) {
    let output = Command::new(python).arg(Path::new(SCRIPTS).join(script)).args(arguments).output().expect("python");
    let said = [output.stdout, output.stderr].map(|bytes| String::from_utf8_lossy(&bytes).into_owned());
    assert!(output.status.success(), "{script}: {}\n{}", said[0], said[1]);
    eprintln!("{}", said[0].trim_end());
}

/// An emulated board with its telemetry ports as terminals.
struct Served {
    board: Child,
    folder: tempfile::TempDir,
    _turn: MutexGuard<'static, ()>,
}

impl Served {
    fn start() -> Self {
        Self::with(&[])
    }

    /// With more arguments of `serve`.
    fn with(arguments: &[&str]) -> Self {
        let turn = turn();
        let folder = tempfile::tempdir().expect("a folder");
        let image = target().join("image/rotator.elf");
        assert!(image.exists(), "no {}; build it with: cargo xtask flash --build-only", image.display());
        let mut board = Command::new(env!("CARGO_BIN_EXE_adit-emulator"))
            .args(["serve", "--image", &image.to_string_lossy()])
            .arg("--telem1")
            .arg(folder.path().join("telem1"))
            .arg("--telem2")
            .arg(folder.path().join("telem2"))
            .args(arguments)
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .expect("an emulated board");
        let talk = board.stderr.take().map(BufReader::new).expect("its talk");
        let ready = talk.lines().map_while(Result::ok).any(|line| line.contains("ready"));
        assert!(ready, "the board's ports are not there");
        Self { board, folder, _turn: turn }
    }

    fn port(&self, name: &str) -> String {
        self.folder.path().join(name).to_string_lossy().into_owned()
    }
}

impl Drop for Served {
    fn drop(&mut self) {
        // One that has ended by itself is no trouble.
        let _ = self.board.kill();
        let _ = self.board.wait();
    }
}

fn count() -> String {
    ParameterTable::rows().len().to_string()
}

#[test]
fn pymavlink_reads_strictly_every_byte_that_the_image_says_in_a_flight() {
    let Some(python) = python("pymavlink_reads_strictly_every_byte_that_the_image_says_in_a_flight") else { return };
    let file = MissionFile::read(Path::new(MISSION), Some(1)).expect("a mission");
    let parameters = file.mission.parameters();
    let fram = provisioned_fram(&parameters).expect("parameters fit");
    let setup = Setup { fram, ..Setup::new(1).expect("a card") };
    let image = target().join("image/rotator.elf");
    let mut board = EmulatedBoard::new(&image, &parameters, setup).expect("a board");
    fly_board(&mut board, &file.mission, &file.simulation, 1).expect("a flight");
    let report = board.finish().expect("a report");
    let folder = tempfile::tempdir().expect("a folder");
    let said = folder.path().join("telem1.bin");
    std::fs::write(&said, &report.sent[0]).expect("a file");
    let names = [
        "HEARTBEAT",
        "STATUSTEXT",
        "COMMAND_LONG",
        "COMMAND_ACK",
        "DISTANCE_SENSOR",
        "NAMED_VALUE_FLOAT",
        "TUNNEL",
        "CAMERA_TRIGGER",
        "CAMERA_IMAGE_CAPTURED",
    ];
    run(&python, "strict.py", &[&[said.to_string_lossy().as_ref()], &names[..]].concat());
}

/// What the library's link asks of an autopilot, in bytes: a parameter borrowed and given back in Loiter, setpoints in Guided.
fn asked_of_an_autopilot() -> Vec<u8> {
    let mut parameters = Parameters::default();
    (parameters.link.axis_yaw_rad, parameters.link.lead_mps) = (Some(0.0), 0.3);
    let mut link = Link::new(&parameters, Memory::default(), 7);
    let mut autopilot = Sender::new(1, 1);
    let mut said = Vec::new();
    for tick in 0..4000_u64 {
        let now_us = tick * 5000;
        // Loiter, then Guided.
        let custom_mode = if tick < 2000 { 5 } else { 4 };
        if tick % 100 == 0 {
            let beat = VehicleBeat { autopilot: 3, base_mode: 0x81, custom_mode };
            link.receive(now_us, Port::Autopilot, &autopilot.vehicle_heartbeat(beat));
        }
        let scans = tick < 3000;
        let (mode, limit) = if scans { (Mode::Scanning, Some(0.3)) } else { (Mode::Ready, None) };
        let outputs = Outputs { mode, speed_limit_mps: limit, ..Outputs::default() };
        link.note(now_us, &outputs, [None; 4], Diagnosis::default());
        if link.take_keep(now_us).is_some() {
            link.kept(true);
        }
        while let Some((_, frame)) = link.next_frame(now_us) {
            let mut decoder = adit_protocol::mavlink::FrameDecoder::default();
            let asked = frame.iter().find_map(|byte| decoder.push(*byte)).and_then(|frame| Incoming::read(&frame));
            said.extend_from_slice(&frame);
            // An autopilot of 4.6 with its Loiter's speed.
            let value = match asked {
                Some(Incoming::ParameterRead { name, .. }) if name.as_deref() == Some("LOIT_SPEED") => 1250.0,
                Some(Incoming::ParameterSet { value, .. }) => {
                    Value::read(value, Encoding::Cast).expect("a value").real()
                }
                _ => continue,
            };
            let answer = autopilot.parameter_value("LOIT_SPEED", Value::Real(value).write(Encoding::Cast), [0, 1]);
            link.receive(now_us, Port::Autopilot, &answer);
        }
    }
    said
}

#[test]
fn pymavlink_reads_strictly_what_is_asked_of_an_autopilot() {
    let Some(python) = python("pymavlink_reads_strictly_what_is_asked_of_an_autopilot") else { return };
    let folder = tempfile::tempdir().expect("a folder");
    let said = folder.path().join("asked.bin");
    std::fs::write(&said, asked_of_an_autopilot()).expect("a file");
    let names = ["COMMAND_LONG", "PARAM_REQUEST_READ", "PARAM_SET", "SET_POSITION_TARGET_LOCAL_NED"];
    run(&python, "strict.py", &[&[said.to_string_lossy().as_ref()], &names[..]].concat());
}

#[test]
fn pymavlink_gets_an_answer_to_everything_that_can_be_asked() {
    let Some(python) = python("pymavlink_gets_an_answer_to_everything_that_can_be_asked") else { return };
    let board = Served::start();
    run(&python, "questions.py", &[&board.port("telem1")]);
}

#[test]
fn pymavlink_reads_and_sets_the_parameters_in_the_encoding_of_either_autopilot() {
    let Some(python) = python("pymavlink_reads_and_sets_the_parameters") else { return };
    let board = Served::start();
    run(&python, "parameters.py", &[&board.port("telem1"), &board.port("telem2"), &count()]);
}

#[test]
fn pymavlink_and_the_image_believe_each_others_signatures_and_no_others() {
    let Some(python) = python("pymavlink_and_the_image_believe_each_others_signatures") else { return };
    let board = Served::start();
    run(&python, "signing.py", &[&board.port("telem1"), &board.port("telem2")]);
}

#[test]
fn mavsdk_lists_and_sets_the_parameters_and_finds_the_camera() {
    let Some(python) = python("mavsdk_lists_and_sets_the_parameters_and_finds_the_camera") else { return };
    let board = Served::start();
    run(&python, "mavsdk_session.py", &[&board.port("telem1"), &count()]);
}

#[test]
fn mavsdk_sees_the_vehicle_with_our_component_beside_it_and_every_capture() {
    let Some(python) = python("mavsdk_sees_the_vehicle_with_our_component_beside_it_and_every_capture") else { return };
    let _turn = turn();
    let folder = tempfile::tempdir().expect("a folder");
    let (image, out) = (target().join("image/rotator.elf"), folder.path().join("flight"));
    let paths = [Path::new(MISSION), &out].map(|path| path.to_string_lossy().into_owned());
    let emulator = env!("CARGO_BIN_EXE_adit-emulator");
    run(&python, "captures.py", &[emulator, &image.to_string_lossy(), &paths[0], &paths[1]]);
}

#[test]
fn mavproxy_loads_the_parameters() {
    let Some(python) = python("mavproxy_loads_the_parameters") else { return };
    let board = Served::start();
    let state = board.folder.path().join("mavproxy");
    let mut mavproxy = Command::new(&python)
        .arg(python.with_file_name("mavproxy.py"))
        .args(["--master", &board.port("telem2"), "--baudrate", "921600", "--source-system", "255"])
        .args(["--target-system", "1", "--target-component", "191", "--non-interactive", "--cmd", "param fetch"])
        .arg("--state-basedir")
        .arg(&state)
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .expect("MAVProxy");
    // It stays until it is told to go, and saves what it has loaded once it has all.
    let loaded = (0..600).find_map(|_| {
        std::thread::sleep(std::time::Duration::from_millis(100));
        std::fs::read_to_string(state.join("mav_1_191.parm")).ok().filter(|loaded| known(loaded) > 0)
    });
    mavproxy.kill().and_then(|()| mavproxy.wait()).expect("MAVProxy ends");
    assert_eq!(loaded.as_deref().map(known), Some(ParameterTable::rows().len()), "{loaded:?}");
}

/// How many of the board's parameters a file of `MAVProxy` has.
fn known(loaded: &str) -> usize {
    let names = loaded.lines().filter_map(|line| line.split_whitespace().next());
    names.filter(|name| ParameterTable::find(name).is_some()).count()
}
