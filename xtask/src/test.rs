//! What a change must pass.

use anyhow::{Result, bail};

use crate::image::{self, Kind};
use crate::shell::{output, run, run_with};
use crate::{flash, image::build, peers, viewer};

/// The rotator board's target.
pub(crate) const BOARD: &str = "thumbv7em-none-eabihf";
/// The emulator's runtime asks for a newer compiler than it needs.
const EMULATOR: [&str; 4] = ["--locked", "--ignore-rust-version", "--package", "adit-emulator"];

/// Installs what is missing and says so.
pub(crate) fn setup() -> Result<()> {
    let board_core = output("rustc", &["--print", "target-libdir", "--target", BOARD]);
    if !board_core.is_some_and(|folder| std::path::Path::new(folder.trim()).is_dir()) {
        eprintln!("xtask: the board's target {BOARD} is missing; installing it");
        if run("rustup", &["target", "add", BOARD]).is_err() {
            bail!(
                "cannot install {BOARD}: install Rust through rustup, or your distribution's package for that target"
            );
        }
    }
    for (tool, component) in [("fmt", "rustfmt"), ("clippy", "clippy")] {
        if output("cargo", &[tool, "--version"]).is_none() {
            eprintln!("xtask: {component} is missing; installing it");
            run("rustup", &["component", "add", component])?;
        }
    }
    peers::install()
}

/// The flash images and their budget, then all tests: the viewer's in a browser, and last those that fly the image on the
/// emulated board.
pub(crate) fn test() -> Result<()> {
    setup()?;
    build(Kind::Hil)?;
    flash::size()?;
    image::write_forms(&Kind::Flight.elf())?;
    run("cargo", &["test", "--locked"])?;
    viewer::test()?;
    run("cargo", &[&["test"], &EMULATOR[..]].concat())
}

/// Format, lints, docs, then [`test()`].
pub(crate) fn ci() -> Result<()> {
    setup()?;
    let strict = ["--", "--deny", "warnings"];
    run("cargo", &["fmt", "--all", "--check"])?;
    run("cargo", &[&["clippy", "--locked", "--all-targets"], &strict[..]].concat())?;
    run("cargo", &[&["clippy", "--all-targets"], &EMULATOR[..], &strict].concat())?;
    for features in ["board", "hil"] {
        let board = ["--locked", "--profile", "flash", "--package", "adit-firmware", "--bins", "--target", BOARD];
        run("cargo", &[&["clippy", "--features", features], &board[..], &strict].concat())?;
    }
    let deny = [("RUSTDOCFLAGS", "--deny warnings")];
    run_with("cargo", &["doc", "--locked", "--no-deps"], &deny)?;
    run_with("cargo", &[&["doc", "--no-deps"], &EMULATOR[..]].concat(), &deny)?;
    test()
}
