//! Set-up, demo, flash, test and ci: the commands of README and `.ci/run`, the same on every machine.

mod bench_peers;
mod demo;
mod flash;
mod image;
mod peers;
mod shell;
mod test;
mod viewer;

use std::path::PathBuf;
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
    /// Run COLMAP and ours on the same surveys and write one table of accuracy, time and memory.
    ///
    /// Installs pycolmap from `PyPI` in target/ and makes the simulator's sets in target/bench-sets, which are kept (delete
    /// a set and its `.finished` mark to have it made again). Results are kept for as long as set and program are the same.
    BenchPeers {
        /// Only these, by commas: samples, kinds of `adit-sim survey`, bal, or long (230 and 2,300 photos, ours only;
        /// not among the default).
        #[arg(long, value_delimiter = ',')]
        sets: Option<Vec<String>>,
        /// Where table.md, table.json and results go.
        #[arg(long, default_value = "target/bench-peers")]
        out: PathBuf,
        /// Leave COLMAP out.
        #[arg(long)]
        skip_peer: bool,
        /// Measure again what an earlier run has measured.
        #[arg(long)]
        fresh: bool,
    },
    /// Run `adit calibrate` and OpenCV on the same photos of chessboards and write one table.
    ///
    /// The real photos of shared/samples, where they are, and two simulated sets with a known camera. Installs OpenCV from
    /// `PyPI` in target/.
    BenchCalibration {
        /// Where table.md and table.json go.
        #[arg(long, default_value = "target/bench-calibration")]
        out: PathBuf,
    },
    /// Build the viewer's page from ground/viewer/ into ground/viewer/dist, which is committed and embedded in `adit`.
    ///
    /// Needs node 20 or newer with npm; packages come from npm as pinned in package-lock.json.
    Viewer {
        /// Fail if what was committed is not what the sources give.
        #[arg(long)]
        check: bool,
    },
    /// Measure the flash image and compare it with firmware/budget.toml.
    Size,
    /// Everything a change must pass: set-up, board build, all tests.
    Test,
    /// What `.ci/run` runs: format, lints and docs, then `test`.
    Ci,
    /// Install what builds and tests need and is missing (the board's target, rustfmt, clippy; as peers of the tests
    /// pymavlink, MAVSDK, `MAVProxy` and readers of exported files from `PyPI`, and Khronos' glTF validator from npm).
    Setup,
}

fn main() -> ExitCode {
    let result = match Cli::parse().command {
        Command::Demo { seed } => demo::demo(seed),
        Command::Flash { build_only, hil } => {
            flash::flash(if hil { image::Kind::Hil } else { image::Kind::Flight }, build_only)
        }
        Command::BenchPeers { sets, out, skip_peer, fresh } => {
            let out = shell::top().join(out);
            bench_peers::bench_peers(&bench_peers::Options { sets, out, skip_peer, fresh })
        }
        Command::BenchCalibration { out } => bench_peers::bench_calibration(&shell::top().join(out)),
        Command::Viewer { check } => viewer::viewer(check),
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
