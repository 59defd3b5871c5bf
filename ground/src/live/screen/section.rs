//! The cross-section, looking forward.

use std::f64::consts::TAU;

use ratatui::layout::Rect;
use ratatui::style::{Color, Styled, Stylize};
use ratatui::symbols::Marker;
use ratatui::text::Line as Text;
use ratatui::widgets::Paragraph;
use ratatui::widgets::canvas::{Canvas, Context, Line, Points};

use super::{BAD, QUIET};
use crate::live::view::{RangeState, RangeView, View};

/// Room around the section, as a share of it.
const MARGIN: f64 = 0.12;
/// What is drawn of the covariance: 95 % of the section's two directions each.
const SIGMAS: f64 = 2.0;
/// Half the width of the vehicle's mark, as a share of the section's height.
const VEHICLE_SHARE: f64 = 0.06;
/// Where the beams look, `[y, z]` of the body: up, right, down, left.
const BEAMS: [[f64; 2]; 4] = [[0.0, -1.0], [1.0, 0.0], [0.0, 1.0], [-1.0, 0.0]];

pub(super) fn draw(target: &mut ratatui::Frame<'_>, area: Rect, view: &View) {
    let Some(window) = Window::around(&view.outline_m, area) else {
        let words = vec![Text::from(""), Text::from("  Section not known."), Text::from("  Give --mission FILE.")];
        target.render_widget(Paragraph::new(words).style(QUIET), area);
        return;
    };
    let canvas = Canvas::default()
        .marker(Marker::Braille)
        .x_bounds(window.y_m)
        .y_bounds(window.up_m)
        .paint(|context| paint(context, view, &window));
    target.render_widget(canvas, area);
}

/// What of the section's plane is on the screen: y to the right, -z up.
struct Window {
    y_m: [f64; 2],
    up_m: [f64; 2],
    /// Columns of the terminal.
    columns: f64,
}

impl Window {
    fn around(outline_m: &[[f64; 2]], area: Rect) -> Option<Self> {
        let bounds = |of: fn(&[f64; 2]) -> f64| {
            let values = outline_m.iter().map(of);
            (values.clone().fold(f64::INFINITY, f64::min), values.fold(f64::NEG_INFINITY, f64::max))
        };
        let ((left_m, right_m), (low_m, high_m)) = (bounds(|point| point[0]), bounds(|point| -point[1]));
        if outline_m.is_empty() {
            return None;
        }
        // Cells are twice as high as wide.
        let (columns, rows) = (f64::from(area.width.max(1)), 2.0 * f64::from(area.height.max(1)));
        let per_column_m = ((right_m - left_m) / columns).max((high_m - low_m) / rows) * (1.0 + 2.0 * MARGIN);
        let around = |low: f64, high: f64, size: f64| {
            let (middle, half) = (f64::midpoint(low, high), per_column_m * size / 2.0);
            [middle - half, middle + half]
        };
        Some(Self { y_m: around(left_m, right_m, columns), up_m: around(low_m, high_m, rows), columns })
    }
}

fn paint(context: &mut Context<'_>, view: &View, window: &Window) {
    for pair in view.outline_m.windows(2) {
        line(context, pair[0], pair[1], Color::Gray);
    }
    context.draw(&Points { coords: &[(0.0, 0.0)], color: Color::DarkGray });
    let Some([y_m, z_m]) = view.offset_m.value else { return };
    let roll_rad = view.roll_rad.fresh().unwrap_or(0.0);
    let turned = |[y, z]: [f64; 2]| {
        let (sin, cos) = roll_rad.sin_cos();
        [y * cos - z * sin, y * sin + z * cos]
    };
    let at = |[y, z]: [f64; 2], range_m: f64| [y_m + y * range_m, z_m + z * range_m];
    context.layer();
    for (range, beam) in view.ranges.iter().zip(BEAMS) {
        if let Some(range_m) = range.range_m {
            line(context, [y_m, z_m], at(turned(beam), range_m), Color::DarkGray);
        }
    }
    let is_old = view.offset_m.is_stale;
    if let Some(shaft_rad) = view.shaft_rad.fresh() {
        let reach_m = (window.up_m[1] - window.up_m[0]) * 0.25;
        line(context, [y_m, z_m], at(turned([shaft_rad.sin(), -shaft_rad.cos()]), reach_m), Color::Yellow);
    }
    context.layer();
    if let Some([sigma_y_m, sigma_z_m]) = view.sigma_m {
        let ellipse: Vec<(f64, f64)> = (0..48)
            .map(|step| {
                let (sin, cos) = (TAU * f64::from(step) / 48.0).sin_cos();
                (y_m + SIGMAS * sigma_y_m * cos, -(z_m + SIGMAS * sigma_z_m * sin))
            })
            .collect();
        context.draw(&Points { coords: &ellipse, color: Color::Cyan });
    }
    let half_m = (window.up_m[1] - window.up_m[0]) * VEHICLE_SHARE;
    let colour = if is_old { Color::DarkGray } else { Color::White };
    line(context, at(turned([-1.0, 0.0]), half_m), at(turned([1.0, 0.0]), half_m), colour);
    context.layer();
    let dot = if is_old { "○".fg(colour) } else { "●".fg(colour).bold() };
    context.print(y_m, -z_m, Text::from(dot));
    readings(context, &view.ranges, window);
}

/// Each range where it was measured: at the edge that its beam looks at.
fn readings(context: &mut Context<'_>, ranges: &[RangeView; 4], window: &Window) {
    let ([left_m, right_m], [low_m, high_m]) = (window.y_m, window.up_m);
    let (column_m, middle) =
        ((right_m - left_m) / window.columns, [f64::midpoint(left_m, right_m), f64::midpoint(low_m, high_m)]);
    let places = [
        (middle[0] - 2.0 * column_m, high_m),
        (right_m - 4.0 * column_m, middle[1]),
        (middle[0] - 2.0 * column_m, low_m),
        (left_m, middle[1]),
    ];
    for (range, (y, up)) in ranges.iter().zip(places) {
        let words = match (range.state, range.range_m) {
            (RangeState::Valid, Some(range_m)) => format!("{range_m:.2}").bold(),
            (RangeState::Invalid | RangeState::Stale, _) => "----".set_style(BAD.bold().reversed()),
            (RangeState::Unknown, _) => "?".set_style(QUIET),
            _ => continue,
        };
        context.print(y, up, Text::from(words));
    }
}

fn line(context: &mut Context<'_>, from: [f64; 2], to: [f64; 2], color: Color) {
    context.draw(&Line { x1: from[0], y1: -from[1], x2: to[0], y2: -to[1], color });
}
