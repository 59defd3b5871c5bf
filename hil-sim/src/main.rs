//! `adit-sim`: flies the rotator board through a simulated tunnel and leaves what a real flight leaves.
//!
//! Exit codes: 0 done, 1 the flight broke a rule that must hold, 2 could not run.

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use adit_hil_sim::card::{CardSource, log_bytes, write_card};
use adit_hil_sim::check::{BoundTable, Figures, Report, check};
use adit_hil_sim::config::Simulation;
use adit_hil_sim::flight::fly;
use adit_protocol::mission::Mission;
use anyhow::{Context, Result, bail};
use clap::{Args, Parser, Subcommand};
use indicatif::{ProgressBar, ProgressStyle};

/// The seed where neither command line nor mission gives one.
const DEFAULT_SEED: u64 = 1;

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
    let file = &arguments.mission;
    let text = std::fs::read_to_string(file).with_context(|| format!("cannot read mission {}", file.display()))?;
    let mission = Mission::from_toml(&text).with_context(|| format!("mission {}", file.display()))?;
    let simulation = Simulation::from_mission(&text).with_context(|| format!("mission {}", file.display()))?;
    let seed = arguments.seed.or(simulation.seed).unwrap_or(DEFAULT_SEED);
    eprintln!("seed {seed}");
    prepare(&arguments.out, arguments.force)?;
    if let Some(threads) = arguments.threads {
        rayon::ThreadPoolBuilder::new().num_threads(threads).build_global().context("cannot start threads")?;
    }

    let flight = fly(&mission, &simulation, seed).with_context(|| format!("mission {}", file.display()))?;
    let log = log_bytes(&flight).context("board.log")?;
    let report = check(&flight, &log, &mission, &mut BoundTable::new(&mission)?);
    let source = CardSource {
        flight: &flight,
        log: &log,
        mission: &mission,
        simulation: &simulation,
        mission_text: &text,
        mission_folder: file.parent().unwrap_or(Path::new(".")),
        report: &report,
    };
    let bar = ProgressBar::new(flight.exposures.len() as u64);
    bar.set_style(ProgressStyle::with_template("photos {bar:40} {pos}/{len} {eta}")?);
    let after_each = || bar.inc(1);
    write_card(&arguments.out, &source, (!arguments.no_photos).then_some(&after_each))?;
    bar.finish_and_clear();
    print(&report, arguments.json)?;
    Ok(report)
}

/// Makes the folder, or refuses one that holds something.
fn prepare(out: &Path, force: bool) -> Result<()> {
    std::fs::create_dir_all(out).with_context(|| format!("cannot make folder {}", out.display()))?;
    let holds_something = std::fs::read_dir(out).with_context(|| format!("cannot read {}", out.display()))?.count() > 0;
    if !holds_something {
        return Ok(());
    }
    if !force {
        bail!("{} is not empty; choose another folder, or --force to replace the flight in it", out.display());
    }
    for name in ["DCIM", "truth"] {
        let folder = out.join(name);
        if folder.exists() {
            std::fs::remove_dir_all(&folder).with_context(|| format!("cannot remove {}", folder.display()))?;
        }
    }
    Ok(())
}

fn print(report: &Report, json: bool) -> Result<()> {
    for violation in &report.violations {
        eprintln!("rule broken: {violation:?}");
    }
    if json {
        println!("{}", serde_json::to_string_pretty(report)?);
        return Ok(());
    }
    let Figures { outcome, duration_s, distance_m, presses, photos, surplus, missed, tags, confirmed, .. } =
        report.figures;
    let Figures { centring_error_mm, offset_mm, limit_use, seen_once_percent, seen_twice_percent, .. } = report.figures;
    println!("outcome            {outcome:?}");
    println!("flown              {distance_m:.2} m in {duration_s:.1} s");
    println!("photos             {photos} ({surplus} surplus) for {presses} presses, {missed} missed");
    println!("tags               {tags}, {confirmed} confirmed");
    println!("centring error     {centring_error_mm:.0} mm (vehicle {offset_mm:.0} mm off the axis), root mean square");
    println!("speed limit        {:.0} % of the exact bound at most", limit_use * 100.0);
    println!("wall seen          {seen_once_percent:.2} % once, {seen_twice_percent:.2} % twice");
    Ok(())
}
