//! A rectangular tunnel painted with lines, and photos of it by a pinhole ray-caster: what the texture must show is known.

use std::fs::File;
use std::io::BufWriter;
use std::path::Path;

use adit_geometry::camera::{Camera, Distortion};
use adit_geometry::profile::{Profile, ProfileSpec};
use adit_geometry::rig::{ImageUp, Rig, nominal_rotation};
use adit_ground::adjust::{PhotoQuality, Tracks};
use adit_ground::poses::{PhotoPose, PoseStatus, Reconstruction};
use adit_ground::survey::{Photo, Survey};
use adit_protocol::mission::{CameraConfig, Sigma, SurveyConfig};
use jpeg_encoder::{ColorType, Encoder};
use nalgebra::{Isometry3, Translation3, Vector2};

/// Right wall, floor, left wall, ceiling: arc length at which each one's line crosses x = [`MIDDLE_X_M`].
pub(crate) const LINES: [(&str, f64); 4] = [("right-wall", 3.5), ("floor", 7.0), ("left-wall", 10.5), ("ceiling", 0.9)];
/// Where the lines cross the arc lengths of [`LINES`].
pub(crate) const MIDDLE_X_M: f64 = 0.9;
/// How far a line moves around the wall per metre along the axis.
pub(crate) const SLOPE: f64 = 0.3;
/// A box on the floor that masks may hide: arc length and x, from and to.
pub(crate) const HIDDEN: [[f64; 2]; 2] = [[6.4, 7.2], [0.5, 1.1]];

const PHOTOS: usize = 20;
const HALF_WIDTH_M: f64 = 0.02;

fn section() -> ProfileSpec<f64> {
    ProfileSpec::Rectangle { width_m: 4.0, height_m: 3.0, axis_height_m: 1.5 }
}

fn camera() -> Camera<f64> {
    Camera {
        width_px: 400,
        height_px: 300,
        focal_px: [186.0, 186.0],
        centre_px: [201.2, 149.2],
        distortion: Distortion::BrownConrady([-0.04, 0.006, 0.0, 0.0, 0.0]),
    }
}

/// Photographs the tunnel into `folder`; with masks over [`HIDDEN`] if asked.
pub(crate) fn painted(folder: &Path, masked: bool) -> (Survey, Reconstruction) {
    let (profile, camera) = (section().build().expect("a section"), camera());
    let mut survey = Survey { folder: folder.to_owned(), config: config(), photos: Vec::new(), losses: Vec::new() };
    let mut poses = Vec::new();
    for index in 0..PHOTOS {
        let name = format!("P{index:02}.JPG");
        let at = index as f64;
        let centre = Translation3::new(0.1 * at, 0.05 * (1.3 * at).sin(), 0.05 * (0.7 * at).cos());
        let pose = Isometry3::from_parts(centre, nominal_rotation(ImageUp::Forward, 36.0_f64.to_radians() * at));
        let (image, mask) = photograph(&profile, &camera, &pose);
        let path = folder.join(&name);
        let encoder = Encoder::new_file(&path, 95).expect("a file");
        encoder.encode(&image, 400, 300, ColorType::Rgb).expect("a JPEG");
        let mask_path = folder.join(format!("{name}.png"));
        if masked {
            write_mask(&mask_path, &mask);
        }
        survey.photos.push(Photo { name: name.clone(), path, mask: masked.then_some(mask_path), tag: None });
        poses.push(PhotoPose {
            photo: name,
            tunnel_from_cam: pose,
            position_sigma_m: [1e-4; 3],
            rotation_sigma_rad: [1e-4; 3],
            status: PoseStatus::Adjusted,
            quality: PhotoQuality::default(),
        });
    }
    (survey, Reconstruction { poses, tracks: Tracks::default(), camera, profile: section() })
}

fn config() -> SurveyConfig {
    SurveyConfig {
        profile: section(),
        camera: CameraConfig { camera: camera(), refine: false, rolling_shutter_s: 0.0 },
        rig: Rig {
            images_per_turn: 10,
            image_up: ImageUp::Forward,
            lever_radial_m: 0.0,
            lever_forward_m: 0.0,
            mount_rotvec_rad: [0.0; 3],
        },
        sigma: Sigma { shaft_rad: 0.01, range_m: 0.02, odometer_m_per_m: 0.02, attitude_rad: 0.02, mount_rad: 0.01 },
    }
}

/// The picture, and a mask that is black over [`HIDDEN`].
fn photograph(profile: &Profile<f64>, camera: &Camera<f64>, pose: &Isometry3<f64>) -> (Vec<u8>, Vec<u8>) {
    let (mut image, mut mask) = (Vec::new(), Vec::new());
    for row in 0..camera.height_px {
        for column in 0..camera.width_px {
            let pixel = Vector2::new(f64::from(column) + 0.5, f64::from(row) + 0.5);
            let ray = pose.rotation * camera.unproject(&pixel).expect("a ray");
            let centre = pose.translation.vector;
            let hit = profile.ray_cast(centre.yz(), ray.yz()).expect("a closed section");
            let (s_m, x_m) = (hit.surface.s_m, centre.x + ray.x * hit.distance);
            let pixel_m = hit.distance / camera.focal_px[0];
            image.extend([paint(s_m, x_m, pixel_m); 3]);
            let hidden = (HIDDEN[0][0]..HIDDEN[0][1]).contains(&s_m) && (HIDDEN[1][0]..HIDDEN[1][1]).contains(&x_m);
            mask.push(if hidden { 0 } else { 255 });
        }
    }
    (image, mask)
}

fn paint(s_m: f64, x_m: f64, pixel_m: f64) -> u8 {
    let away = |line_m: f64| (s_m - line_m - SLOPE * (x_m - MIDDLE_X_M)).abs();
    let away_m = LINES.iter().map(|(_, line_m)| away(*line_m)).fold(f64::INFINITY, f64::min);
    let covered = (0.5 + (HALF_WIDTH_M - away_m) / pixel_m).clamp(0.0, 1.0);
    (180.0 - 120.0 * covered) as u8
}

fn write_mask(path: &Path, mask: &[u8]) {
    let mut encoder = png::Encoder::new(BufWriter::new(File::create(path).expect("a file")), 400, 300);
    encoder.set_color(png::ColorType::Grayscale);
    encoder.set_depth(png::BitDepth::Eight);
    encoder.write_header().expect("a header").write_image_data(mask).expect("a PNG");
}
