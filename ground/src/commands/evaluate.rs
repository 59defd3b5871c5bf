//! `adit evaluate`.

use std::path::PathBuf;

use adit_ground::evaluate::{Evaluation, evaluate};
use anyhow::Result;
use clap::Args;

use super::{Answer, Common, print};

/// Compare a reconstruction with the truth of a synthetic survey.
///
/// Reads OUT/poses.csv and SURVEY/truth/poses.csv: errors of the optical centres in millimetres and of the orientations
/// in degrees, after the best similarity transform ("aligned", what the photos decide) and as they are in the tunnel
/// frame ("absolute", what the tags add). Drift is how the position error grows per metre of distance from the start, the
/// reconstruction laid onto the truth at its first ten photos, its scale that of the whole.
///
/// If there is a panorama and SURVEY/truth/texture.jpg, patches of 1 m are looked for in it, and the shift is given in
/// millimetres on the wall; and it is counted how much of what a photo saw is coloured.
///
/// If there is OUT/surface and SURVEY/truth/relief.f32, heights of the wall over the section are compared where two or more
/// photos saw it: as they are, and after the rigid motion that lays our photos onto the true ones.
///
/// The answer is no (exit code 1) if a photo of the truth has no adjusted pose, or if a limit given is exceeded.
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  adit evaluate demo/survey\n  \
    adit evaluate survey --max-aligned-mm 1 --max-absolute-mm 5 --min-coloured-percent 99")]
pub(super) struct Arguments {
    /// The survey folder, with truth/
    #[arg(value_name = "SURVEY")]
    survey: PathBuf,
    /// The reconstruction's folder [default: SURVEY/out]
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Largest allowed RMSE of the aligned positions, in millimetres
    #[arg(long, value_name = "MM", value_parser = limit)]
    max_aligned_mm: Option<f64>,
    /// Largest allowed RMSE of the absolute positions, in millimetres
    #[arg(long, value_name = "MM", value_parser = limit)]
    max_absolute_mm: Option<f64>,
    /// Smallest allowed share of the seen wall that is coloured, in percent
    #[arg(long, value_name = "PERCENT", value_parser = limit)]
    min_coloured_percent: Option<f64>,
}

fn limit(text: &str) -> Result<f64, String> {
    let value: f64 = text.parse().map_err(|_| "not a number".to_owned())?;
    if value.is_finite() && value >= 0.0 { Ok(value) } else { Err("expected a number from 0".to_owned()) }
}

pub(super) fn run(arguments: &Arguments, common: &Common) -> Result<Answer> {
    let out = arguments.out.clone().unwrap_or_else(|| arguments.survey.join("out"));
    let evaluation = evaluate(&arguments.survey, &out)?;
    print(&evaluation, common)?;
    let shortfalls = shortfalls(&evaluation, arguments);
    for shortfall in &shortfalls {
        eprintln!("adit: {shortfall}");
    }
    Ok(if shortfalls.is_empty() { Answer::Yes } else { Answer::No })
}

/// What is not as it should be, one line each.
fn shortfalls(evaluation: &Evaluation, limits: &Arguments) -> Vec<String> {
    let mut lines = Vec::new();
    let poses = &evaluation.poses;
    if poses.registered < poses.photos {
        lines.push(format!("{} of {} photos are not registered", poses.photos - poses.registered, poses.photos));
    }
    let aligned = poses.aligned.as_ref().map(|aligned| aligned.errors.position_mm.rmse);
    let absolute = poses.absolute.as_ref().map(|absolute| absolute.position_mm.rmse);
    let coloured = evaluation.coverage.map(|coverage| coverage.coloured_percent);
    let mut check = |what: &str, value: Option<f64>, limit: Option<f64>, at_most: bool| {
        let Some(limit) = limit else { return };
        let word = if at_most { "at most" } else { "at least" };
        match value {
            Some(value) if if at_most { value <= limit } else { value >= limit } => {}
            Some(value) => lines.push(format!("{what} is {value:.3}, asked for {word} {limit}")),
            None => lines.push(format!("{what} could not be measured, asked for {word} {limit}")),
        }
    };
    check("RMSE of aligned positions in mm", aligned, limits.max_aligned_mm, true);
    check("RMSE of absolute positions in mm", absolute, limits.max_absolute_mm, true);
    check("percentage of the seen wall that is coloured", coloured, limits.min_coloured_percent, false);
    lines
}
