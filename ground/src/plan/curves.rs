//! The speeds over the offset as a drawing.

use std::fmt::Write as _;

use super::{OffsetRow, Plan};

/// Size of the drawing, and of its plot.
const WIDTH: f64 = 640.0;
const HEIGHT: f64 = 400.0;
const LEFT: f64 = 70.0;
const RIGHT: f64 = 500.0;
const TOP: f64 = 40.0;
const BOTTOM: f64 = 340.0;

/// The speeds over the offset.
pub(super) fn speed_svg(plan: &Plan) -> String {
    type Curve = (&'static str, &'static str, fn(&OffsetRow) -> f64);
    let curves: [Curve; 4] = [
        ("1 view", "#2b6cb0", |row| row.one_view.speed_mps),
        ("2 views", "#2f855a", |row| row.two_views.speed_mps),
        ("paper", "#b7791f", |row| row.paper.speed_mps),
        ("flown", "#1a202c", |row| row.flown.speed_mps),
    ];
    let speeds = || plan.offsets.iter().flat_map(|row| curves.iter().map(move |(.., value)| value(row)));
    let step_mps = round_step(speeds().fold(0.0, f64::max) / 5.0);
    let ticks = (speeds().fold(0.0, f64::max) / step_mps).ceil().max(1.0);
    let most_m = plan.offsets.last().map_or(0.0, |row| row.offset_m).max(1e-3);
    let x = |offset_m: f64| LEFT + (RIGHT - LEFT) * offset_m / most_m;
    let y = |speed_mps: f64| BOTTOM - (BOTTOM - TOP) * speed_mps / (step_mps * ticks);
    let mut svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {WIDTH} {HEIGHT}\" font-family=\"sans-serif\" \
         font-size=\"13\" fill=\"#1a202c\">\n<rect width=\"{WIDTH}\" height=\"{HEIGHT}\" fill=\"#fff\"/>\n"
    );
    // Writing to a String cannot fail.
    let _ = writeln!(svg, "<text x=\"{LEFT}\" y=\"22\">Speed in m/s, within a distance from the axis</text>");
    for tick in 0..=ticks as u32 {
        let speed_mps = step_mps * f64::from(tick);
        let at = y(speed_mps);
        let _ = writeln!(
            svg,
            "<path d=\"M{LEFT} {at:.1}H{RIGHT}\" stroke=\"#e2e8f0\"/><text x=\"{}\" y=\"{:.1}\" \
             text-anchor=\"end\">{speed_mps:.2}</text>",
            LEFT - 8.0,
            at + 4.0
        );
    }
    for row in &plan.offsets {
        let _ = writeln!(
            svg,
            "<text x=\"{:.1}\" y=\"{}\" text-anchor=\"middle\">{:.3}</text>",
            x(row.offset_m),
            BOTTOM + 20.0,
            row.offset_m
        );
    }
    let _ = writeln!(
        svg,
        "<text x=\"{}\" y=\"{}\" text-anchor=\"middle\">largest offset sideways and vertically, m</text>",
        f64::midpoint(LEFT, RIGHT),
        BOTTOM + 45.0
    );
    for ((name, colour, value), label_y) in
        curves.iter().zip(label_places(&curves.map(|(.., value)| y(plan.offsets.last().map_or(0.0, value)))))
    {
        let points: Vec<String> =
            plan.offsets.iter().map(|row| format!("{:.1},{:.1}", x(row.offset_m), y(value(row)))).collect();
        let _ = writeln!(
            svg,
            "<polyline points=\"{}\" fill=\"none\" stroke=\"{colour}\" stroke-width=\"2\"/>\
             <text x=\"{}\" y=\"{label_y:.1}\" fill=\"{colour}\">{name}</text>",
            points.join(" "),
            RIGHT + 10.0
        );
    }
    svg.push_str("</svg>\n");
    svg
}

/// Where the labels stand: at their curves' ends, moved down where two would overlap.
fn label_places(ends: &[f64; 4]) -> [f64; 4] {
    let mut order = [0, 1, 2, 3];
    order.sort_by(|a: &usize, b| ends[*a].total_cmp(&ends[*b]));
    let mut places = [0.0; 4];
    let mut last = f64::NEG_INFINITY;
    for index in order {
        last = (ends[index] + 4.0).max(last + 16.0);
        places[index] = last;
    }
    places
}

/// The smallest of 1, 2, 5 times a power of ten that is no smaller; 0.01 for nothing.
fn round_step(at_least: f64) -> f64 {
    if !(at_least > 0.0) {
        return 0.01;
    }
    let decade = 10f64.powf(at_least.log10().floor());
    [1.0, 2.0, 5.0].into_iter().map(|factor| factor * decade).find(|step| *step >= at_least).unwrap_or(decade * 10.0)
}
