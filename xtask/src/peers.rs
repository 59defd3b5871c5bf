//! Independent implementations of MAVLink from PyPI, which the tests of the link talk to, in a virtual environment of their own.

use anyhow::{Context, Result};

use crate::shell::{output, run, top};

/// Where they go.
const FOLDER: &str = "target/peers";
/// What is installed with what it needs.
const REQUIREMENTS: &str = "hil-sim/emulator/tests/peers/requirements.txt";
/// It needs a window system's libraries for what nobody uses here, so it comes without what it needs.
const MAVPROXY: &str = "MAVProxy==1.8.75";

/// Installs the peers if they are missing or others are wanted.
///
/// Without Python, or without a way to PyPI, there are none: the tests that need them skip themselves and say so.
pub(crate) fn install() -> Result<()> {
    let wanted =
        std::fs::read_to_string(top().join(REQUIREMENTS)).with_context(|| format!("cannot read {REQUIREMENTS}"))?;
    let wanted = format!("{wanted}{MAVPROXY}\n");
    let note = top().join(FOLDER).join("installed.txt");
    if std::fs::read_to_string(&note).is_ok_and(|installed| installed == wanted) {
        return Ok(());
    }
    if output("python3", &["-c", "import venv, ensurepip"]).is_none() {
        eprintln!(
            "xtask: no python3 with venv here: the tests against pymavlink, MAVSDK and MAVProxy will skip themselves"
        );
        return Ok(());
    }
    eprintln!("xtask: installing pymavlink, MAVSDK and MAVProxy from PyPI to {FOLDER}");
    if let Err(error) = fetch() {
        eprintln!("xtask: {error:#}: the tests against pymavlink, MAVSDK and MAVProxy will skip themselves");
        return Ok(());
    }
    std::fs::write(&note, wanted).with_context(|| format!("cannot write {}", note.display()))
}

fn fetch() -> Result<()> {
    run("python3", &["-m", "venv", "--clear", FOLDER])?;
    let pip = format!("{FOLDER}/bin/pip");
    let install = ["install", "--quiet", "--disable-pip-version-check"];
    run(&pip, &[&install[..], &["--requirement", REQUIREMENTS]].concat())?;
    run(&pip, &[&install[..], &["--no-deps", MAVPROXY]].concat())
}
