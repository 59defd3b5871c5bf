//! The profile's pieces in the form in which the foot of a nearby point costs a few operations.

use adit_geometry::profile::Profile;
use nalgebra::Vector2;

/// A piece of the profile in the form in which nearest points are cheap.
#[derive(Clone, Copy, Debug)]
pub(super) enum Local {
    Line {
        start: Vector2<f64>,
        tangent: Vector2<f64>,
        start_s_m: f64,
        length_m: f64,
    },
    /// `radius_m` is negative where the lining bulges inwards; `middle` is the unit vector from the centre to the
    /// piece's middle, at `middle_s_m`.
    Arc {
        centre: Vector2<f64>,
        radius_m: f64,
        middle: Vector2<f64>,
        middle_s_m: f64,
        length_m: f64,
    },
}

/// Place of a point relative to the profile.
#[derive(Clone, Copy, Debug)]
pub(super) struct Foot {
    pub(super) clearance_m: f64,
    pub(super) s_m: f64,
    /// Inward unit normal of the profile there.
    pub(super) normal: Vector2<f64>,
    /// Curvature of the profile, positive where it is hollow seen from inside.
    pub(super) curvature: f64,
}

impl Foot {
    /// What a point that is not a number gets.
    pub(super) fn nowhere() -> Self {
        Self { clearance_m: f64::NAN, s_m: 0.0, normal: Vector2::zeros(), curvature: 0.0 }
    }
}

impl Local {
    pub(super) fn curvature(&self) -> f64 {
        match self {
            Self::Line { .. } => 0.0,
            Self::Arc { radius_m, .. } => 1.0 / radius_m,
        }
    }

    pub(super) fn foot(&self, section: Vector2<f64>) -> Option<Foot> {
        match *self {
            Self::Line { start, tangent, start_s_m, length_m } => {
                let offset = section - start;
                let along_m = offset.dot(&tangent);
                let normal = Vector2::new(-tangent.y, tangent.x);
                let within = along_m >= 0.0 && along_m <= length_m;
                let s_m = start_s_m + along_m;
                within.then(|| Foot { clearance_m: offset.dot(&normal), s_m, normal, curvature: 0.0 })
            }
            Self::Arc { centre, radius_m, middle, middle_s_m, length_m } => {
                let offset = section - centre;
                let distance_m = offset.norm();
                let from_middle_m = middle.perp(&offset).atan2(middle.dot(&offset)) * radius_m;
                let within = from_middle_m.abs() <= 0.5 * length_m && distance_m > 0.0;
                within.then(|| Foot {
                    clearance_m: (radius_m.abs() - distance_m) * radius_m.signum(),
                    s_m: middle_s_m + from_middle_m,
                    normal: offset * (-radius_m.signum() / distance_m),
                    curvature: 1.0 / radius_m,
                })
            }
        }
    }
}

/// The form of one piece. `None` only for an index out of range.
pub(super) fn local_shape(profile: &Profile<f64>, index: usize) -> Option<Local> {
    let piece = profile.pieces().get(index)?;
    let (start_s_m, length_m) = (piece.start_s_m(), piece.length_m());
    let at = |share: f64| profile.at(start_s_m + share * length_m);
    let (first, middle, last) = (at(0.25)?, at(0.5)?, at(0.75)?);
    if piece.is_planar() {
        let tangent = (last.point - first.point).normalize();
        let start = middle.point - tangent * (0.5 * length_m);
        return Some(Local::Line { start, tangent, start_s_m, length_m });
    }
    let turn = first.normal - last.normal;
    let radius_m = -(first.point - last.point).dot(&turn) / turn.norm_squared();
    Some(Local::Arc {
        centre: middle.point + middle.normal * radius_m,
        radius_m,
        middle: -middle.normal * radius_m.signum(),
        middle_s_m: middle.s_m,
        length_m,
    })
}
