//! `adit-sim`: flies the rotator board through a simulated tunnel and leaves what a real flight leaves.
//!
//! Exit codes: 0 done, 1 the flight broke a rule that must hold, 2 could not run.

use std::path::PathBuf;
use std::process::ExitCode;

use adit_hil_sim::card::log_bytes;
use adit_hil_sim::check::Report;
use adit_hil_sim::command::{Left, MissionFile, figures_text, prepare};
use adit_hil_sim::flight::{FlightError, fly, fly_board};
use adit_hil_sim::serial_board::SerialBoard;
use anyhow::{Context, Result};
use clap::{Args, Parser, Subcommand};

/// Name and version of this program, for `flight.json`.
const PROGRAM: &str = concat!("adit-sim ", env!("CARGO_PKG_VERSION"));

/// Flies the rotator board through a simulated tunnel and leaves what a real flight leaves.
#[derive(Parser)]
#[command(name = "adit-sim", version)]
struct Cli {
    #[command(subcommand)]
    command: Verb,
}

#[derive(Subcommand)]
enum Verb {
    /// Fly a mission; writes board.log, DCIM/, truth/ and flight.json.
    Fly(FlyArguments),
}

#[derive(Args)]
struct FlyArguments {
    /// Mission file (TOML) with tables tunnel, camera, rig, flight and simulation.
    mission: PathBuf,
    /// Folder to write to; made if it is not there.
    #[arg(long)]
    out: PathBuf,
    /// Seed of everything that happens by chance; default: the mission's, else 1.
    #[arg(long)]
    seed: Option<u64>,
    /// Fly a real board at this serial port instead of the library; it must run the image of `cargo xtask flash --hil`.
    #[arg(long, value_name = "PORT")]
    board: Option<String>,
    /// Leave out photos and the true texture.
    #[arg(long)]
    no_photos: bool,
    /// Threads for rendering; default: all processors.
    #[arg(long)]
    threads: Option<usize>,
    /// Print the figures as JSON.
    #[arg(long)]
    json: bool,
    /// Write into a folder that is not empty: what an earlier flight left there is removed first.
    #[arg(long)]
    force: bool,
}

fn main() -> ExitCode {
    let Cli { command: Verb::Fly(arguments) } = Cli::parse();
    match run(&arguments) {
        Ok(report) if report.violations.is_empty() => ExitCode::SUCCESS,
        Ok(_) => ExitCode::from(1),
        Err(error) => {
            eprintln!("error: {error:#}");
            ExitCode::from(2)
        }
    }
}

fn run(arguments: &FlyArguments) -> Result<Report> {
    let file = MissionFile::read(&arguments.mission, arguments.seed)?;
    eprintln!("seed {}", file.seed);
    prepare(&arguments.out, arguments.force)?;
    if let Some(threads) = arguments.threads {
        rayon::ThreadPoolBuilder::new().num_threads(threads).build_global().context("cannot start threads")?;
    }

    let flight = match &arguments.board {
        None => fly(&file.mission, &file.simulation, file.seed),
        Some(port) => SerialBoard::open(port, &file.mission.parameters())
            .map_err(FlightError::from)
            .and_then(|mut board| fly_board(&mut board, &file.mission, &file.simulation, file.seed)),
    };
    let flight = flight.with_context(|| format!("mission {}", file.path.display()))?;
    let log = log_bytes(&flight).context("board.log")?;
    let report = file.check(&flight, &log)?;
    let photos = !arguments.no_photos;
    file.leave(&arguments.out, &Left { program: PROGRAM, flight: &flight, log: &log, report: &report, photos })?;
    print(&report, arguments.json)?;
    Ok(report)
}

fn print(report: &Report, json: bool) -> Result<()> {
    for violation in &report.violations {
        eprintln!("rule broken: {violation:?}");
    }
    if json {
        println!("{}", serde_json::to_string_pretty(report)?);
    } else {
        print!("{}", figures_text(report));
    }
    Ok(())
}
