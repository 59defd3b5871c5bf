//! A small reconstruction's folder as the stages leave it, with a wall whose colours say where they are.

use std::fs;
use std::path::Path;

use adit_geometry::camera::{Camera, Distortion};
use adit_geometry::profile::ProfileSpec;
use adit_ground::adjust::{AdjustReport, Observation, Outcome, PhotoQuality, PruneCounts, Shared, Tracks};
use adit_ground::pipeline::AdjustStage;
use adit_ground::poses::{PhotoPose, PoseStatus, Reconstruction};
use adit_ground::texture::PanoramaGrid;
use nalgebra::{Isometry3, Point3, Vector3};

/// Side of a tile of the pyramid.
const TILE_PX: usize = 256;

/// RGBA pixels.
struct Picture {
    width: usize,
    height: usize,
    pixels: Vec<[u8; 4]>,
}

/// Writes what stages adjust and texture leave: three photos in a pipe of 1 m, 1.2 m of its wall at 4 mm.
pub(crate) fn write(out: &Path) {
    fs::create_dir_all(out.join("stages")).expect("a folder");
    let content = postcard::to_stdvec(&stage()).expect("a stage is serialised");
    // In front of the result lies a key of what it was made from, which export does not look at.
    fs::write(out.join("stages/adjust.bin"), [vec![0; 32], content].concat()).expect("the stage is written");
    let profile = stage().reconstruction.profile;
    let grid = PanoramaGrid::new(profile.build().expect("a circle").perimeter_m(), 4.0, -0.2, 1.0);
    let tiles = out.join("panorama/tiles");
    let mut level = paint(&grid);
    let last = level.width.max(level.height).next_power_of_two().trailing_zeros();
    for number in (0..=last).rev() {
        write_tiles(&level, &tiles.join("panorama_files").join(number.to_string()));
        level = halved(&level);
    }
    fs::write(tiles.join("panorama.dzi"), "<Image/>").expect("the description is written");
    fs::write(out.join("panorama/panorama.json"), grid.to_json(&profile).to_string()).expect("the geometry is written");
}

/// Red grows with s, green with x, 20 to 220; unseen from 30 to 45 % of s and 20 to 50 % of x.
fn paint(grid: &PanoramaGrid) -> Picture {
    let (width, height) = (grid.width_px, grid.height_px);
    let share = |at: usize, length: usize| (at as f64 + 0.5) / length as f64;
    let pixels = (0..width * height).map(|at| {
        let (s, x) = (share(at % width, width), share(at / width, height));
        let shade = |share: f64| (20.0 + 200.0 * share).round() as u8;
        let unseen = (0.3..0.45).contains(&s) && (0.2..0.5).contains(&x);
        if unseen { [0; 4] } else { [shade(s), shade(x), 60, 255] }
    });
    Picture { width, height, pixels: pixels.collect() }
}

/// Means of up to four pixels, of those that were seen.
fn halved(picture: &Picture) -> Picture {
    let (width, height) = (picture.width.div_ceil(2), picture.height.div_ceil(2));
    let pixel = |at: usize| {
        let (column, row) = (at % width * 2, at / width * 2);
        let rows = row..(row + 2).min(picture.height);
        let all: Vec<[u8; 4]> = rows
            .flat_map(|row| (column..(column + 2).min(picture.width)).map(move |column| row * picture.width + column))
            .map(|at| picture.pixels[at])
            .collect();
        let seen: Vec<_> = all.iter().filter(|pixel| pixel[3] > 0).collect();
        let mean = |channel: usize| {
            seen.iter().map(|pixel| usize::from(pixel[channel])).sum::<usize>().checked_div(seen.len()).unwrap_or(0)
        };
        [mean(0) as u8, mean(1) as u8, mean(2) as u8, (255 * seen.len() / all.len()) as u8]
    };
    Picture { width, height, pixels: (0..width * height).map(pixel).collect() }
}

fn write_tiles(picture: &Picture, folder: &Path) {
    fs::create_dir_all(folder).expect("a folder");
    for row in 0..picture.height.div_ceil(TILE_PX) {
        for column in 0..picture.width.div_ceil(TILE_PX) {
            let width = TILE_PX.min(picture.width - column * TILE_PX);
            let rows = row * TILE_PX..((row + 1) * TILE_PX).min(picture.height);
            let height = rows.len();
            let start = |row: usize| row * picture.width + column * TILE_PX;
            let bytes: Vec<u8> =
                rows.flat_map(|row| &picture.pixels[start(row)..start(row) + width]).flatten().copied().collect();
            let file = fs::File::create(folder.join(format!("{column}_{row}.png"))).expect("a tile");
            let mut encoder = png::Encoder::new(file, width as u32, height as u32);
            encoder.set_color(png::ColorType::Rgba);
            encoder.write_header().and_then(|mut writer| writer.write_image_data(&bytes)).expect("a PNG");
        }
    }
}

fn stage() -> AdjustStage {
    let camera = Camera {
        width_px: 1000,
        height_px: 750,
        focal_px: [466.0, 466.5],
        centre_px: [503.0, 373.0],
        distortion: Distortion::BrownConrady([-0.04, 0.006, 0.001, -0.002, 0.0]),
    };
    let pose = |index: u32| PhotoPose {
        photo: format!("GOPR{:04}.JPG", index + 1),
        tunnel_from_cam: Isometry3::new(
            Vector3::new(0.1 * f64::from(index), 0.02, -0.03),
            Vector3::new(0.3, -0.2, 0.1 + 0.05 * f64::from(index)),
        ),
        position_sigma_m: [0.001, 0.002, 0.003],
        rotation_sigma_rad: [0.001; 3],
        status: if index == 2 { PoseStatus::PriorOnly } else { PoseStatus::Adjusted },
        quality: PhotoQuality { observations: 40, rms_px: 0.1, doubted_share: 0.0 },
    };
    let poses: Vec<PhotoPose> = (0..3).map(pose).collect();
    let mut tracks = Tracks::default();
    for index in 0..40 {
        let in_cam = Point3::new(0.02 * f64::from(index) - 0.4, 0.3 - 0.015 * f64::from(index), 0.5);
        let point = poses[0].tunnel_from_cam * in_cam;
        let seen = |photo: usize| {
            let in_cam = poses[photo].tunnel_from_cam.inverse_transform_point(&point).coords;
            let pixel = camera.project(&in_cam).expect("in front of the camera");
            Observation { photo: photo as u32, pixel: [pixel.x as f32, pixel.y as f32] }
        };
        tracks.push(point, [seen(0), seen(1)]);
    }
    let report = AdjustReport {
        photos: 3,
        points: 40,
        observations: 80,
        iterations: 1,
        cost_before: 1.0,
        cost_after: 0.0,
        median_before_px: 1.0,
        median_after_px: 0.0,
        mean_after_px: 0.0,
        outcome: Outcome::Converged,
    };
    AdjustStage {
        reconstruction: Reconstruction { poses, tracks, camera, profile: ProfileSpec::Circle { radius_m: 0.5 } },
        shared: Shared {
            mount_rotvec: Vector3::zeros(),
            odometer_scale: 0.0,
            shaft_bias_rad: 0.0,
            shaft_periodic_rad: [0.0; 2],
            lever_m: [0.0; 2],
            profile_size: 1.0,
            shutter_rad_per_s: 0.0,
            camera,
        },
        warnings: Vec::new(),
        first: report.clone(),
        last: report,
        pruned: PruneCounts::default(),
    }
}
