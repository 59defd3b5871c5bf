//! compare.html: one file, no script, nothing loaded.

use std::fmt::Write as _;

use jpeg_encoder::ColorType;

use super::align::ShiftField;
use super::difference::{CommonGrid, Run};
use super::heights::HeightMap;
use super::{Both, Change, ChangeError, ChangeReport, Region, ReliefChange};
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

/// Difference of heights that is shown in full colour, at least.
const FULL_COLOUR_M: f32 = 0.010;

/// What the page shows.
pub(super) struct Page<'a> {
    pub(super) report: &'a ChangeReport,
    pub(super) both: &'a Both<'a>,
    pub(super) grid: &'a CommonGrid,
    pub(super) field: &'a ShiftField,
    pub(super) runs: &'a [Run],
    /// Rows of the grid.
    pub(super) rows: usize,
    pub(super) map: Option<&'a HeightMap>,
}

impl Page<'_> {
    /// The whole page.
    pub(super) fn html(&self) -> Result<String, ChangeError> {
        let Self { report, both, grid, field, runs, rows, map } = *self;
        let mut page = String::from(HEAD);
        let [a, b] = [&report.a, &report.b].map(|path| escaped(&path.display().to_string()));
        let _ =
            writeln!(page, "<p>A (earlier): {a}<br>B (later): {b}</p>\n<pre>{}</pre>", escaped(&report.to_string()));
        let _ = writeln!(
            page,
            "<h2>Where</h2>\n<p>The wall of A: along the tunnel from left to right, clockwise looking forward from bottom to top. \
             Marked is what B shows <span class=\"d\">darker</span> or <span class=\"b\">brighter</span>.</p>\n<img alt=\"map of \
             changes\" src=\"{}\">",
            overview(both, grid, runs, rows)?
        );
        let _ = writeln!(page, "<h2>The largest {} of {}</h2>", report.changes.len().min(SHOWN), report.changes.len());
        for Change { region, grey } in report.changes.iter().take(SHOWN) {
            let [a, b] = crops(region, both, field)?;
            let _ = writeln!(
                page,
                "<h3>{:.2} m, {:.1} o'clock: {:.0} cm&sup2;, {:+.0} grey levels</h3>\n<figure><img alt=\"A\" src=\"{a}\"><figcaption>A\
                 </figcaption></figure><figure><img alt=\"B\" src=\"{b}\"><figcaption>B</figcaption></figure>",
                region.x_from_m, region.clock_from, region.area_cm2, grey
            );
        }
        if let (Some(map), Some(relief)) = (map, &report.relief) {
            heights(&mut page, map, &relief.changes)?;
        }
        page.push_str("</body></html>\n");
        Ok(page)
    }
}

/// Map and list of what has come in or gone back.
fn heights(page: &mut String, map: &HeightMap, changes: &[ReliefChange]) -> Result<(), ChangeError> {
    let largest_m =
        map.difference_m.iter().filter(|height| !height.is_nan()).fold(0.0_f32, |most, h| most.max(h.abs()));
    let full_m = largest_m.clamp(FULL_COLOUR_M, 5.0 * FULL_COLOUR_M);
    let columns = map.grid.columns;
    let rows = map.difference_m.len() / columns;
    let stride = rows.max(columns).div_ceil(OVERVIEW_PX).max(1);
    let (width, height) = (rows.div_ceil(stride), columns.div_ceil(stride));
    let mut rgb = Vec::with_capacity(width * height * 3);
    for line in (0..height).rev() {
        for row in (0..rows).step_by(stride) {
            rgb.extend(height_colour(map.difference_m[row * columns + line * stride] / full_m));
        }
    }
    let _ = writeln!(
        page,
        "<h2>Height</h2>\n<p>Later less earlier height of the wall, laid out as above, less its mean over 1.4 m: \
         <span class=\"d\">come in</span>, <span class=\"b\">gone back</span>, full colour from {:.0} mm. Grey: not known to \
         both.</p>\n<img alt=\"map of heights\" src=\"{}\">\n<table><tr><th>x</th><th>o'clock</th><th>area\
         </th><th>mean</th></tr>",
        full_m * 1e3,
        jpeg_address(&rgb, [width, height], ColorType::Rgb)?
    );
    for ReliefChange { region, height_mm } in changes {
        let _ = writeln!(
            page,
            "<tr><td>{:.2} to {:.2} m</td><td>{:.1} to {:.1}</td><td>{:.0} cm&sup2;</td><td>{height_mm:+.1} mm</td></tr>",
            region.x_from_m, region.x_to_m, region.clock_from, region.clock_to, region.area_cm2
        );
    }
    let _ = writeln!(page, "</table>{}", if changes.is_empty() { "<p>Nothing has moved.</p>" } else { "" });
    Ok(())
}

/// White at 0, towards the marks' colours at -1 and 1.
fn height_colour(share: f32) -> [u8; 3] {
    if share.is_nan() {
        return [UNSEEN; 3];
    }
    let full = if share > 0.0 { DARKER } else { BRIGHTER };
    full.map(|value| (255.0 + share.abs().min(1.0) * (f32::from(value) - 255.0)) as u8)
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
        let colour = if run.sum < 0.0 { DARKER } else { BRIGHTER };
        for column in (run.columns[0]..=run.columns[1]).step_by(stride) {
            let at = ((height - 1 - (column / stride).min(height - 1)) * width + (run.row / stride).min(width - 1)) * 3;
            rgb[at..at + 3].copy_from_slice(&colour);
        }
    }
    Ok(jpeg_address(&rgb, [width, height], ColorType::Rgb)?)
}

/// The same part of both walls, turned as the overview is.
fn crops(region: &Region, both: &Both<'_>, field: &ShiftField) -> Result<[String; 2], ChangeError> {
    let x_m = [region.x_from_m - AROUND_M, region.x_to_m + AROUND_M];
    let s_m = [region.s_from_m - AROUND_M, region.s_to_m + AROUND_M];
    let longest_m = (x_m[1] - x_m[0]).max(s_m[1] - s_m[0]);
    let step_m = both.step_m.max(longest_m / CROP_PX as f64);
    let (width, height) = (((x_m[1] - x_m[0]) / step_m) as usize, ((s_m[1] - s_m[0]) / step_m) as usize);
    let in_b = [x_m[0], x_m[1]].map(|x_m| field.place_in_b(region.s_from_m, x_m)[1]);
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
