//! What the commands that fly a mission have in common: reading it, checking the flight, leaving the card, saying how it
//! went.

use std::path::{Path, PathBuf};

use adit_protocol::mission::Mission;
use anyhow::{Context, Result, bail};
use indicatif::{ProgressBar, ProgressStyle};

use crate::card::{CardSource, write_card};
use crate::check::{BoundTable, Figures, Report, check};
use crate::config::Simulation;
use crate::flight::Flight;

/// The seed where neither command line nor mission gives one.
const DEFAULT_SEED: u64 = 1;

/// A mission file, read and checked.
#[derive(Clone, Debug)]
pub struct MissionFile {
    /// Where it is.
    pub path: PathBuf,
    /// Its text.
    pub text: String,
    /// The mission in it.
    pub mission: Mission,
    /// Its table `simulation`.
    pub simulation: Simulation,
    /// The seed to fly with.
    pub seed: u64,
}

impl MissionFile {
    /// Reads a mission and settles the seed: the one given, else the mission's, else 1.
    ///
    /// # Errors
    /// If the file cannot be read or is no mission; the message names it.
    pub fn read(path: &Path, seed: Option<u64>) -> Result<Self> {
        let name = path.display();
        let text = std::fs::read_to_string(path).with_context(|| format!("cannot read mission {name}"))?;
        let mission = Mission::from_toml(&text).with_context(|| format!("mission {name}"))?;
        let simulation = Simulation::from_mission(&text).with_context(|| format!("mission {name}"))?;
        let seed = seed.or(simulation.seed).unwrap_or(DEFAULT_SEED);
        Ok(Self { path: path.to_owned(), text, mission, simulation, seed })
    }

    /// Checks a flight of this mission against its log.
    ///
    /// # Errors
    /// If the table of exact bounds cannot be computed.
    pub fn check(&self, flight: &Flight, log: &[u8]) -> Result<Report> {
        Ok(check(flight, log, &self.mission, &mut BoundTable::new(&self.mission)?))
    }

    /// Leaves in `out` what a real flight leaves, and the truth beside it; draws a bar while photos are rendered.
    ///
    /// # Errors
    /// If a file cannot be written.
    pub fn leave(&self, out: &Path, left: &Left<'_>) -> Result<()> {
        let source = CardSource {
            program: left.program,
            flight: left.flight,
            log: left.log,
            mission: &self.mission,
            simulation: &self.simulation,
            mission_text: &self.text,
            mission_folder: self.path.parent().unwrap_or(Path::new(".")),
            report: left.report,
        };
        let bar = photo_bar()?;
        bar.set_length(left.flight.exposures.len() as u64);
        let after_each = || bar.inc(1);
        write_card(out, &source, left.photos.then_some(&after_each))?;
        bar.finish_and_clear();
        Ok(())
    }
}

/// What a flight leaves.
#[derive(Clone, Copy, Debug)]
pub struct Left<'f> {
    /// Name and version of the program that flew it.
    pub program: &'f str,
    /// The flight.
    pub flight: &'f Flight,
    /// Its log.
    pub log: &'f [u8],
    /// The checker's report.
    pub report: &'f Report,
    /// Whether photos and the true texture are wanted.
    pub photos: bool,
}

/// A progress bar for photos; their number is set later.
///
/// # Errors
/// Never; its template is checked when it is made.
pub fn photo_bar() -> Result<ProgressBar> {
    let style = ProgressStyle::with_template("photos {bar:40} {pos}/{len} {eta}")?;
    Ok(ProgressBar::new(0).with_style(style))
}

/// What a flight leaves that a later one must not mix with.
pub const FLIGHT_PARTS: [&str; 2] = ["DCIM", "truth"];

/// Makes the folder, or refuses one that holds something; with `force`, removes the folders `parts` that an earlier run left
/// in it.
///
/// # Errors
/// If the folder holds something and `force` is not set, or cannot be made or emptied.
pub fn prepare(out: &Path, force: bool, parts: &[&str]) -> Result<()> {
    std::fs::create_dir_all(out).with_context(|| format!("cannot make folder {}", out.display()))?;
    let holds_something = std::fs::read_dir(out).with_context(|| format!("cannot read {}", out.display()))?.count() > 0;
    if !holds_something {
        return Ok(());
    }
    if !force {
        bail!("{} is not empty; choose another folder, or --force to replace what is in it", out.display());
    }
    for name in parts {
        let folder = out.join(name);
        if folder.exists() {
            std::fs::remove_dir_all(&folder).with_context(|| format!("cannot remove {}", folder.display()))?;
        }
    }
    Ok(())
}

/// The report as people read it.
pub fn figures_text(report: &Report) -> String {
    let Figures { outcome, duration_s, distance_m, presses, photos, surplus, missed, tags, confirmed, .. } =
        report.figures;
    let Figures { centring_error_mm, offset_mm, limit_use, seen_once_percent, seen_twice_percent, .. } = report.figures;
    let limit_percent = limit_use * 100.0;
    [
        format!("outcome            {outcome:?}\n"),
        format!("flown              {distance_m:.2} m in {duration_s:.1} s\n"),
        format!("photos             {photos} ({surplus} surplus) for {presses} presses, {missed} missed\n"),
        format!("tags               {tags}, {confirmed} confirmed\n"),
        format!(
            "centring error     {centring_error_mm:.0} mm (vehicle {offset_mm:.0} mm off the axis), root mean square\n"
        ),
        format!("speed limit        {limit_percent:.0} % of the exact bound at most\n"),
        format!("wall seen          {seen_once_percent:.2} % once, {seen_twice_percent:.2} % twice\n"),
    ]
    .concat()
}
