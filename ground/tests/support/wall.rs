//! A small world of its own for the matching: photos of a round tunnel with a texture of noise or of bricks, bulging if wanted.

use std::f64::consts::TAU;

use adit_geometry::camera::{Camera, Distortion};
use adit_geometry::rig::{ImageUp, nominal_rotation};
use adit_ground::matching::Pixels;
use adit_ground::raster::Luma;
use nalgebra::{Isometry3, Point3, Translation3, Vector2, Vector3};
use rayon::prelude::*;

/// Nominal radius.
pub(crate) const RADIUS_M: f64 = 3.0;

/// Sides of the texture's cells along the axis, and their weights.
const OCTAVES: [(f64, f64); 3] = [(0.012, 0.4), (0.04, 0.35), (0.15, 0.25)];

/// Pitch of the bricks along the axis and, about, around; width of the joints.
const BRICK_M: [f64; 3] = [0.225, 0.075, 0.01];

/// Sides of the stains' cells along the axis and, about, around.
const STAIN_M: [f64; 2] = [0.35, 1.4];

/// What the wall shows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Paint {
    /// Noise of several sizes.
    Grained,
    /// Bricks in half bond, all alike, with a stain here and there.
    StainedBricks,
    /// Bricks all alike and nothing else.
    CleanBricks,
}

/// A round tunnel whose wall may stand out from the circle.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Wall {
    pub(crate) paint: Paint,
    /// Height of the relief, metres; its standard deviation is about half of it.
    pub(crate) relief_m: f64,
}

impl Wall {
    /// Twelve photos across the crown: three directions 36 degrees apart, four turns 0.36 m apart.
    pub(crate) fn poses() -> Vec<Isometry3<f64>> {
        let pose = |index: usize| {
            let shaft_rad = (324.0 + 36.0 * (index % 3) as f64).to_radians();
            let x_m = 0.36 * (index / 3) as f64 + 0.05 * (index % 3) as f64;
            let centre = Translation3::new(x_m, 0.02 * (index as f64).sin(), 0.05 * (2.0 * index as f64).cos());
            Isometry3::from_parts(centre, nominal_rotation(ImageUp::Forward, shaft_rad))
        };
        (0..12).map(pose).collect()
    }

    /// The camera of the photos.
    pub(crate) fn camera() -> Camera<f64> {
        Camera {
            width_px: 1000,
            height_px: 750,
            focal_px: [466.0, 466.0],
            centre_px: [503.0, 373.0],
            distortion: Distortion::BrownConrady([-0.04, 0.006, 0.0, 0.0, 0.0]),
        }
    }

    /// The wall point that a pixel sees.
    pub(crate) fn hit(self, pose: &Isometry3<f64>, pixel: Vector2<f64>) -> Point3<f64> {
        let ray = pose.rotation * Self::camera().unproject(&pixel).expect("a ray");
        let centre = pose.translation.vector;
        let (a, b) = (ray.yz().norm_squared(), ray.yz().dot(&centre.yz()));
        let mut point = centre;
        // The relief is low and smooth: the radius at the last hit leads to the next one.
        for _ in 0..5 {
            let radius_m = RADIUS_M + self.relief(&point);
            let c = centre.yz().norm_squared() - radius_m * radius_m;
            point = centre + ray * ((-b + (b * b - a * c).sqrt()) / a);
        }
        point.into()
    }

    /// Photographs the wall with a lamp that moves along, and noise.
    pub(crate) fn photo(self, pose: &Isometry3<f64>, seed: u64) -> Pixels {
        let camera = Self::camera();
        let (width, height) = (camera.width_px as usize, camera.height_px as usize);
        let shade = |index: usize| {
            let pixel = Vector2::new((index % width) as f64 + 0.5, (index / width) as f64 + 0.5);
            let from_middle = (pixel - Vector2::from(camera.centre_px)) / camera.focal_px[0];
            let noise = 6.0 * (random(seed, index as i64, 0) - 0.5);
            let light = 190.0 / (1.0 + 0.5 * from_middle.norm_squared());
            (light * self.reflectance(&self.hit(pose, pixel)) + noise).round().clamp(0.0, 255.0) as u8
        };
        let data = (0..width * height).into_par_iter().map(shade).collect();
        Pixels::new(Luma { width, height, data })
    }

    fn reflectance(self, point: &Point3<f64>) -> f64 {
        match self.paint {
            Paint::Grained => grain(point),
            Paint::StainedBricks => bricks(point) * stains(point),
            Paint::CleanBricks => bricks(point),
        }
    }

    fn relief(self, point: &Vector3<f64>) -> f64 {
        let phi = point.y.atan2(-point.z);
        self.relief_m * (0.6 * (7.0 * phi + 0.5).sin() * (2.3 * point.x).cos() + 0.4 * (2.0 * phi).cos())
    }
}

/// Place around the section, turns from the crown.
fn turn(point: &Point3<f64>) -> f64 {
    (point.y.atan2(-point.z) / TAU).rem_euclid(1.0)
}

/// Bricks of 0.4 in joints of 0.8, with edges as soft as a pixel.
fn bricks(point: &Point3<f64>) -> f64 {
    let [length_m, height_m, joint_m] = BRICK_M;
    // An even number, so that the bond closes.
    let courses = 2.0 * (0.5 * TAU * RADIUS_M / height_m).round();
    let course = turn(point) * courses;
    let along = point.x / length_m + 0.5 * course.floor().rem_euclid(2.0);
    let from_joint_m = |place: f64, pitch_m: f64| 0.5 * pitch_m - (place - place.floor() - 0.5).abs() * pitch_m;
    let nearest_m = from_joint_m(course, TAU * RADIUS_M / courses).min(from_joint_m(along, length_m));
    0.8 - 0.4 * ((nearest_m - 0.5 * joint_m) / 0.006 + 0.5).clamp(0.0, 1.0)
}

/// 0.65 in about one place in twenty, else 1.
fn stains(point: &Point3<f64>) -> f64 {
    let around = (TAU * RADIUS_M / STAIN_M[1]).round();
    let damp = lattice_noise(9, turn(point) * around, around as i64, point.x / STAIN_M[0]);
    1.0 - 0.35 * ((damp - 0.78) / 0.1).clamp(0.0, 1.0)
}

/// Reflectance, about 0.2 to 0.9.
fn grain(point: &Point3<f64>) -> f64 {
    let turn = turn(point);
    let octave = |index: usize| {
        let (cell_m, weight) = OCTAVES[index];
        let around = (TAU * RADIUS_M / cell_m).round();
        weight * lattice_noise(index as u64, turn * around, around as i64, point.x / cell_m)
    };
    0.15 + 0.8 * (octave(0) + octave(1) + octave(2))
}

/// Random values on a lattice, blended smoothly; `u` comes round after `around` cells.
fn lattice_noise(seed: u64, u: f64, around: i64, v: f64) -> f64 {
    let (i, j) = (u.floor(), v.floor());
    let smooth = |t: f64| t * t * (3.0 - 2.0 * t);
    let (a, b) = (smooth(u - i), smooth(v - j));
    let at = |di: i64, dj: i64| random(seed, (i as i64 + di).rem_euclid(around), j as i64 + dj);
    (1.0 - b) * ((1.0 - a) * at(0, 0) + a * at(1, 0)) + b * ((1.0 - a) * at(0, 1) + a * at(1, 1))
}

/// A number in 0..1 from three others (the finaliser of `splitmix64`).
fn random(seed: u64, i: i64, j: i64) -> f64 {
    let mut z = seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ (i as u64).wrapping_mul(0xd6e8_feb8_6659_fd93);
    z = (z ^ (j as u64).wrapping_mul(0xa076_1d64_78bd_642f)).wrapping_add(0x9e37_79b9_7f4a_7c15);
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    ((z ^ (z >> 31)) >> 11) as f64 / (1_u64 << 53) as f64
}
