//! The comparison as a table for people.

use std::fmt;

use super::{Comparison, PairKind, Reference, StrategyName};

impl StrategyName {
    /// As the command line and the table have it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Ratio => "ratio",
            Self::Orb => "orb",
            Self::Gms => "gms",
            Self::Repmatch => "repmatch",
            Self::Guided => "guided",
        }
    }
}

impl fmt::Display for Comparison {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.reference {
            Reference::Truth => writeln!(
                out,
                "correct: both pixels see the same point of the true section, to {} px in either photo",
                self.correct_px
            )?,
            Reference::Adjusted => writeln!(
                out,
                "no truth/poses.csv: \"correct\" only means within {} px of the epipolar line by the adjusted poses",
                self.correct_px
            )?,
        }
        writeln!(
            out,
            "features: {:.3} s per photo for sift (ratio, repmatch), {:.3} s for orb (orb, gms); {} threads",
            self.sift_seconds_per_photo, self.orb_seconds_per_photo, self.threads
        )?;
        let mut last = None;
        for row in &self.rows {
            if last.replace(row.kind) != Some(row.kind) {
                heading(out, row.kind, row.pairs)?;
            }
            let or_dash = |value: Option<f64>, decimals: usize| {
                value.map_or_else(|| "-".to_owned(), |value| format!("{value:.decimals$}"))
            };
            let solved = |value: f64| or_dash((row.solved > 0).then_some(value), 3);
            writeln!(
                out,
                "{:<10}{:>9}{:>11.0}{:>9.0}{:>9.0}{:>8}{:>8}{:>8}{:>10}{:>10}{:>10}{:>10}{:>8.3}",
                row.strategy.name(),
                or_dash(row.features, 0),
                row.tentative,
                row.matches,
                row.correct,
                row.fewest_correct,
                or_dash(row.precision_percent, 1),
                format!("{}/{}", row.solved, row.pairs),
                solved(row.rotation_error_deg.median),
                solved(row.rotation_error_deg.max),
                solved(row.direction_error_deg.median),
                solved(row.direction_error_deg.max),
                row.seconds_per_pair,
            )?;
        }
        Ok(())
    }
}

fn heading(out: &mut fmt::Formatter<'_>, kind: PairKind, pairs: usize) -> fmt::Result {
    let what = match kind {
        PairKind::Successive => "successive photos",
        PairKind::NextTurn => "photos one turn apart",
    };
    writeln!(out, "\n{pairs} pairs of {what}; per pair, means; errors of the relative pose in degrees")?;
    writeln!(
        out,
        "{:<10}{:>9}{:>11}{:>9}{:>9}{:>8}{:>8}{:>8}{:>20}{:>20}{:>8}",
        "", "", "", "", "", "fewest", "", "", "rotation error", "direction error", ""
    )?;
    writeln!(
        out,
        "{:<10}{:>9}{:>11}{:>9}{:>9}{:>8}{:>8}{:>8}{:>10}{:>10}{:>10}{:>10}{:>8}",
        "",
        "features",
        "tentative",
        "matches",
        "correct",
        "correct",
        "%",
        "solved",
        "median",
        "max",
        "median",
        "max",
        "s"
    )
}
