//! `adit match`.

use std::num::NonZeroUsize;
use std::path::PathBuf;

use adit_ground::comparison::{compare, write_figure};
use adit_ground::pipeline::Verbosity;
use adit_ground::survey;
use anyhow::Result;
use clap::Args;

use super::{Answer, Common, print};

/// Compare the ways of matching photos on the same pairs.
///
/// Runs ratio (SIFT, ratio test, RANSAC), repmatch (SIFT, likelihood and motion curves), orb and gms (binary features with
/// ratio test or motion statistics) and guided (templates on the wall, predicted by the tags) on pairs of successive
/// photos and of photos one turn apart. Prints matches, correct matches, errors of the relative pose and time. Guided runs
/// on the whole survey, both rounds and the adjustment between them included; its time is divided by the pairs it tried.
///
/// Correct is judged by SURVEY/truth. Without one it is judged by the adjusted poses' epipolar lines, which also some wrong
/// matches keep to; the output says so.
#[derive(Debug, Args)]
#[command(
    after_help = "Examples:\n  adit match survey --compare\n  adit match survey --compare --pairs 30 --out figures"
)]
pub(super) struct Arguments {
    /// The survey folder (survey.toml, tags.csv, photos/, masks/)
    #[arg(value_name = "SURVEY")]
    survey: PathBuf,
    /// Compare all strategies
    #[arg(long, required = true)]
    compare: bool,
    /// Pairs of each kind, spread over the survey
    #[arg(long, value_name = "N", default_value = "12")]
    pairs: NonZeroUsize,
    /// Write comparison.html there: the photos with the matches of each strategy
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
}

pub(super) fn run(arguments: &Arguments, common: &Common) -> Result<Answer> {
    let survey = survey::load(&arguments.survey)?;
    for loss in &survey.losses {
        eprintln!("left out: {}: {}", loss.what, loss.why);
    }
    let comparison = compare(&survey, arguments.pairs.get(), Verbosity::Talk)?;
    if let Some(folder) = &arguments.out {
        let path = write_figure(&comparison, &survey, folder)?;
        eprintln!("figure: {}", path.display());
    }
    print(&comparison, common)?;
    Ok(Answer::Yes)
}
