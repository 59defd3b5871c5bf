//! Set-up, demo, flash, test and ci: the commands of README and `.ci/run`, the same on every machine.

mod demo;
mod flash;
mod image;
mod peers;
mod shell;
mod test;

use std::process::ExitCode;

use clap::{Parser, Subcommand};

/// Adit's chores.
#[derive(Parser)]
#[command(name = "cargo xtask", bin_name = "cargo xtask", disable_help_subcommand = true)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Fly a simulated 10 m tunnel, ingest the flight, reconstruct it, compare with the truth, say where to look.
    ///
    /// Builds the release binaries first. Results go to `demo/` in the checkout.
    Demo {
        /// Seed of the simulated flight.
        #[arg(long, default_value_t = 1)]
        seed: u64,
    },
    /// Build the board's flash image, write it as ELF, binary, Intel HEX and .apj to target/image/, and load it if a probe
    /// is there.
    Flash {
        /// Build and write only.
        #[arg(long)]
        build_only: bool,
        /// The image that takes its inputs from a simulator over TELEM2 (`adit-sim fly --board PORT`).
        #[arg(long)]
        hil: bool,
    },
    /// Measure the flash image and compare it with firmware/budget.toml.
    Size,
    /// Everything a change must pass: set-up, board build, all tests.
    Test,
    /// What `.ci/run` runs: format, lints and docs, then `test`.
    Ci,
    /// Install what builds and tests need and is missing (the board's target, rustfmt, clippy, and pymavlink, MAVSDK and
    /// MAVProxy from PyPI as peers for the tests of the link).
    Setup,
}

fn main() -> ExitCode {
    let result = match Cli::parse().command {
        Command::Demo { seed } => demo::demo(seed),
        Command::Flash { build_only, hil } => {
            flash::flash(if hil { image::Kind::Hil } else { image::Kind::Flight }, build_only)
        }
        Command::Size => flash::size(),
        Command::Test => test::test(),
        Command::Ci => test::ci(),
        Command::Setup => test::setup(),
    };
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("xtask: {error:#}");
            ExitCode::FAILURE
        }
    }
}
