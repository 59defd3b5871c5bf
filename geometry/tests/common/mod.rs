//! Profiles and strategies that several tests share.
#![allow(dead_code, unreachable_pub, reason = "each test binary uses its own share of this module")]

use adit_geometry::profile::{ChainVertex, Profile, ProfileSpec};
use adit_geometry::{Real, SectionVector};
use nalgebra::Vector2;
use proptest::prelude::*;

/// The three kinds of section that the samples and the paper use, two more, and two chains (the last one not convex).
pub fn spec(kind: usize, scale: f64) -> ProfileSpec<f64> {
    match kind {
        0 => ProfileSpec::Circle { radius_m: 3.0 * scale },
        1 => ProfileSpec::Rectangle { width_m: 4.0 * scale, height_m: 3.0 * scale, axis_height_m: 1.3 * scale },
        2 => ProfileSpec::Underpass {
            width_m: 4.0 * scale,
            wall_m: 2.5 * scale,
            rise_m: 1.0 * scale,
            axis_height_m: 1.4 * scale,
        },
        3 => ProfileSpec::Horseshoe { width_m: 5.0 * scale, wall_m: 2.0 * scale, axis_height_m: 1.9 * scale },
        4 => chain(&[(0.4, -2.0, 0.2), (2.2, -0.3, 0.1), (2.0, 1.5, 0.0), (-1.9, 1.6, 0.15), (-2.3, 0.2, 0.25)], scale),
        _ => chain(
            &[
                (2.0, -1.8, 0.0),
                (2.0, 1.2, 0.0),
                (1.2, 1.2, 0.0),
                (1.2, 1.7, 0.0),
                (-1.2, 1.7, -0.2),
                (-2.0, 1.2, 0.0),
                (-2.0, -1.8, 0.5),
            ],
            scale,
        ),
    }
}

/// Number of kinds that [`spec`] knows.
pub const KINDS: usize = 6;

fn chain(vertices: &[(f64, f64, f64)], scale: f64) -> ProfileSpec<f64> {
    let vertices =
        vertices.iter().map(|&(y, z, bulge)| ChainVertex { y_m: y * scale, z_m: z * scale, bulge }).collect();
    ProfileSpec::Chain { vertices }
}

/// The same description in another scalar.
pub fn convert<T: Real>(spec: &ProfileSpec<f64>) -> ProfileSpec<T> {
    let of = T::of;
    match spec {
        ProfileSpec::Circle { radius_m } => ProfileSpec::Circle { radius_m: of(*radius_m) },
        ProfileSpec::Rectangle { width_m, height_m, axis_height_m } => {
            ProfileSpec::Rectangle { width_m: of(*width_m), height_m: of(*height_m), axis_height_m: of(*axis_height_m) }
        }
        ProfileSpec::Underpass { width_m, wall_m, rise_m, axis_height_m } => ProfileSpec::Underpass {
            width_m: of(*width_m),
            wall_m: of(*wall_m),
            rise_m: of(*rise_m),
            axis_height_m: of(*axis_height_m),
        },
        ProfileSpec::Horseshoe { width_m, wall_m, axis_height_m } => {
            ProfileSpec::Horseshoe { width_m: of(*width_m), wall_m: of(*wall_m), axis_height_m: of(*axis_height_m) }
        }
        ProfileSpec::Chain { vertices } => ProfileSpec::Chain {
            vertices: vertices
                .iter()
                .map(|v| ChainVertex { y_m: of(v.y_m), z_m: of(v.z_m), bulge: of(v.bulge) })
                .collect(),
        },
    }
}

/// Builds kind `kind` at scale `scale`.
pub fn profile<T: Real>(kind: usize, scale: f64) -> Profile<T> {
    convert(&spec(kind, scale)).build().expect("a valid profile")
}

/// Any kind at any size of the trade, from a 1.2 m sewer to a road tunnel.
pub fn any_kind() -> impl Strategy<Value = (usize, f64)> {
    (0..KINDS, 0.4f64..4.0)
}

/// A point inside, by share `0..1` of the way from the axis to the wall at angle `phi`.
pub fn inside<T: Real>(profile: &Profile<T>, phi: f64, share: f64) -> SectionVector<T> {
    let direction = Vector2::new(T::of(phi.sin()), T::of(-phi.cos()));
    let wall = profile.ray_cast(Vector2::zeros(), direction).expect("the axis is inside");
    direction * (wall.distance * T::of(share))
}
