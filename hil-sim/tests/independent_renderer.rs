//! Our renderer against photos made by an independent program with its own ray-caster and its own conventions:
//! given the same wall picture and the same pose, the same detail must appear at the same pixel.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use adit_geometry::camera::{Camera, Distortion};
use adit_geometry::profile::ProfileSpec;
use adit_hil_sim::render::{PhotoRenderer, RenderConfig, RgbImage, Shot};
use adit_hil_sim::scene::{LiningPaint, Pattern, PhotoTextureConfig, TextureConfig, Wall, WallConfig};
use nalgebra::{Isometry3, Quaternion, Translation3, UnitQuaternion};
use zune_jpeg::zune_core::bytestream::ZCursor;

/// Half the edge of a compared block.
const HALF_PX: usize = 20;
/// Largest shift that is tried.
const REACH_PX: usize = 4;

fn samples() -> Option<PathBuf> {
    let found = Path::new(env!("CARGO_MANIFEST_DIR")).ancestors().map(|folder| folder.join("shared/samples"));
    found.into_iter().find(|folder| folder.is_dir())
}

/// The camera of all three sample surveys.
fn camera() -> Camera<f64> {
    Camera {
        width_px: 1000,
        height_px: 750,
        focal_px: [466.0, 466.0],
        centre_px: [503.0, 373.0],
        distortion: Distortion::BrownConrady([-0.04, 0.006, 0.0, 0.0, 0.0]),
    }
}

fn renderer(survey: &Path, spec: &ProfileSpec<f64>) -> PhotoRenderer {
    let text = std::fs::read_to_string(survey.join("truth/texture.json")).expect("texture.json");
    let geometry: serde_json::Value = serde_json::from_str(&text).expect("JSON");
    let number = |key: &str| geometry[key].as_f64().expect("a number");
    let photo = PhotoTextureConfig {
        file: "truth/texture.jpg".into(),
        mm_per_px: number("mm_per_px"),
        x0_m: number("x0_m"),
        s0_m: number("s0_m"),
    };
    let texture = TextureConfig { pattern: Pattern::Photo, photo: Some(photo), ..TextureConfig::default() };
    let profile = spec.build().expect("a valid profile");
    let paint = LiningPaint::new(&profile, &texture, survey, 1).expect("a readable texture");
    let wall = Wall::new(profile, &WallConfig::default(), 1).expect("a valid wall");
    PhotoRenderer::new(camera(), 0.0, Arc::new(wall), Arc::new(paint), &RenderConfig::default(), 1).expect("valid")
}

fn true_pose(survey: &Path, photo: &str) -> Isometry3<f64> {
    let text = std::fs::read_to_string(survey.join("truth/poses.csv")).expect("poses.csv");
    let line = text.lines().find(|line| line.starts_with(photo)).expect("the photo's line");
    let numbers: Vec<f64> = line.split(',').skip(1).map(|cell| cell.parse().expect("a number")).collect();
    let [qw, qx, qy, qz, x, y, z] = numbers[..] else { panic!("seven numbers") };
    let rotation = UnitQuaternion::from_quaternion(Quaternion::new(qw, qx, qy, qz));
    Isometry3::from_parts(Translation3::new(x, y, z), rotation)
}

fn photo(survey: &Path, name: &str) -> RgbImage {
    let bytes = std::fs::read(survey.join("photos").join(name)).expect("the photo");
    let data = zune_jpeg::JpegDecoder::new(ZCursor::new(bytes)).decode().expect("a JPEG");
    RgbImage { width: 1000, height: 750, data }
}

/// Green values of a block, less their mean, with unit norm; `None` for an even block.
fn block(image: &RgbImage, column: usize, row: usize) -> Option<Vec<f32>> {
    let mut values = Vec::new();
    for row in row - HALF_PX..row + HALF_PX {
        for column in column - HALF_PX..column + HALF_PX {
            values.push(f32::from(image.data[(row * image.width + column) * 3 + 1]));
        }
    }
    let mean = values.iter().sum::<f32>() / values.len() as f32;
    let norm = values.iter().map(|value| (value - mean).powi(2)).sum::<f32>().sqrt();
    (norm > 40.0).then(|| values.iter().map(|value| (value - mean) / norm).collect())
}

/// Best correlation of a block over shifts and the shift, with a parabola through the peak; `None` if at the border.
fn best_shift(ours: &RgbImage, theirs: &RgbImage, column: usize, row: usize) -> Option<(f32, [f32; 2])> {
    let template = block(ours, column, row)?;
    let mut scores = [[0.0_f32; 2 * REACH_PX + 1]; 2 * REACH_PX + 1];
    let mut best = (0, 0);
    for dv in 0..=2 * REACH_PX {
        for du in 0..=2 * REACH_PX {
            let other = block(theirs, column + du - REACH_PX, row + dv - REACH_PX)?;
            scores[dv][du] = template.iter().zip(&other).map(|(a, b)| a * b).sum();
            if scores[dv][du] > scores[best.0][best.1] {
                best = (dv, du);
            }
        }
    }
    let (dv, du) = best;
    let inside = 1..2 * REACH_PX;
    if !inside.contains(&dv) || !inside.contains(&du) {
        return None;
    }
    let peak = |before: f32, at: f32, after: f32| 0.5 * (before - after) / (before - 2.0 * at + after);
    let u = du as f32 - REACH_PX as f32 + peak(scores[dv][du - 1], scores[dv][du], scores[dv][du + 1]);
    let v = dv as f32 - REACH_PX as f32 + peak(scores[dv - 1][du], scores[dv][du], scores[dv + 1][du]);
    Some((scores[dv][du], [u, v]))
}

/// Compares photos of a survey: number of blocks that agree, and the median shift of those.
fn compare(name: &str, spec: &ProfileSpec<f64>, photos: &[&str]) {
    let Some(samples) = samples() else {
        eprintln!("skipped {name}: no ../shared/samples");
        return;
    };
    let survey = samples.join(name);
    let renderer = renderer(&survey, spec);
    for photo_name in photos {
        let theirs = photo(&survey, photo_name);
        let pose = true_pose(&survey, photo_name);
        let ours = renderer.render(&Shot::still(0, pose, pose)).image;
        let (mut shifts, mut tried) = (Vec::new(), 0);
        for row in (60..700).step_by(90) {
            for column in (60..950).step_by(90) {
                tried += 1;
                if let Some((score, [u, v])) = best_shift(&ours, &theirs, column, row)
                    && score > 0.6
                {
                    shifts.push(u.hypot(v));
                }
            }
        }
        shifts.sort_by(f32::total_cmp);
        let median_px = shifts.get(shifts.len() / 2).copied().unwrap_or(f32::INFINITY);
        eprintln!("{name} {photo_name}: {} of {tried} blocks agree, median shift {median_px:.3} px", shifts.len());
        assert!(shifts.len() * 10 > tried * 7, "{photo_name}: only {} of {tried} blocks agree", shifts.len());
        assert!(median_px < 0.15, "{photo_name}: median shift {median_px} px");
    }
}

#[test]
fn a_circular_brick_tunnel_looks_as_an_independent_program_drew_it() {
    let circle = ProfileSpec::Circle { radius_m: 3.0 };
    compare("cylinder-brick-spiral", &circle, &["GOPR0001.JPG", "GOPR0014.JPG", "GOPR0028.JPG"]);
}

#[test]
fn an_underpass_looks_as_an_independent_program_drew_it() {
    let underpass = ProfileSpec::Underpass { width_m: 4.0, wall_m: 2.5, rise_m: 1.0, axis_height_m: 1.4 };
    compare("underpass-spiral", &underpass, &["GOPR0001.JPG", "GOPR0004.JPG", "GOPR0006.JPG", "GOPR0018.JPG"]);
}
