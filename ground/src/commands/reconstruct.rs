//! `adit reconstruct`.

use std::fmt;
use std::path::PathBuf;

use adit_ground::pipeline::{ReconstructOptions, SolveOptions, Stage, Start, Summary, Verbosity, reconstruct};
use anyhow::Result;
use clap::{Args, ValueEnum};
use serde::Serialize;

use super::{Answer, Common, positive, print};

/// Turn a survey folder into poses, a panorama, a textured model and a report.
///
/// Every stage leaves its result in OUT, so a run that was stopped goes on where it was, and a run with other options
/// repeats only what depends on them. Photos and tags that cannot be used are left out, named on standard error and in
/// the report.
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  adit reconstruct demo/survey\n  \
    adit reconstruct survey --out results --mm-per-px 1 --threads 8\n  \
    adit reconstruct survey --stop-after adjust      poses only\n  \
    adit reconstruct survey --match none             a quick look, by the tags alone")]
pub(super) struct Arguments {
    /// The survey folder (survey.toml, tags.csv, photos/, masks/)
    #[arg(value_name = "SURVEY")]
    survey: PathBuf,
    /// Where results go [default: SURVEY/out]
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// How photos are matched
    #[arg(long = "match", value_enum, default_value_t = Strategy::Guided)]
    strategy: Strategy,
    /// Size of the panorama's pixels on the wall, in millimetres [default: the photos' own]
    #[arg(long, value_name = "X", value_parser = positive)]
    mm_per_px: Option<f64>,
    /// Last stage to run
    #[arg(long, value_enum, value_name = "STAGE")]
    stop_after: Option<Stage>,
    /// Leave out a pruning step (may be given more than once)
    #[arg(long, value_enum, value_name = "STEP")]
    without_pruning: Vec<Pruning>,
    /// Forget what earlier runs left in OUT
    #[arg(long)]
    fresh: bool,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Strategy {
    /// Templates on the wall, predicted by the tags; photos without tags are placed as by repmatch
    Guided,
    /// Features first, whatever the tags say, matched by likelihood and motion curves; then as guided
    Repmatch,
    /// Features first, whatever the tags say, matched by the ratio test; then as guided
    Ratio,
    /// Not at all: every photo stays where its tag puts it (feature-less); quick, seams are off by the tags' errors
    None,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Pruning {
    /// P1: points under a mask
    Mask,
    /// P2: points off the section
    Surface,
    /// P3: sightings with a large reprojection error
    Reprojection,
}

/// So many warnings are printed; report.json has all of them.
const SHOWN_WARNINGS: usize = 20;

/// What is printed: where the results are, and the pipeline's summary.
#[derive(Serialize)]
struct Figures {
    out: PathBuf,
    #[serde(flatten)]
    summary: Summary,
}

impl fmt::Display for Figures {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let summary = &self.summary;
        match summary.registered {
            Some(registered) => writeln!(f, "registered photos   {registered} of {}", summary.photos)?,
            None => writeln!(f, "photos              {}", summary.photos)?,
        }
        writeln!(f, "warnings            {}", summary.warnings.len())?;
        writeln!(f, "losses              {}", summary.losses.len())?;
        writeln!(f, "results             {}", self.out.display())
    }
}

pub(super) fn run(arguments: &Arguments, common: &Common) -> Result<Answer> {
    let keep = |step: Pruning| !arguments.without_pruning.contains(&step);
    let out = arguments.out.clone().unwrap_or_else(|| arguments.survey.join("out"));
    let summary = reconstruct(&ReconstructOptions {
        survey: arguments.survey.clone(),
        out: out.clone(),
        mm_per_px: arguments.mm_per_px,
        stop_after: arguments.stop_after,
        fresh: arguments.fresh,
        solve: SolveOptions {
            prune_mask: keep(Pruning::Mask),
            prune_surface: keep(Pruning::Surface),
            prune_reprojection: keep(Pruning::Reprojection),
            start: match arguments.strategy {
                Strategy::Guided => Start::Tags,
                Strategy::Repmatch => Start::RepMatch,
                Strategy::Ratio => Start::Ratio,
                Strategy::None => Start::TagsOnly,
            },
        },
        verbosity: Verbosity::Talk,
    })?;
    for warning in summary.warnings.iter().take(SHOWN_WARNINGS) {
        eprintln!("warning: {warning}");
    }
    if summary.warnings.len() > SHOWN_WARNINGS {
        eprintln!("warning: and {} more, all in report.json", summary.warnings.len() - SHOWN_WARNINGS);
    }
    for loss in &summary.losses {
        eprintln!("left out: {}: {}", loss.what, loss.why);
    }
    let nothing_registered = summary.registered == Some(0);
    print(&Figures { out, summary }, common)?;
    Ok(if nothing_registered { Answer::No } else { Answer::Yes })
}
