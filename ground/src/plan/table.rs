//! The plan as a table for people.

use std::fmt;

use adit_geometry::profile::Part;
use adit_protocol::parameters::SpeedBound;

use super::{Bound, Pace, PixelSize, Plan};
use crate::texture::Coverage;

/// So many holes are listed; all are in plan.json.
const LISTED_HOLES: usize = 5;

impl fmt::Display for Plan {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        head(self, out)?;
        offsets(self, out)?;
        if let Some(flight) = &self.flight {
            let slowest = flight.slowest.as_ref();
            writeln!(
                out,
                "\n{:<20}{:>12}{:>12}",
                format!("{:.1} m long", self.asked.length_m),
                "on the axis",
                "slowest"
            )?;
            let mut line = |label: &str, value: &dyn Fn(&Pace) -> String| {
                writeln!(out, "{label:<20}{:>12}{:>12}", value(&flight.planned), slowest.map_or("-".to_owned(), value))
            };
            line("speed, m/s", &|pace| format!("{:.3}", pace.speed_mps))?;
            line("step, mm per image", &|pace| format!("{:.0}", pace.step_m * 1000.0))?;
            line("photos", &|pace| pace.photos.to_string())?;
            line("turns", &|pace| format!("{:.1}", pace.turns))?;
            line("time, min:s", &|pace| minutes(pace.duration_s))?;
            line("storage, GB", &|pace| format!("{:.2}", pace.storage_gb))?;
            line("  of the card", &|pace| percent(pace.card_share))?;
            line("  of the battery", &|pace| percent(pace.battery_share))?;
            writeln!(
                out,
                "on the axis: as the board reckons there, with the camera's answer after {} s\n\
                 slowest: always at the worst place allowed, and a wired camera answers after a whole period",
                self.asked.answer_s
            )?;
            if flight.capped {
                writeln!(out, "the speed is flight.max_speed_mps; the bound would allow more")?;
            }
        }
        if let Some(pixel) = &self.pixel {
            writeln!(out, "\n{:<20}{:>8}{:>8}{:>8}", "mm per pixel", "min", "median", "max")?;
            pixels(out, "wall", &pixel.wall)?;
            if pixel.parts.len() > 1 {
                for (part, size) in &pixel.parts {
                    pixels(out, part_name(*part), size)?;
                }
            }
        }
        if let Some(overlap) = &self.overlap {
            let [photo, turn] = [overlap.next_photo, overlap.next_turn].map(|share| share * 100.0);
            writeln!(out, "\na photo shares       {photo:.0} % with the next, {turn:.0} % with that of the next turn")?;
        }
        if let (Some(between), Some(coverage)) = (&self.between_ends, &self.coverage) {
            writeln!(out, "\n{:<20}{:>9}{:>9}{:>9} photos", "wall seen by", "1+", "2+", "3+")?;
            shares(out, "between the ends", between)?;
            let label = if coverage.x_to_m < self.asked.length_m { "flight of 30 m" } else { "whole flight" };
            shares(out, label, coverage)?;
            holes(out, coverage)?;
        }
        for finding in &self.findings {
            let label = if finding.forbids() { "cannot be flown" } else { "warning" };
            writeln!(out, "\n{label}: {finding}")?;
        }
        Ok(())
    }
}

fn head(plan: &Plan, out: &mut fmt::Formatter<'_>) -> fmt::Result {
    let asked = &plan.asked;
    let bound = match asked.speed_bound {
        SpeedBound::Paper => "paper, at most 1 view",
        SpeedBound::OneView => "1 view",
        SpeedBound::TwoViews => "2 views",
    };
    writeln!(
        out,
        "tunnel              {}, {:.2} m around, {:.2} m from the axis to the nearest wall",
        asked.profile.get("profile").and_then(|name| name.as_str()).unwrap_or_default(),
        asked.perimeter_m,
        asked.clearance_m
    )?;
    let [around_deg, along_deg] = asked.view_rad.map(f64::to_degrees);
    writeln!(
        out,
        "camera              {around_deg:.1} deg around, {along_deg:.1} deg along; {} images per turn, one per {:.2} s",
        asked.images_per_turn, asked.image_period_s
    )?;
    writeln!(
        out,
        "flown               {} of the bound \"{bound}\", latency {} s, at most {} m/s\n",
        asked.speed_margin, asked.latency_s, asked.max_speed_mps
    )
}

fn offsets(plan: &Plan, out: &mut fmt::Formatter<'_>) -> fmt::Result {
    let group = |name: &str| format!("  {name:^14}");
    writeln!(
        out,
        "{:>7}{}{}{}{}  worst at",
        "within",
        group("paper"),
        group("1 view"),
        group("2 views"),
        group("flown")
    )?;
    write!(out, "{:>7}", "m")?;
    for _ in 0..4 {
        write!(out, "  {:>6}{:>8}", "mm", "m/s")?;
    }
    writeln!(out, "  right, down m")?;
    for row in &plan.offsets {
        write!(out, "{:>7.3}", row.offset_m)?;
        for Bound { step_m, speed_mps } in [row.paper, row.one_view, row.two_views, row.flown] {
            write!(out, "  {:>6.0}{speed_mps:>8.3}", step_m * 1000.0)?;
        }
        let [right_m, down_m] = row.worst_at_m;
        write!(out, "  {:+.2}, {:+.2}", tidy(right_m), tidy(down_m))?;
        if let Some(standstill) = &row.standstill {
            write!(out, "  0: {standstill}")?;
        }
        writeln!(out)?;
    }
    writeln!(
        out,
        "within: largest distance from the axis sideways and vertically; each figure at its worst place there\n\
         mm: step per image, and the speed at it; flown: by the next row, with margin, latency and the camera's answer\n\
         paper: its law is for circles; here the largest circle around the axis, {:.2} m in radius",
        plan.asked.clearance_m
    )
}

fn pixels(out: &mut fmt::Formatter<'_>, label: &str, size: &PixelSize) -> fmt::Result {
    writeln!(out, "{label:<20}{:>8.2}{:>8.2}{:>8.2}", size.min_mm, size.median_mm, size.max_mm)
}

fn shares(out: &mut fmt::Formatter<'_>, label: &str, coverage: &Coverage) -> fmt::Result {
    write!(out, "{label:<20}")?;
    for share in coverage.seen_share {
        // Rounded down: 100 % is said only of all of it.
        write!(out, "{:>7.2} %", (share * 10_000.0).floor() / 100.0)?;
    }
    writeln!(out)
}

fn holes(out: &mut fmt::Formatter<'_>, coverage: &Coverage) -> fmt::Result {
    for hole in coverage.holes.iter().take(LISTED_HOLES) {
        writeln!(
            out,
            "  hole              {:.2} to {:.2} m, {:.1} to {:.1} o'clock, {:.3} m2",
            hole.x_from_m, hole.x_to_m, hole.clock_from, hole.clock_to, hole.area_m2
        )?;
    }
    let more = coverage.hole_count.saturating_sub(LISTED_HOLES);
    if more > 0 { writeln!(out, "  and {more} more") } else { Ok(()) }
}

fn part_name(part: Part) -> &'static str {
    match part {
        Part::Lining => "  lining",
        Part::Ceiling => "  ceiling",
        Part::RightWall => "  right wall",
        Part::Floor => "  floor",
        Part::LeftWall => "  left wall",
    }
}

fn minutes(duration_s: f64) -> String {
    let seconds = duration_s.round();
    format!("{:.0}:{:02.0}", (seconds / 60.0).floor(), seconds % 60.0)
}

fn percent(share: Option<f64>) -> String {
    share.map_or("not given".to_owned(), |share| format!("{:.1} %", share * 100.0))
}

/// No "-0.00".
fn tidy(value: f64) -> f64 {
    if value.abs() < 5e-3 { 0.0 } else { value }
}
