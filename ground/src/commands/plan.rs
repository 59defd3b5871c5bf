//! `adit plan`.

use std::path::PathBuf;

use adit_ground::plan::{plan, write};
use adit_protocol::mission::Mission;
use anyhow::{Context, Result};
use clap::Args;

use super::{Answer, Common, print};

/// See before the flight how fast, how many photos, how long, and what they will show.
///
/// Prints the largest step per image and the speed by the paper's law and by the exact bound (every wall point in one or
/// in two photos) over the vehicle's distance from the axis; then photos, time, storage, millimetres per pixel, overlap and
/// the predicted coverage of the flight that the mission file asks for; and what to mind: autopilots' modes that cannot be
/// held to so low a limit, a shaft or camera slower than asked for, batteries, cards, light, blur.
///
/// With --out, plan.html (everything in one page, to be looked at before the flight), plan.json (all figures), coverage.png
/// (predicted number of photos; columns around the wall from the crown clockwise, rows along the axis; red means none) and
/// pixels.png (predicted size of a pixel, alike; yellow is finest) are written; and PARAMS.ADT, which `adit board load` sends
/// to the board. Copied to the root of the board's microSD card, the board takes it over at its next start.
///
/// The answer is no (exit code 1) if the mission cannot be flown as planned: no speed is allowed on the axis, the battery
/// is too short or the card too small.
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  adit plan hil-sim/missions/demo.toml\n  \
    adit plan mission.toml --out plan --json")]
pub(super) struct Arguments {
    /// The mission file
    #[arg(value_name = "MISSION.toml")]
    mission: PathBuf,
    /// Folder for the page, the figures, the pictures and PARAMS.ADT; made if it is not there
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
}

pub(super) fn run(arguments: &Arguments, common: &Common) -> Result<Answer> {
    let file = arguments.mission.display();
    let text = std::fs::read_to_string(&arguments.mission).with_context(|| format!("cannot read mission {file}"))?;
    let mission = Mission::from_toml(&text).with_context(|| format!("mission {file}"))?;
    let plan = plan(&mission).with_context(|| format!("mission {file}"))?;
    if let Some(out) = &arguments.out {
        write(&plan, &mission.parameters(), out)?;
    }
    print(&plan, common)?;
    Ok(if plan.is_flyable() { Answer::Yes } else { Answer::No })
}
