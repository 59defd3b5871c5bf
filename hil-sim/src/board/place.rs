//! Where boards are held: all over the photo, tilted by turns, as much in view as asked for.

use std::f64::consts::TAU;

use adit_geometry::camera::Camera;
use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector2, Vector3};

use super::{CORNERS, SQUARE_M, corners};
use crate::seed::Random;

/// Tilt against the image, radians.
const TILT_RAD: [f64; 2] = [0.2, 0.65];
/// Turn about the viewing direction either way, radians.
const ROLL_RAD: f64 = 0.5;
/// Distance in widths of the board.
const DISTANCE: [f64; 2] = [0.55, 1.3];
/// From the photo's border to the nearest corner, as a share of the photo's width.
const MARGIN: f64 = 0.025;
/// Draws before a board is held farther away.
const PATIENCE: usize = 60;

/// Draws the pose `cam_from_board` of a photo: its middle in one of nine parts of the photo, by turns.
pub(super) fn cam_from_board(camera: &Camera<f64>, index: usize, in_view: f64, random: &mut Random) -> Isometry3<f64> {
    let (width, height) = (f64::from(camera.width_px), f64::from(camera.height_px));
    let board_m = (CORNERS[0] - 1) as f64 * SQUARE_M;
    let mut farther = 1.0;
    loop {
        for _ in 0..PATIENCE {
            let part = |which: usize, random: &mut Random| (which as f64 + random.uniform(0.15, 0.85)) / 3.0;
            let at = Vector2::new(part(index % 3, random) * width, part(index / 3 % 3, random) * height);
            let tilt_rad = random.uniform(TILT_RAD[0], TILT_RAD[1]);
            let about = random.uniform(0.0, TAU);
            let roll = Vector3::z() * random.uniform(-ROLL_RAD, ROLL_RAD);
            let distance_m = board_m * farther * random.uniform(DISTANCE[0], DISTANCE[1]);
            let Some(ray) = camera.unproject(&at) else { continue };
            let tilt = Vector3::new(about.cos(), about.sin(), 0.0) * tilt_rad;
            let rotation = UnitQuaternion::from_scaled_axis(tilt) * UnitQuaternion::from_scaled_axis(roll);
            let middle = Vector3::new((CORNERS[0] - 1) as f64, (CORNERS[1] - 1) as f64, 0.0) * (0.5 * SQUARE_M);
            let translation = ray.normalize() * distance_m - rotation * middle;
            let pose = Isometry3::from_parts(Translation3::from(translation), rotation);
            if is_in_view(camera, &pose, in_view) {
                return pose;
            }
        }
        farther *= 1.15;
    }
}

/// All corners, and these with a margin, or at least such a share of them.
fn is_in_view(camera: &Camera<f64>, pose: &Isometry3<f64>, share: f64) -> bool {
    let margin_px = if share < 1.0 { 0.0 } else { MARGIN * f64::from(camera.width_px) };
    let seen = corners(camera, pose).flatten().filter(|corner| camera.contains(corner, margin_px)).count();
    seen as f64 >= share * (CORNERS[0] * CORNERS[1]) as f64
}
