use adit_geometry::profile::ProfileSpec;
use proptest::prelude::*;

use super::*;
use crate::scene::BulgeConfig;

fn circle() -> Profile<f64> {
    ProfileSpec::Circle { radius_m: 3.0 }.build().expect("a valid profile")
}

fn underpass() -> Profile<f64> {
    ProfileSpec::Underpass { width_m: 4.0, wall_m: 2.5, rise_m: 1.0, axis_height_m: 1.4 }.build().expect("valid")
}

fn rough() -> WallConfig {
    WallConfig {
        ovality_mm: 12.0,
        ring_step_mm: 5.0,
        undulation_mm: 4.0,
        bulges: vec![
            BulgeConfig { s_m: 4.0, x_m: 1.5, height_mm: 30.0, sigma_m: 0.3 },
            BulgeConfig { s_m: 0.1, x_m: 0.5, height_mm: -25.0, sigma_m: 0.2 },
        ],
        ..WallConfig::default()
    }
}

/// Clearance to the profile minus relief at the point's foot, by the geometry crate alone.
fn gap_by_profile(wall: &Wall, point: &Point3<f64>) -> f64 {
    let nearest = wall.profile().nearest(point.coords.yz()).expect("finite");
    nearest.clearance_m - wall.relief_m(nearest.surface.s_m, point.x)
}

proptest! {
    #[test]
    fn a_hit_lies_on_the_displaced_surface_and_nothing_lies_before_it(
        underpass_shape in any::<bool>(), y in -0.8..0.8f64, z in -0.8..0.8f64, x in -5.0..5.0f64,
        phi in 0.0..std::f64::consts::TAU, lean in -1.2..1.2f64, seed in 0..20u64,
    ) {
        let profile = if underpass_shape { underpass() } else { circle() };
        let wall = Wall::new(profile, &rough(), seed).expect("valid");
        let direction = Vector3::new(lean.sin(), phi.sin() * lean.cos(), -phi.cos() * lean.cos());
        let origin = Point3::new(x, y, z);
        let hit = wall.ray_cast(origin, direction).expect("a wall all around");
        let gap_m = gap_by_profile(&wall, &hit.point);
        let on_step_face = hit.normal.x.abs() == 1.0;
        prop_assert!(gap_m.abs() < 1e-6 || on_step_face && gap_m.abs() < 0.011, "gap {} m", gap_m);
        prop_assert!(hit.normal.dot(&direction) < 0.0);
        prop_assert!((hit.normal.norm() - 1.0).abs() < 1e-12);
        for share in 1..400 {
            let before = origin + direction * (hit.distance * f64::from(share) / 400.0);
            // Behind silhouettes of the gentle relief a ray may dip by micrometres.
            prop_assert!(gap_by_profile(&wall, &before) > -1e-4);
        }
    }

    #[test]
    fn the_normal_is_that_of_three_neighbouring_hits(s in 0.0..18.8f64, x in -3.0..3.0f64) {
        let config = WallConfig { ring_step_mm: 0.0, ..rough() };
        let wall = Wall::new(circle(), &config, 5).expect("valid");
        let target = wall.lining_point(s, x).expect("finite");
        let origin = Point3::new(x, 0.1, -0.2);
        let hit = wall.ray_cast(origin, target - origin).expect("hit");
        prop_assert!((hit.point - target).norm() < 1e-6);
        prop_assert!((hit.distance - 1.0).abs() < 1e-6);
        let h = 1e-4;
        let around = wall.lining_point(s + h, x).expect("finite") - wall.lining_point(s - h, x).expect("finite");
        let along = wall.lining_point(s, x + h).expect("finite") - wall.lining_point(s, x - h).expect("finite");
        prop_assert!(hit.normal.dot(&around.normalize()).abs() < 1e-5);
        prop_assert!(hit.normal.dot(&along.normalize()).abs() < 1e-5);
    }
}

#[test]
fn without_relief_the_wall_is_the_profile() {
    for profile in [circle(), underpass()] {
        let wall = Wall::new(profile, &WallConfig::default(), 1).expect("valid");
        for step in 0..100 {
            let phi = f64::from(step) * 0.0628;
            let direction = Vector3::new(0.4, phi.sin(), -phi.cos());
            let hit = wall.ray_cast(Point3::new(1.0, 0.2, 0.1), direction).expect("hit");
            let nominal = wall.profile().ray_cast(Vector2::new(0.2, 0.1), direction.yz()).expect("hit");
            assert!((hit.distance - nominal.distance).abs() < 1e-12);
            assert!((hit.s_m - nominal.surface.s_m).abs() < 1e-9, "{} {}", hit.s_m, nominal.surface.s_m);
            assert!((hit.normal.yz() - nominal.surface.normal).norm() < 1e-9);
        }
    }
}

#[test]
fn a_bulge_shortens_the_range_by_its_height_and_a_hollow_lengthens_it() {
    let config = WallConfig {
        bulges: vec![
            BulgeConfig { s_m: 0.0, x_m: 2.0, height_mm: 20.0, sigma_m: 0.3 },
            BulgeConfig { s_m: 3.0 * std::f64::consts::PI, x_m: 2.0, height_mm: -15.0, sigma_m: 0.3 },
        ],
        ..WallConfig::default()
    };
    let wall = Wall::new(circle(), &config, 1).expect("valid");
    let range_m = |direction| wall.ray_cast(Point3::new(2.0, 0.0, 0.0), direction).expect("hit").distance;
    assert!((range_m(-Vector3::z()) - 2.98).abs() < 1e-6, "the bulge hangs from the crown");
    assert!((range_m(Vector3::z()) - 3.015).abs() < 1e-6, "the hollow is in the invert");
    assert!((range_m(Vector3::y()) - 3.0).abs() < 1e-6);
}

#[test]
fn positive_ovality_lowers_the_crown_and_widens_the_section() {
    let config = WallConfig { ovality_mm: 10.0, ..WallConfig::default() };
    let wall = Wall::new(circle(), &config, 1).expect("valid");
    let range_m = |direction| wall.ray_cast(Point3::origin(), direction).expect("hit").distance;
    assert!((range_m(-Vector3::z()) - 2.99).abs() < 1e-6);
    assert!((range_m(Vector3::y()) - 3.01).abs() < 1e-6);
}

#[test]
fn rings_step_at_their_joints_and_nowhere_else() {
    let config = WallConfig { ring_length_m: 1.0, ring_step_mm: 8.0, ..WallConfig::default() };
    let wall = Wall::new(circle(), &config, 3).expect("valid");
    let height = |x_m: f64| wall.relief_m(1.0, x_m);
    assert_eq!(height(0.01), height(0.99));
    assert_ne!(height(0.99), height(1.01));
    assert!((0..50).all(|ring| height(f64::from(ring)).abs() <= 0.008));
}

#[test]
fn a_pipe_hides_the_wall_behind_it_and_shows_in_the_true_relief() {
    let pipe = PipeConfig { s_m: 3.0, radius_mm: 60.0, standoff_mm: 20.0, from_x_m: 1.0, to_x_m: 4.0 };
    let config = WallConfig { pipes: vec![pipe], ..WallConfig::default() };
    let wall = Wall::new(circle(), &config, 1).expect("valid");
    let target = wall.lining_point(3.0, 2.0).expect("finite");
    let hit = wall.ray_cast(Point3::new(2.0, 0.0, 0.0), target - Point3::new(2.0, 0.0, 0.0)).expect("hit");
    assert_eq!(hit.surface, Surface::Pipe(0));
    assert!((hit.height_m - 0.14).abs() < 1e-9);
    assert!((wall.relief_m(3.0, 2.0) - 0.14).abs() < 1e-9);
    assert_eq!(wall.relief_m(3.0, 0.5), 0.0);
    assert_eq!(wall.relief_m(3.0 + 3.0 * std::f64::consts::PI, 2.0), 0.0, "not on the opposite wall");
    let towards_end = Vector3::new(2.0, hit.point.y, hit.point.z);
    let end = wall.ray_cast(Point3::new(-1.0, 0.0, 0.0), towards_end).expect("hit");
    assert_eq!(end.surface, Surface::Pipe(0));
    assert!((end.x_m - 1.0).abs() < 1e-12, "its flat end");
}

#[test]
fn water_ends_the_downward_beam_and_is_not_seen_from_the_side() {
    let config = WallConfig { water_z_m: Some(2.5), ..WallConfig::default() };
    let wall = Wall::new(circle(), &config, 1).expect("valid");
    let down = wall.ray_cast(Point3::origin(), Vector3::z()).expect("hit");
    assert_eq!((down.surface, down.distance), (Surface::Water, 2.5));
    let side = wall.ray_cast(Point3::origin(), Vector3::y()).expect("hit");
    assert_eq!(side.surface, Surface::Lining);
}

#[test]
fn relief_that_could_fill_the_tunnel_is_refused() {
    let config = WallConfig { ovality_mm: 400.0, ..WallConfig::default() };
    assert!(matches!(Wall::new(circle(), &config, 1), Err(WallError::TooDeep { .. })));
    let config = WallConfig { ring_length_m: 0.0, ..WallConfig::default() };
    assert!(matches!(Wall::new(circle(), &config, 1), Err(WallError::NotPositive { name: "ring_length_m", .. })));
    let config = WallConfig { undulation_mm: f64::NAN, ..WallConfig::default() };
    assert!(matches!(Wall::new(circle(), &config, 1), Err(WallError::NotFinite { name: "undulation_mm", .. })));
}
