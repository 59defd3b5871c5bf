//! `adit ingest`.

use std::path::PathBuf;

use adit_ground::ingest::{IngestOptions, ingest};
use anyhow::Result;
use clap::Args;

use super::{Answer, Common, print};

/// Make a survey folder from board logs and the camera's card.
///
/// Captures and photos are paired by the differences of their times: the camera's clock need not be set, may run up to
/// about 100 ppm too fast or too slow, and may write whole seconds only; shots may be missed, photos may be surplus,
/// names may wrap from GOPR9999 to GOPR0001 and folders step from 100GOPRO to 101GOPRO. What has no partner is named.
///
/// Photos are linked (or copied, across file systems), never moved; SURVEY/ingest.json says what was done. Run it again
/// after it was stopped, or with more logs.
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  \
    adit ingest --log board.log --photos /media/card/DCIM --mission mission.toml --out survey\n  \
    adit ingest --log 1.log 2.log --photos DCIM --mission mission.toml --out survey --json")]
pub(super) struct Arguments {
    /// Board logs, in the order in which they were written
    #[arg(long = "log", value_name = "FILE", required = true, num_args = 1..)]
    logs: Vec<PathBuf>,
    /// The card, its DCIM folder, or any folder of JPEG files
    #[arg(long, value_name = "DIR")]
    photos: PathBuf,
    /// The mission file that was flown
    #[arg(long, value_name = "MISSION.toml")]
    mission: PathBuf,
    /// The survey folder to make
    #[arg(long, value_name = "SURVEY")]
    out: PathBuf,
}

pub(super) fn run(arguments: &Arguments, common: &Common) -> Result<Answer> {
    let report = ingest(&IngestOptions {
        logs: arguments.logs.clone(),
        photos: arguments.photos.clone(),
        mission: arguments.mission.clone(),
        out: arguments.out.clone(),
    })?;
    print(&report, common)?;
    Ok(Answer::Yes)
}
