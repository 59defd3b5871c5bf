//! `adit preflight` and `adit board load` against a vehicle on the bench, one fault at a time.

use std::path::PathBuf;

use adit_hil_sim::autopilot::Kind;
use adit_hil_sim::faults::{BeamName, FaultKind};
use adit_hil_sim::sensors::range::RangeDefect;
use adit_protocol::mission::Mission;
use adit_protocol::parameters::{CaptureWiring, Parameters};
use serde_json::Value;
use tempfile::TempDir;

use super::bench::{Bench, Setup};
use super::programs::{errors, run, text};

const MISSION: &str = include_str!("../../../hil-sim/missions/demo.toml");

/// The mission, parsed and as a file.
fn mission() -> (Mission, TempDir, PathBuf) {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let file = folder.path().join("mission.toml");
    std::fs::write(&file, MISSION).expect("the mission is written");
    (Mission::from_toml(MISSION).expect("a mission"), folder, file)
}

/// What the list says of a subject: the verdict and its words.
fn found<'a>(list: &'a Value, subject: &str) -> (&'a str, &'a str) {
    let checks = list["checks"].as_array().expect("checks");
    let check = checks.iter().find(|check| check["subject"] == subject);
    let check = check.unwrap_or_else(|| panic!("no {subject} in {list:#}"));
    (check["verdict"].as_str().expect("a verdict"), check["words"].as_str().expect("words"))
}

/// Subjects with a no.
fn refused(list: &Value) -> Vec<&str> {
    let checks = list["checks"].as_array().expect("checks").iter();
    checks.filter(|check| check["verdict"] == "no").filter_map(|check| check["subject"].as_str()).collect()
}

/// A fault, and what must be said of it: the subjects with a no, and words in the first.
struct Case {
    name: &'static str,
    change: fn(&mut Setup),
    refused: &'static [&'static str],
    words: &'static str,
    arguments: &'static [&'static str],
}

const fn case(
    name: &'static str,
    change: fn(&mut Setup),
    refused: &'static [&'static str],
    words: &'static str,
) -> Case {
    Case { name, change, refused, words, arguments: &[] }
}

fn left_dead(setup: &mut Setup) {
    setup.faults = vec![FaultKind::Range { beam: BeamName::Left, defect: RangeDefect::Dead }];
}

/// On the axis the limit is within millimetres per second of the 0.1 m/s that this autopilot can be held to; here it is 0.08.
fn old_off_the_axis(setup: &mut Setup) {
    (setup.autopilot, setup.hold_m) = (Kind::ArduPilot46, [0.3, 0.0]);
}

const AFTER_SELF_TEST: [&str; 3] = ["self-test", "camera", "enforcement"];
const CASES: [Case; 14] = [
    case("healthy", |_| (), &[], ""),
    case("healthy PX4", |setup| (setup.autopilot, setup.mode) = (Kind::Px4, "POSITION"), &[], ""),
    case("sensor unplugged", left_dead, &["sensors"], "no reading left"),
    case("camera dead", |setup| setup.faults = vec![FaultKind::CameraDeaf], &["camera"], "test photos missed"),
    case("no card", |setup| setup.has_card = false, &["card", "self-test", "camera", "enforcement"], "no card in it"),
    case("no clock", |setup| setup.tells_time = false, &["clock"], "does not answer"),
    case("crystal dead", |setup| setup.clock_rate = 0.985, &["clock"], "crystal"),
    case(
        "wrong parameters",
        |setup| setup.parameters.speed.margin = 0.7,
        &["parameters"],
        "SPD_MARGIN is 0.7, wanted 0.95",
    ),
    case("old ArduPilot", old_off_the_axis, &["autopilot", "enforcement"], "before 4.7"),
    case("wrong mode", |setup| setup.mode = "ALT_HOLD", &["enforcement"], "ALT_HOLD takes no limit"),
    case(
        "shaft jammed",
        |setup| setup.faults = vec![FaultKind::ServoStall],
        &AFTER_SELF_TEST,
        "does not reach its angles",
    ),
    case(
        "encoder silent",
        |setup| setup.faults = vec![FaultKind::EncoderSilent],
        &AFTER_SELF_TEST,
        "encoder is silent",
    ),
    case(
        "no estimate",
        |setup| setup.faults = vec![FaultKind::NavigationSilent],
        &["enforcement"],
        "speed is not known",
    ),
    case("armed", |setup| setup.armed = true, &AFTER_SELF_TEST, "the vehicle is armed"),
];

/// Runs the program against a bench; returns what does not fit the case.
fn tried(case: &Case, mission: &Mission, file: &str) -> Option<String> {
    let mut setup = Setup::good(mission);
    (case.change)(&mut setup);
    let bench = Bench::start(setup);
    let arguments = ["preflight", bench.connection(), "--mission", file, "--json"];
    let output = run("adit", &[&arguments[..], case.arguments].concat());
    let Ok(list) = serde_json::from_slice::<Value>(&output.stdout) else {
        return Some(format!("{}: {}", case.name, errors(&output)));
    };
    let expected = i32::from(!case.refused.is_empty());
    let as_expected = output.status.code() == Some(expected)
        && refused(&list) == case.refused
        && case.refused.first().is_none_or(|subject| found(&list, subject).1.contains(case.words));
    (!as_expected).then(|| format!("{}: {} {list:#}", case.name, output.status))
}

#[test]
fn a_healthy_vehicle_is_ready_and_each_fault_is_a_no_with_its_reason() {
    let (mission, _folder, file) = mission();
    // They wait for most of their time.
    let troubles: Vec<String> = std::thread::scope(|scope| {
        let tries: Vec<_> = CASES.iter().map(|case| scope.spawn(|| tried(case, &mission, text(&file)))).collect();
        tries.into_iter().filter_map(|tried| tried.join().expect("a try")).collect()
    });
    assert!(troubles.is_empty(), "{}", troubles.join("\n"));
}

#[test]
fn what_cannot_be_known_is_no_yes_and_no_no() {
    let (mission, _folder, file) = mission();
    let mut setup = Setup::good(&mission);
    setup.mission.board.shutter.wiring = CaptureWiring::None;
    setup.parameters = setup.mission.parameters();
    let bench = Bench::start(setup);
    let still = run("adit", &["preflight", bench.connection(), "--still", "--json"]);
    let list: Value = serde_json::from_slice(&still.stdout).expect("figures");
    assert_eq!(still.status.code(), Some(0), "{list:#}");
    for subject in ["parameters", "self-test", "camera", "enforcement", "camera-supplies"] {
        assert_eq!(found(&list, subject).0, "unknown", "{list:#}");
    }
    let moved = run("adit", &["preflight", bench.connection(), "--mission", text(&file), "--json"]);
    let list: Value = serde_json::from_slice(&moved.stdout).expect("figures");
    assert_eq!(refused(&list), ["parameters"], "the mission has another wiring: {list:#}");
    let (verdict, words) = found(&list, "camera");
    assert!(verdict == "unknown" && words.contains("look whether"), "{list:#}");
}

#[test]
fn a_silent_line_is_a_no_and_a_port_that_is_not_there_an_error() {
    let port = std::net::UdpSocket::bind("127.0.0.1:0").and_then(|probe| probe.local_addr()).expect("a port").port();
    let silent = run("adit", &["preflight", &format!("udpin:127.0.0.1:{port}"), "--timeout", "1", "--json"]);
    let list: Value = serde_json::from_slice(&silent.stdout).expect("figures");
    assert_eq!((silent.status.code(), refused(&list)), (Some(1), vec!["link"]), "{list:#}");
    let absent = run("adit", &["preflight", "serial:/dev/no-such-port:57600"]);
    assert_eq!(absent.status.code(), Some(2));
    assert!(errors(&absent).contains("/dev/no-such-port"), "{}", errors(&absent));
}

#[test]
fn a_plan_is_loaded_read_back_and_in_force_after_the_restart() {
    let (mission, folder, file) = mission();
    let plan = folder.path().join("plan");
    let planned = run("adit", &["plan", text(&file), "--out", text(&plan)]);
    assert!(planned.status.success(), "{}", errors(&planned));
    let bench = Bench::start(Setup { parameters: Parameters::default(), ..Setup::good(&mission) });
    let load = |more: &[&str]| {
        let arguments = ["board", "load", bench.connection(), text(&plan), "--json"];
        let output = run("adit", &[&arguments[..], more].concat());
        let loaded: Value = serde_json::from_slice(&output.stdout).unwrap_or_else(|_| panic!("{}", errors(&output)));
        assert_eq!(output.status.code(), Some(0), "{loaded:#}");
        loaded
    };
    let count = |loaded: &Value, outcome: &str| {
        let changes = loaded["changes"].as_array().expect("changes").iter();
        changes.filter(|change| change["outcome"] == outcome).count()
    };
    let dry = load(&["--dry-run"]);
    assert!(count(&dry, "would-set") > 10 && dry["read_back_hash"].is_null(), "{dry:#}");
    let loaded = load(&["--restart"]);
    assert_eq!(count(&loaded, "set"), count(&dry, "would-set"));
    let hash = loaded["hash"].as_str().expect("a hash");
    assert_eq!([&loaded["read_back_hash"], &loaded["in_force"]["hash"]], [hash; 2], "{loaded:#}");
    let page = std::fs::read_to_string(plan.join("plan.html")).expect("the plan's page");
    assert!(page.contains(hash), "the page has another hash than {hash}");
    let again = load(&[]);
    assert_eq!((count(&again, "set"), again["hash"].as_str()), (0, Some(hash)));
    let ready = run("adit", &["preflight", bench.connection(), "--mission", text(&file), "--json"]);
    let list: Value = serde_json::from_slice(&ready.stdout).expect("figures");
    assert!(found(&list, "parameters").1.contains(hash), "{list:#}");
}

#[test]
fn what_is_no_plan_is_told_by_its_file() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let empty = run("adit", &["board", "load", "udpin:127.0.0.1:0", text(folder.path())]);
    assert_eq!(empty.status.code(), Some(2));
    assert!(errors(&empty).contains("PARAMS.ADT") && errors(&empty).contains("adit plan"), "{}", errors(&empty));
    let file = folder.path().join("PARAMS.ADT");
    std::fs::write(&file, "no parameters").expect("written");
    let wrong = run("adit", &["board", "load", "udpin:127.0.0.1:0", text(&file)]);
    assert!(wrong.status.code() == Some(2) && errors(&wrong).contains("no parameters in it"), "{}", errors(&wrong));
}
