//! `adit-emulator`: flies the flash image itself through a simulated tunnel and leaves what a real flight leaves.
//!
//! Exit codes: 0 done, 1 the flight broke a rule that must hold, 2 could not run.

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use adit_emulator::serve::{Hovering, Ports, serve};
use adit_emulator::{EmulatedBoard, Report, Setup, Watched, log_of, provisioned_fram};
use adit_firmware::io::Inputs;
use adit_hil_sim::check;
use adit_hil_sim::command::{FLIGHT_PARTS, Left, MissionFile, figures_text, prepare};
use adit_hil_sim::flight::fly_board;
use adit_hil_sim::peer::Peer;
use adit_protocol::connection::Connection;
use anyhow::{Context, Result, bail};
use clap::{Args, Parser, Subcommand};

/// Name and version of this program, for `flight.json`.
const PROGRAM: &str = concat!("adit-emulator ", env!("CARGO_PKG_VERSION"));
/// Where `cargo xtask flash --build-only` leaves the image.
const IMAGE: &str = "target/image/rotator.elf";

/// Flies the rotator board's flash image, on an emulated Pixracer, through a simulated tunnel.
#[derive(Parser)]
#[command(name = "adit-emulator", version)]
struct Cli {
    #[command(subcommand)]
    command: Verb,
}

#[derive(Subcommand)]
enum Verb {
    /// Fly a mission; writes board.log, DCIM/, truth/ and flight.json.
    Fly(FlyArguments),
    /// Run the board with its telemetry ports as pseudo-terminals, for programs that talk to a board.
    Serve(ServeArguments),
}

#[derive(Args)]
struct ServeArguments {
    /// The flash image (ELF).
    #[arg(long, default_value = IMAGE)]
    image: PathBuf,
    /// Mission whose parameters lie in the board's memory; default: the memory is empty.
    #[arg(long)]
    mission: Option<PathBuf>,
    /// Put the board into a vehicle that hovers at the mouth of the mission's tunnel: sensors, shaft and camera are there, and
    /// fail as the mission has it. Otherwise nothing is connected.
    #[arg(long, requires = "mission")]
    hover: bool,
    /// Link to make to the terminal of TELEM1 (MAVLink).
    #[arg(long, value_name = "LINK")]
    telem1: Option<PathBuf>,
    /// Link to make to the terminal of TELEM2 (the service cable; a simulator, with the image of `cargo xtask flash --hil`).
    #[arg(long, value_name = "LINK")]
    telem2: Option<PathBuf>,
    /// Stop after so many seconds of the board's time; default: run until stopped.
    #[arg(long)]
    seconds: Option<f64>,
}

/// Who watches, and how fast time goes.
#[derive(Args)]
struct WatchArguments {
    /// Show the vehicle to a ground station there, such as udpout:127.0.0.1:14550.
    #[arg(long, value_name = "CONNECTION")]
    mavlink: Option<Connection>,
    /// Let a second last a second.
    #[arg(long)]
    realtime: bool,
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
    /// The flash image (ELF).
    #[arg(long, default_value = IMAGE)]
    image: PathBuf,
    #[command(flatten)]
    watch: WatchArguments,
    /// Leave out photos and the true texture.
    #[arg(long)]
    no_photos: bool,
    /// Print the figures as JSON.
    #[arg(long)]
    json: bool,
    /// Write into a folder that is not empty: what an earlier flight left there is removed first.
    #[arg(long)]
    force: bool,
}

/// What is printed as JSON.
#[derive(serde::Serialize)]
struct Figures<'r> {
    #[serde(flatten)]
    flight: &'r check::Report,
    board: BoardFigures<'r>,
}

/// How the board itself fared.
#[derive(serde::Serialize)]
struct BoardFigures<'r> {
    instructions: u64,
    restarts: &'r [adit_emulator::Restart],
    gaps: &'r [String],
    ranger_misuse: adit_emulator::RangerMisuse,
    card_blocks_written: usize,
    fram_bytes_written: usize,
}

fn main() -> ExitCode {
    let outcome = match Cli::parse().command {
        Verb::Fly(arguments) => run(&arguments),
        Verb::Serve(arguments) => run_served(&arguments),
    };
    match outcome {
        Ok(true) => ExitCode::SUCCESS,
        Ok(false) => ExitCode::from(1),
        Err(error) => {
            eprintln!("error: {error:#}");
            ExitCode::from(2)
        }
    }
}

fn must_exist(image: &Path) -> Result<()> {
    if !image.exists() {
        bail!("no flash image at {}; build it with: cargo xtask flash --build-only", image.display());
    }
    Ok(())
}

fn run_served(arguments: &ServeArguments) -> Result<bool> {
    must_exist(&arguments.image)?;
    let mission = arguments.mission.as_ref().map(|path| MissionFile::read(path, None)).transpose()?;
    let parameters = mission.as_ref().map(|file| file.mission.parameters());
    let mut hovering = mission.as_ref().filter(|_| arguments.hover).map(Hovering::new).transpose()?;
    let fram = parameters.as_ref().map(provisioned_fram).transpose()?.unwrap_or_default();
    let setup = Setup { fram, ..Setup::new(1)? };
    let mut board = EmulatedBoard::new(&arguments.image, &parameters.unwrap_or_default(), setup)?;
    let ports = Ports { telem1: arguments.telem1.clone(), telem2: arguments.telem2.clone() };
    let mut announced = false;
    serve(&mut board, &ports, |now_s, outputs| {
        if !std::mem::replace(&mut announced, true) {
            eprintln!("ready");
        }
        let senses = hovering.as_mut().map_or_else(Inputs::default, |vehicle| vehicle.sense(now_s, outputs));
        arguments.seconds.is_none_or(|seconds| now_s < seconds).then_some(senses)
    })?;
    let report = board.finish()?;
    for restart in &report.restarts {
        eprintln!("restarted: {:?} at {:.3} s", restart.cause, restart.at_ns as f64 / 1e9);
    }
    Ok(report.gaps.is_empty())
}

fn run(arguments: &FlyArguments) -> Result<bool> {
    let file = MissionFile::read(&arguments.mission, arguments.seed)?;
    eprintln!("seed {}", file.seed);
    let image = &arguments.image;
    must_exist(image)?;
    prepare(&arguments.out, arguments.force, &FLIGHT_PARTS)?;

    let parameters = file.mission.parameters();
    let setup = Setup { fram: provisioned_fram(&parameters)?, ..Setup::new(file.seed)? };
    let peer = arguments
        .watch
        .mavlink
        .as_ref()
        .map(|connection| Peer::open(connection).with_context(|| format!("cannot open {connection}")));
    let board = EmulatedBoard::new(image, &parameters, setup)?;
    let mut watched = Watched::new(board, peer.transpose()?, arguments.watch.realtime);
    let mut flight = fly_board(&mut watched, &file.mission, &file.simulation, file.seed)
        .with_context(|| format!("mission {}", file.path.display()))?;
    let board = watched.board.finish()?;
    let log = log_of(&board)?;
    flight.entries = log.entries;
    flight.restarts_s = board.restarts.iter().map(|restart| restart.at_ns as f64 * 1e-9).collect();
    let report = file.check(&flight, &log.bytes)?;
    let left =
        Left { program: PROGRAM, flight: &flight, log: &log.bytes, report: &report, photos: !arguments.no_photos };
    file.leave(&arguments.out, &left)?;
    print(&report, &board, arguments.json)?;
    Ok(report.violations.is_empty() && board.gaps.is_empty())
}

fn print(report: &check::Report, board: &Report, json: bool) -> Result<()> {
    for violation in &report.violations {
        eprintln!("rule broken: {violation:?}");
    }
    for gap in &board.gaps {
        eprintln!("not emulated: {gap}");
    }
    if json {
        let figures = BoardFigures {
            instructions: board.instructions,
            restarts: &board.restarts,
            gaps: &board.gaps,
            ranger_misuse: board.ranger_misuse,
            card_blocks_written: board.card_writes.len(),
            fram_bytes_written: board.fram_writes.len(),
        };
        println!("{}", serde_json::to_string_pretty(&Figures { flight: report, board: figures })?);
        return Ok(());
    }
    print!("{}", figures_text(report));
    println!("instructions       {:.1} million", board.instructions as f64 / 1e6);
    println!("restarts           {}", board.restarts.len());
    for restart in &board.restarts {
        println!("                   {:?} at {:.3} s", restart.cause, restart.at_ns as f64 / 1e9);
    }
    Ok(())
}
