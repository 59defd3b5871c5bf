//! The peer: `pycolmap` from `PyPI` in a virtual environment of its own, and what tells one program from the next.

use std::fs;
use std::path::Path;
use std::process::Command;

use anyhow::{Context, Result, bail};
use crc::{CRC_64_XZ, Crc};

use super::outcome::Who;
use super::program;
use crate::shell::{output, run, top};

/// Where it goes.
const FOLDER: &str = "target/peers-colmap";
/// Scripts that run it.
const SCRIPTS: &str = "xtask/peers";

/// Installs the peer if it is missing or another is wanted.
pub(super) fn install() -> Result<()> {
    let requirements = format!("{SCRIPTS}/requirements.txt");
    let wanted = read(&requirements)?;
    let note = top().join(FOLDER).join("installed.txt");
    if fs::read_to_string(&note).is_ok_and(|installed| installed == wanted) {
        return Ok(());
    }
    if output("python3", &["-c", "import venv, ensurepip"]).is_none() {
        bail!("no python3 with venv here: it runs the peer and measures both sides; install it and try again");
    }
    run("python3", &["-m", "venv", "--clear", FOLDER])?;
    let pip = format!("{FOLDER}/bin/pip");
    run(&pip, &["install", "--quiet", "--disable-pip-version-check", "--requirement", &requirements])?;
    fs::write(&note, wanted).with_context(|| format!("cannot write {}", note.display()))
}

/// The environment's interpreter.
pub(super) fn python() -> String {
    top().join(FOLDER).join("bin/python").to_string_lossy().into_owned()
}

/// A script beside this program.
pub(super) fn script(name: &str) -> String {
    top().join(SCRIPTS).join(name).to_string_lossy().into_owned()
}

/// What changes when a side's program does: the digest of the binary, or of the requirements and the script.
pub(super) fn version_of(who: Who) -> Result<String> {
    let bytes = match who {
        Who::Ours => fs::read(program("adit")).context("cannot read target/release/adit")?,
        Who::Peer => {
            (read(&format!("{SCRIPTS}/requirements.txt"))? + &read(&format!("{SCRIPTS}/colmap.py"))?).into_bytes()
        }
    };
    Ok(format!("{:016x}", Crc::<u64>::new(&CRC_64_XZ).checksum(&bytes)))
}

/// Wall time and largest resident set of a command that ran.
pub(super) struct Measured {
    pub(super) seconds: f64,
    pub(super) peak_mib: f64,
    pub(super) stdout: String,
}

/// Runs a command to its end and measures it, either side in the same way.
///
/// Exit code 1 is an answer of `adit` (nothing registered), not a failure.
pub(super) fn measure(command: &[&str], figures: &Path) -> Result<Measured> {
    eprintln!("xtask: {}", command.join(" "));
    let output = Command::new(python())
        .arg(script("measure.py"))
        .arg(figures)
        .args(command)
        .current_dir(top())
        .stderr(std::process::Stdio::inherit())
        .output()
        .context("cannot run measure.py")?;
    let text = fs::read_to_string(figures).with_context(|| format!("cannot read {}", figures.display()))?;
    let value: serde_json::Value = serde_json::from_str(&text).context("measure.py")?;
    if !matches!(value["status"].as_i64(), Some(0 | 1)) {
        bail!("{} ended with {}", command.join(" "), value["status"]);
    }
    let number = |key: &str| value[key].as_f64().with_context(|| format!("measure.py says nothing of {key}"));
    Ok(Measured {
        seconds: number("seconds")?,
        peak_mib: number("peak_mib")?,
        stdout: String::from_utf8_lossy(&output.stdout).into_owned(),
    })
}

fn read(path: &str) -> Result<String> {
    fs::read_to_string(top().join(path)).with_context(|| format!("cannot read {path}"))
}
