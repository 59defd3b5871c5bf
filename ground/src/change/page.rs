//! compare.html: one file, no script, nothing loaded.

use std::fmt::Write as _;

use jpeg_encoder::ColorType;

use super::align::ShiftField;
use super::difference::{CommonGrid, Run};
use super::{Both, Change, ChangeError, ChangeReport};
use crate::report::jpeg_address;

/// Longest side of the overview.
const OVERVIEW_PX: usize = 1800;
/// Changes shown side by side; all are in compare.json.
const SHOWN: usize = 24;
/// Wall around a change, at least.
const AROUND_M: f64 = 0.15;
/// Longest side of a crop; larger changes are shown coarser.
const CROP_PX: usize = 420;
/// Grey of what no photo saw.
const UNSEEN: u8 = 236;
/// Marks of what became darker and brighter.
const DARKER: [u8; 3] = [214, 39, 40];
const BRIGHTER: [u8; 3] = [31, 119, 220];

const HEAD: &str = "<!doctype html>\n<html lang=\"en\"><head><meta charset=\"utf-8\"><title>Two surveys compared</title>\n\
    <style>body{font:15px/1.5 sans-serif;margin:2em;background:#fff;color:#222;max-width:1500px}\
    img{max-width:100%;image-rendering:auto;border:1px solid #ccc}table{border-collapse:collapse}\
    td,th{padding:.2em .8em;text-align:right;border-bottom:1px solid #ddd}figure{display:inline-block;margin:.6em}\
    .d{color:#d62728}.b{color:#1f77dc}</style></head><body>\n<h1>Two surveys compared</h1>\n";

/// The whole page.
pub(super) fn page(
    report: &ChangeReport,
    both: &Both<'_>,
    grid: &CommonGrid,
    field: &ShiftField,
    runs: &[Run],
    rows: usize,
) -> Result<String, ChangeError> {
    let mut page = String::from(HEAD);
    let [a, b] = [&report.a, &report.b].map(|path| escaped(&path.display().to_string()));
    let _ = writeln!(page, "<p>A (earlier): {a}<br>B (later): {b}</p>\n<pre>{}</pre>", escaped(&report.to_string()));
    let _ = writeln!(
        page,
        "<h2>Where</h2>\n<p>The wall of A: along the tunnel from left to right, clockwise looking forward from bottom to top. \
         Marked is what B shows <span class=\"d\">darker</span> or <span class=\"b\">brighter</span>.</p>\n<img alt=\"map of \
         changes\" src=\"{}\">",
        overview(both, grid, runs, rows)?
    );
    let _ = writeln!(page, "<h2>The largest {} of {}</h2>", report.changes.len().min(SHOWN), report.changes.len());
    for change in report.changes.iter().take(SHOWN) {
        let [a, b] = crops(change, both, field)?;
        let _ = writeln!(
            page,
            "<h3>{:.2} m, {:.1} o'clock: {:.0} cm&sup2;, {:+.0} grey levels</h3>\n<figure><img alt=\"A\" src=\"{a}\"><figcaption>A\
             </figcaption></figure><figure><img alt=\"B\" src=\"{b}\"><figcaption>B</figcaption></figure>",
            change.x_from_m, change.clock_from, change.area_cm2, change.grey
        );
    }
    page.push_str("</body></html>\n");
    Ok(page)
}

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;")
}

fn overview(both: &Both<'_>, grid: &CommonGrid, runs: &[Run], rows: usize) -> Result<String, ChangeError> {
    let stride = rows.max(grid.columns).div_ceil(OVERVIEW_PX).max(1);
    let (width, height) = (rows.div_ceil(stride).max(1), grid.columns.div_ceil(stride));
    let whole = [grid.x0_m, grid.x0_m + rows as f64 * grid.step_m];
    let wall = both.a.band(whole, stride as f64 * grid.step_m)?;
    let mut rgb = Vec::with_capacity(width * height * 3);
    for line in (0..height).rev() {
        for column in 0..width {
            let [s_m, x_m] = grid.place(line * stride, column * stride);
            rgb.extend([byte(wall.sample(s_m, x_m)); 3]);
        }
    }
    for run in runs {
        let colour = if run.grey_sum < 0.0 { DARKER } else { BRIGHTER };
        for column in (run.columns[0]..=run.columns[1]).step_by(stride) {
            let at = ((height - 1 - (column / stride).min(height - 1)) * width + (run.row / stride).min(width - 1)) * 3;
            rgb[at..at + 3].copy_from_slice(&colour);
        }
    }
    Ok(jpeg_address(&rgb, [width, height], ColorType::Rgb)?)
}

/// The same part of both walls, turned as the overview is.
fn crops(change: &Change, both: &Both<'_>, field: &ShiftField) -> Result<[String; 2], ChangeError> {
    let x_m = [change.x_from_m - AROUND_M, change.x_to_m + AROUND_M];
    let s_m = [change.s_from_m - AROUND_M, change.s_to_m + AROUND_M];
    let longest_m = (x_m[1] - x_m[0]).max(s_m[1] - s_m[0]);
    let step_m = both.step_m.max(longest_m / CROP_PX as f64);
    let (width, height) = (((x_m[1] - x_m[0]) / step_m) as usize, ((s_m[1] - s_m[0]) / step_m) as usize);
    let in_b = [x_m[0], x_m[1]].map(|x_m| field.place_in_b(change.s_from_m, x_m)[1]);
    let a = both.a.band(x_m, step_m)?;
    let b = both.b.band([in_b[0] - both.margin_m, in_b[1] + both.margin_m], step_m)?;
    let mut pictures = [Vec::new(), Vec::new()];
    for line in (0..height).rev() {
        for column in 0..width {
            let at = |start_m: f64, index: usize| start_m + (index as f64 + 0.5) * step_m;
            let (s_m, x_m) = (at(s_m[0], line), at(x_m[0], column));
            let [s_in_b_m, x_in_b_m] = field.place_in_b(s_m, x_m);
            pictures[0].push(byte(a.sample(s_m, x_m)));
            pictures[1].push(byte(b.sample(s_in_b_m, x_in_b_m)));
        }
    }
    let [a, b] = pictures.map(|grey| jpeg_address(&grey, [width, height], ColorType::Luma));
    Ok([a?, b?])
}

fn byte(grey: f32) -> u8 {
    if grey.is_nan() { UNSEEN } else { grey.round() as u8 }
}
