//! `adit preflight`.

use std::path::PathBuf;

use adit_ground::preflight::{Options, preflight};
use adit_protocol::mission::Mission;
use anyhow::{Context, Result};
use clap::Args;

use super::board::{LinkArguments, with_session};
use super::{Answer, Common, print};

/// Check whether the vehicle is ready to fly, where it stands.
///
/// Looks at the board and its program, the autopilot, the parameters (against the mission's, and whether they are in force),
/// the card, the clock and the range sensors. Then it moves things: the board's self-test turns the shaft, test photos are
/// taken, and the autopilot is asked for the speed limit in the mode it is in, as in flight. In the end the board is at rest
/// again, restarted so that the flight has a log of its own. What only a person can see is marked with a question mark.
///
/// The vehicle must be disarmed, in the tunnel or at its mouth, its camera on. The answer is no (exit code 1), with the reasons,
/// if something speaks against the flight.
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  adit preflight serial:/dev/ttyUSB0:57600 --mission mission.toml\n  \
    adit preflight udpin:0.0.0.0:14550 --still --json")]
pub(super) struct Arguments {
    #[command(flatten)]
    link: LinkArguments,
    /// The mission that is to be flown
    #[arg(long, value_name = "MISSION.toml")]
    mission: Option<PathBuf>,
    /// Move nothing: no self-test, no photo, no speed limit
    #[arg(long)]
    still: bool,
}

pub(super) fn run(arguments: &Arguments, common: &Common) -> Result<Answer> {
    let mission = arguments.mission.as_deref().map(|path| {
        let file = path.display();
        let text = std::fs::read_to_string(path).with_context(|| format!("cannot read mission {file}"))?;
        Mission::from_toml(&text).with_context(|| format!("mission {file}"))
    });
    let mission = mission.transpose()?;
    let options = Options { mission: mission.as_ref(), still: arguments.still, ..Options::default() };
    let list = with_session(&arguments.link, async |session| {
        preflight(session, &options, &mut |words| eprintln!("{words}")).await
    })?;
    print(&list, common)?;
    Ok(if list.is_ready() { Answer::Yes } else { Answer::No })
}
