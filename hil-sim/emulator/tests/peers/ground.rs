//! Our own ground station against the flash image, through the terminal of its service port.

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use adit_ground::link::{CommandOutcome, Config, Session};
use adit_protocol::log::FlightLog;
use adit_protocol::mavlink::Value;
use adit_protocol::parameters::ParameterTable;

use serde_json::Value as Json;
use tempfile::TempDir;

use crate::{MISSION, Served};

#[test]
fn our_ground_sets_parameters_restarts_the_board_and_fetches_its_logs() {
    let board = Served::start();
    let connection = format!("serial:{}:921600", board.port("telem2")).parse().expect("a connection");
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().expect("a runtime");
    let folder = tempfile::tempdir().expect("a folder");
    runtime.block_on(async {
        let session = Session::open(&connection, Config::default()).await.expect("a session");
        let found = session.board().await.expect("a board");
        let parameters = session.parameters(&found, &mut |_, _| {}).await.expect("parameters");
        assert_eq!(parameters.len(), ParameterTable::rows().len());
        session.set_parameter(&found, "RIG_IMAGES", Value::Whole(10)).await.expect("a change");
        assert_eq!(session.restart(&found).await.expect("an answer"), CommandOutcome::Accepted);
        let kept = session.parameter(&found, "RIG_IMAGES").await.expect("a parameter");
        assert_eq!(kept.value.real(), 10.0, "kept over the restart");
        let logs = session.logs(&found).await.expect("logs");
        assert_eq!(logs.len(), 2, "one for each start");
        // The second is being written: a record may grow between two reads of the fetch.
        for (log, (images_per_turn, most_damage)) in logs.into_iter().zip([(12, 0), (10, 1)]) {
            let file = session.fetch_log(&found, log, folder.path(), &mut |_| {}).await.expect("a log");
            let fetched = FlightLog::from_bytes(&std::fs::read(file).expect("a file"));
            assert_eq!(fetched.sessions.len(), 1);
            assert!(fetched.damage.len() <= most_damage, "{:?}", fetched.damage);
            let header = fetched.sessions[0].header.as_ref().expect("a header");
            assert_eq!(header.parameters.rig.images_per_turn, images_per_turn);
        }
        session.close().await.expect("an end");
    });
}

/// Runs `adit`, which `cargo build` and `cargo test` in the workspace's root leave beside these tests.
fn adit(arguments: &[&str]) -> Output {
    let test = std::env::current_exe().expect("tests run from a file");
    let adit = test.ancestors().nth(2).expect("target/<profile>/deps/<test>").join("adit");
    assert!(adit.is_file(), "{} is not built; run `cargo build` first", adit.display());
    Command::new(adit).args(arguments).output().expect("the program starts")
}

/// Runs `adit` with `--json`: its exit code and its figures.
fn figures(arguments: &[&str]) -> (Option<i32>, Json) {
    let output = adit(&[arguments, &["--json"]].concat());
    let figures = serde_json::from_slice(&output.stdout);
    let figures = figures.unwrap_or_else(|_| panic!("{arguments:?}: {}", String::from_utf8_lossy(&output.stderr)));
    (output.status.code(), figures)
}

/// The mission with a change, as a file.
fn changed(folder: &TempDir, name: &str, change: impl Fn(String) -> String) -> PathBuf {
    let file = folder.path().join(name);
    let text = std::fs::read_to_string(MISSION).expect("the mission");
    std::fs::write(&file, change(text)).expect("the mission is written");
    file
}

fn text(path: &Path) -> &str {
    path.to_str().expect("a path of ours is UTF-8")
}

/// Subjects of a preflight's list that have this verdict, but for the clock: while one talks to the emulated board its time runs
/// ahead of the wall's, and preflight may or may not see it (the clock is judged in the system tests).
fn judged<'a>(list: &'a Json, verdict: &str) -> Vec<&'a str> {
    let checks = list["checks"].as_array().expect("checks").iter();
    let subjects = checks.filter(|check| check["verdict"] == verdict).filter_map(|check| check["subject"].as_str());
    subjects.filter(|subject| *subject != "clock").collect()
}

#[test]
fn a_plan_is_loaded_into_the_image_in_which_preflight_then_finds_no_fault() {
    let folder = tempfile::tempdir().expect("a folder");
    let before = changed(&folder, "before.toml", |text| text.replace("speed_margin = 0.95", "speed_margin = 0.7"));
    let plan = folder.path().join("plan");
    assert!(adit(&["plan", MISSION, "--out", text(&plan)]).status.success());
    let board = Served::with(&["--mission", text(&before), "--hover"]);
    let line = format!("serial:{}:921600", board.port("telem2"));
    let (code, loaded) = figures(&["board", "load", &line, text(&plan), "--restart"]);
    let hash = loaded["hash"].as_str().expect("a hash");
    let told = [&loaded["read_back_hash"], &loaded["in_force"]["hash"]];
    assert_eq!((code, told), (Some(0), [&Json::from(hash); 2]), "{loaded:#}");
    let (_, list) = figures(&["preflight", &line, "--mission", MISSION]);
    assert_eq!(judged(&list, "no"), [""; 0], "{list:#}");
    let good =
        ["link", "firmware", "board", "parameters", "card", "sensors", "self-test", "camera", "enforcement", "restart"];
    assert_eq!(judged(&list, "yes"), good, "{list:#}");
    // The cable does not carry what the autopilot says.
    assert_eq!(judged(&list, "unknown"), ["autopilot", "camera-supplies"], "{list:#}");
}

#[test]
fn an_image_with_a_dead_sensor_is_not_ready_and_says_which() {
    let folder = tempfile::tempdir().expect("a folder");
    let dead = changed(&folder, "dead.toml", |text| {
        text + "\n[[simulation.faults]]\nkind = \"range-dead\"\nbeam = \"left\"\nat_s = 0.0\n"
    });
    let board = Served::with(&["--mission", text(&dead), "--hover"]);
    let line = format!("serial:{}:921600", board.port("telem2"));
    let (code, list) = figures(&["preflight", &line, "--mission", text(&dead), "--still"]);
    assert_eq!((code, judged(&list, "no")), (Some(1), vec!["sensors"]), "{list:#}");
    let checks = list["checks"].as_array().expect("checks");
    let sensors = checks.iter().find(|check| check["subject"] == "sensors").expect("sensors");
    assert!(sensors["words"].as_str().is_some_and(|words| words.contains("no reading left")), "{sensors}");
}
