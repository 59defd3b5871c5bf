//! What a change must pass.

use anyhow::{Result, bail};

use crate::shell::{output, run, run_with};

/// The rotator board's target.
pub(crate) const BOARD: &str = "thumbv7em-none-eabihf";

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
    Ok(())
}

/// Board build, then all tests.
pub(crate) fn test() -> Result<()> {
    setup()?;
    run("cargo", &["build", "--locked", "--package", "adit-firmware", "--lib", "--target", BOARD])?;
    run("cargo", &["test", "--locked", "--workspace"])
}

/// Format, lints, docs, then [`test()`].
pub(crate) fn ci() -> Result<()> {
    setup()?;
    run("cargo", &["fmt", "--all", "--check"])?;
    run("cargo", &["clippy", "--locked", "--workspace", "--all-targets", "--", "--deny", "warnings"])?;
    run_with("cargo", &["doc", "--locked", "--workspace", "--no-deps"], &[("RUSTDOCFLAGS", "--deny warnings")])?;
    test()
}
