//! Invariants of section profiles: ray-cast, nearest point, arc length, normals, parts.

mod common;

use std::f64::consts::{PI, TAU};

use adit_geometry::profile::{ChainVertex, Part, Profile, ProfileError, ProfileSpec};
use adit_geometry::{Real, SectionVector};
use common::{KINDS, any_kind, inside, profile};
use nalgebra::Vector2;
use proptest::prelude::*;

fn direction<T: Real>(phi: f64) -> SectionVector<T> {
    Vector2::new(T::of(phi.sin()), T::of(-phi.cos()))
}

/// Distance from `point` to the nearest of `count` points along the lining, by looking at all of them.
fn brute_force_distance<T: Real>(profile: &Profile<T>, point: SectionVector<T>, count: u32) -> f64 {
    let step = profile.perimeter_m().to_f64() / f64::from(count);
    (0..count)
        .map(|i| (profile.at(T::of(step * f64::from(i))).unwrap().point - point).norm().to_f64())
        .fold(f64::MAX, f64::min)
}

fn check_ray_cast<T: Real>(kind: usize, scale: f64, at: (f64, f64), phi: f64, tolerance: f64) {
    let profile: Profile<T> = profile(kind, scale);
    let origin = inside(&profile, at.0, at.1);
    let ray = direction::<T>(phi);
    let hit = profile.ray_cast(origin, ray).expect("an inner point sees a wall everywhere");
    let reached = origin + ray * hit.distance;
    assert!((reached - hit.surface.point).norm().to_f64() < tolerance * scale);
    let nearest = profile.nearest(hit.surface.point).unwrap();
    assert!(nearest.clearance_m.abs().to_f64() < tolerance * scale, "the hit lies on the lining: {nearest:?}");
    assert!(hit.surface.normal.dot(&ray).to_f64() < 1e-3, "the wall that is met faces the ray");
    // Nothing is met before: all points on the way are inside.
    for share in [0.01, 0.3, 0.7, 0.99] {
        assert!(profile.contains(origin + ray * (hit.distance * T::of(share))), "inside at {share} of the way");
    }
}

fn check_nearest<T: Real>(kind: usize, scale: f64, at: (f64, f64), tolerance: f64) {
    let profile: Profile<T> = profile(kind, scale);
    let point = inside(&profile, at.0, at.1);
    let nearest = profile.nearest(point).unwrap();
    let distance = nearest.clearance_m.abs().to_f64();
    let brute = brute_force_distance(&profile, point, 4000);
    let step = profile.perimeter_m().to_f64() / 4000.0;
    assert!(distance <= brute + tolerance * scale, "nothing is nearer than nearest: {distance} > {brute}");
    assert!(brute <= distance + step, "and brute force comes as close: {brute} > {distance}");
    assert!(((nearest.surface.point - point).norm().to_f64() - distance).abs() < tolerance * scale);
    // Only near the lining itself may rounding decide the sign.
    if distance > tolerance * scale {
        assert_eq!(nearest.clearance_m > T::zero(), profile.contains(point));
    }
}

fn check_arc_length<T: Real>(kind: usize, scale: f64, share: f64, tolerance: f64) {
    let profile: Profile<T> = profile(kind, scale);
    let perimeter = profile.perimeter_m().to_f64();
    let s = T::of(share * perimeter);
    let surface = profile.at(s).unwrap();
    let back = profile.nearest(surface.point).unwrap();
    let around = (back.surface.s_m - s).abs().to_f64();
    assert!(around.min(perimeter - around) < tolerance * scale, "at {s} nearest says {}", back.surface.s_m);
    let depth = T::of(1e-3 * scale);
    let near_corner = profile.pieces().iter().any(|piece| {
        let from_joint = (piece.start_s_m() - s).abs().to_f64();
        from_joint.min(perimeter - from_joint) < 5e-3 * scale
    });
    if !near_corner {
        assert!(profile.contains(surface.point + surface.normal * depth), "the normal points inside");
        assert!(!profile.contains(surface.point - surface.normal * depth), "and away from the outside");
    }
    assert!((surface.normal.norm().to_f64() - 1.0).abs() < 1e-5);
    let moved = profile.at(s + T::of(perimeter)).unwrap();
    assert!((moved.point - surface.point).norm().to_f64() < 10.0 * tolerance * scale, "one turn further is the same");
}

proptest! {
    #[test]
    fn ray_casts_end_on_the_lining_and_meet_nothing_before(
        (kind, scale) in any_kind(), phi0 in 0.0..TAU, share in 0.0f64..0.95, phi in 0.0..TAU,
    ) {
        check_ray_cast::<f64>(kind, scale, (phi0, share), phi, 1e-11);
        check_ray_cast::<f32>(kind, scale, (phi0, share), phi, 2e-5);
    }

    #[test]
    fn nearest_is_nearest((kind, scale) in any_kind(), phi0 in 0.0..TAU, share in 0.0f64..1.5) {
        check_nearest::<f64>(kind, scale, (phi0, share), 1e-11);
        check_nearest::<f32>(kind, scale, (phi0, share), 1e-5);
    }

    #[test]
    fn arc_length_is_the_inverse_of_nearest_and_normals_point_inside((kind, scale) in any_kind(), share in 0.0f64..1.0) {
        check_arc_length::<f64>(kind, scale, share, 1e-11);
        check_arc_length::<f32>(kind, scale, share, 2e-5);
    }

    #[test]
    fn a_ray_twice_as_long_meets_the_wall_after_half_as_many_lengths(
        (kind, scale) in any_kind(), phi in 0.0..TAU, length in 0.01f64..50.0,
    ) {
        let profile: Profile<f64> = profile(kind, scale);
        let unit = profile.ray_cast(Vector2::zeros(), direction(phi)).unwrap();
        let long = profile.ray_cast(Vector2::zeros(), direction::<f64>(phi) * length).unwrap();
        prop_assert!((long.distance * length - unit.distance).abs() < 1e-9 * scale);
    }

    #[test]
    fn arc_length_grows_clockwise((kind, scale) in any_kind(), share in 0.001f64..0.999) {
        // The turn from one wall point to the next around an inner neighbour is clockwise, that is, from y towards z.
        let profile: Profile<f64> = profile(kind, scale);
        let s = share * profile.perimeter_m();
        let (one, other) = (profile.at(s).unwrap(), profile.at(s + 1e-4 * scale).unwrap());
        let eye = one.point + one.normal * 1e-3 * scale;
        prop_assert!((one.point - eye).perp(&(other.point - eye)) > 0.0);
    }

    #[test]
    fn nothing_panics_or_answers_for_nan(kind in 0..KINDS, which in 0..4usize) {
        let profile: Profile<f32> = profile(kind, 1.0);
        let bad = |i: usize| if i == which { f32::NAN } else { 0.3 };
        let hit = profile.ray_cast(Vector2::new(bad(0), bad(1)), Vector2::new(bad(2), bad(3)));
        prop_assert!(hit.is_none(), "{hit:?}");
        prop_assert!(profile.at(f32::NAN).is_none());
        prop_assert!(!profile.contains(Vector2::new(f32::NAN, 0.0)));
        prop_assert!(profile.nearest(Vector2::new(f32::NAN, 0.0)).is_none());
    }
}

#[test]
fn arc_length_starts_at_the_crown() {
    for kind in 0..KINDS {
        let profile: Profile<f64> = profile(kind, 1.0);
        let crown = profile.at(0.0).unwrap().point;
        assert!(crown.x.abs() < 1e-9 && crown.y < 0.0, "kind {kind}: s = 0 at {crown:?}");
        let quarter = profile.at(0.05 * profile.perimeter_m()).unwrap().point;
        assert!(quarter.x > 0.0, "kind {kind}: s grows to the right from the crown");
        let single: Profile<f32> = common::profile(kind, 1.0);
        assert!(single.at(0.0).unwrap().point.x.abs() < 1e-5);
    }
}

#[test]
fn perimeters_follow_their_formulas() {
    let perimeter = |kind: usize| profile::<f64>(kind, 1.0).perimeter_m();
    assert!((perimeter(0) - TAU * 3.0).abs() < 1e-12);
    assert!((perimeter(1) - 14.0).abs() < 1e-12);
    // Underpass 4.0/2.5/1.0: radius (2^2 + 1^2) / 2 = 2.5, half angle asin(2 / 2.5); the sample says 13.636 m.
    let arc = 2.0 * 2.5 * (2.0f64 / 2.5).asin();
    assert!((perimeter(2) - (4.0 + 5.0 + arc)).abs() < 1e-12);
    assert!((perimeter(2) - 13.636).abs() < 1e-3);
    assert!((perimeter(3) - (5.0 + 4.0 + PI * 2.5)).abs() < 1e-12);
    for kind in 0..KINDS {
        let profile: Profile<f64> = profile(kind, 1.0);
        let count = 20_000;
        let at = |i: u32| profile.at(profile.perimeter_m() * f64::from(i) / f64::from(count)).unwrap().point;
        let walked: f64 = (0..count).map(|i| (at(i + 1) - at(i)).norm()).sum();
        assert!((walked - profile.perimeter_m()).abs() < 1e-3, "kind {kind}: {walked} {}", profile.perimeter_m());
    }
}

#[test]
fn parts_face_their_sides() {
    for kind in [1, 2, 3] {
        let profile: Profile<f64> = profile(kind, 1.0);
        for (phi, part) in
            [(0.0, Part::Ceiling), (PI / 2.0, Part::RightWall), (PI, Part::Floor), (-PI / 2.0, Part::LeftWall)]
        {
            let hit = profile.ray_cast(Vector2::zeros(), direction(phi)).unwrap();
            let piece = profile.pieces()[hit.surface.piece];
            assert_eq!(piece.part(), part, "kind {kind} at {phi}");
        }
    }
}

#[test]
fn bounds_hold_the_lining_and_touch_it() {
    for kind in 0..KINDS {
        let profile: Profile<f64> = profile(kind, 1.0);
        let (low, high) = profile.bounds();
        let points: Vec<_> =
            (0..5000).map(|i| profile.at(profile.perimeter_m() * f64::from(i) / 5000.0).unwrap().point).collect();
        for axis in 0..2 {
            let least = points.iter().map(|p| p[axis]).fold(f64::MAX, f64::min);
            let most = points.iter().map(|p| p[axis]).fold(f64::MIN, f64::max);
            assert!((least - low[axis]).abs() < 5e-3 && least >= low[axis] - 1e-9, "kind {kind} axis {axis}");
            assert!((most - high[axis]).abs() < 5e-3 && most <= high[axis] + 1e-9, "kind {kind} axis {axis}");
        }
    }
}

#[test]
fn contains_agrees_with_a_polygon_of_many_corners() {
    for kind in 0..KINDS {
        let profile: Profile<f64> = profile(kind, 1.0);
        let corners: Vec<_> =
            (0..4000).map(|i| profile.at(profile.perimeter_m() * f64::from(i) / 4000.0).unwrap().point).collect();
        for row in 0..41 {
            for column in 0..41 {
                let point = Vector2::new(f64::from(column) * 0.2 - 4.0, f64::from(row) * 0.2 - 4.0);
                if brute_force_distance(&profile, point, 4000) < 0.01 {
                    continue;
                }
                let crossings = corners
                    .iter()
                    .zip(corners.iter().cycle().skip(1))
                    .filter(|(a, b)| {
                        (a.y > point.y) != (b.y > point.y)
                            && point.x < (b.x - a.x) * (point.y - a.y) / (b.y - a.y) + a.x
                    })
                    .count();
                assert_eq!(profile.contains(point), crossings % 2 == 1, "kind {kind} at {point:?}");
            }
        }
    }
}

#[test]
fn a_circle_made_of_two_half_circles_is_the_circle() {
    let vertex = |y_m: f64| ChainVertex { y_m, z_m: 0.0, bulge: 1.0 };
    let halves = ProfileSpec::Chain { vertices: [vertex(3.0), vertex(-3.0)].into_iter().collect() }.build().unwrap();
    let circle = ProfileSpec::Circle { radius_m: 3.0 }.build().unwrap();
    assert!((halves.perimeter_m() - circle.perimeter_m()).abs() < 1e-12);
    for i in 0..100 {
        let s = f64::from(i) * 0.188;
        assert!((halves.at(s).unwrap().point - circle.at(s).unwrap().point).norm() < 1e-9);
    }
}

#[test]
fn wrong_profiles_are_refused_with_the_reason() {
    let circle = ProfileSpec::Circle { radius_m: -1.0f64 }.build();
    assert_eq!(circle, Err(ProfileError::NotPositive { name: "radius_m", value: -1.0 }));
    assert!(matches!(ProfileSpec::Circle { radius_m: f32::NAN }.build(), Err(ProfileError::NotPositive { .. })));
    let high = ProfileSpec::Rectangle { width_m: 4.0, height_m: 3.0, axis_height_m: 3.5 }.build();
    assert_eq!(high, Err(ProfileError::AxisOutside));
    let corner = |y_m: f64, z_m: f64| ChainVertex { y_m, z_m, bulge: 0.0 };
    let square = [corner(1.0, 1.0), corner(1.0, -1.0), corner(-1.0, -1.0), corner(-1.0, 1.0)];
    let backwards = ProfileSpec::Chain { vertices: square.into_iter().collect() }.build();
    assert_eq!(backwards, Err(ProfileError::CounterClockwise));
    let twice = ProfileSpec::Chain { vertices: [square[0], square[0], square[1]].into_iter().collect() }.build();
    assert_eq!(twice, Err(ProfileError::Degenerate { vertex: 0 }));
    let none = ProfileSpec::<f64>::Chain { vertices: heapless::Vec::new() }.build();
    assert!(none.is_err());
}
