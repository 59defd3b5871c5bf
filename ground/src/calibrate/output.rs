//! Writes what a calibration leaves: camera.toml, calibration.json, undistorted.jpg, and calibration.html, in which every
//! photo is shown with its corners, for a wrong board is seen at once and hardly ever in figures.

use std::fmt::Write as _;
use std::io;
use std::path::{Path, PathBuf};

use jpeg_encoder::{ColorType, Encoder, EncodingError};
use nalgebra::Vector2;

use super::{Calibration, CalibrationPhoto, Corner, Fit};
use crate::files::write_whole;
use crate::raster::Rgb8;
use crate::report::jpeg_address;
use crate::survey::{PhotoError, decode_rgb};

/// Longest side of a photo in the page.
const SHOWN_PX: usize = 900;
/// Errors are drawn so many times as long.
const ENLARGED: f64 = 40.0;
/// Quality of undistorted.jpg.
const QUALITY: u8 = 90;

/// Why a file cannot be written.
#[derive(Debug, thiserror::Error)]
pub enum OutputError {
    /// A folder or file cannot be made.
    #[error("cannot write {}", path.display())]
    Io {
        /// Which.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// A photo that was read before cannot be read again.
    #[error(transparent)]
    Photo(#[from] PhotoError),
    /// The figures cannot be encoded.
    #[error("calibration.json")]
    Json(#[from] serde_json::Error),
    /// A picture cannot be encoded.
    #[error("a picture")]
    Picture(#[from] EncodingError),
}

/// Writes calibration.json and calibration.html, and if there is a camera camera.toml and undistorted.jpg.
///
/// # Errors
/// [`OutputError`] names the file.
pub fn write(calibration: &Calibration, out: &Path) -> Result<(), OutputError> {
    std::fs::create_dir_all(out).map_err(|source| OutputError::Io { path: out.to_owned(), source })?;
    let save = |name: &str, content: &[u8]| {
        let path = out.join(name);
        write_whole(&path, content).map_err(|source| OutputError::Io { path, source })
    };
    let figures = calibration.figures();
    save("calibration.json", serde_json::to_string_pretty(&figures)?.as_bytes())?;
    if let Some(toml) = &figures.camera_toml {
        save("camera.toml", toml.as_bytes())?;
    }
    let undistorted = calibration.fit.as_ref().map(|fit| undistorted(calibration, fit)).transpose()?.flatten();
    if let Some(picture) = &undistorted {
        let mut jpeg = Vec::new();
        let (width, height) = (picture.width as u16, picture.height as u16);
        Encoder::new(&mut jpeg, QUALITY).encode(&picture.data, width, height, ColorType::Rgb)?;
        save("undistorted.jpg", &jpeg)?;
    }
    save("calibration.html", page(calibration, &figures.to_string(), undistorted.is_some())?.as_bytes())
}

const HEAD: &str = "<!doctype html>\n<html lang=\"en\"><head><meta charset=\"utf-8\"><title>Calibration</title>\n\
    <style>body{font:15px/1.5 sans-serif;margin:2em;background:#fff;color:#222}figure{display:inline-block;margin:.6em;\
    vertical-align:top}svg{width:60em;max-width:100%;border:1px solid #ccc}figure svg{width:30em}img{max-width:60em;width:100%}\
    .no{color:#b00}.hint{color:#a50}</style></head><body>\n<h1>Calibration</h1>\n";

fn page(calibration: &Calibration, figures: &str, undistorted: bool) -> Result<String, OutputError> {
    let mut page = String::from(HEAD);
    // Writing to a String cannot fail.
    for hint in &calibration.hints {
        let _ = writeln!(page, "<p class=\"hint\">{}</p>", escaped(&hint.to_string()));
    }
    let _ = writeln!(page, "<pre>{}</pre>", escaped(figures));
    if let Some(fit) = &calibration.fit {
        let _ = writeln!(
            page,
            "<h2>All corners</h2>\n<p>Every corner where it was seen, and its error {ENLARGED} times as long. Errors that lie \
             alike in one place say that the lens is not as its model, or the board not flat.</p>\n{}",
            all_corners(calibration, fit)
        );
    }
    if undistorted {
        page.push_str(
            "<h2>Undistorted</h2>\n<p>The photo with the widest board as a pinhole would have taken it: what is straight must look \
             straight.</p>\n<img alt=\"undistorted\" src=\"undistorted.jpg\">\n",
        );
    }
    page.push_str("<h2>Photos</h2>\n<p>Circles are corners in the order of the line; the first is filled.</p>\n");
    for (index, photo) in calibration.photos.iter().enumerate() {
        let _ = writeln!(page, "<figure>{}", drawn(calibration, photo)?);
        let _ = write!(page, "<figcaption>{}", escaped(&photo.name));
        let fitted = calibration.fit.as_ref().and_then(|fit| fit.photos.iter().find(|fitted| fitted.index == index));
        match (&photo.unused, fitted) {
            (Some(reason), _) => {
                let _ = write!(page, " <span class=\"no\">not used: {}</span>", escaped(&reason.to_string()));
            }
            (None, Some(fitted)) => {
                let _ = write!(page, " {:.3} px", fitted.rms_px);
            }
            (None, None) => {}
        }
        page.push_str("</figcaption></figure>\n");
    }
    page.push_str("</body></html>\n");
    Ok(page)
}

/// A photo with its corners; the empty string if it cannot be shown.
fn drawn(calibration: &Calibration, photo: &CalibrationPhoto) -> Result<String, OutputError> {
    let size = calibration.size;
    let Ok(pixels) = decode_rgb(&photo.path, size) else { return Ok(String::new()) };
    let stride = pixels.width.max(pixels.height).div_ceil(SHOWN_PX).max(1);
    let mut rgb = Vec::new();
    for row in (0..pixels.height).step_by(stride) {
        for column in (0..pixels.width).step_by(stride) {
            rgb.extend(pixels.at(column, row));
        }
    }
    let shown = [pixels.width.div_ceil(stride), pixels.height.div_ceil(stride)];
    let (width, height) = (size.width_px, size.height_px);
    let mut svg = format!(
        "<svg viewBox=\"0 0 {width} {height}\"><image width=\"{width}\" height=\"{height}\" href=\"{}\"/>",
        jpeg_address(&rgb, shown, ColorType::Rgb)?
    );
    if !photo.corners.is_empty() {
        let corners = || photo.corners.iter().map(|corner| corner.pixel);
        let line: Vec<String> = corners().map(|at| format!("{:.1},{:.1}", at.x, at.y)).collect();
        let stroke = f64::from(width) / 500.0;
        let _ = write!(
            svg,
            "<polyline points=\"{}\" fill=\"none\" stroke=\"#0a0\" stroke-width=\"{stroke:.1}\"/>",
            line.join(" ")
        );
        for (index, at) in corners().enumerate() {
            let fill = if index == 0 { "#f00" } else { "none" };
            let _ = write!(
                svg,
                "<circle cx=\"{:.1}\" cy=\"{:.1}\" r=\"{:.1}\" fill=\"{fill}\" stroke=\"#f00\" stroke-width=\"{stroke:.1}\"/>",
                at.x,
                at.y,
                3.0 * stroke
            );
        }
    }
    svg.push_str("</svg>");
    Ok(svg)
}

/// The corners of all photos used, with their errors.
fn all_corners(calibration: &Calibration, fit: &Fit) -> String {
    let (width, height) = (calibration.size.width_px, calibration.size.height_px);
    let radius = f64::from(width) / 400.0;
    let mut svg = format!("<svg viewBox=\"0 0 {width} {height}\">");
    for share in [1, 2] {
        let (x, y) = (width * share / 3, height * share / 3);
        let _ = write!(svg, "<path d=\"M{x} 0V{height}M0 {y}H{width}\" stroke=\"#ddd\" stroke-width=\"{radius:.1}\"/>");
    }
    for photo in &fit.photos {
        for Corner { number, pixel: corner } in &calibration.photos[photo.index].corners {
            let place = calibration.board.place(*number);
            let point = photo.cam_from_board.rotation * place + photo.cam_from_board.translation.vector;
            let Some(seen) = fit.camera.project(&point) else { continue };
            let end = corner + (corner - seen) * ENLARGED;
            let _ = write!(
                svg,
                "<path d=\"M{:.1} {:.1}L{:.1} {:.1}\" stroke=\"#06c\" stroke-width=\"{:.1}\"/>\
                 <circle cx=\"{:.1}\" cy=\"{:.1}\" r=\"{radius:.1}\"/>",
                corner.x,
                corner.y,
                end.x,
                end.y,
                radius * 0.6,
                corner.x,
                corner.y
            );
        }
    }
    svg.push_str("</svg>");
    svg
}

/// The photo with the widest board as a pinhole camera of the same size and principal point would have taken it; its focal
/// length is such that the middles of the photo's sides stay in view, up to 78 degrees from the axis. `None` without a photo.
fn undistorted(calibration: &Calibration, fit: &Fit) -> Result<Option<Rgb8>, OutputError> {
    let extent = |index: usize| {
        let corners = &calibration.photos[index].corners;
        let (low, high) = corners.iter().fold(
            (Vector2::repeat(f64::MAX), Vector2::repeat(f64::MIN)),
            |(low, high): (Vector2<f64>, Vector2<f64>), at| (low.inf(&at.pixel), high.sup(&at.pixel)),
        );
        (high - low).product()
    };
    let widest = fit.photos.iter().max_by(|a, b| extent(a.index).total_cmp(&extent(b.index)));
    let Some(widest) = widest else { return Ok(None) };
    let focal_px = pinhole_focal_px(fit);
    let photo = decode_rgb(&calibration.photos[widest.index].path, calibration.size)?;
    let mut out = Rgb8::new(photo.width, photo.height);
    let [cx, cy] = fit.camera.centre_px;
    for row in 0..out.height {
        for column in 0..out.width {
            let ray = Vector2::new(column as f64 + 0.5 - cx, row as f64 + 0.5 - cy) / focal_px;
            let seen = fit.camera.project(&ray.push(1.0)).filter(|seen| fit.camera.contains(seen, 1.0));
            if let Some(seen) = seen {
                out.set(column, row, interpolated(&photo, seen.x - 0.5, seen.y - 0.5));
            }
        }
    }
    Ok(Some(out))
}

/// Where the model ends before a side (Brown-Conrady folds back there), the last place before is taken for its middle.
fn pinhole_focal_px(fit: &Fit) -> f64 {
    const STEPS: u32 = 50;
    let camera = &fit.camera;
    let (width, height) = (f64::from(camera.width_px), f64::from(camera.height_px));
    let centre = Vector2::from(camera.centre_px);
    let sides = [[0.0, centre.y], [width, centre.y], [centre.x, 0.0], [centre.x, height]].map(Vector2::from);
    let focal_px = |side: Vector2<f64>| {
        let ray = (1..=STEPS).rev().find_map(|step| {
            let share = f64::from(step) / f64::from(STEPS);
            camera.unproject(&centre.lerp(&side, share)).filter(|ray| ray.z > 0.2 * ray.norm())
        });
        ray.map_or(camera.focal_px[0], |ray| (side - centre).norm() * ray.z / ray.xy().norm())
    };
    sides.map(focal_px).into_iter().fold(f64::MAX, f64::min)
}

/// The colour between four pixels, by the coordinates of their centres.
fn interpolated(photo: &Rgb8, x: f64, y: f64) -> [u8; 3] {
    let (column, row) = ((x as usize).min(photo.width - 2), (y as usize).min(photo.height - 2));
    let (u, v) = (x - column as f64, y - row as f64);
    let [a, b] = [0, 1].map(|r| [0, 1].map(|c| photo.at(column + c, row + r)));
    std::array::from_fn(|channel| {
        let mix = |line: [[u8; 3]; 2]| f64::from(line[0][channel]) * (1.0 - u) + f64::from(line[1][channel]) * u;
        (mix(a) * (1.0 - v) + mix(b) * v).round() as u8
    })
}

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;")
}
