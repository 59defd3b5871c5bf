//! The ablation as a table for people.

use std::fmt;

use super::{Ablation, Row};
use crate::adjust::Outcome;

impl fmt::Display for Ablation {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(
            out,
            "{} photos, {} with a mask; {} points held out; position errors are RMSE",
            self.photos, self.masked_photos, self.held_out_points
        )?;
        writeln!(
            out,
            "{:<10}{:>18}{:>18}{:>18}{:>12}{:>10}{:>10}{:>10}",
            "", "points", "observations", "mean error px", "", "aligned", "absolute", "held out"
        )?;
        writeln!(
            out,
            "{:<10}{:>9}{:>9}{:>9}{:>9}{:>9}{:>9}{:>12}{:>10}{:>10}{:>10}",
            "", "before", "after", "before", "after", "before", "after", "registered", "mm", "mm", "px"
        )?;
        self.rows.iter().try_for_each(|row| line(out, row))
    }
}

fn line(out: &mut fmt::Formatter<'_>, row: &Row) -> fmt::Result {
    let rmse = |spread: Option<crate::evaluate::Spread>| {
        spread.map_or_else(|| "-".to_owned(), |spread| format!("{:.3}", spread.rmse))
    };
    let ended = match row.outcome {
        Outcome::Converged => "",
        Outcome::IterationLimit => "  not converged",
        Outcome::Stuck => "  stuck",
    };
    writeln!(
        out,
        "{:<10}{:>9}{:>9}{:>9}{:>9}{:>9.3}{:>9.3}{:>12}{:>10}{:>10}{:>10.3}{ended}",
        row.variant.name(),
        row.points[0],
        row.points[1],
        row.observations[0],
        row.observations[1],
        row.mean_error_px[0],
        row.mean_error_px[1],
        row.registered,
        rmse(row.aligned_mm),
        rmse(row.absolute_mm),
        row.held_out_px,
    )
}
