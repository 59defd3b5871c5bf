//! `adit-sim`: flies the rotator board through a simulated tunnel and leaves what a real flight leaves; or makes survey sets.
//!
//! Exit codes: 0 done, 1 the flight broke a rule that must hold, 2 could not run.

use std::path::PathBuf;
use std::process::ExitCode;

use adit_geometry::charuco::Dictionary;
use adit_hil_sim::board::{BOARD_PARTS, BoardOptions, LensModel, make_board_photos};
use adit_hil_sim::card::log_bytes;
use adit_hil_sim::check::Report;
use adit_hil_sim::command::{FLIGHT_PARTS, Left, MissionFile, figures_text, photo_bar, prepare};
use adit_hil_sim::config::AutopilotKind;
use adit_hil_sim::flight::{Flight, FlightError, Linked, fly, fly_board};
use adit_hil_sim::peer::Peer;
use adit_hil_sim::serial_board::SerialBoard;
use adit_hil_sim::survey::{SET_PARTS, SetKind, SetOptions, WIDTH_PX, make_set};
use adit_protocol::connection::Connection;
use anyhow::{Context, Result, bail};
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
    /// Make a survey folder with its truth from a scripted way through a tunnel, to test the ground side with.
    Survey(SurveyArguments),
    /// Make photos of a chessboard, with markers or without, by a camera that is known exactly, to test `adit calibrate` with.
    Board(BoardArguments),
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
    #[command(flatten)]
    vehicle: VehicleArguments,
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

#[derive(Args)]
struct SurveyArguments {
    /// What the set is to show.
    #[arg(value_enum)]
    kind: SetKind,
    /// Folder to write to; made if it is not there.
    #[arg(long)]
    out: PathBuf,
    /// How many photos; default: the kind's own number.
    #[arg(long, value_parser = clap::value_parser!(u32).range(1..10_000))]
    photos: Option<u32>,
    /// Seed of everything that happens by chance.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// A later flight, with this seed, through the tunnel of --seed, where a bulge and a stain have come up since: a pair for
    /// `adit compare`.
    #[arg(long, value_name = "SEED")]
    later: Option<u64>,
    /// Width of the photos in pixels; height and lens follow.
    #[arg(long, default_value_t = WIDTH_PX, value_parser = clap::value_parser!(u32).range(40..=8000))]
    width_px: u32,
    /// Leave out the true texture.
    #[arg(long)]
    no_texture: bool,
    /// Threads for rendering; default: all processors.
    #[arg(long)]
    threads: Option<usize>,
    /// Print the figures as JSON.
    #[arg(long)]
    json: bool,
    /// Write into a folder that is not empty: what an earlier set left there is removed first.
    #[arg(long)]
    force: bool,
}

#[derive(Args)]
struct BoardArguments {
    /// Folder to write to; made if it is not there.
    #[arg(long)]
    out: PathBuf,
    /// The lens's model.
    #[arg(long, value_enum, default_value_t = LensModel::BrownConrady)]
    model: LensModel,
    /// Markers in the white squares, of this dictionary: 4x4, 5x5 or 6x6.
    #[arg(long, value_name = "DICTIONARY", value_parser = dictionary)]
    charuco: Option<Dictionary>,
    /// Least share of a board's corners that is in view.
    #[arg(long, default_value_t = 1.0, value_name = "SHARE")]
    in_view: f64,
    /// How many photos.
    #[arg(long, default_value_t = 20, value_parser = clap::value_parser!(u32).range(1..1_000))]
    photos: u32,
    /// Seed of camera, poses and noise.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Width of the photos in pixels; height and lens follow.
    #[arg(long, default_value_t = 1280, value_parser = clap::value_parser!(u32).range(200..=8000))]
    width_px: u32,
    /// Blur of the lens: standard deviation of its point spread.
    #[arg(long, default_value_t = 0.7, value_name = "PX")]
    blur_px: f64,
    /// Noise: standard deviation, of 255 levels.
    #[arg(long, default_value_t = 2.0, value_name = "LEVELS")]
    noise_levels: f64,
    /// Threads for rendering; default: all processors.
    #[arg(long)]
    threads: Option<usize>,
    /// Print the figures as JSON.
    #[arg(long)]
    json: bool,
    /// Write into a folder that is not empty: what an earlier set left there is removed first.
    #[arg(long)]
    force: bool,
}

/// Who flies the board, and who watches.
#[derive(Args)]
struct VehicleArguments {
    /// Which autopilot flies: simple, or at the other end of a MAVLink line ardupilot, ardupilot-4.7, px4, px4-development;
    /// default: the mission's, else simple.
    #[arg(long, value_enum, hide_possible_values = true, conflicts_with = "board")]
    autopilot: Option<AutopilotKind>,
    /// Show the vehicle to a ground station there, such as udpout:127.0.0.1:14550; not with the simple autopilot.
    #[arg(long, value_name = "CONNECTION", conflicts_with = "board")]
    mavlink: Option<Connection>,
    /// Let a second last a second; not with the simple autopilot.
    #[arg(long, conflicts_with = "board")]
    realtime: bool,
}

fn main() -> ExitCode {
    let good = match Cli::parse().command {
        Verb::Fly(arguments) => run(&arguments).map(|report| report.violations.is_empty()),
        Verb::Survey(arguments) => survey(&arguments).map(|()| true),
        Verb::Board(arguments) => board(&arguments).map(|()| true),
    };
    match good {
        Ok(true) => ExitCode::SUCCESS,
        Ok(false) => ExitCode::from(1),
        Err(error) => {
            eprintln!("error: {error:#}");
            ExitCode::from(2)
        }
    }
}

fn run(arguments: &FlyArguments) -> Result<Report> {
    let mut file = MissionFile::read(&arguments.mission, arguments.seed)?;
    file.simulation.autopilot.kind = arguments.vehicle.autopilot.unwrap_or(file.simulation.autopilot.kind);
    eprintln!("seed {}", file.seed);
    prepare(&arguments.out, arguments.force, &FLIGHT_PARTS)?;
    start_threads(arguments.threads)?;

    let flight = flown(arguments, &file).with_context(|| format!("mission {}", file.path.display()))?;
    let log = log_bytes(&flight).context("board.log")?;
    let report = file.check(&flight, &log)?;
    let photos = !arguments.no_photos;
    file.leave(&arguments.out, &Left { program: PROGRAM, flight: &flight, log: &log, report: &report, photos })?;
    print(&report, arguments.json)?;
    Ok(report)
}

fn survey(arguments: &SurveyArguments) -> Result<()> {
    eprintln!("seed {}", arguments.seed);
    prepare(&arguments.out, arguments.force, &SET_PARTS)?;
    start_threads(arguments.threads)?;
    let options = SetOptions {
        kind: arguments.kind,
        seed: arguments.seed,
        later: arguments.later,
        photos: arguments.photos,
        width_px: arguments.width_px,
        texture: !arguments.no_texture,
    };
    let bar = photo_bar()?;
    let figures = make_set(&arguments.out, &options, &|all| {
        bar.set_length(all as u64);
        bar.inc(1);
    })?;
    bar.finish_and_clear();
    if arguments.json {
        println!("{}", serde_json::to_string_pretty(&figures)?);
    } else {
        println!("photos             {}", figures.photos);
        println!("length             {:.2} m", figures.length_m);
    }
    Ok(())
}

fn board(arguments: &BoardArguments) -> Result<()> {
    eprintln!("seed {}", arguments.seed);
    prepare(&arguments.out, arguments.force, &BOARD_PARTS)?;
    start_threads(arguments.threads)?;
    let options = BoardOptions {
        model: arguments.model,
        charuco: arguments.charuco,
        in_view: arguments.in_view,
        photos: arguments.photos,
        seed: arguments.seed,
        width_px: arguments.width_px,
        blur_px: arguments.blur_px,
        noise_levels: arguments.noise_levels,
    };
    let bar = photo_bar()?;
    bar.set_length(u64::from(arguments.photos));
    let truth = make_board_photos(&arguments.out, &options, &|| bar.inc(1))?;
    bar.finish_and_clear();
    if arguments.json {
        println!("{}", serde_json::to_string_pretty(&truth)?);
    } else {
        println!("photos             {}", truth.photos.len());
        println!("camera             {}", arguments.out.join("truth/camera.toml").display());
    }
    Ok(())
}

fn dictionary(name: &str) -> Result<Dictionary, String> {
    Dictionary::named(name).ok_or_else(|| "expected 4x4, 5x5 or 6x6, or OpenCV's name, such as DICT_4X4_50".to_owned())
}

fn start_threads(threads: Option<usize>) -> Result<()> {
    if let Some(threads) = threads {
        rayon::ThreadPoolBuilder::new().num_threads(threads).build_global().context("cannot start threads")?;
    }
    Ok(())
}

fn flown(arguments: &FlyArguments, file: &MissionFile) -> Result<Flight> {
    let MissionFile { mission, simulation, seed, .. } = file;
    if let Some(port) = &arguments.board {
        if simulation.autopilot.kind.named().is_some() {
            bail!("a board at a serial port flies with the simple autopilot: change simulation.autopilot.kind");
        }
        let mut board = SerialBoard::open(port, &mission.parameters()).map_err(FlightError::from)?;
        return Ok(fly_board(&mut board, mission, simulation, *seed)?);
    }
    let Some(kind) = simulation.autopilot.kind.named() else {
        if arguments.vehicle.mavlink.is_some() || arguments.vehicle.realtime {
            bail!("the simple autopilot speaks no MAVLink and knows no clock; choose another with --autopilot");
        }
        return Ok(fly(mission, simulation, *seed)?);
    };
    let mut board = Linked::new(kind, &mission.parameters(), simulation)?;
    if let Some(connection) = &arguments.vehicle.mavlink {
        board = board.watched_by(Peer::open(connection).with_context(|| format!("cannot open {connection}"))?);
    }
    if arguments.vehicle.realtime {
        board = board.in_real_time();
    }
    let flight = fly_board(&mut board, mission, simulation, *seed)?;
    eprintln!("{}: {}", kind.name(), board.account().text());
    Ok(flight)
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
