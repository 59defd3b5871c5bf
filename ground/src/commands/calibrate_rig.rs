//! `adit calibrate-rig`.

use std::path::PathBuf;

use adit_ground::calibrate::calibrate_rig;
use adit_ground::pipeline::Verbosity;
use adit_ground::survey;
use anyhow::{Context, Result};
use clap::Args;

use super::{Answer, Common, print};

/// Calibrate how the camera sits on its shaft: mounting rotation, shaft zero, radial lever arm.
///
/// Takes a survey folder (survey.toml, tags.csv, photos/) of a first turn, or of any flight, in any place with texture on its
/// walls; matches the photos as `adit reconstruct` does, and adjusts with the rig free. Prints each number with its standard
/// deviation, what the survey does not tell, and the rig table for survey.toml and mission.toml.
///
/// The camera's own table must be right before: see `adit calibrate`.
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  adit calibrate-rig first-turn\n  adit calibrate-rig survey --json")]
pub(super) struct Arguments {
    /// The survey folder
    #[arg(value_name = "SURVEY")]
    survey: PathBuf,
}

pub(super) fn run(arguments: &Arguments, common: &Common) -> Result<Answer> {
    let survey = survey::load(&arguments.survey)?;
    for loss in &survey.losses {
        eprintln!("left out: {}: {}", loss.what, loss.why);
    }
    let folder = arguments.survey.display();
    let calibrated = calibrate_rig(&survey, Verbosity::Talk).with_context(|| format!("{folder}: no rig"))?;
    print(&calibrated, common)?;
    Ok(Answer::Yes)
}
