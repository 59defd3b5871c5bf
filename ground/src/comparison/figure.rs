//! The comparison as a picture: the same two photos once per strategy, with the matches drawn from one to the other.

use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use jpeg_encoder::ColorType;

use super::{Comparison, PairKind, PairResult};
use crate::files::write_whole;
use crate::report::jpeg_address;
use crate::survey::{Size, Survey, decode_rgb};

/// Most matches drawn per strategy: more make one green surface.
const DRAWN: usize = 400;

/// Longest side of an embedded photo, pixels.
const LONGEST_PX: usize = 1000;

/// Writes `comparison.html` (one file, no script, nothing loaded) into `folder` and returns its path.
///
/// Of each kind of pair it shows the middle one.
///
/// # Errors
/// If a photo cannot be decoded or the file cannot be written.
pub fn write_figure(comparison: &Comparison, survey: &Survey, folder: &Path) -> Result<PathBuf> {
    let mut page = String::from(HEAD);
    for kind in [PairKind::Successive, PairKind::NextTurn] {
        let of_kind: Vec<&PairResult> = comparison.results.iter().filter(|result| result.kind == kind).collect();
        let Some(middle) = of_kind.get(of_kind.len() / 2) else { continue };
        let shown: Vec<&PairResult> = of_kind.iter().filter(|result| result.photos == middle.photos).copied().collect();
        pair(&mut page, survey, middle.photos, &shown)?;
    }
    let _ = writeln!(page, "<pre>{comparison}</pre>\n</body></html>");
    fs::create_dir_all(folder).with_context(|| format!("cannot make {}", folder.display()))?;
    let path = folder.join("comparison.html");
    write_whole(&path, page.as_bytes()).with_context(|| format!("cannot write {}", path.display()))?;
    Ok(path)
}

const HEAD: &str = "<!doctype html>\n<html lang=\"en\"><head><meta charset=\"utf-8\"><title>Matches by strategy</title>\n\
    <style>body{font:15px sans-serif;margin:2em;background:#fff;color:#222}svg{width:100%;max-width:1400px;display:block}\
    .right{stroke:#1b9e3e;stroke-opacity:.55}.wrong{stroke:#d7191c;stroke-opacity:.8}pre{overflow-x:auto}</style>\
    </head><body>\n<h1>The same photos, matched by each strategy</h1>\n\
    <p>Green: both ends show the same point of the wall. Red: they do not.</p>\n";

/// The two photos once per strategy; the pictures are embedded once and used by all.
fn pair(page: &mut String, survey: &Survey, photos: [usize; 2], results: &[&PairResult]) -> Result<()> {
    let camera = &survey.config.camera.camera;
    let (width, height) = (camera.width_px, camera.height_px);
    let names = photos.map(|photo| &survey.photos[photo].name);
    let _ = writeln!(page, "<h2>{} and {}</h2>", names[0], names[1]);
    let _ = writeln!(page, "<svg style=\"height:0\" viewBox=\"0 0 1 1\"><defs>");
    for photo in photos {
        let data = embedded(&survey.photos[photo].path, Size { width_px: width, height_px: height })?;
        let _ = writeln!(
            page,
            "<image id=\"p{}-{}\" width=\"{width}\" height=\"{height}\" href=\"{data}\"/>",
            photos[0], photo
        );
    }
    let _ = writeln!(page, "</defs></svg>");
    for result in results {
        let stride = result.matches.len().div_ceil(DRAWN).max(1);
        let (found, correct) = (result.matches.len(), result.correct());
        let part = if stride > 1 { format!(", one in {stride} drawn") } else { String::new() };
        let _ = writeln!(page, "<h3>{}: {found} matches, {correct} correct{part}</h3>", result.strategy.name());
        let _ = writeln!(page, "<svg viewBox=\"0 0 {} {height}\" stroke-width=\"1.2\">", 2 * width);
        let _ = writeln!(page, "<use href=\"#p{}-{}\"/>", photos[0], photos[0]);
        let _ = writeln!(page, "<use href=\"#p{}-{}\" x=\"{width}\"/>", photos[0], photos[1]);
        // The wrong ones last, so that they lie on top.
        let mut drawn: Vec<_> = result.matches.iter().step_by(stride).collect();
        drawn.sort_by_key(|(_, correct)| !*correct);
        for ([first, second], correct) in drawn {
            let class = if *correct { "right" } else { "wrong" };
            let _ = writeln!(
                page,
                "<line class=\"{class}\" x1=\"{:.1}\" y1=\"{:.1}\" x2=\"{:.1}\" y2=\"{:.1}\"/>",
                first[0],
                first[1],
                second[0] + f64::from(width),
                second[1]
            );
        }
        let _ = writeln!(page, "</svg>");
    }
    Ok(())
}

/// A photo of at most [`LONGEST_PX`] as a data address.
fn embedded(path: &Path, size: Size) -> Result<String> {
    let photo = decode_rgb(path, size)?;
    let stride = photo.width.max(photo.height).div_ceil(LONGEST_PX).max(1);
    let (width, height) = (photo.width / stride, photo.height / stride);
    let mut rgb = Vec::with_capacity(width * height * 3);
    for row in 0..height {
        for column in 0..width {
            rgb.extend(photo.at(column * stride, row * stride));
        }
    }
    Ok(jpeg_address(&rgb, [width, height], ColorType::Rgb)?)
}
