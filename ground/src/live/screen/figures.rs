//! Figures beside the section.

use adit_protocol::telemetry::Enforcement;
use ratatui::layout::Rect;
use ratatui::style::{Style, Stylize};
use ratatui::text::{Line, Span};
use ratatui::widgets::Paragraph;

use super::{BAD, GOOD, QUIET, WARN};
use crate::live::reading::Reading;
use crate::live::view::{RangeState, View};

/// Nearer to the centre than this nobody need steer.
const CENTRED_M: f64 = 0.05;
/// Columns of a label.
const LABEL: usize = 9;

pub(super) fn draw(target: &mut ratatui::Frame<'_>, area: Rect, view: &View) {
    let lines = vec![
        steer(view),
        Line::default(),
        speed(view),
        bar(view, area.width),
        Line::default(),
        photos(view),
        wall(view),
        shaft(view),
        ranges(view),
        row(
            "WATER",
            vec![reading(&view.water_level_m, |level_m| format!("{:.0} cm above the floor", level_m * 100.0))],
        ),
        battery(view),
    ];
    target.render_widget(Paragraph::new(lines), area);
}

fn row(label: &'static str, values: Vec<Span<'static>>) -> Line<'static> {
    let mut spans = vec![Span::styled(format!(" {label:LABEL$}"), QUIET)];
    spans.extend(values);
    Line::from(spans)
}

/// The value in bold; grey where it is old, a dash where there is none.
fn reading<T: Clone>(reading: &Reading<T>, words: impl FnOnce(T) -> String) -> Span<'static> {
    match (&reading.value, reading.is_stale) {
        (None, _) => Span::styled("--", QUIET),
        (Some(value), true) => Span::styled(words(value.clone()), QUIET),
        (Some(value), false) => Span::raw(words(value.clone())).bold(),
    }
}

fn steer(view: &View) -> Line<'static> {
    let Some([right_m, down_m]) = view.steer_m() else {
        let words = if view.offset_m.is_stale { "position is old" } else { "position unknown" };
        return row("STEER", vec![Span::styled(words, WARN.bold())]);
    };
    let arrow = |along_m: f64, [less, more]: [&str; 2]| {
        let words = format!(" {} {:>3.0} cm ", if along_m < 0.0 { less } else { more }, along_m.abs() * 100.0);
        if along_m.abs() < CENTRED_M { Span::styled(words, GOOD) } else { Span::styled(words, WARN.bold().reversed()) }
    };
    let mut values = vec![arrow(right_m, ["◀", "▶"]), Span::raw("  "), arrow(down_m, ["▲", "▼"])];
    if let Some([y_m, z_m]) = view.sigma_m {
        values.push(Span::styled(format!("  ±{:.0} ±{:.0} cm", y_m * 100.0, z_m * 100.0), QUIET));
    }
    row("STEER", values)
}

fn speed(view: &View) -> Line<'static> {
    let (state, style) = match view.enforcement.fresh() {
        Some(Enforcement::Enforced) => ("enforced", GOOD),
        Some(Enforcement::Requested) => ("requested", Style::new()),
        Some(Enforcement::Ineffective) => ("IGNORED", BAD.bold()),
        Some(Enforcement::NotPossible) => ("BY HAND", WARN.bold()),
        Some(Enforcement::Idle) | None => ("", QUIET),
    };
    let speed = reading(&view.speed_mps, |speed_mps| format!("{speed_mps:.2} m/s"));
    let speed = if view.is_overspeed && !view.speed_mps.is_stale { speed.patch_style(BAD.reversed()) } else { speed };
    let limit = reading(&view.limit_mps, |limit_mps| format!("{limit_mps:.2} m/s "));
    row("SPEED", vec![speed, Span::styled("   limit ", QUIET), limit, Span::styled(state, style)])
}

/// The speed as a share of the limit; the limit is at two thirds of the width.
fn bar(view: &View, width: u16) -> Line<'static> {
    let (Some(speed_mps), Some(limit_mps)) = (view.speed_mps.fresh(), view.limit_mps.fresh()) else {
        return Line::default();
    };
    let columns = usize::from(width).saturating_sub(LABEL + 4);
    let mark = columns * 2 / 3;
    let filled = if limit_mps > 0.0 { (speed_mps / limit_mps).max(0.0) * mark as f64 } else { 0.0 };
    let filled = (filled.round() as usize).min(columns);
    let text: String = (0..columns)
        .map(|column| {
            if column == mark {
                '┃'
            } else if column < filled {
                '█'
            } else {
                '─'
            }
        })
        .collect();
    row("", vec![Span::styled(text, if view.is_overspeed { BAD } else { GOOD })])
}

fn photos(view: &View) -> Line<'static> {
    let mut values = vec![reading(&view.captures, |captures| format!("{captures} taken"))];
    let style = if view.captures.is_stale { QUIET } else { Style::new() };
    values.push(match view.confirmed {
        Some(confirmed) => Span::styled(format!("  {confirmed} stored"), style),
        None => Span::styled("  storing not wired", QUIET),
    });
    if let Some(missed) = view.missed.value {
        let words = format!("  {missed} missed");
        values.push(if missed == 0 { Span::styled(words, style) } else { Span::styled(words, WARN.bold()) });
    }
    row("PHOTOS", values)
}

fn wall(view: &View) -> Line<'static> {
    let Some(wall) = view.wall else { return row("WALL", vec![Span::styled("--", QUIET)]) };
    let mut values = vec![Span::raw(format!("{:.1} m² seen", wall.seen_m2)).bold()];
    if wall.marked_m2 > 0.0 {
        values.push(Span::styled(format!("  {:.1} m² missing", wall.marked_m2), WARN.bold()));
    }
    row("WALL", values)
}

fn shaft(view: &View) -> Line<'static> {
    let shaft = reading(&view.shaft_rad, |shaft_rad| format!("{:>3.0}°", shaft_rad.to_degrees()));
    let place = reading(&view.odometer_m, |x_m| format!("place {x_m:.2} m"));
    row("SHAFT", vec![shaft, Span::raw("   "), place])
}

fn ranges(view: &View) -> Line<'static> {
    let arrows = view.ranges.iter().zip(["↑", "→", "↓", "←"]);
    let values = arrows.map(|(range, arrow)| match (range.state, range.range_m) {
        (RangeState::Valid, Some(range_m)) => Span::raw(format!("{arrow}{range_m:.2}  ")).bold(),
        (RangeState::Unfitted, _) => Span::styled(format!("{arrow} none  "), QUIET),
        (RangeState::Unknown, _) => Span::styled(format!("{arrow}--  "), QUIET),
        (_, _) => Span::styled(format!("{arrow}----  "), BAD.bold()),
    });
    row("RANGES", values.collect())
}

fn battery(view: &View) -> Line<'static> {
    let words = reading(&view.battery, |battery| {
        let share = battery.remaining.map(|share| format!("{:.0} %  ", share * 100.0)).unwrap_or_default();
        let voltage = battery.voltage_v.map(|voltage_v| format!("{voltage_v:.1} V")).unwrap_or_default();
        format!("{share}{voltage}")
    });
    row("BATTERY", vec![words])
}
