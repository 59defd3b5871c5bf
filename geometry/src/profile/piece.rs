//! One piece of a profile: a line segment or a circular arc, run clockwise looking forward.

use nalgebra::Vector2;

use super::Part;
use crate::{Real, SectionVector};

/// The shape of a piece.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Shape<T> {
    /// From `start` along the unit vector `tangent`.
    Line { start: SectionVector<T>, tangent: SectionVector<T> },
    /// Around `centre`; the polar angle (of `atan2(z, y)`) starts at `start_rad` and changes by `sweep_rad`.
    /// A positive sweep is convex seen from inside (the usual vault), a negative one bulges inwards.
    Arc { centre: SectionVector<T>, radius_m: T, start_rad: T, sweep_rad: T },
}

/// A piece of the lining: shape, place in arc length and name.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Piece<T> {
    pub(super) shape: Shape<T>,
    pub(super) start_s_m: T,
    pub(super) length_m: T,
    pub(super) part: Part,
    /// The points where it starts and ends: derived from the shape, so that no look-up needs a sine.
    ends: [SectionVector<T>; 2],
}

impl<T: Real> Piece<T> {
    pub(super) fn new(shape: Shape<T>, start_s_m: T, length_m: T, part: Part) -> Self {
        let mut piece = Self { shape, start_s_m, length_m, part, ends: [Vector2::zeros(); 2] };
        piece.ends = [T::zero(), length_m].map(|along_m| piece.at(along_m).0);
        piece
    }

    /// Arc length at which the piece starts.
    pub fn start_s_m(&self) -> T {
        self.start_s_m
    }

    /// Length of the piece.
    pub fn length_m(&self) -> T {
        self.length_m
    }

    /// The part of the lining it belongs to.
    pub fn part(&self) -> Part {
        self.part
    }

    /// Tells whether the piece is a straight segment, so that it makes a planar wall.
    pub fn is_planar(&self) -> bool {
        matches!(self.shape, Shape::Line { .. })
    }

    /// Whether the piece is straight or convex seen from inside.
    pub(super) fn bends_outwards(&self) -> bool {
        match self.shape {
            Shape::Line { .. } => true,
            Shape::Arc { sweep_rad, .. } => sweep_rad > T::zero(),
        }
    }

    /// Point and inward unit normal at `along_m` from the piece's start.
    pub(super) fn at(&self, along_m: T) -> (SectionVector<T>, SectionVector<T>) {
        match self.shape {
            Shape::Line { start, tangent } => (start + tangent * along_m, Vector2::new(-tangent.y, tangent.x)),
            Shape::Arc { centre, radius_m, start_rad, sweep_rad } => {
                let turn = sweep_rad.signum();
                let (sin, cos) = (start_rad + turn * along_m / radius_m).sin_cos();
                let outward = Vector2::new(cos, sin);
                (centre + outward * radius_m, -outward * turn)
            }
        }
    }

    /// What rounding may put a hit beyond the piece's ends.
    fn slack_m(&self) -> T {
        T::default_epsilon() * T::of(16.0) * (T::one() + self.length_m)
    }

    /// Distance (in multiples of `direction`) of the first hit with `t > 0`.
    pub(super) fn ray_cast(&self, origin: SectionVector<T>, direction: SectionVector<T>) -> Option<T> {
        let slack = self.slack_m();
        match self.shape {
            Shape::Line { start, tangent } => {
                let normal = Vector2::new(-tangent.y, tangent.x);
                let closing = direction.dot(&normal);
                let distance = (start - origin).dot(&normal) / closing;
                let along_m = (origin + direction * distance - start).dot(&tangent);
                let hit = distance > T::zero() && along_m >= -slack && along_m <= self.length_m + slack;
                hit.then_some(distance)
            }
            Shape::Arc { centre, radius_m, .. } => {
                let offset = origin - centre;
                let a = direction.norm_squared();
                let half_b = offset.dot(&direction);
                let c = offset.norm_squared() - radius_m * radius_m;
                let discriminant = half_b * half_b - a * c;
                if discriminant < T::zero() || a <= T::zero() {
                    return None;
                }
                // The root that does not cancel first; the other from the product of the roots.
                let q = -(half_b + half_b.signum() * discriminant.sqrt());
                let (one, other) = if q == T::zero() { (T::zero(), T::zero()) } else { (q / a, c / q) };
                let (near, far) = if one < other { (one, other) } else { (other, one) };
                let reaches = |distance: &T| {
                    *distance > T::zero() && self.arc_reaches(offset + direction * *distance, slack * radius_m)
                };
                [near, far].into_iter().find(reaches)
            }
        }
    }

    /// Place along the piece, point and inward unit normal of a hit near `point`.
    pub(super) fn surface_near(&self, point: SectionVector<T>) -> (T, SectionVector<T>, SectionVector<T>) {
        match self.shape {
            Shape::Line { start, tangent } => {
                let along_m = (point - start).dot(&tangent).max(T::zero()).min(self.length_m);
                let (point, normal) = self.at(along_m);
                (along_m, point, normal)
            }
            Shape::Arc { centre, radius_m, .. } => {
                let normal = self.normal_near(point);
                // A hit that rounding put beyond an end counts as the end.
                let along_m = self.along_arc(point, self.slack_m()).unwrap_or(self.length_m);
                (along_m, centre + (point - centre).normalize() * radius_m, normal)
            }
        }
    }

    /// Inward unit normal at the place of a hit near `point`.
    pub(super) fn normal_near(&self, point: SectionVector<T>) -> SectionVector<T> {
        match self.shape {
            Shape::Line { tangent, .. } => Vector2::new(-tangent.y, tangent.x),
            Shape::Arc { centre, sweep_rad, .. } => (centre - point).normalize() * sweep_rad.signum(),
        }
    }

    /// Whether the arc reaches the direction of `offset` from its centre; `slack` as a cross product.
    fn arc_reaches(&self, offset: SectionVector<T>, slack: T) -> bool {
        let Shape::Arc { centre, sweep_rad, .. } = self.shape else { return false };
        let [from, to] = self.ends.map(|end| end - centre);
        let turn = sweep_rad.signum();
        let (past_start, before_end) = (from.perp(&offset) * turn, offset.perp(&to) * turn);
        if sweep_rad.abs() <= T::pi() {
            past_start >= -slack && before_end >= -slack
        } else {
            // More than half a circle: not in the wedge that is left out.
            past_start >= -slack || before_end >= -slack
        }
    }

    /// Distance and place along the piece of the point nearest to `point`.
    pub(super) fn nearest(&self, point: SectionVector<T>) -> (T, T) {
        match self.shape {
            Shape::Line { start, tangent } => {
                let along_m = (point - start).dot(&tangent).max(T::zero()).min(self.length_m);
                ((start + tangent * along_m - point).norm(), along_m)
            }
            Shape::Arc { centre, radius_m, .. } => {
                if let Some(along_m) = self.along_arc(point, T::zero()) {
                    return (((point - centre).norm() - radius_m).abs(), along_m);
                }
                let [to_start, to_end] = self.ends.map(|end| (end - point).norm());
                if to_start <= to_end { (to_start, T::zero()) } else { (to_end, self.length_m) }
            }
        }
    }

    /// The signed angle under which the piece is seen from `point`; the sum over a closed chain is 0 or a full turn.
    pub(super) fn angle_seen_from(&self, point: SectionVector<T>) -> T {
        let [start, end] = self.ends.map(|end| end - point);
        let chord = start.perp(&end).atan2(start.dot(&end));
        let Shape::Arc { centre, radius_m, sweep_rad, .. } = self.shape else { return chord };
        if (point - centre).norm_squared() >= radius_m * radius_m {
            return chord;
        }
        // From within the circle the arc always turns its own way. A chord that seems to turn the other way hides the
        // arc behind it; so does, by the sign of a rounding error, a chord through the point, and a chord of no length.
        let turn = sweep_rad.signum();
        let full_turn =
            (end - start).norm() <= T::default_epsilon() * T::of(64.0) * radius_m && sweep_rad.abs() > T::pi();
        if chord * turn < T::zero() || full_turn { chord + T::two_pi() * turn } else { chord }
    }

    pub(super) fn bounds(&self) -> (SectionVector<T>, SectionVector<T>) {
        let [start, end] = self.ends;
        let (mut low, mut high) = (start.inf(&end), start.sup(&end));
        if let Shape::Arc { centre, radius_m, .. } = self.shape {
            for axis in [Vector2::x(), -Vector2::x(), Vector2::y(), -Vector2::y()] {
                let extreme = centre + axis * radius_m;
                if self.along_arc(extreme, T::zero()).is_some() {
                    (low, high) = (low.inf(&extreme), high.sup(&extreme));
                }
            }
        }
        (low, high)
    }

    /// Place along the arc of the point in the direction of `point`, if the arc reaches there.
    fn along_arc(&self, point: SectionVector<T>, slack: T) -> Option<T> {
        let Shape::Arc { centre, radius_m, start_rad, sweep_rad } = self.shape else { return None };
        let offset = point - centre;
        let mut turned = (offset.y.atan2(offset.x) - start_rad) * sweep_rad.signum();
        turned -= (turned / T::two_pi()).floor() * T::two_pi();
        let along_m = turned * radius_m;
        let full_m = T::two_pi() * radius_m;
        if along_m <= self.length_m + slack {
            Some(along_m.min(self.length_m))
        } else if along_m >= full_m - slack {
            Some(T::zero())
        } else {
            None
        }
    }
}
