//! Relative poses on scenes of which everything is known.

use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, UnitVector3, Vector3};
use proptest::prelude::{ProptestConfig, any, proptest};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, Normal};

use super::*;

/// Half a pixel of the sample sets' camera (focal length 466 px), in radians.
const NOISE_RAD: f64 = 0.5 / 466.0;

#[derive(Clone, Copy)]
enum Wall {
    /// A cylinder of 3 m radius about the first camera's x axis.
    Cylinder,
    /// A plane 2 m ahead of a camera half way between the two.
    Plane,
    /// No wall: points between 1 m and 6 m ahead.
    Open,
}

/// Rays to points of a wall that both cameras see, the first `true_pairs` of them right.
struct Scene {
    rays: Vec<[UnitVector3<f64>; 2]>,
    true_pairs: usize,
    second_from_first: Isometry3<f64>,
}

impl Scene {
    /// The second camera is turned by 36 degrees about x and displaced by `moved_m`.
    fn new(wall: Wall, moved_m: Vector3<f64>, pairs: usize, outlier_share: f64, seed: u64) -> Self {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let turn = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), 0.2 * std::f64::consts::PI);
        let first_from_second = Isometry3::from_parts(Translation3::from(moved_m), turn);
        let second_from_first = first_from_second.inverse();
        let true_pairs = (pairs as f64 * (1.0 - outlier_share)).round() as usize;
        let normal = Normal::new(0.0, NOISE_RAD).unwrap();
        let mut rays = Vec::new();
        while rays.len() < true_pairs {
            let point = match wall {
                Wall::Cylinder => {
                    let (sin, cos) = random.random_range(-1.0..1.6_f64).sin_cos();
                    Point3::new(random.random_range(-2.0..2.0), -3.0 * sin, 3.0 * cos)
                }
                Wall::Open => {
                    let depth_m = random.random_range(1.0..6.0);
                    Point3::new(random.random_range(-1.0..1.0), random.random_range(-0.8..0.8), 1.0) * depth_m
                }
                Wall::Plane => {
                    let tilt = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), 0.1 * std::f64::consts::PI);
                    tilt * Point3::new(random.random_range(-2.0..2.0), random.random_range(-3.0..3.0), 2.0)
                }
            };
            let both = [point.coords, second_from_first.transform_point(&point).coords];
            if both.iter().all(|p| p.z > 0.0 && (p.x / p.z).abs() < 1.07 && (p.y / p.z).abs() < 0.8) {
                rays.push(both.map(|p| {
                    UnitVector3::new_normalize(p.normalize() + Vector3::from_fn(|_, _| normal.sample(&mut random)))
                }));
            }
        }
        while rays.len() < pairs {
            rays.push([0, 1].map(|_| {
                let direction = Vector3::new(random.random_range(-1.07..1.07), random.random_range(-0.8..0.8), 1.0);
                UnitVector3::new_normalize(direction)
            }));
        }
        Self { rays, true_pairs, second_from_first }
    }

    fn estimate(&self) -> TwoView {
        estimate(&self.rays, &TwoViewOptions::default()).expect("a motion")
    }

    fn rotation_error_rad(&self, found: &TwoView) -> f64 {
        found.second_from_first.rotation.angle_to(&self.second_from_first.rotation)
    }

    fn direction_error_rad(&self, found: &TwoView) -> f64 {
        found.second_from_first.translation.vector.angle(&self.second_from_first.translation.vector)
    }

    /// Share of the right pairs that were kept, and of the wrong ones.
    fn kept(&self, found: &TwoView) -> [f64; 2] {
        let (right, wrong) = found.inliers.split_at(self.true_pairs);
        [right, wrong].map(|part| part.iter().filter(|kept| **kept).count() as f64 / part.len().max(1) as f64)
    }
}

/// One step of the vehicle with the camera's lever arm: forward (camera's -y is up; x here), and along the turn.
fn step_m() -> Vector3<f64> {
    Vector3::new(0.1, -0.036, -0.012)
}

#[test]
fn half_of_the_pairs_may_be_wrong_on_a_cylinder_wall() {
    let mut worst_rad = 0.0_f64;
    for seed in 0..20 {
        let scene = Scene::new(Wall::Cylinder, step_m(), 600, 0.5, seed);
        let found = scene.estimate();
        assert_eq!(found.motion, Motion::General, "seed {seed}");
        let [right, wrong] = scene.kept(&found);
        assert!(right > 0.98 && wrong < 0.06, "seed {seed}: kept {right} of the right and {wrong} of the wrong pairs");
        worst_rad = worst_rad.max(scene.rotation_error_rad(&found));
    }
    // With a step of a decimetre the overlap is as good as flat: the twin, 2.1 degrees away, fits within the noise.
    assert!(worst_rad.to_degrees() < 2.5, "the rotation is off by {} degrees at worst", worst_rad.to_degrees());
}

#[test]
fn half_of_the_pairs_may_be_wrong_where_depth_tells_the_twins_apart() {
    let mut worst = [0.0_f64; 2];
    for seed in 0..20 {
        let scene = Scene::new(Wall::Open, step_m() * 3.0, 600, 0.5, seed);
        let found = scene.estimate();
        let [right, wrong] = scene.kept(&found);
        assert!(right > 0.98 && wrong < 0.06, "seed {seed}: kept {right} of the right and {wrong} of the wrong pairs");
        worst[0] = worst[0].max(scene.rotation_error_rad(&found));
        worst[1] = worst[1].max(scene.direction_error_rad(&found));
    }
    let worst = worst.map(f64::to_degrees);
    assert!(worst[0] < 0.2 && worst[1] < 2.0, "rotation and direction are off by {worst:?} degrees at worst");
}

#[test]
fn a_turn_on_the_spot_is_a_pure_rotation_and_a_step_of_a_decimetre_is_not() {
    for share in [0.0, 0.5] {
        let mut told = 0;
        for seed in 0..20 {
            let still = Scene::new(Wall::Cylinder, Vector3::zeros(), 400, share, seed);
            let found = still.estimate();
            if found.motion == Motion::PureRotation {
                told += 1;
                assert_eq!(found.second_from_first.translation.vector, Vector3::zeros());
                assert!(still.rotation_error_rad(&found).to_degrees() < 0.05, "seed {seed}");
            }
            let moving = Scene::new(Wall::Cylinder, Vector3::new(0.1, 0.0, 0.0), 400, share, seed);
            assert_eq!(moving.estimate().motion, Motion::General, "seed {seed}, outliers {share}");
        }
        assert!(told >= 18, "outliers {share}: {told} of 20 turns on the spot were told as such");
    }
}

#[test]
fn a_flat_wall_gives_the_true_pose_or_its_twin_and_keeps_the_right_pairs() {
    let mut right_pose = 0;
    for seed in 0..20 {
        let scene = Scene::new(Wall::Plane, Vector3::new(0.3, -0.2, 0.1), 600, 0.3, seed);
        let found = scene.estimate();
        let [right, wrong] = scene.kept(&found);
        assert!(right > 0.97 && wrong < 0.06, "seed {seed}: {right} {wrong}");
        right_pose += usize::from(scene.rotation_error_rad(&found).to_degrees() < 1.0);
    }
    assert!(right_pose >= 5, "the true pose was found in {right_pose} of 20 scenes");
}

#[test]
fn random_pairs_and_too_few_pairs_have_no_motion() {
    for seed in 0..10 {
        let scene = Scene::new(Wall::Cylinder, step_m(), 60, 1.0, seed);
        let options = TwoViewOptions { max_iterations: 300, ..TwoViewOptions::default() };
        assert_eq!(estimate(&scene.rays, &options), None, "seed {seed}");
    }
    assert_eq!(estimate(&[], &TwoViewOptions::default()), None);
    let scene = Scene::new(Wall::Cylinder, step_m(), 14, 0.0, 0);
    assert_eq!(estimate(&scene.rays, &TwoViewOptions::default()), None);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(12))]

    #[test]
    fn turning_either_camera_turns_the_answer(seed in any::<u64>(), axis in [-1.0..1.0, -1.0..1.0, -1.0..1.0_f64]) {
        let scene = Scene::new(Wall::Open, step_m() * 5.0, 300, 0.2, seed);
        let turn = UnitQuaternion::from_scaled_axis(Vector3::from(axis));
        let turned: Vec<_> = scene.rays.iter().map(|[first, second]| [turn * first, *second]).collect();
        let plain = scene.estimate();
        let found = estimate(&turned, &TwoViewOptions::default()).expect("a motion");
        let expected = plain.second_from_first.rotation * turn.inverse();
        assert!(found.second_from_first.rotation.angle_to(&expected) < 2e-3);
        let direction = plain.second_from_first.translation.vector.angle(&found.second_from_first.translation.vector);
        assert!(direction < 2e-2, "{direction}");
    }

    #[test]
    fn swapping_the_photos_inverts_the_answer(seed in any::<u64>()) {
        let scene = Scene::new(Wall::Open, step_m() * 5.0, 300, 0.2, seed);
        let swapped: Vec<_> = scene.rays.iter().map(|[first, second]| [*second, *first]).collect();
        let found = estimate(&swapped, &TwoViewOptions::default()).expect("a motion");
        let product = found.second_from_first.rotation * scene.estimate().second_from_first.rotation;
        assert!(product.angle() < 2e-3, "{}", product.angle());
    }
}
