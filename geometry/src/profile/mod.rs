//! Section profiles: a closed chain of line segments and arcs in the plane `[y, z]` (right, down; metres).
//!
//! A profile is built from a [`ProfileSpec`] and answers ray-casts, nearest points and arc length. Arc length `s` starts
//! at the crown (the wall straight above the axis) and grows clockwise looking forward, so it is the panorama's
//! horizontal axis. Everything downstream is written against this one type: a new shape is a new chain, not new code.

mod piece;
mod spec;

use nalgebra::Vector2;

pub use piece::Piece;
pub use spec::{ChainVertex, ProfileError, ProfileSpec};

use crate::{Real, SectionVector};

/// The most pieces a profile may have. A horseshoe needs five, a lining with benches about a dozen.
pub const MAX_PIECES: usize = 24;

/// A named part of the lining.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(rename_all = "kebab-case"))]
pub enum Part {
    /// A lining without corners (circle), or a piece of a chain that faces no one side.
    Lining,
    /// Above.
    Ceiling,
    /// On the right, looking forward.
    RightWall,
    /// Below.
    Floor,
    /// On the left, looking forward.
    LeftWall,
}

/// A point of the lining.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfacePoint<T> {
    /// Arc length from the crown, clockwise looking forward, in `[0, perimeter)`.
    pub s_m: T,
    /// Position `[y, z]`.
    pub point: SectionVector<T>,
    /// Unit normal, towards the inside.
    pub normal: SectionVector<T>,
    /// Index of the piece it lies on.
    pub piece: usize,
}

/// Where a ray meets the lining.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RayHit<T> {
    /// Multiple of the direction vector's length from the origin to the wall.
    pub distance: T,
    /// The point that was met.
    pub surface: SurfacePoint<T>,
}

/// The lining's point nearest to a given one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Nearest<T> {
    /// Signed distance to the lining, positive inside.
    pub clearance_m: T,
    /// The nearest point.
    pub surface: SurfacePoint<T>,
}

/// A closed section profile.
#[derive(Clone, Debug, PartialEq)]
pub struct Profile<T: Real> {
    pieces: heapless::Vec<Piece<T>, MAX_PIECES>,
    perimeter_m: T,
    bounds: (SectionVector<T>, SectionVector<T>),
}

impl<T: Real> Profile<T> {
    fn new(pieces: heapless::Vec<Piece<T>, MAX_PIECES>, perimeter_m: T) -> Self {
        let mut low = Vector2::repeat(T::of(1e9));
        let mut high = -low;
        for piece in &pieces {
            let (piece_low, piece_high) = piece.bounds();
            (low, high) = (low.inf(&piece_low), high.sup(&piece_high));
        }
        Self { pieces, perimeter_m, bounds: (low, high) }
    }

    /// Returns the pieces in order of arc length; the first starts at the crown.
    pub fn pieces(&self) -> &[Piece<T>] {
        &self.pieces
    }

    /// Returns the length of the lining once around.
    pub fn perimeter_m(&self) -> T {
        self.perimeter_m
    }

    /// Returns `s_m` brought into `[0, perimeter)`.
    pub fn wrap_s(&self, s_m: T) -> T {
        let turns = (s_m / self.perimeter_m).floor();
        let wrapped = s_m - turns * self.perimeter_m;
        if wrapped >= self.perimeter_m { T::zero() } else { wrapped }
    }

    /// Returns the first wall that the ray `origin + t direction`, `t > 0`, meets.
    ///
    /// The origin must lie inside, otherwise a far wall may be answered. `None` if nothing is met (a zero direction, NaN).
    pub fn ray_cast(&self, origin: SectionVector<T>, direction: SectionVector<T>) -> Option<RayHit<T>> {
        let (distance, index) = self.first_hit(origin, direction)?;
        let piece = self.pieces.get(index)?;
        let (along_m, point, normal) = piece.surface_near(origin + direction * distance);
        let s_m = self.wrap_s(piece.start_s_m() + along_m);
        Some(RayHit { distance, surface: SurfacePoint { s_m, point, normal, piece: index } })
    }

    /// As [`Self::ray_cast`], but only the distance and the wall's inward unit normal: a third of the cost on the board, for it
    /// needs no arc length.
    pub(crate) fn wall_ahead(
        &self,
        origin: SectionVector<T>,
        direction: SectionVector<T>,
    ) -> Option<(T, SectionVector<T>)> {
        let (distance, index) = self.first_hit(origin, direction)?;
        Some((distance, self.pieces.get(index)?.normal_near(origin + direction * distance)))
    }

    /// Distance to the first piece that the ray meets, and which.
    fn first_hit(&self, origin: SectionVector<T>, direction: SectionVector<T>) -> Option<(T, usize)> {
        let hits = self
            .pieces
            .iter()
            .enumerate()
            .filter_map(|(index, piece)| piece.ray_cast(origin, direction).map(|distance| (distance, index)));
        hits.reduce(|best, next| if next.0 < best.0 { next } else { best })
    }

    /// Returns the lining's point nearest to `point`, and the signed distance to it (positive inside).
    ///
    /// `None` only for NaN.
    pub fn nearest(&self, point: SectionVector<T>) -> Option<Nearest<T>> {
        let mut best: Option<(T, usize, T)> = None;
        for (index, piece) in self.pieces.iter().enumerate() {
            let (distance_m, along_m) = piece.nearest(point);
            if distance_m.is_finite() && best.is_none_or(|(nearest, ..)| distance_m < nearest) {
                best = Some((distance_m, index, along_m));
            }
        }
        let (distance_m, index, along_m) = best?;
        let surface = self.surface_on(index, along_m)?;
        // Off the ends of a piece the normal tells the side; only at a corner all pieces have a say.
        let ahead_m = (point - surface.point).dot(&surface.normal);
        let inside =
            if ahead_m.abs() >= distance_m * T::of(0.99) { ahead_m >= T::zero() } else { self.contains(point) };
        let clearance_m = if inside { distance_m } else { -distance_m };
        Some(Nearest { clearance_m, surface })
    }

    /// Returns the lining's point at arc length `s_m` (any value; taken modulo the perimeter).
    ///
    /// `None` only for NaN.
    pub fn at(&self, s_m: T) -> Option<SurfacePoint<T>> {
        let s_m = self.wrap_s(s_m);
        let index = self.pieces.iter().rposition(|piece| piece.start_s_m() <= s_m)?;
        let along_m = s_m - self.pieces.get(index)?.start_s_m();
        self.surface_on(index, along_m)
    }

    /// Tells whether `point` lies inside (the winding number of the lining around it is not zero).
    pub fn contains(&self, point: SectionVector<T>) -> bool {
        let mut turns = T::zero();
        for piece in &self.pieces {
            turns += piece.angle_seen_from(point);
        }
        turns.abs() > T::pi()
    }

    /// Tells whether every wall point is seen from everywhere inside: no piece bulges inwards, no corner turns inwards.
    pub fn is_convex(&self) -> bool {
        let slack = T::of(-1e-4);
        self.pieces.iter().zip(self.pieces.iter().cycle().skip(1)).all(|(piece, next)| {
            let (_, leaving) = piece.at(piece.length_m());
            let (_, entering) = next.at(T::zero());
            piece.bends_outwards() && leaving.perp(&entering) >= slack
        })
    }

    /// Returns the smallest box `(min, max)` in `[y, z]` that holds the lining.
    pub fn bounds(&self) -> (SectionVector<T>, SectionVector<T>) {
        self.bounds
    }

    fn surface_on(&self, index: usize, along_m: T) -> Option<SurfacePoint<T>> {
        let piece = self.pieces.get(index)?;
        let (point, normal) = piece.at(along_m);
        Some(SurfacePoint { s_m: self.wrap_s(piece.start_s_m() + along_m), point, normal, piece: index })
    }
}
