//! The pages of viewer and live view: built from `ground/viewer/`, and tested in a browser.

use anyhow::{Context, Result, ensure};

use crate::shell::{output, run, top};

/// Sources, packages and the built page.
const FOLDER: &str = "ground/viewer";
/// What the build makes.
const BUILT: [&str; 6] = ["index.html", "viewer.css", "viewer.js", "live.html", "live.css", "live.js"];
/// Programs that drive a page as the tests need it.
const BROWSERS: [&str; 3] = ["chromium", "chromium-browser", "google-chrome"];

/// `cargo xtask viewer`.
pub(crate) fn viewer(check: bool) -> Result<()> {
    ensure!(has_npm(), "no npm here: install Node.js 20 or newer");
    packages()?;
    if check { check_built() } else { build() }
}

/// Compares the committed page with a fresh one and drives it in a headless browser.
///
/// Without Node.js, npm's registry or a browser that can be installed, these tests are left out and that is said.
pub(crate) fn test() -> Result<()> {
    if !has_npm() {
        eprintln!("xtask: no node with npm here: the viewer's page is not compared and not tested in a browser");
        return Ok(());
    }
    if let Err(error) = packages() {
        eprintln!("xtask: {error:#}: the viewer's page is not compared and not tested in a browser");
        return Ok(());
    }
    check_built()?;
    if !browser() {
        eprintln!("xtask: no Chromium here and none can be installed: the viewer is not tested in a browser");
        return Ok(());
    }
    for (package, program) in [("adit-ground", "adit"), ("adit-hil-sim", "adit-sim")] {
        run("cargo", &["build", "--locked", "--package", package, "--bin", program])?;
    }
    npm(&["test"])
}

fn has_npm() -> bool {
    output("npm", &["--version"]).is_some() && output("node", &["--version"]).is_some()
}

fn npm(script: &[&str]) -> Result<()> {
    run("npm", &[&["--prefix", FOLDER, "--silent"], script].concat())
}

/// Installs the packages if they are missing or others are wanted.
fn packages() -> Result<()> {
    let lock = top().join(FOLDER).join("package-lock.json");
    let wanted = std::fs::read_to_string(&lock).with_context(|| format!("cannot read {}", lock.display()))?;
    let note = top().join(FOLDER).join("node_modules/installed.json");
    if std::fs::read_to_string(&note).is_ok_and(|installed| installed == wanted) {
        return Ok(());
    }
    eprintln!(
        "xtask: installing three.js, esbuild, TypeScript, playwright-core and iwer from npm to {FOLDER}/node_modules"
    );
    npm(&["ci", "--no-audit", "--no-fund"])?;
    std::fs::write(&note, wanted).with_context(|| format!("cannot write {}", note.display()))
}

fn build() -> Result<()> {
    npm(&["run", "check"])?;
    npm(&["run", "build"])
}

/// Builds in place: what differs is then ready to be committed.
fn check_built() -> Result<()> {
    let before = built()?;
    build()?;
    let changed: Vec<&str> = BUILT
        .into_iter()
        .zip(before)
        .zip(built()?)
        .filter(|((_, old), new)| old != new)
        .map(|((name, _), _)| name)
        .collect();
    ensure!(
        changed.is_empty(),
        "{FOLDER}/dist was not what its sources give ({}); it is now: commit it",
        changed.join(", ")
    );
    Ok(())
}

fn built() -> Result<Vec<Option<Vec<u8>>>> {
    let read = |name: &str| {
        let path = top().join(FOLDER).join("dist").join(name);
        match std::fs::read(&path) {
            Ok(bytes) => Ok(Some(bytes)),
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => Ok(None),
            Err(error) => Err(error).with_context(|| format!("cannot read {}", path.display())),
        }
    };
    BUILT.into_iter().map(read).collect()
}

/// Whether there is a browser, installed if need be and as far as one may.
fn browser() -> bool {
    let is_there = || BROWSERS.iter().any(|name| output(name, &["--version"]).is_some());
    if is_there() {
        return true;
    }
    let is_root = output("id", &["-u"]).is_some_and(|id| id.trim() == "0");
    if is_root && output("apt-get", &["--version"]).is_some() {
        eprintln!("xtask: Chromium is missing; installing Debian's for the viewer's tests");
        let installed = run("apt-get", &["-qq", "update"])
            .and_then(|()| run("apt-get", &["-qq", "install", "--yes", "--no-install-recommends", "chromium"]));
        if let Err(error) = installed {
            eprintln!("xtask: {error:#}");
        }
    }
    is_there()
}
