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
/// Seven variants. SBA is standard bundle adjustment: squared loss, free points, no tags, no surface, no pruning. P1 drops
/// from it the sightings on masked pixels, P2 the points off the section, P3 the sightings of a large reprojection error:
/// P1, P2, P1+P2, P1+P2+P3, each adjusted again afterwards. These five share their matches, which tags guide but no mask.
/// Masked is SBA on matches found with masks, ours what `adit reconstruct` does with these: all steps, robust loss, tags,
/// surface.
///
/// Prints points, observations and the mean reprojection error before and after pruning. This error cannot judge P3, which
/// drops what is large. So each variant is judged by SURVEY/truth as well, if there is one (position errors after the best
/// similarity transform and in the tunnel frame), and by matches in a tenth of the wall that no variant was shown: their
/// median reprojection error, triangulated at the variant's poses. The adjustments have that tenth less to work with than
/// `adit reconstruct`.
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  adit ablation survey\n  adit ablation survey --out figures --json\n\n\
    In the paper, on other photos, mean reprojection error in px of SBA, P1, P2, P1+P2:\n  \
    cylindrical set  0.74, 0.74, 0.65, 0.63\n  spiral set  41.88, 0.69, 1.65, 3.25\n\
    Of its trolley set 24,000 of 105,000 points were pruned.")]
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
