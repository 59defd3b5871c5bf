//! The solver against exact synthetic tunnels, and the whole adjustment on a noisy one.

use adit_geometry::camera::{Camera, Distortion};
use adit_geometry::profile::{Profile, ProfileSpec};
use adit_geometry::rig::{ImageUp, Rig};
use adit_protocol::mission::Sigma;
use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, Normal};

use super::*;
use crate::prior::{Beam, TagPrior, prior_poses};

struct Tunnel {
    camera: Camera<f64>,
    profile: Profile<f64>,
    rig: Rig<f64>,
    sigma: Sigma,
    truth: Vec<Isometry3<f64>>,
    tags: Vec<TagPrior>,
    tracks: Tracks,
    starts: Vec<Isometry3<f64>>,
}

/// A spiral of `photos` in an underpass (whose corners fix the roll), wall points 20 mm off the profile, and noisy tags.
fn tunnel(photos: usize, pixel_px: f64, seed: u64) -> Tunnel {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let normal = Normal::new(0.0, 1.0).unwrap();
    let mut noise = |sigma: f64| normal.sample(&mut random) * sigma;
    let camera = Camera {
        width_px: 1000,
        height_px: 750,
        focal_px: [466.0; 2],
        centre_px: [503.0, 373.0],
        distortion: Distortion::BrownConrady([-0.04, 0.006, 0.0, 0.0, 0.0]),
    };
    let profile =
        ProfileSpec::Underpass { width_m: 4.0, wall_m: 2.5, rise_m: 1.0, axis_height_m: 1.4 }.build().unwrap();
    let rig = Rig {
        images_per_turn: 10,
        image_up: ImageUp::Forward,
        lever_radial_m: 0.06,
        lever_forward_m: 0.0,
        mount_rotvec_rad: [0.0; 3],
    };
    let sigma =
        Sigma { shaft_rad: 0.017, range_m: 0.02, odometer_m_per_m: 0.02, attitude_rad: 0.017, mount_rad: 0.017 };
    let mounted = Rig { mount_rotvec_rad: [0.012, -0.01, 0.015], ..rig };
    let (mut truth, mut tags) = (Vec::new(), Vec::new());
    let mut odometer_m = 0.0;
    for index in 0..photos {
        let shaft = (index as f64 * 36.0).to_radians();
        let body = Vector3::new(0.1 * index as f64, noise(0.03), noise(0.03));
        let rotation = UnitQuaternion::from_euler_angles(noise(0.01), noise(0.01), noise(0.01));
        truth.push(Isometry3::from_parts(Translation3::from(body), rotation) * mounted.body_from_cam(shaft));
        let beams = [Vector3::new(0.0, 0.0, -1.0), Vector3::y(), -Vector3::y()].map(|direction| {
            let hit = profile.ray_cast(body.yz(), (rotation * direction).yz()).unwrap();
            Beam { direction, measured_m: hit.distance + noise(0.02) }
        });
        tags.push(TagPrior {
            shaft_rad: shaft + noise(0.017),
            attitude_rad: None,
            beams: beams.to_vec(),
            range_head_m: None,
            odometer_m: Some(odometer_m),
            rotation_sigma_rad: [0.017f64.hypot(0.017), 0.017, 0.017],
        });
        odometer_m += 0.1 * 0.985 + noise(0.008);
    }
    let mut tracks = Tracks::default();
    while tracks.len() < photos * 60 {
        let along = random.random_range(-1.5..0.1 * photos as f64 + 1.5);
        let surface = profile.at(random.random_range(0.0..profile.perimeter_m())).unwrap();
        let relief = normal.sample(&mut random) * 0.02;
        let section = surface.point + surface.normal * relief;
        let position = Point3::new(along, section.x, section.y);
        let mut seen = Vec::new();
        for (photo, pose) in truth.iter().enumerate() {
            if let Some(pixel) = camera.project(&pose.inverse_transform_point(&position).coords)
                && camera.contains(&pixel, 5.0)
            {
                let jittered = pixel.map(|value| value + normal.sample(&mut random) * pixel_px);
                seen.push(Observation { photo: photo as u32, pixel: [jittered.x as f32, jittered.y as f32] });
            }
        }
        if seen.len() >= 2 {
            tracks.push(Point3::new(along, surface.point.x, surface.point.y), seen);
        }
    }
    let starts = prior_poses(&tags, &rig, &profile, sigma.range_m);
    Tunnel { camera, profile, rig, sigma, truth, tags, tracks, starts }
}

impl Tunnel {
    fn problem(&self) -> Problem<'_> {
        Problem {
            camera: &self.camera,
            profile: &self.profile,
            rig: &self.rig,
            sigma: self.sigma,
            tags: &self.tags,
            poses: &self.starts,
            tracks: &self.tracks,
            shared: Shared::nominal(&self.camera, &self.rig),
            shared_sigmas: SharedSigmas::of_tags(&self.sigma),
            readout_s: 0.0,
        }
    }

    fn rmse_mm(&self, poses: &[Isometry3<f64>]) -> f64 {
        let sum: f64 = poses
            .iter()
            .zip(&self.truth)
            .map(|(pose, truth)| (pose.translation.vector - truth.translation.vector).norm_squared())
            .sum();
        (sum / poses.len() as f64).sqrt() * 1e3
    }

    /// Changes every observation; those that the closure does not accept are dropped.
    fn change(&mut self, mut keep: impl FnMut(&mut Observation) -> bool) {
        self.tracks.retain(|_, seen| {
            seen.retain_mut(|seen| keep(seen));
            seen.len() >= 2
        });
    }
}

const WEIGHTS: Weights = Weights { pixel_px: 0.3, loss: Loss::GemanMcClure(3.0), surface_m: 0.05 };

#[test]
fn a_noisy_spiral_is_recovered_to_a_few_millimetres_from_priors_of_centimetres() {
    let tunnel = tunnel(30, 0.3, 7);
    let problem = tunnel.problem();
    let before_mm = tunnel.rmse_mm(problem.poses);
    let adjusted = adjust(&problem, &WEIGHTS).unwrap();
    let after_mm = tunnel.rmse_mm(&adjusted.poses);
    assert!(before_mm > 15.0, "the prior is already good: {before_mm} mm");
    assert!(after_mm < 4.0, "{before_mm} mm -> {after_mm} mm, {:?}", adjusted.report);
    assert_eq!(adjusted.report.outcome, Outcome::Converged);
}

#[test]
fn a_third_of_wrong_matches_changes_little() {
    let mut tunnel = tunnel(20, 0.3, 11);
    let mut random = ChaCha8Rng::seed_from_u64(3);
    tunnel.change(|seen| {
        if random.random_range(0.0..1.0) < 0.3 {
            seen.pixel = seen.pixel.map(|value| value + random.random_range(-60.0..60.0));
        }
        true
    });
    let adjusted = adjust(&tunnel.problem(), &WEIGHTS).unwrap();
    let after_mm = tunnel.rmse_mm(&adjusted.poses);
    assert!(after_mm < 6.0, "{after_mm} mm, {:?}", adjusted.report);
}

#[test]
fn the_same_problem_gives_the_same_bits_with_one_thread_or_two() {
    let tunnel = tunnel(12, 0.3, 5);
    let run = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| adjust(&tunnel.problem(), &WEIGHTS).unwrap())
    };
    assert_eq!(run(1).poses, run(2).poses);
}

#[test]
fn photos_without_any_match_keep_their_prior() {
    let mut tunnel = tunnel(10, 0.3, 9);
    tunnel.change(|seen| seen.photo != 4);
    let problem = tunnel.problem();
    let adjusted = adjust(&problem, &WEIGHTS).unwrap();
    let error = adjusted.poses[4].translation.vector - tunnel.truth[4].translation.vector;
    assert!(error.norm() < 0.08, "{error}");
}
