//! Independent programs that tests hold ours against: implementations of MAVLink and readers of what `adit export` writes from
//! PyPI, in a virtual environment of their own, and Khronos' glTF validator from npm.

use anyhow::{Context, Result};

use crate::shell::{output, run, top};

/// Where they go.
const FOLDER: &str = "target/peers";
/// What is installed with what it needs.
const REQUIREMENTS: [&str; 2] =
    ["hil-sim/emulator/tests/peers/requirements.txt", "ground/tests/peers/requirements.txt"];
/// It needs a window system's libraries for what nobody uses here, so it comes without what it needs.
const MAVPROXY: &str = "MAVProxy==1.8.75";
/// Where npm's go.
const NODE_FOLDER: &str = "target/peers/node";
/// The reference for glTF files; kept by the Khronos group.
const GLTF_VALIDATOR: &str = "gltf-validator@2.0.0-dev.3.10";

/// Installs the peers if they are missing or others are wanted.
///
/// Without Python or Node, or without a way to PyPI or npm, there are none: the tests that need them skip themselves and say so.
pub(crate) fn install() -> Result<()> {
    let mut wanted = String::new();
    for file in REQUIREMENTS {
        wanted += &std::fs::read_to_string(top().join(file)).with_context(|| format!("cannot read {file}"))?;
    }
    let python = Peers {
        names: "pymavlink, MAVSDK, MAVProxy and readers of exported files from PyPI",
        note: "target/peers/installed.txt",
        wanted: format!("{wanted}{MAVPROXY}\n"),
    };
    python.install("python3 with venv", &["python3", "-c", "import venv, ensurepip"], fetch_python)?;
    let node = Peers {
        names: "gltf-validator from npm",
        note: "target/peers/node/installed.txt",
        wanted: format!("{GLTF_VALIDATOR}\n"),
    };
    node.install("npm", &["npm", "--version"], fetch_node)
}

/// What one package manager installs.
struct Peers {
    names: &'static str,
    /// File that says what is installed.
    note: &'static str,
    wanted: String,
}

impl Peers {
    fn install(&self, manager: &str, probe: &[&str], fetch: fn() -> Result<()>) -> Result<()> {
        let note = top().join(self.note);
        if std::fs::read_to_string(&note).is_ok_and(|installed| installed == self.wanted) {
            return Ok(());
        }
        if output(probe[0], &probe[1..]).is_none() {
            eprintln!("xtask: no {manager} here: the tests against {} will skip themselves", self.names);
            return Ok(());
        }
        eprintln!("xtask: installing {} to {FOLDER}", self.names);
        if let Err(error) = fetch() {
            eprintln!("xtask: {error:#}: the tests against {} will skip themselves", self.names);
            return Ok(());
        }
        std::fs::write(&note, &self.wanted).with_context(|| format!("cannot write {}", note.display()))
    }
}

fn fetch_python() -> Result<()> {
    run("python3", &["-m", "venv", "--clear", FOLDER])?;
    let pip = format!("{FOLDER}/bin/pip");
    let install = ["install", "--quiet", "--disable-pip-version-check"];
    for file in REQUIREMENTS {
        run(&pip, &[&install[..], &["--requirement", file]].concat())?;
    }
    run(&pip, &[&install[..], &["--no-deps", MAVPROXY]].concat())
}

fn fetch_node() -> Result<()> {
    run(
        "npm",
        &["install", "--silent", "--no-save", "--no-audit", "--no-fund", "--prefix", NODE_FOLDER, GLTF_VALIDATOR],
    )
}
