//! What the page is told about a reconstruction.

use std::fs;
use std::io;
use std::path::Path;

use adit_geometry::profile::{Piece, Profile};
use serde::Serialize;
use serde_json::Value;

use super::Viewer;
use super::error::ViewError;
use super::footprints::{footprint, read_camera};
use crate::poses::{PoseStatus, read_poses};
use crate::texture::{Panorama, PanoramaGrid, TILE_PX, TileReader};

/// No chord of the section's polyline is farther from its arc.
const SAGITTA_M: f64 = 0.0005;
/// Nor longer than this share of the perimeter, so that an unrolling wall looks round.
const LONGEST_SHARE: f64 = 1.0 / 96.0;

/// The scene; lengths in metres, frames as in the panorama and the tunnel.
#[derive(Serialize)]
pub(super) struct Scene {
    name: String,
    program: &'static str,
    grid: PanoramaGrid,
    tile_px: usize,
    /// Number of the full-size level of the deep-zoom pyramid.
    last_level: u32,
    section: Section,
    coverage: Option<CoverageLayer>,
    relief: Option<ReliefLayer>,
    photos: Vec<Photo>,
    /// The photos themselves can be fetched.
    has_photos: bool,
    /// What is missing and why that matters, for people.
    notes: Vec<String>,
}

/// Once around the wall from the crown, clockwise looking forward; the last vertex closes it.
#[derive(Clone, Debug, Serialize)]
#[expect(clippy::struct_field_names, reason = "the unit belongs into every name")]
pub(crate) struct Section {
    pub(crate) s_m: Vec<f64>,
    pub(crate) y_m: Vec<f64>,
    pub(crate) z_m: Vec<f64>,
}

/// A picture over the whole perimeter, and over this stretch of the axis.
#[derive(Serialize)]
struct Layer {
    url: &'static str,
    x_from_m: f64,
    x_to_m: f64,
}

#[derive(Serialize)]
struct CoverageLayer {
    #[serde(flatten)]
    layer: Layer,
    /// None, one, two, three, four and more photos.
    colours: [[u8; 3]; 5],
}

#[derive(Serialize)]
struct ReliefLayer {
    #[serde(flatten)]
    layer: Layer,
    /// Height of full red, depth of full blue; white lies between.
    full_colour_mm: Option<f64>,
}

#[derive(Serialize)]
struct Photo {
    name: String,
    status: PoseStatus,
    /// Optical centre in the tunnel frame.
    centre_m: [f64; 3],
    sigma_mm: f64,
    rms_px: f64,
    matches: usize,
    /// `[s_m, x_m]` around.
    footprint: Vec<[f64; 2]>,
}

/// Reads what there is. Only the panorama is needed; everything else that is missing becomes a note.
pub(super) fn read(viewer: &Viewer) -> Result<Scene, ViewError> {
    let panorama = Panorama::open(&viewer.out)?;
    let mut notes = Vec::new();
    let photos = noted(photos(&viewer.out, &panorama.profile), "no photos can be shown on the wall", &mut notes);
    let coverage = noted(coverage(&viewer.out), "no coverage can be shown", &mut notes);
    let relief = noted(relief(&viewer.out), "no relief can be shown", &mut notes);
    let grid = panorama.grid;
    Ok(Scene {
        name: viewer.name.clone(),
        program: concat!("adit ", env!("CARGO_PKG_VERSION")),
        grid,
        tile_px: TILE_PX,
        last_level: TileReader::new(&viewer.out, grid.width_px, grid.height_px).last_level(),
        section: section(&panorama.profile),
        coverage: coverage.flatten(),
        relief: relief.flatten(),
        photos: photos.unwrap_or_default(),
        has_photos: viewer.photos.is_some(),
        notes,
    })
}

fn noted<T>(found: Result<T, ViewError>, consequence: &str, notes: &mut Vec<String>) -> Option<T> {
    found.map_err(|error| notes.push(format!("{}: {consequence}", chain(&error)))).ok()
}

/// An error and its causes in one line.
pub(super) fn chain(error: &dyn std::error::Error) -> String {
    let mut text = error.to_string();
    let mut cause = error.source();
    while let Some(error) = cause {
        let next = error.to_string();
        if !text.contains(&next) {
            text = format!("{text}: {next}");
        }
        cause = error.source();
    }
    text
}

/// The section as a polyline.
pub(crate) fn section(profile: &Profile<f64>) -> Section {
    let mut section = Section { s_m: Vec::new(), y_m: Vec::new(), z_m: Vec::new() };
    let longest_m = profile.perimeter_m() * LONGEST_SHARE;
    for piece in profile.pieces() {
        // A chord of an arc departs from it by chord^2 * curvature / 8.
        let arc_m = (8.0 * SAGITTA_M / curvature_per_m(profile, piece)).sqrt();
        let steps = (piece.length_m() / arc_m.min(longest_m)).ceil().max(1.0) as usize;
        for step in 0..steps {
            let s_m = piece.start_s_m() + piece.length_m() * step as f64 / steps as f64;
            if let Some(wall) = profile.at(s_m) {
                section.push(s_m, wall.point.x, wall.point.y);
            }
        }
    }
    if let (Some(&y_m), Some(&z_m)) = (section.y_m.first(), section.z_m.first()) {
        section.push(profile.perimeter_m(), y_m, z_m);
    }
    section
}

/// How fast the wall turns along a piece; zero where it is straight.
fn curvature_per_m(profile: &Profile<f64>, piece: &Piece<f64>) -> f64 {
    // Near enough that an arc of a whole turn has turned by less than a right angle.
    let apart_m = piece.length_m() * 0.1;
    let normal = |share: f64| profile.at(piece.start_s_m() + piece.length_m() * share).map(|wall| wall.normal);
    let turned = normal(0.4).zip(normal(0.5)).map_or(0.0, |(one, other)| one.perp(&other).clamp(-1.0, 1.0).asin());
    turned.abs() / apart_m
}

impl Section {
    fn push(&mut self, s_m: f64, y_m: f64, z_m: f64) {
        self.s_m.push(s_m);
        self.y_m.push(y_m);
        self.z_m.push(z_m);
    }
}

fn photos(out: &Path, profile: &Profile<f64>) -> Result<Vec<Photo>, ViewError> {
    let poses = read_poses(&out.join("poses.csv"))?;
    let camera = read_camera(&out.join("colmap/cameras.txt"))?;
    let photos = poses.into_iter().map(|pose| {
        let centre = pose.tunnel_from_cam.translation.vector;
        let sigma_m = pose.position_sigma_m.iter().map(|sigma| sigma * sigma).sum::<f64>().sqrt();
        Photo {
            footprint: footprint(&camera, &pose.tunnel_from_cam, profile),
            name: pose.photo,
            status: pose.status,
            centre_m: [centre.x, centre.y, centre.z],
            sigma_mm: sigma_m * 1000.0,
            rms_px: pose.quality.rms_px,
            matches: pose.quality.observations,
        }
    });
    Ok(photos.collect())
}

/// The coverage map: cells of `cell_m`, rows from `x0_m` on.
fn coverage(out: &Path) -> Result<Option<CoverageLayer>, ViewError> {
    let path = out.join("coverage.json");
    let about = read_json(&path)?;
    let Some((_, rows)) = png_size(&out.join("coverage.png"))? else { return Ok(None) };
    let number = |key: &str| about.get(key).and_then(Value::as_f64);
    let Some((x_from_m, cell_m)) = number("x0_m").zip(number("cell_m")) else {
        return Err(ViewError::Coverage { path, what: "it does not say where its cells lie (x0_m, cell_m)" });
    };
    let x_to_m = x_from_m + f64::from(rows) * cell_m;
    let layer = Layer { url: "coverage.png", x_from_m, x_to_m };
    Ok(Some(CoverageLayer { layer, colours: crate::texture::COVERAGE_COLOURS }))
}

/// The picture of the relief; there is none where the surface stage has not run. Its place is the surface's lattice, its colours
/// are the report's figures of that stage.
fn relief(out: &Path) -> Result<Option<ReliefLayer>, ViewError> {
    if png_size(&out.join("relief.png"))?.is_none() {
        return Ok(None);
    }
    let surface = read_json(&out.join("surface/surface.json"))?;
    let number = |key: &str| surface.pointer(key).and_then(Value::as_f64);
    let place = number("/lattice/x0_m").zip(number("/lattice/step_x_m")).zip(number("/lattice/rows"));
    let Some(((x_from_m, step_m), rows)) = place else { return Ok(None) };
    let layer = Layer { url: "relief.png", x_from_m, x_to_m: x_from_m + step_m * rows };
    Ok(Some(ReliefLayer { layer, full_colour_mm: full_colour_mm(out) }))
}

fn full_colour_mm(out: &Path) -> Option<f64> {
    let report = read_json(&out.join("report.json")).ok()?;
    let stages = report.get("stages")?.as_array()?;
    let surface = stages.iter().find(|stage| stage.get("stage").is_some_and(|name| name == "surface"))?;
    surface.pointer("/figures/full_colour_mm")?.as_f64()
}

fn read_json(path: &Path) -> Result<Value, ViewError> {
    let text = fs::read_to_string(path).map_err(|source| ViewError::Read { path: path.to_owned(), source })?;
    serde_json::from_str(&text).map_err(|source| ViewError::Json { path: path.to_owned(), source })
}

/// Width and height from a PNG's header; `None` where there is no such file or it is no PNG.
fn png_size(path: &Path) -> Result<Option<(u32, u32)>, ViewError> {
    let file = match fs::File::open(path) {
        Ok(file) => file,
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(None),
        Err(source) => return Err(ViewError::Read { path: path.to_owned(), source }),
    };
    let reader = png::Decoder::new(io::BufReader::new(file)).read_info().ok();
    Ok(reader.map(|reader| (reader.info().width, reader.info().height)))
}

#[cfg(test)]
mod tests {
    use adit_geometry::profile::ProfileSpec;

    use super::*;

    #[test]
    fn the_polyline_closes_keeps_corners_and_stays_half_a_millimetre_from_the_wall() {
        for spec in [
            ProfileSpec::Circle { radius_m: 3.0 },
            ProfileSpec::Underpass { width_m: 4.0, wall_m: 2.5, rise_m: 1.0, axis_height_m: 1.4 },
        ] {
            let profile = spec.build().unwrap();
            let section = section(&profile);
            let last = section.s_m.len() - 1;
            assert!((section.s_m[last] - profile.perimeter_m()).abs() < 1e-12);
            assert!((section.y_m[last] - section.y_m[0]).abs() < 1e-12);
            for piece in profile.pieces() {
                assert!(section.s_m.iter().any(|s_m| (s_m - piece.start_s_m()).abs() < 1e-12));
            }
            for at in 0..last {
                assert!(section.s_m[at] < section.s_m[at + 1]);
                let middle = profile.at(f64::midpoint(section.s_m[at], section.s_m[at + 1])).unwrap().point;
                let chord = [section.y_m[at] + section.y_m[at + 1], section.z_m[at] + section.z_m[at + 1]];
                let off_m = (chord[0] / 2.0 - middle.x).hypot(chord[1] / 2.0 - middle.y);
                assert!(off_m < SAGITTA_M * 1.01, "{off_m} m off at {}", section.s_m[at]);
            }
        }
    }
}
