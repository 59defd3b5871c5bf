//! Running `adit` and `adit-sim` as built beside these tests.

use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::sync::LazyLock;

use serde_json::Value;
use tempfile::TempDir;

/// A small pipe with a small camera: a few seconds for the whole way.
const MISSION: &str = include_str!("small.toml");

/// A program of the workspace; `cargo test --workspace` builds it beside the tests.
pub(crate) fn program(name: &str) -> PathBuf {
    let test = std::env::current_exe().expect("tests run from a file");
    let folder = test.ancestors().nth(2).expect("target/<profile>/deps/<test>");
    let path = folder.join(format!("{name}{}", std::env::consts::EXE_SUFFIX));
    assert!(path.is_file(), "{} is not built; run `cargo build --workspace` first", path.display());
    path
}

/// Runs a program and returns what it said.
pub(crate) fn run(name: &str, arguments: &[&str]) -> Output {
    Command::new(program(name)).args(arguments).output().expect("the program starts")
}

/// Runs a program with `--json`, expects exit code 0 and returns the figures.
pub(crate) fn figures(name: &str, arguments: &[&str]) -> Value {
    let output = run(name, &[arguments, &["--json"]].concat());
    assert!(output.status.success(), "{name} {arguments:?}: {}\n{}", output.status, errors(&output));
    serde_json::from_slice(&output.stdout).expect("figures are JSON")
}

/// What a program said on standard error.
pub(crate) fn errors(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

/// A path as an argument.
pub(crate) fn text(path: &Path) -> &str {
    path.to_str().expect("a path of ours is UTF-8")
}

/// One simulated flight, ingested; made once for all tests, which copy what they change.
pub(crate) struct Flown {
    folder: TempDir,
}

impl Flown {
    fn new() -> Self {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let mission = folder.path().join("mission.toml");
        std::fs::write(&mission, MISSION).expect("the mission is written");
        let flown = Self { folder };
        let flight = flown.flight();
        figures("adit-sim", &["fly", text(&mission), "--out", text(&flight), "--seed", "5"]);
        let survey = flown.survey();
        figures(
            "adit",
            &[
                "ingest",
                "--log",
                text(&flight.join("board.log")),
                "--photos",
                text(&flight.join("DCIM")),
                "--mission",
                text(&mission),
                "--out",
                text(&survey),
            ],
        );
        copy(&flight.join("truth"), &survey.join("truth"));
        flown
    }

    /// What the simulator left.
    pub(crate) fn flight(&self) -> PathBuf {
        self.folder.path().join("flight")
    }

    /// What `ingest` made of it, with the truth beside it.
    pub(crate) fn survey(&self) -> PathBuf {
        self.folder.path().join("survey")
    }

    /// A copy of the survey that a test may spoil.
    pub(crate) fn copy(&self) -> TempDir {
        let folder = tempfile::tempdir().expect("a temporary folder");
        copy(&self.survey(), folder.path());
        folder
    }
}

/// The flight that all tests share.
pub(crate) static FLOWN: LazyLock<Flown> = LazyLock::new(Flown::new);

/// Copies a folder with everything in it.
pub(crate) fn copy(from: &Path, to: &Path) {
    std::fs::create_dir_all(to).expect("the folder is made");
    for entry in std::fs::read_dir(from).expect("the folder is read") {
        let entry = entry.expect("the entry is read");
        let target = to.join(entry.file_name());
        if entry.path().is_dir() {
            copy(&entry.path(), &target);
        } else {
            std::fs::copy(entry.path(), target).expect("the file is copied");
        }
    }
}
