//! What we write, read by pymavlink, which Mission Planner's and MAVProxy's records and files go by.

use std::path::{Path, PathBuf};
use std::process::Command;

use adit_protocol::mavlink::Value;

use super::*;

/// A Python with pymavlink: the one that `cargo xtask` installs, or that of this variable.
const PYTHON_VARIABLE: &str = "ADIT_PEERS_PYTHON";

fn python() -> Option<PathBuf> {
    let installed = Path::new(env!("CARGO_MANIFEST_DIR")).join("../target/peers/bin/python");
    std::env::var_os(PYTHON_VARIABLE).map(PathBuf::from).or(Some(installed)).filter(|path| path.exists())
}

#[tokio::test]
async fn pymavlink_reads_records_and_parameter_files() {
    let Some(python) = python() else {
        eprintln!("skipped: pymavlink_reads_records_and_parameter_files needs target/peers or {PYTHON_VARIABLE}");
        return;
    };
    let folder = tempfile::tempdir().unwrap();
    let (record, file) = (folder.path().join("flight.tlog"), folder.path().join("board.param"));
    let key = KeyFile::create(&folder.path().join("board.key")).unwrap();
    let script = Script { key: Some(key.key), ..Script::default() };
    let config = Config { key: Some(key), record: Some(record.clone()), ..config() };
    let (session, _board) = over_tcp(script, config).await;
    let board = session.board().await.unwrap();
    session.set_parameter(&board, "SPD_MARGIN", Value::Real(0.7)).await.unwrap();
    let list = session.parameters(&board, &mut |_, _| ()).await.unwrap();
    ParameterFile::write(&file, "a test", &list).unwrap();
    session.close().await.unwrap();

    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("src/link/tests/peers.py");
    let output = Command::new(python).arg(script).arg(&record).arg(&file).output().unwrap();
    let text = String::from_utf8(output.stdout).unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    for line in [
        "1/1 HEARTBEAT",
        "1/191 AUTOPILOT_VERSION",
        "1/191 PARAM_VALUE",
        "255/190 HEARTBEAT",
        "255/190 PARAM_REQUEST_LIST",
        "255/190 PARAM_SET",
        "SPD_MARGIN 0.7",
        "RIG_IMAGES 12",
    ] {
        assert!(text.lines().any(|found| found == line), "no {line:?} in:\n{text}");
    }
    assert!(!text.contains("bad data") && !text.contains("time runs back"), "{text}");
    assert_eq!(text.lines().filter(|line| !line.contains('/')).count(), list.len(), "{text}");
}
