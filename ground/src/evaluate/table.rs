//! The evaluation as a table for people.

use std::fmt;

use super::{Evaluation, FrameErrors, ReliefEvaluation, Spread};

/// At most so many names of photos are listed.
const LISTED: usize = 10;

impl fmt::Display for Evaluation {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        let poses = &self.poses;
        writeln!(out, "registered photos   {} of {}", poses.registered, poses.photos)?;
        for (label, names) in
            [("  prior only", &poses.prior_only), ("  missing", &poses.missing), ("  unknown", &poses.unknown)]
        {
            if !names.is_empty() {
                writeln!(out, "{label:<20}{}", shorten(names))?;
            }
        }
        writeln!(out, "{:<20}{:>10}{:>10}{:>10}{:>10}", "", "RMSE", "median", "95 %", "max")?;
        if let Some(aligned) = &poses.aligned {
            frame(out, "aligned", &aligned.errors)?;
            writeln!(out, "{:<20}{:>+10.4} %", "  scale error", aligned.scale_error_percent)?;
        } else {
            writeln!(out, "aligned             not determined (fewer than three photos, or all on a line)")?;
        }
        if let Some(absolute) = &poses.absolute {
            frame(out, "absolute", absolute)?;
        }
        if let Some(drift) = poses.drift_mm_per_m {
            writeln!(out, "{:<20}{drift:>10.3} mm per metre from the start", "drift")?;
        }
        if let Some(shift) = &self.panorama {
            writeln!(
                out,
                "panorama            {} of {} patches of 1 m found in the true texture",
                shift.matched, shift.patches
            )?;
            line(out, "  shift", &shift.absolute_mm, "mm", 2)?;
            line(out, "  without common", &shift.relative_mm, "mm", 2)?;
            writeln!(
                out,
                "{:<20}{:>+10.2} mm around, {:+.2} mm along",
                "  common offset", shift.common_s_mm, shift.common_x_mm
            )?;
        }
        if let Some(coverage) = &self.coverage {
            writeln!(
                out,
                "coloured            {:.2} % of {} wall cells (5 cm) that a photo saw",
                coverage.coloured_percent, coverage.seen
            )?;
        }
        if let Some(relief) = &self.relief {
            table_of_relief(out, relief)?;
        }
        for note in &self.notes {
            writeln!(out, "note: {note}")?;
        }
        Ok(())
    }
}

fn frame(out: &mut fmt::Formatter<'_>, label: &str, errors: &FrameErrors) -> fmt::Result {
    line(out, &format!("{label} position"), &errors.position_mm, "mm", 3)?;
    line(out, &format!("{label} rotation"), &errors.rotation_deg, "deg", 4)?;
    writeln!(out, "  worst photo       {}", errors.worst_photo)
}

fn table_of_relief(out: &mut fmt::Formatter<'_>, relief: &ReliefEvaluation) -> fmt::Result {
    writeln!(
        out,
        "relief              {:.2} % known of {} places (25 mm) that two photos saw",
        relief.known_percent, relief.places
    )?;
    let rows = [
        ("  absolute", &relief.absolute_mm),
        ("  aligned", &relief.aligned_mm),
        ("  shape", &relief.shape_mm),
        ("  filled too", &relief.filled_mm),
        ("  true relief", &relief.true_relief_mm),
    ];
    for (label, errors) in rows {
        line(out, label, errors, "mm", 2)?;
    }
    writeln!(out, "{:<20}{:>+10.2} mm of height, from the section's size", "  constant", relief.constant_mm)?;
    if let Some(percent) = relief.ovality_error_percent {
        writeln!(out, "{:<20}{percent:>10.3} % at most in {} rings", "  ovality error", relief.rings.len())?;
    }
    Ok(())
}

fn line(out: &mut fmt::Formatter<'_>, label: &str, spread: &Spread, unit: &str, decimals: usize) -> fmt::Result {
    let Spread { rmse, median, p95, max } = spread;
    writeln!(out, "{label:<20}{rmse:>10.decimals$}{median:>10.decimals$}{p95:>10.decimals$}{max:>10.decimals$} {unit}")
}

fn shorten(names: &[String]) -> String {
    let listed: Vec<&str> = names.iter().take(LISTED).map(String::as_str).collect();
    let more = names.len().saturating_sub(LISTED);
    if more > 0 { format!("{} and {more} more", listed.join(", ")) } else { listed.join(", ") }
}
