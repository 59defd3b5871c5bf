//! The flash image itself, from switching on to the last photo, on an emulated board in a simulated pipe.

use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, OnceLock};

use adit_emulator::serve::{Ports, serve};
use adit_emulator::{EmulatedBoard, Report, RestartCause, Setup, log_of, parameters_in, provisioned_fram};
use adit_firmware::io::Inputs;
use adit_ground::ingest::{IngestOptions, ingest};
use adit_hil_sim::card::log_bytes;
use adit_hil_sim::command::{Left, MissionFile};
use adit_hil_sim::flight::{Board as _, Flight, Outcome, fly, fly_board};
use adit_hil_sim::serial_board::SerialBoard;
use adit_protocol::log::{FlightLog, PARAMETERS_FILE, encode_header};
use adit_protocol::mavlink::FrameDecoder;
use adit_protocol::record::Header;
use adit_protocol::tag::{CaptureState, CaptureTag, TagFlags};

/// Two turns of ten photos in a pipe of 3 m; range sensors with 2 cm of noise.
const MISSION: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/missions/two-turns.toml");
const SEED: u64 = 5;
/// Tags of image and library may differ by so much, counted from the first tag: two ticks of the controller.
const TAG_TIME_S: f64 = 0.010;
/// And their angles by what encoder, dead band and play leave open.
const TAG_ANGLE_RAD: f32 = 0.035;

fn image(name: &str) -> PathBuf {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../target/image").join(name);
    assert!(path.exists(), "no {}; build it with: cargo xtask flash --build-only", path.display());
    path
}

fn mission() -> MissionFile {
    MissionFile::read(Path::new(MISSION), Some(SEED)).expect("a mission")
}

/// The flight of the image, flown once for all tests.
struct Flown {
    flight: Flight,
    report: Report,
    log: Vec<u8>,
}

fn flown() -> &'static Flown {
    static FLOWN: OnceLock<Flown> = OnceLock::new();
    FLOWN.get_or_init(|| {
        let file = mission();
        let parameters = file.mission.parameters();
        let fram = provisioned_fram(&parameters).expect("parameters fit");
        let setup = Setup { fram, ..Setup::new(SEED).expect("a card") };
        let mut board = EmulatedBoard::new(&image("rotator.elf"), &parameters, setup).expect("a board");
        let mut flight = fly_board(&mut board, &file.mission, &file.simulation, SEED).expect("a flight");
        let report = board.finish().expect("a report");
        let log = log_of(&report).expect("a log");
        flight.entries = log.entries;
        Flown { flight, report, log: log.bytes }
    })
}

/// The newest value of each figure that the board sent to the pilot.
fn figure(report: &Report, name: &str) -> f32 {
    let mut decoder = FrameDecoder::default();
    let frames = report.sent[0].iter().filter_map(|byte| decoder.push(*byte));
    // NAMED_VALUE_FLOAT: time, value, name.
    let figures = frames.filter(|frame| frame.message == 251 && frame.bytes::<10>(8).starts_with(name.as_bytes()));
    figures.last().unwrap_or_else(|| panic!("no figure {name}")).f32(4)
}

#[test]
fn it_boots_passes_its_self_test_and_scans_two_turns_without_a_restart() {
    let Flown { flight, report, .. } = flown();
    assert_eq!(flight.outcome, Outcome::Completed);
    assert_eq!(report.restarts, []);
    assert_eq!(report.gaps, Vec::<String>::new(), "accesses that the emulator cannot answer");
    assert_eq!(report.ranger_misuse, adit_emulator::RangerMisuse::default());
}

#[test]
fn every_capture_is_confirmed_and_has_its_photo() {
    let Flown { flight, log, .. } = flown();
    let log = FlightLog::from_bytes(log);
    assert_eq!((log.damage.len(), log.conflicts.len(), log.sessions.len()), (0, 0, 1));
    let tags: Vec<_> = log.tags().collect();
    assert!(tags.len() >= 20, "{} tags", tags.len());
    assert_eq!((tags.len(), tags.len()), (flight.exposures.len(), flight.presses_s.len()));
    for (index, (tag, exposure)) in tags.iter().zip(&flight.exposures).enumerate() {
        assert_eq!((tag.capture, tag.state), (index as u32 + 1, CaptureState::Confirmed));
        let late_s = tag.time_us as f64 * 1e-6 - exposure.time_s;
        assert!(late_s.abs() < 0.05, "tag {} is {late_s} s beside its photo", tag.capture);
    }
}

#[test]
fn the_offset_errs_by_less_than_five_centimetres() {
    let Flown { flight, log, .. } = flown();
    let log = FlightLog::from_bytes(log);
    let mut squares = Vec::new();
    for tag in log.tags() {
        let [y_m, z_m] = tag.offset_m.expect("an offset in every tag");
        let time_s = tag.time_us as f64 * 1e-6;
        let moment =
            flight.moments.iter().min_by(|a, b| (a.time_s - time_s).abs().total_cmp(&(b.time_s - time_s).abs()));
        let truth_m = moment.expect("a flight").vehicle.position_m;
        squares.push((f64::from(y_m) - truth_m.y).powi(2) + (f64::from(z_m) - truth_m.z).powi(2));
    }
    let rms_m = (squares.iter().sum::<f64>() / squares.len() as f64).sqrt();
    println!("offset error {:.1} mm root mean square over {} tags", rms_m * 1000.0, squares.len());
    assert!(rms_m < 0.05, "{rms_m} m");
}

#[test]
fn it_keeps_its_budget_of_stack_and_of_time_for_a_step() {
    let Flown { report, .. } = flown();
    let text = std::fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("../../firmware/budget.toml"));
    let budget: toml::Table = text.expect("the budget").parse().expect("a table");
    let most = |key: &str| budget[key].as_integer().expect("a number") as f32;
    let (stack_bytes, step_us) = (figure(report, "stack_b"), figure(report, "step_us"));
    println!("stack {stack_bytes} bytes, longest step {step_us} us with the interrupts that came in between");
    assert!(stack_bytes > 0.0 && stack_bytes <= most("stack_bytes"), "{stack_bytes} bytes of stack");
    assert!(most("stack_bytes") + most("static_ram_bytes") <= 96.0 * 1024.0);
    // 0.3 ms of its own, and as much again for interrupts of drivers.
    assert!(step_us > 0.0 && step_us < 600.0, "a step of {step_us} us");
}

#[test]
fn image_and_library_give_the_same_captures() {
    let file = mission();
    let library = fly(&file.mission, &file.simulation, SEED).expect("a flight");
    let library = FlightLog::from_bytes(&log_bytes(&library).expect("a log"));
    let image = FlightLog::from_bytes(&flown().log);
    let (library, image): (Vec<_>, Vec<_>) = (library.tags().collect(), image.tags().collect());
    // The vehicle is at another place when the image has booted: where the scan ends may differ by a photo or two.
    assert!(library.len().abs_diff(image.len()) <= 2, "{} and {} tags", library.len(), image.len());
    for (ours, theirs) in image.iter().zip(&library) {
        // Whether a gust pushes the vehicle over its limit depends on the moment, and the image starts later.
        let flags = |tag: &CaptureTag| tag.flags.0 & !TagFlags::OVERSPEED.0;
        assert_eq!((ours.capture, ours.state, flags(ours)), (theirs.capture, theirs.state, flags(theirs)));
        let since_first_s = |tag: &CaptureTag, first: u64| (tag.time_us - first) as f64 * 1e-6;
        let apart_s = since_first_s(ours, image[0].time_us) - since_first_s(theirs, library[0].time_us);
        assert!(apart_s.abs() <= TAG_TIME_S, "capture {}: {apart_s} s apart", ours.capture);
        let apart_rad = ours.shaft_rad - theirs.shaft_rad;
        assert!(apart_rad.abs() <= TAG_ANGLE_RAD, "capture {}: {apart_rad} rad apart", ours.capture);
    }
}

#[test]
fn the_ground_pairs_the_card_one_to_one() {
    let Flown { flight, log, .. } = flown();
    let file = mission();
    let folder = tempfile::tempdir().expect("a folder");
    let out = folder.path().join("flight");
    let report = file.check(flight, log).expect("a check");
    assert_eq!(report.violations, []);
    file.leave(&out, &Left { program: "test", flight, log, report: &report, photos: true }).expect("a card");
    let paired = ingest(&IngestOptions {
        logs: vec![out.join("board.log")],
        photos: out.join("DCIM"),
        mission: PathBuf::from(MISSION),
        out: folder.path().join("survey"),
    })
    .expect("a survey");
    assert_eq!(
        (paired.pairs.len(), paired.photos, paired.unmatched_captures.len()),
        (flight.exposures.len(), flight.exposures.len(), 0)
    );
}

#[test]
fn hardware_in_the_loop_flies_bit_for_bit_as_the_library_does() {
    let file = mission();
    let parameters = file.mission.parameters();
    let folder = tempfile::tempdir().expect("a folder");
    let port = folder.path().join("telem2");
    let mut board =
        EmulatedBoard::new(&image("rotator-hil.elf"), &parameters, Setup::new(SEED).expect("a card")).expect("a board");
    let (ready, is_ready) = std::sync::mpsc::channel();
    let over = Arc::new(AtomicBool::new(false));
    let is_over = Arc::clone(&over);
    let ports = Ports { telem2: Some(port.clone()), ..Ports::default() };
    let served = std::thread::spawn(move || {
        let around = |_, _: &_| {
            // Nobody waits any more after the first time.
            let _ = ready.send(());
            (!is_over.load(Ordering::Relaxed)).then(Inputs::default)
        };
        serve(&mut board, &ports, around).expect("served");
        board.finish().expect("a report")
    });
    is_ready.recv().expect("ready");
    let mut serial = SerialBoard::open(&port.to_string_lossy(), &parameters).expect("the board answers");
    let flight = fly_board(&mut serial, &file.mission, &file.simulation, SEED).expect("a flight");
    over.store(true, Ordering::Relaxed);
    let library = fly(&file.mission, &file.simulation, SEED).expect("a flight");
    assert_eq!(log_bytes(&flight).expect("a log"), log_bytes(&library).expect("a log"));
    let report = served.join().expect("the board's thread");
    assert_eq!((report.restarts.len(), report.gaps.len()), (0, 0));
}

#[test]
fn parameters_on_the_card_are_taken_over_once() {
    let parameters = mission().mission.parameters();
    let mut setup = Setup::new(SEED).expect("a card");
    let header = Header::new(&parameters, "adit").and_then(|header| encode_header(&header)).expect("a header");
    setup.card.put_file(PARAMETERS_FILE, &header).expect("room on the card");
    let mut board = EmulatedBoard::new(&image("rotator.elf"), &parameters, setup).expect("a board");
    for step in 0..800 {
        board.step(step * 5_000, &Inputs::default()).expect("a step");
    }
    let report = board.finish().expect("a report");
    assert_eq!(parameters_in(&report.fram).expect("the FRAM").as_ref(), Some(&parameters));
    let causes: Vec<RestartCause> = report.restarts.iter().map(|restart| restart.cause).collect();
    assert_eq!(causes, [RestartCause::Firmware], "one restart, then they are in force");
    let log = FlightLog::from_bytes(&log_of(&report).expect("a log").bytes);
    let last = log.sessions.last().expect("a session");
    assert_eq!(last.header.as_ref().map(|header| &header.parameters), Some(&parameters));
    assert_eq!(last.messages[0].text.as_str(), "new parameters from the card");
}
