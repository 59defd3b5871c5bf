//! The solver against exact synthetic tunnels, and the whole adjustment on a noisy one.

use adit_geometry::camera::{Camera, Distortion};
use adit_geometry::profile::{Profile, ProfileSpec};
use adit_geometry::rig::{ImageUp, Rig, nominal_rotation};
use adit_protocol::mission::Sigma;
use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3, Vector6};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use rayon::prelude::*;

use super::factors::{ANCHOR_M, ODOMETER_STEP_M};
use super::*;
use crate::prior::{Beam, PriorModel, TagPrior, prior_views};

struct Tunnel {
    camera: Camera<f64>,
    profile: Profile<f64>,
    rig: Rig<f64>,
    truth: Vec<Isometry3<f64>>,
    tags: Vec<TagPrior>,
    tracks: Tracks,
    starts: Vec<Isometry3<f64>>,
    shared_sigmas: SharedSigmas,
    readout_s: f64,
}

/// What a synthetic survey looks like.
struct Spec {
    shape: ProfileSpec<f64>,
    photos: usize,
    points_per_photo: usize,
    pixel_px: f64,
    /// What the shared unknowns really are; drawn from the tags' sigmas (mounting, odometer) where `None`.
    shared: Option<fn(&mut Shared)>,
    readout_s: f64,
    seed: u64,
}

const UNDERPASS: ProfileSpec<f64> =
    ProfileSpec::Underpass { width_m: 4.0, wall_m: 2.5, rise_m: 1.0, axis_height_m: 1.4 };
const CIRCLE: ProfileSpec<f64> = ProfileSpec::Circle { radius_m: 2.2 };
/// No photo sees a point farther away along the axis.
const REACH_M: f64 = 4.0;
const SIGMA: Sigma =
    Sigma { shaft_rad: 0.017, range_m: 0.02, odometer_m_per_m: 0.02, attitude_rad: 0.017, mount_rad: 0.017 };

fn camera() -> Camera<f64> {
    Camera {
        width_px: 1000,
        height_px: 750,
        focal_px: [466.0; 2],
        centre_px: [503.0, 373.0],
        distortion: Distortion::BrownConrady([-0.04, 0.006, 0.0, 0.0, 0.0]),
    }
}

fn rig() -> Rig<f64> {
    Rig {
        images_per_turn: 10,
        image_up: ImageUp::Forward,
        lever_radial_m: 0.06,
        lever_forward_m: 0.0,
        mount_rotvec_rad: [0.0; 3],
    }
}

/// A spiral in an underpass (whose corners fix the roll) with noisy tags.
fn tunnel(photos: usize, pixel_px: f64, seed: u64) -> Tunnel {
    let shared = |shared: &mut Shared| {
        shared.mount_rotvec = Vector3::new(0.012, -0.01, 0.015);
        shared.odometer_scale = 0.015;
    };
    Spec { shape: UNDERPASS, photos, points_per_photo: 60, pixel_px, shared: Some(shared), readout_s: 0.0, seed }
        .build()
}

impl Spec {
    /// Draws a survey whose every noise is what the adjustment believes it to be.
    fn build(&self) -> Tunnel {
        let mut random = ChaCha8Rng::seed_from_u64(self.seed);
        let mut noise = move |sigma: f64| {
            let value: f64 = StandardNormal.sample(&mut random);
            value * sigma
        };
        let (camera, rig, profile) = (camera(), rig(), self.shape.build().unwrap());
        let mut shared = Shared::nominal(&camera, &rig);
        if let Some(set) = self.shared {
            set(&mut shared);
        } else {
            shared.mount_rotvec = Vector3::from_fn(|_, _| noise(SIGMA.mount_rad));
            shared.odometer_scale = noise(SIGMA.odometer_m_per_m);
        }
        let mounted = Rig {
            lever_radial_m: shared.lever_m[0],
            lever_forward_m: shared.lever_m[1],
            mount_rotvec_rad: shared.mount_rotvec.into(),
            ..rig
        };
        let (mut truth, mut tags) = (Vec::new(), Vec::new());
        let mut odometer_m = noise(ANCHOR_M);
        for index in 0..self.photos {
            let tag_rad = (index as f64 * 36.0).to_radians();
            let [by_sin, by_cos] = shared.shaft_periodic_rad;
            let shaft_rad = tag_rad + shared.shaft_bias_rad + by_sin * tag_rad.sin() + by_cos * tag_rad.cos();
            let body = Vector3::new(0.1 * index as f64, noise(0.03), noise(0.03));
            let attitude = UnitQuaternion::from_scaled_axis(Vector3::new(
                noise(SIGMA.shaft_rad.hypot(SIGMA.attitude_rad)),
                noise(SIGMA.attitude_rad),
                noise(SIGMA.attitude_rad),
            ));
            truth.push(Isometry3::from_parts(Translation3::from(body), attitude) * mounted.body_from_cam(shaft_rad));
            let beams = [-Vector3::z(), Vector3::y(), -Vector3::y()].map(|direction| {
                let hit = profile.ray_cast(body.yz() / shared.profile_size, direction.yz()).unwrap();
                Beam { direction, measured_m: hit.distance * shared.profile_size + noise(SIGMA.range_m) }
            });
            tags.push(TagPrior {
                shaft_rad: tag_rad,
                attitude_rad: None,
                beams: beams.to_vec(),
                range_head_m: None,
                odometer_m: Some(odometer_m),
                rotation_sigma_rad: [SIGMA.shaft_rad.hypot(SIGMA.attitude_rad), SIGMA.attitude_rad, SIGMA.attitude_rad],
            });
            odometer_m += (0.1 + noise(ODOMETER_STEP_M)) / (1.0 + shared.odometer_scale);
        }
        let tracks = self.tracks(&truth, &shared, &profile, &mut noise);
        let model =
            PriorModel { rig: &rig, profile: &profile, sigma: &SIGMA, odometer_factor: 1.0, unknown_step_m: 0.0 };
        let starts = prior_views(&tags, &model).into_iter().map(|view| view.tunnel_from_cam).collect();
        let (shared_sigmas, readout_s) = (SharedSigmas::of_tags(&SIGMA), self.readout_s);
        Tunnel { camera, profile, rig, truth, tags, tracks, starts, shared_sigmas, readout_s }
    }

    /// Wall points off the profile by what the surface prior allows, placed on it to start from.
    fn tracks(
        &self,
        truth: &[Isometry3<f64>],
        shared: &Shared,
        profile: &Profile<f64>,
        noise: &mut impl FnMut(f64) -> f64,
    ) -> Tracks {
        let mut random = ChaCha8Rng::seed_from_u64(self.seed + 1_000_000);
        let x_axis = |pose: &Isometry3<f64>| {
            // The shaft's axis: along x, through the body's origin.
            let view = pose.rotation * (UnitQuaternion::from_scaled_axis(-shared.mount_rotvec) * Vector3::z());
            pose.translation.vector - view * shared.lever_m[0]
        };
        let mut tracks = Tracks::default();
        while tracks.len() < self.photos * self.points_per_photo {
            let along = random.random_range(-1.5..0.1 * self.photos as f64 + 1.5);
            let surface = profile.at(random.random_range(0.0..profile.perimeter_m())).unwrap();
            let section = surface.point * shared.profile_size + surface.normal * noise(WEIGHTS.surface_m);
            let position = Point3::new(along, section.x, section.y);
            let mut seen = Vec::new();
            let near = |pose: &Isometry3<f64>| (pose.translation.x - along).abs() < REACH_M;
            for (photo, pose) in truth.iter().enumerate().filter(|(_, pose)| near(pose)) {
                let mut row = 0.5 * f64::from(shared.camera.height_px);
                let mut found = None;
                for _ in 0..5 {
                    let delay_s = self.readout_s * (row / f64::from(shared.camera.height_px) - 0.5);
                    let axis = pose.rotation * nominal_axis(shared);
                    let turn = UnitQuaternion::from_scaled_axis(axis * shared.shutter_rad_per_s * delay_s);
                    let foot = x_axis(pose);
                    let centre = foot + turn * (pose.translation.vector - foot);
                    let turned = Isometry3::from_parts(Translation3::from(centre), turn * pose.rotation);
                    found = shared.camera.project(&turned.inverse_transform_point(&position).coords);
                    row = found.map_or(row, |pixel| pixel.y);
                }
                if let Some(pixel) = found.filter(|pixel| shared.camera.contains(pixel, 5.0)) {
                    let jittered = pixel.map(|value| value + noise(self.pixel_px));
                    seen.push(Observation { photo: photo as u32, pixel: [jittered.x as f32, jittered.y as f32] });
                }
            }
            if seen.len() >= 2 {
                tracks.push(Point3::new(along, surface.point.x, surface.point.y), seen);
            }
        }
        tracks
    }
}

/// The shaft's direction in the camera frame.
fn nominal_axis(shared: &Shared) -> Vector3<f64> {
    UnitQuaternion::from_scaled_axis(-shared.mount_rotvec)
        * (nominal_rotation(rig().image_up, 0.0).inverse() * Vector3::x())
}

impl Tunnel {
    fn problem(&self) -> Problem<'_> {
        Problem {
            camera: &self.camera,
            profile: &self.profile,
            rig: &self.rig,
            sigma: SIGMA,
            tags: &self.tags,
            poses: &self.starts,
            tracks: &self.tracks,
            shared: Shared::nominal(&self.camera, &self.rig),
            shared_sigmas: self.shared_sigmas,
            readout_s: self.readout_s,
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

/// Photos that start 1.5 % off, as their odometer is, are metres away from their place at the end of a long tunnel: nothing may
/// hold them there, and the length must be right before the adjustment says that it has converged.
#[test]
fn a_hundred_metres_get_their_length_from_the_section_and_not_from_the_odometer() {
    let shared = |shared: &mut Shared| shared.odometer_scale = 0.015;
    let spec = Spec {
        shape: UNDERPASS,
        photos: 1000,
        points_per_photo: 8,
        pixel_px: 0.1,
        shared: Some(shared),
        readout_s: 0.0,
        seed: 31,
    };
    let mut tunnel = spec.build();
    // Points start where a drifted photo sees them.
    let first: Vec<usize> = tunnel.tracks.iter().map(|(_, seen)| seen[0].photo as usize).collect();
    for (position, photo) in tunnel.tracks.positions_mut().iter_mut().zip(first) {
        position.x += tunnel.starts[photo].translation.x - tunnel.truth[photo].translation.x;
    }
    let length_error = |poses: &[Isometry3<f64>]| {
        let length_m = |poses: &[Isometry3<f64>]| poses[999].translation.x - poses[0].translation.x;
        length_m(poses) / length_m(&tunnel.truth) - 1.0
    };
    assert!(length_error(&tunnel.starts) < -0.01, "{}", length_error(&tunnel.starts));
    let adjusted = adjust(&tunnel.problem(), &Weights { pixel_px: 0.1, ..WEIGHTS }).unwrap();
    // Points 5 cm off the section give 0.03 %.
    let error = length_error(&adjusted.poses);
    assert!(error.abs() < 1e-3, "{error}, {:?}", adjusted.report);
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

/// Normalised estimation error squared of each pose, mean over the seeds.
fn nees(shape: &ProfileSpec<f64>, seeds: u64) -> Vec<f64> {
    let of_seed = |seed: u64| -> Vec<f64> {
        let spec = Spec {
            shape: shape.clone(),
            photos: 11,
            points_per_photo: 25,
            pixel_px: WEIGHTS.pixel_px,
            shared: None,
            readout_s: 0.0,
            seed: 500 + seed,
        };
        let mut tunnel = spec.build();
        let adjusted = adjust(&tunnel.problem(), &WEIGHTS).unwrap();
        tunnel.tracks.positions_mut().copy_from_slice(&adjusted.points);
        let problem = Problem { poses: &adjusted.poses, shared: adjusted.shared, ..tunnel.problem() };
        let covariances = Covariances::at(&problem, &WEIGHTS).unwrap();
        let squared =
            adjusted.poses.iter().zip(&tunnel.truth).zip(&covariances.poses).map(|((pose, truth), covariance)| {
                let turned = (pose.rotation.inverse() * truth.rotation).scaled_axis();
                let moved = truth.translation.vector - pose.translation.vector;
                let error = Vector6::new(turned.x, turned.y, turned.z, moved.x, moved.y, moved.z);
                (error.transpose() * covariance.try_inverse().unwrap() * error).x
            });
        squared.collect()
    };
    let all: Vec<Vec<f64>> = (0..seeds).into_par_iter().map(of_seed).collect();
    (0..11).map(|photo| all.iter().map(|squared| squared[photo]).sum::<f64>() / seeds as f64).collect()
}

/// Over 100 seeds the mean normalised estimation error squared of a pose (6 degrees of freedom) is a chi-square of 600 degrees
/// over 100: 5.34 to 6.70 with 95 %. The mean over the poses of a survey must lie there (poses that share their error do not
/// narrow it), and each pose in the band that eleven of them leave with 95 % (99.5 % each): 5.07 to 7.01.
#[test]
fn covariances_are_honest_on_a_circle_and_in_an_underpass() {
    for shape in [CIRCLE, UNDERPASS] {
        let poses = nees(&shape, 100);
        let mean = poses.iter().sum::<f64>() / poses.len() as f64;
        assert!((5.34..6.70).contains(&mean), "{shape:?}: mean {mean:.2}, poses {poses:.2?}");
        assert!(poses.iter().all(|pose| (5.07..7.01).contains(pose)), "{shape:?}: {poses:.2?}");
    }
}

#[test]
fn half_a_unit_in_the_last_place_of_a_pixel_moves_no_pose() {
    let tunnel = tunnel(12, 0.05, 21);
    let mut nudged = self::tunnel(12, 0.05, 21);
    let mut random = ChaCha8Rng::seed_from_u64(4);
    // Rounding errs by at most half a unit; here every coordinate is off by a whole one.
    nudged.change(|seen| {
        seen.pixel = seen.pixel.map(|value| if random.random_bool(0.5) { value.next_up() } else { value.next_down() });
        true
    });
    // There are no wrong matches, and a loss with one minimum: else a match on the edge of belief may fall to either side.
    let weights = Weights { pixel_px: 0.05, loss: Loss::Squared, ..WEIGHTS };
    let [one, other] = [&tunnel, &nudged].map(|tunnel| adjust(&tunnel.problem(), &weights).unwrap());
    let sigmas = Covariances::at(&tunnel.problem(), &weights).unwrap().pose_sigmas();
    for ((one, other), sigma) in one.poses.iter().zip(&other.poses).zip(sigmas) {
        let moved = one.translation.vector - other.translation.vector;
        for axis in 0..3 {
            assert!(moved[axis].abs() < 0.01 * sigma.position_m[axis], "{moved:?} against {sigma:?}");
        }
    }
}

/// Adjusts with more unknowns free; returns what was found, and how well it claims to know it.
fn found(readout_s: f64, set: fn(&mut Shared), free: fn(&mut SharedSigmas)) -> (Shared, SharedSigmas) {
    let weights = Weights { pixel_px: 0.1, ..WEIGHTS };
    let spec = Spec {
        shape: UNDERPASS,
        photos: 40,
        points_per_photo: 40,
        pixel_px: 0.1,
        shared: Some(set),
        readout_s,
        seed: 31,
    };
    let mut tunnel = spec.build();
    free(&mut tunnel.shared_sigmas);
    let adjusted = adjust(&tunnel.problem(), &weights).unwrap();
    tunnel.tracks.positions_mut().copy_from_slice(&adjusted.points);
    let problem = Problem { poses: &adjusted.poses, shared: adjusted.shared, ..tunnel.problem() };
    (adjusted.shared, Covariances::at(&problem, &weights).unwrap().shared)
}

/// Whether an estimate lies within three of its standard deviations, which must have shrunk to `most` at least.
#[track_caller]
fn assert_found(value: f64, truth: f64, sigma: f64, most: f64) {
    assert!((value - truth).abs() < 3.0 * sigma, "{value} is not {truth} within {sigma}");
    assert!(sigma < most, "sigma {sigma} of {value}");
}

#[test]
fn focal_length_and_distortion_are_found() {
    let set = |shared: &mut Shared| {
        shared.camera.focal_px = [470.0, 469.0];
        shared.camera.distortion = Distortion::BrownConrady([-0.05, 0.008, 0.0, 0.0, 0.0]);
    };
    let free = |sigmas: &mut SharedSigmas| {
        sigmas.focal_px = [5.0; 2];
        sigmas.distortion = [0.02, 0.01, 0.0, 0.0, 0.0];
    };
    let (Shared { camera, .. }, sigmas) = found(0.0, set, free);
    assert_found(camera.focal_px[0], 470.0, sigmas.focal_px[0], 0.3);
    assert_found(camera.focal_px[1], 469.0, sigmas.focal_px[1], 0.3);
    let Distortion::BrownConrady(k) = camera.distortion else { panic!("{camera:?}") };
    assert_found(k[0], -0.05, sigmas.distortion[0], 1e-3);
    assert_found(k[1], 0.008, sigmas.distortion[1], 1e-3);
    assert_eq!((&k[2..], sigmas.distortion[2]), (&[0.0; 3][..], 0.0), "fixed ones move");
}

#[test]
fn the_profile_size_is_found_from_the_ranges() {
    let set = |shared: &mut Shared| shared.profile_size = 1.01;
    let (shared, sigmas) = found(0.0, set, |sigmas| sigmas.profile_size = 0.05);
    assert_found(shared.profile_size, 1.01, sigmas.profile_size, 0.002);
}

#[test]
fn shaft_bias_and_periodic_error_are_found_in_an_underpass() {
    let set = |shared: &mut Shared| {
        shared.shaft_bias_rad = 0.05;
        shared.shaft_periodic_rad = [0.02, -0.03];
    };
    let (shared, sigmas) = found(0.0, set, |sigmas| {
        sigmas.shaft_bias_rad = 0.1;
        sigmas.shaft_periodic_rad = [0.05; 2];
    });
    assert_found(shared.shaft_bias_rad, 0.05, sigmas.shaft_bias_rad, 0.03);
    assert_found(shared.shaft_periodic_rad[0], 0.02, sigmas.shaft_periodic_rad[0], 0.01);
    assert_found(shared.shaft_periodic_rad[1], -0.03, sigmas.shaft_periodic_rad[1], 0.01);
}

#[test]
fn the_rotation_during_readout_is_found() {
    let set = |shared: &mut Shared| shared.shutter_rad_per_s = 0.5;
    let (shared, sigmas) = found(0.03, set, |sigmas| sigmas.shutter_rad_per_s = 1.0);
    assert_found(shared.shutter_rad_per_s, 0.5, sigmas.shutter_rad_per_s, 0.05);
}

#[test]
fn the_radial_lever_is_found() {
    let set = |shared: &mut Shared| shared.lever_m[0] = 0.09;
    let (shared, sigmas) = found(0.0, set, |sigmas| sigmas.lever_m[0] = 0.05);
    assert_found(shared.lever_m[0], 0.09, sigmas.lever_m[0], 0.02);
}

#[test]
fn a_photo_without_a_tag_is_placed_by_its_matches_and_one_with_nothing_goes_with_its_neighbours() {
    let mut tunnel = tunnel(14, 0.3, 13);
    for photo in [5, 9] {
        let nothing = [f64::INFINITY; 3];
        tunnel.tags[photo] =
            TagPrior { rotation_sigma_rad: nothing, beams: Vec::new(), odometer_m: None, ..tunnel.tags[photo].clone() };
    }
    tunnel.change(|seen| seen.photo != 9);
    let adjusted = adjust(&tunnel.problem(), &WEIGHTS).unwrap();
    let error_m =
        |photo: usize| (adjusted.poses[photo].translation.vector - tunnel.truth[photo].translation.vector).norm();
    assert!(error_m(5) < 0.006, "{}", error_m(5));
    let moved = |photo: usize| adjusted.poses[photo].translation.vector - tunnel.starts[photo].translation.vector;
    let apart = moved(9) - Vector3::x() * (0.5 * (moved(8) + moved(10)).x);
    assert!(apart.norm() < 1e-6, "{apart}");
}

#[test]
fn the_quality_of_a_photo_counts_its_wrong_matches() {
    let mut tunnel = tunnel(12, 0.3, 17);
    let mut random = ChaCha8Rng::seed_from_u64(8);
    tunnel.change(|seen| {
        if seen.photo == 6 && random.random_bool(0.4) {
            seen.pixel[0] += 15.0;
        }
        true
    });
    let adjusted = adjust(&tunnel.problem(), &WEIGHTS).unwrap();
    tunnel.tracks.positions_mut().copy_from_slice(&adjusted.points);
    let problem = Problem { poses: &adjusted.poses, shared: adjusted.shared, ..tunnel.problem() };
    let qualities = photo_qualities(&problem, &WEIGHTS);
    let total: usize = qualities.iter().map(|quality| quality.observations).sum();
    assert_eq!(total, tunnel.tracks.observations().len());
    assert!((0.3..0.55).contains(&qualities[6].doubted_share), "{:?}", qualities[6]);
    assert!(qualities[6].rms_px > 5.0, "{:?}", qualities[6]);
    for photo in [0, 3, 11] {
        assert!(qualities[photo].doubted_share < 0.12 && qualities[photo].rms_px < 1.0, "{:?}", qualities[photo]);
    }
}

#[test]
fn points_triangulated_at_true_poses_fit_and_at_prior_poses_do_not() {
    let mut tunnel = tunnel(12, 0.0, 21);
    for position in tunnel.tracks.positions_mut() {
        position.coords *= 0.9;
    }
    let error_px = |poses| median(&triangulated_errors_px(&Problem { poses, ..tunnel.problem() }));
    assert!(error_px(&tunnel.truth) < 1e-3, "{}", error_px(&tunnel.truth));
    assert!(error_px(&tunnel.starts) > 1.0, "{}", error_px(&tunnel.starts));
}
