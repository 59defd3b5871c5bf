//! Poses without tags in tunnels of which everything is known.

use std::f64::consts::TAU;

use adit_geometry::camera::{Camera, Distortion};
use adit_geometry::profile::{Profile, ProfileSpec};
use adit_geometry::rig::{ImageUp, Rig, attitude};
use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, UnitVector3, Vector2, Vector3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, Normal};

use super::fit::is_round;
use super::*;
use crate::two_view::{TwoViewOptions, estimate};

const CIRCLE: ProfileSpec<f64> = ProfileSpec::Circle { radius_m: 3.0 };
const UNDERPASS: ProfileSpec<f64> =
    ProfileSpec::Underpass { width_m: 4.0, wall_m: 2.5, rise_m: 1.0, axis_height_m: 1.4 };

fn rig() -> Rig<f64> {
    Rig {
        images_per_turn: 10,
        image_up: ImageUp::Forward,
        lever_radial_m: 0.06,
        lever_forward_m: 0.0,
        mount_rotvec_rad: [0.0; 3],
    }
}

fn camera() -> Camera<f64> {
    Camera {
        width_px: 1000,
        height_px: 750,
        focal_px: [466.0, 466.0],
        centre_px: [503.0, 373.0],
        distortion: Distortion::BrownConrady([-0.04, 0.006, 0.0, 0.0, 0.0]),
    }
}

/// A flight as in the samples: 10 cm and 36 degrees per photo, centimetres and degrees of noise.
struct Flight {
    profile: Profile<f64>,
    truth: Vec<Isometry3<f64>>,
    seed: u64,
}

impl Flight {
    fn new(spec: &ProfileSpec<f64>, photos: usize, first_rad: f64, seed: u64) -> Self {
        let mut flight = Self { profile: spec.build().unwrap(), truth: Vec::new(), seed };
        flight.fly((0..photos).map(|i| (i as f64 * 0.1, first_rad + i as f64 * TAU / 10.0)));
        flight
    }

    fn fly(&mut self, stations: impl Iterator<Item = (f64, f64)>) {
        let mut random = ChaCha8Rng::seed_from_u64(self.seed);
        let normal = Normal::new(0.0, 1.0).unwrap();
        let mut draw = |sigma: f64| sigma * normal.sample(&mut random);
        let mount = Vector3::new(draw(0.015), draw(0.015), draw(0.015));
        let rig = Rig { mount_rotvec_rad: mount.into(), ..rig() };
        let mut offset = Vector2::new(draw(0.08), draw(0.08));
        self.truth = stations
            .map(|(x_m, shaft_rad)| {
                offset += Vector2::new(draw(0.02), draw(0.02));
                let rotation = attitude(draw(0.025), draw(0.025), draw(0.025));
                let centre = Translation3::new(x_m + draw(0.01), offset.x, offset.y);
                Isometry3::from_parts(centre, rotation) * rig.body_from_cam(shaft_rad + draw(0.017))
            })
            .collect();
    }

    /// What matching would find: wall points that both see, half a pixel of noise, 30 % of them wrong; then RANSAC.
    fn link(&self, photos: [usize; 2]) -> Option<Link> {
        let seed = self.seed * 1_000_003 + (photos[0] * 1009 + photos[1]) as u64;
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let normal = Normal::new(0.0, 0.5).unwrap();
        let camera = camera();
        let poses = photos.map(|photo| self.truth[photo]);
        let mut rays = Vec::new();
        for _ in 0..4000 {
            let surface = self.profile.at(random.random_range(0.0..self.profile.perimeter_m())).unwrap();
            let x_m = poses[0].translation.x + random.random_range(-2.5..2.5);
            let point = Point3::new(x_m, surface.point.x, surface.point.y);
            let pixels = poses.map(|pose| {
                let pixel = camera.project(&pose.inverse_transform_point(&point).coords)?;
                camera.contains(&pixel, 10.0).then_some(pixel)
            });
            let [Some(first), Some(second)] = pixels else { continue };
            let mut seen = [first, second]
                .map(|pixel| pixel + Vector2::new(normal.sample(&mut random), normal.sample(&mut random)));
            if random.random_range(0.0..1.0) < 0.3 {
                seen[1] = Vector2::new(random.random_range(20.0..980.0), random.random_range(20.0..730.0));
            }
            rays.push(seen.map(|pixel| UnitVector3::new_normalize(camera.unproject(&pixel).unwrap())));
            if rays.len() == 150 {
                break;
            }
        }
        let found = estimate(&rays, &TwoViewOptions { max_iterations: 400, ..TwoViewOptions::default() })?;
        let kept = rays.into_iter().zip(&found.inliers).filter(|(_, inlier)| **inlier).map(|(pair, _)| pair).collect();
        Some(Link { photos, rays: kept, second_from_first: found.second_from_first.rotation })
    }

    fn place(&self) -> Vec<PlacedPhoto> {
        let graph = view_graph(self.truth.len(), &rig(), |pair| self.link(pair)).unwrap();
        place(&graph, &self.profile, &rig()).unwrap()
    }

    /// Worst errors `[metres, degrees]` over the placed photos, after the gauge: x, and the roll if `round`.
    fn worst(&self, placed: &[PlacedPhoto], round: bool) -> [f64; 2] {
        let mut worst = [0.0_f64; 2];
        for (position_m, rotation_rad, photo) in errors(&self.truth, placed, round) {
            if placed[photo].placed {
                worst = [worst[0].max(position_m), worst[1].max(rotation_rad.to_degrees())];
            }
        }
        worst
    }
}

/// Position and rotation error of each photo after the gauge that a flight without tags leaves free.
fn errors(truth: &[Isometry3<f64>], placed: &[PlacedPhoto], round: bool) -> Vec<(f64, f64, usize)> {
    let count = truth.len() as f64;
    let about_axis = |turn: UnitQuaternion<f64>| turn.scaled_axis().x;
    let first_rad = about_axis(truth[0].rotation * placed[0].tunnel_from_cam.rotation.inverse());
    let roll = |angle_rad: f64| UnitQuaternion::from_axis_angle(&Vector3::x_axis(), angle_rad);
    let turn = if round {
        let rest = |(t, p): (&Isometry3<f64>, &PlacedPhoto)| {
            about_axis(t.rotation * (roll(first_rad) * p.tunnel_from_cam.rotation).inverse())
        };
        roll(first_rad + truth.iter().zip(placed).map(rest).sum::<f64>() / count)
    } else {
        UnitQuaternion::identity()
    };
    let shift_m =
        truth.iter().zip(placed).map(|(t, p)| t.translation.x - p.tunnel_from_cam.translation.x).sum::<f64>() / count;
    truth
        .iter()
        .zip(placed)
        .enumerate()
        .map(|(photo, (truth, placed))| {
            let centre = turn * placed.tunnel_from_cam.translation.vector + Vector3::x() * shift_m;
            let rotation = (turn * placed.tunnel_from_cam.rotation).angle_to(&truth.rotation);
            ((centre - truth.translation.vector).norm(), rotation, photo)
        })
        .collect()
}

#[test]
fn a_flight_through_a_round_tunnel_is_placed_within_two_degrees_and_five_centimetres() {
    for seed in 0..3 {
        let flight = Flight::new(&CIRCLE, 40, 1.0, seed);
        let placed = flight.place();
        assert!(placed.iter().all(|photo| photo.placed), "seed {seed}");
        let [position_m, rotation_deg] = flight.worst(&placed, true);
        assert!(position_m < 0.03 && rotation_deg < 1.0, "seed {seed}: {position_m} m, {rotation_deg} degrees");
    }
}

#[test]
fn in_an_underpass_the_starting_angle_is_found_as_well() {
    for (seed, first_rad) in [(0, 0.0), (1, 2.0), (2, 4.5)] {
        let flight = Flight::new(&UNDERPASS, 30, first_rad, seed);
        let placed = flight.place();
        let [position_m, rotation_deg] = flight.worst(&placed, false);
        assert!(position_m < 0.03 && rotation_deg < 1.0, "seed {seed}: {position_m} m, {rotation_deg} degrees");
    }
}

#[test]
fn a_shaft_that_turns_the_other_way_and_a_vehicle_that_flies_backwards_are_placed() {
    let mut flight = Flight::new(&CIRCLE, 0, 0.0, 5);
    flight.fly((0..30).map(|i| (-0.08 * f64::from(i), -f64::from(i) * TAU / 10.0)));
    let placed = flight.place();
    let [position_m, rotation_deg] = flight.worst(&placed, true);
    assert!(position_m < 0.03 && rotation_deg < 1.0, "{position_m} m, {rotation_deg} degrees");
}

#[test]
fn a_missed_photo_is_noticed_by_the_turn_between_its_neighbours() {
    let mut flight = Flight::new(&CIRCLE, 0, 0.0, 6);
    flight.fly((0..31).filter(|i| *i != 14).map(|i| (0.1 * f64::from(i), f64::from(i) * TAU / 10.0)));
    let placed = flight.place();
    let [position_m, rotation_deg] = flight.worst(&placed, true);
    assert!(position_m < 0.03 && rotation_deg < 1.0, "{position_m} m, {rotation_deg} degrees");
}

#[test]
fn a_vehicle_that_stands_is_placed_by_the_turn_of_its_camera_alone() {
    let mut flight = Flight::new(&UNDERPASS, 0, 0.0, 7);
    flight.fly((0..20).map(|i| (0.0, f64::from(i) * TAU / 10.0)));
    let placed = flight.place();
    let [position_m, rotation_deg] = flight.worst(&placed, false);
    assert!(position_m < 0.05 && rotation_deg < 2.0, "{position_m} m, {rotation_deg} degrees");
}

#[test]
fn a_photo_without_a_match_is_interpolated_with_a_wide_sigma() {
    let flight = Flight::new(&CIRCLE, 30, 0.0, 8);
    let blind = 12;
    let graph = view_graph(30, &rig(), |pair| if pair.contains(&blind) { None } else { flight.link(pair) }).unwrap();
    let placed = place(&graph, &flight.profile, &rig()).unwrap();
    let lost: Vec<usize> = (0..30).filter(|photo| !placed[*photo].placed).collect();
    assert_eq!(lost, [blind]);
    let usual_m = placed[blind + 1].position_sigma_m;
    assert!(placed[blind].position_sigma_m > 5.0 * usual_m, "{} beside {usual_m}", placed[blind].position_sigma_m);
    for (position_m, rotation_rad, photo) in errors(&flight.truth, &placed, true) {
        let sigmas = [placed[photo].position_sigma_m, placed[photo].rotation_sigma_rad];
        assert!(position_m < 0.03 || photo == blind, "photo {photo}: {position_m} m");
        assert!(
            position_m < 6.0 * sigmas[0] && rotation_rad < 6.0 * sigmas[1],
            "photo {photo}: {position_m} m, {rotation_rad} rad; {sigmas:?}"
        );
    }
}

#[test]
fn photos_that_match_nothing_are_an_error_that_says_what_was_expected() {
    let error = view_graph(5, &rig(), |_| None).unwrap_err();
    assert_eq!(error, UntaggedError::NoTurn { pairs: 4, step_deg: 36 });
    assert!(error.to_string().contains("images_per_turn"), "{error}");
    assert_eq!(view_graph(1, &rig(), |_| None).unwrap_err(), UntaggedError::TooFewPhotos { photos: 1 });
}

#[test]
fn the_tag_of_a_placed_photo_gives_its_pose_back() {
    let flight = Flight::new(&CIRCLE, 12, 0.7, 9);
    for truth in &flight.truth {
        let placed = PlacedPhoto {
            tunnel_from_cam: *truth,
            position_sigma_m: 0.01,
            rotation_sigma_rad: 0.01,
            support: 100,
            placed: true,
        };
        let tag = placed.tag(&rig());
        let back = tag.tunnel_from_body_rotation() * rig().body_from_cam(tag.shaft_rad).rotation;
        assert!(back.angle_to(&truth.rotation) < 1e-9);
        let x_m = (tag.tunnel_from_body_rotation() * rig().body_from_cam(tag.shaft_rad).translation.vector).x;
        assert!((tag.odometer_m.unwrap() + x_m - truth.translation.x).abs() < 1e-9);
    }
}

/// Two turns of each sample, without a look at the tags.
#[test]
fn photos_of_the_samples_are_placed_within_two_degrees_and_five_centimetres() {
    let Some(samples) = crate::samples_folder() else {
        eprintln!("skipped: no shared/samples above this crate");
        return;
    };
    for (name, matcher) in [
        ("cylinder-brick-spiral", Matcher::RepMatch),
        ("cylinder-concrete-spiral", Matcher::Ratio),
        ("underpass-spiral", Matcher::Ratio),
    ] {
        let mut survey = crate::survey::load(&samples.join(name)).unwrap();
        survey.photos.truncate(22);
        let profile = survey.config.profile.build().unwrap();
        let found = survey_poses(&survey, &profile, matcher).unwrap();
        assert!(found.losses.is_empty(), "{name}: {:?}", found.losses);
        let truth: Vec<Isometry3<f64>> = crate::poses::read_poses(&samples.join(name).join("truth/poses.csv"))
            .unwrap()
            .iter()
            .take(22)
            .map(|pose| pose.tunnel_from_cam)
            .collect();
        for (position_m, rotation_rad, photo) in errors(&truth, &found.photos, is_round(&profile)) {
            let rotation_deg = rotation_rad.to_degrees();
            assert!(
                position_m < 0.05 && rotation_deg < 2.0,
                "{name}, photo {photo}: off by {position_m} m and {rotation_deg} degrees"
            );
        }
    }
}
