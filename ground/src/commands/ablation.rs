//! `adit ablation`.

use std::path::PathBuf;

use adit_ground::ablation::ablate;
use adit_ground::pipeline::Verbosity;
use adit_ground::survey;
use anyhow::{Context, Result};
use clap::Args;

use super::{Answer, Common, print};

/// Show what each pruning step of the adjustment is worth.
///
/// Matches the survey with and without masks, then adjusts in six variants: SBA (standard bundle adjustment: squared loss,
/// free points, no tags, no surface, no pruning), the same with P1 (masks), P2 (points off the section dropped), P1+P2,
/// P1+P2+P3 (sightings of a large reprojection error dropped), and ours, which is what `adit reconstruct` does. All start
/// from the same tag-guided matches, which hold few wrong ones.
///
/// Prints points, observations and the mean reprojection error before and after pruning. This error cannot judge P3, which
/// drops what is large. So each variant is judged by SURVEY/truth as well, if there is one (position errors after the best
/// similarity transform and in the tunnel frame), and by matches in a tenth of the wall that no variant was shown: their
/// median reprojection error, triangulated at the variant's poses. So the adjustments have a tenth less to work with than
/// `adit reconstruct`.
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  adit ablation survey\n  adit ablation survey --out figures --json\n\n\
    In the paper, on other photos (mean reprojection error in px of SBA, P1, P2, P1+P2): cylindrical set 0.74, 0.74, 0.65,\n\
    0.63; spiral set 41.88, 0.69, 1.65, 3.25. Of the trolley set it pruned 24,000 of 105,000 points.")]
pub(super) struct Arguments {
    /// The survey folder (survey.toml, tags.csv, photos/, masks/)
    #[arg(value_name = "SURVEY")]
    survey: PathBuf,
    /// Write ablation.json there
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
}

pub(super) fn run(arguments: &Arguments, common: &Common) -> Result<Answer> {
    let survey = survey::load(&arguments.survey)?;
    for loss in &survey.losses {
        eprintln!("left out: {}: {}", loss.what, loss.why);
    }
    let ablation = ablate(&survey, Verbosity::Talk)?;
    if let Some(folder) = &arguments.out {
        let path = folder.join("ablation.json");
        std::fs::create_dir_all(folder).with_context(|| format!("cannot make {}", folder.display()))?;
        std::fs::write(&path, serde_json::to_vec_pretty(&ablation)?)
            .with_context(|| format!("cannot write {}", path.display()))?;
    }
    print(&ablation, common)?;
    Ok(Answer::Yes)
}
