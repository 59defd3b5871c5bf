//! The strategies on features of known points of a round wall, with strangers among them and patterns that repeat.

use adit_geometry::camera::Distortion;
use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::*;
use crate::features::{Keypoint, SiftDescriptor};

const CAMERA: Camera<f64> = Camera {
    width_px: 1000,
    height_px: 750,
    focal_px: [466.0, 466.0],
    centre_px: [500.0, 375.0],
    distortion: Distortion::BrownConrady([0.0; 5]),
};

/// Two views of a wall; feature i of either shows point i, for the first [`POINTS`] of them.
struct Scene {
    views: [View<SiftDescriptor>; 2],
    second_from_first: Isometry3<f64>,
}

const POINTS: usize = 900;
const STRANGERS: usize = 500;

impl Scene {
    /// A share of the points looks like one of twenty patterns, as bricks do.
    fn new(repeating: f64) -> Self {
        let mut rng = ChaCha8Rng::seed_from_u64(11);
        let second_from_first = Isometry3::from_parts(
            Translation3::new(0.15, 0.5, 0.05),
            UnitQuaternion::from_scaled_axis(Vector3::new(0.02, 0.3, -0.01)),
        );
        let patterns: Vec<SiftDescriptor> = (0..20).map(|_| descriptor(&mut rng)).collect();
        let mut features = [0, 1].map(|_| Features { keypoints: Vec::new(), descriptors: Vec::new() });
        while features[0].keypoints.len() < POINTS {
            let (phi, y): (f64, f64) = (rng.random_range(-0.7..0.7), rng.random_range(-2.0..2.0));
            let point = Point3::new(3.0 * phi.sin(), y, 3.0 * phi.cos());
            let points = [point, second_from_first * point];
            let pixels = points.map(|point| CAMERA.project(&point.coords).filter(|at| CAMERA.contains(at, 0.0)));
            let [Some(first), Some(second)] = pixels else { continue };
            let repeats = rng.random_bool(repeating);
            let looks = if repeats { patterns[rng.random_range(0..20)] } else { descriptor(&mut rng) };
            for (features, pixel) in features.iter_mut().zip([first, second]) {
                let noisy = [pixel.x + rng.random_range(-0.5..0.5), pixel.y + rng.random_range(-0.5..0.5)];
                features.keypoints.push(keypoint(noisy));
                features.descriptors.push(looks.map(|value| value.saturating_add(rng.random_range(0..12))));
            }
        }
        for features in &mut features {
            for _ in 0..STRANGERS {
                features.keypoints.push(keypoint([rng.random_range(0.0..1000.0), rng.random_range(0.0..750.0)]));
                features.descriptors.push(descriptor(&mut rng));
            }
        }
        Self { views: features.map(|features| View::new(features, &CAMERA)), second_from_first }
    }

    /// Matches, and the share of them that is right.
    fn run(&self, strategy: &impl Strategy<SiftDescriptor>) -> (Correspondences, f64) {
        let [first, second] = &self.views;
        let found = strategy.correspond(first, second);
        for side in 0..2 {
            let mut features: Vec<u32> = found.matches.iter().map(|pair| pair[side]).collect();
            features.sort_unstable();
            features.dedup();
            assert_eq!(features.len(), found.matches.len(), "a feature is in two matches");
        }
        let right = found.matches.iter().filter(|pair| pair[0] == pair[1] && pair[0] < POINTS as u32).count();
        let share = right as f64 / found.matches.len().max(1) as f64;
        (found, share)
    }
}

fn keypoint(pixel: [f64; 2]) -> Keypoint {
    Keypoint { pixel, scale_px: 2.0, angle_rad: 0.0, response: 1.0 }
}

fn descriptor(rng: &mut ChaCha8Rng) -> SiftDescriptor {
    std::array::from_fn(|_| rng.random_range(0..90))
}

#[test]
fn every_strategy_finds_the_motion_of_a_wall_without_repetition() {
    let scene = Scene::new(0.0);
    let strategies: [&dyn Fn() -> (Correspondences, f64); 3] =
        [&|| scene.run(&Ratio::default()), &|| scene.run(&Gms::default()), &|| scene.run(&RepMatch::default())];
    for run in strategies {
        let (found, right) = run();
        let two_view = found.two_view.expect("a motion");
        let off_rad = two_view.second_from_first.rotation.angle_to(&scene.second_from_first.rotation);
        let count = found.matches.len();
        assert!(count > 700 && right > 0.99 && off_rad < 0.004, "{count} {right} {off_rad}");
    }
}

#[test]
fn where_most_of_the_wall_repeats_repmatch_keeps_what_the_ratio_test_throws_away() {
    let scene = Scene::new(0.8);
    let (ratio, ratio_right) = scene.run(&Ratio::default());
    let (repmatch, repmatch_right) = scene.run(&RepMatch::default());
    let counts = [ratio.matches.len(), repmatch.matches.len()];
    assert!(ratio_right > 0.97 && counts[0] < 300, "{counts:?} {ratio_right}");
    assert!(repmatch_right > 0.97 && counts[1] > 2 * counts[0], "{counts:?} {repmatch_right}");
}

#[test]
fn photos_with_nothing_in_common_have_no_motion() {
    let scene = Scene::new(0.0);
    let [first, mut second] = scene.views.clone();
    // Everything is still there, but each descriptor in another's place.
    second.features.descriptors.reverse();
    let mixed = Scene { views: [first, second], ..scene };
    for (found, _) in [mixed.run(&Ratio::default()), mixed.run(&Gms::default()), mixed.run(&RepMatch::default())] {
        assert!(found.two_view.is_none() && found.matches.is_empty(), "{} matches", found.matches.len());
    }
}
