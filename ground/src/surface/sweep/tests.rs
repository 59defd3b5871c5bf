use adit_geometry::camera::{Camera, Distortion};
use adit_geometry::profile::ProfileSpec;
use adit_geometry::rig::{ImageUp, nominal_rotation};
use nalgebra::{Isometry3, Point3, Translation3, Vector2, Vector3};

use super::super::strips::PASSES;
use super::*;
use crate::raster::Raster;
use crate::survey::Photo;
use crate::texture::{Usable, View};

const RADIUS_M: f64 = 3.0;
/// Size of the blots on the wall: three pixels.
const BLOT_M: f64 = 0.045;

/// A camera at 15 mm of wall per pixel.
fn camera() -> Camera<f64> {
    Camera {
        width_px: 400,
        height_px: 300,
        focal_px: [200.0; 2],
        centre_px: [200.0, 150.0],
        distortion: Distortion::BrownConrady([0.0; 5]),
    }
}

/// Blots of random grey, smooth between.
fn grey(s_m: f64, x_m: f64, seed: u64) -> f64 {
    let (column, row) = (s_m / BLOT_M, x_m / BLOT_M);
    let value = |column: f64, row: f64| {
        let mixed = (column as i64 as u64).wrapping_mul(0x9E37_79B9_7F4A_7C15)
            ^ (row as i64 as u64).wrapping_mul(0xC2B2_AE3D_27D4_EB4F)
            ^ seed.wrapping_mul(0x1656_67B1_9E37_79F9);
        let mixed = (mixed ^ (mixed >> 29)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        ((mixed ^ (mixed >> 32)) % 200) as f64 + 28.0
    };
    let (left, upper) = (column.floor(), row.floor());
    let mix = |row: f64| value(left, row) + (column - left) * (value(left + 1.0, row) - value(left, row));
    mix(upper) + (row - upper) * (mix(upper + 1.0) - mix(upper))
}

/// What a camera that looks up sees of a wall that stands `height_m` out of the circle everywhere.
fn render(pose: &Isometry3<f64>, height_m: f64, seed: u64) -> Pixels {
    let camera = camera();
    let wall = ProfileSpec::Circle { radius_m: RADIUS_M - height_m }.build().unwrap();
    let mut image = Raster::<u8, 1>::new(400, 300);
    for row in 0..300 {
        for column in 0..400 {
            let pixel = Vector2::new(f64::from(column) + 0.5, f64::from(row) + 0.5);
            let direction = pose.rotation * camera.unproject(&pixel).unwrap();
            let centre = pose.translation.vector;
            let hit = wall.ray_cast(centre.yz(), direction.yz()).unwrap();
            let at: Point3<f64> = Point3::from(centre + direction * hit.distance);
            let s_m = at.y.atan2(-at.z) * RADIUS_M;
            image.set(column as usize, row as usize, [grey(s_m, at.x, seed) as u8]);
        }
    }
    Pixels::new(image, 0, Usable::new(400, 300, None))
}

/// Sweeps 8 x 8 cells above cameras at these stations; each has its own wall paint.
fn swept(stations: &[(f64, u64)], height_m: f64, known_m: f32, pass: usize) -> Option<Vec<Found>> {
    let profile = ProfileSpec::Circle { radius_m: RADIUS_M }.build().unwrap();
    let columns = 314;
    let step_m = profile.perimeter_m() / columns as f64;
    let lattice = Lattice { step_s_m: step_m, step_x_m: step_m, columns, rows: 100, x0_m: -50.0 * step_m };
    let photo = Photo { name: String::new(), path: std::path::PathBuf::new(), mask: None, tag: None };
    let cameras: Vec<(Shot, Pixels)> = stations
        .iter()
        .map(|&(x_m, seed)| {
            let rotation = nominal_rotation(ImageUp::Forward, 0.0);
            let pose = Isometry3::from_parts(Translation3::from(Vector3::new(x_m, 0.02, 0.1)), rotation);
            let view = View::new(camera(), &pose, 1.0);
            let footprint = view.footprint(&profile).unwrap();
            (Shot { photo: &photo, view, footprint }, render(&pose, height_m, seed))
        })
        .collect();
    let photos: Vec<(&Shot, &Pixels)> = cameras.iter().map(|(shot, pixels)| (shot, pixels)).collect();
    let known = move |_: i64, _: i64| known_m;
    let scene = Scene { profile: &profile, lattice: &lattice, photos: &photos, known_m: &known };
    sweep(&scene, &Tile { column0: -4, columns: 8, row0: 46, rows: 8 }, &PASSES[pass])
}

/// Share of cells that are known and within `error_m` of the truth.
fn right(found: &[Found], height_m: f32, error_m: f32) -> f32 {
    let near = |found: &&Found| found.confidence > 0.3 && (found.height_m - height_m).abs() < error_m;
    found.iter().filter(near).count() as f32 / found.len() as f32
}

#[test]
fn a_wall_that_stands_out_is_found_coarse_and_then_fine() {
    let stations = [(-0.9, 1), (0.0, 1), (0.9, 1)];
    for (height_m, nearly_m) in [(0.04, 0.036), (-0.05, -0.044)] {
        let coarse = swept(&stations, height_m, 0.0, 0).unwrap();
        assert!(right(&coarse, height_m as f32, 0.008) > 0.9, "{coarse:?}");
        let fine = swept(&stations, height_m, nearly_m, 1).unwrap();
        assert!(right(&fine, height_m as f32, 0.002) > 0.9, "{fine:?}");
    }
}

#[test]
fn one_photo_measures_nothing_and_two_that_disagree_neither() {
    assert_eq!(swept(&[(0.0, 1)], 0.0, 0.0, 1), None);
    let found = swept(&[(0.0, 1), (0.9, 2)], 0.0, 0.0, 1).unwrap();
    assert!(found.iter().filter(|found| found.confidence > 0.3).count() <= 3, "{found:?}");
}

#[test]
fn photos_from_the_same_place_have_no_parallax() {
    assert_eq!(swept(&[(0.0, 1), (0.02, 1)], 0.0, 0.0, 1), None);
}
