//! How a profile is described in files and on the board, and how it is built.

use nalgebra::Vector2;

use super::piece::{Piece, Shape};
use super::{MAX_PIECES, Part, Profile};
use crate::{Real, SectionVector};

/// A vertex of a chain and the bulge of the piece that follows it.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct ChainVertex<T> {
    /// Right of the axis.
    pub y_m: T,
    /// Below the axis.
    pub z_m: T,
    /// `tan(sweep / 4)` of the arc to the next vertex (as in DXF); 0 is a straight segment, positive bulges outwards.
    pub bulge: T,
}

/// A section profile as files and board parameters describe it. Lengths in metres.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum ProfileSpec<T> {
    /// A circular pipe or bore around the axis.
    Circle {
        /// Radius.
        radius_m: T,
    },
    /// A rectangle.
    Rectangle {
        /// Width.
        width_m: T,
        /// Height.
        height_m: T,
        /// Height of the axis above the floor.
        axis_height_m: T,
    },
    /// Flat floor, vertical walls, an arc as ceiling.
    Underpass {
        /// Width.
        width_m: T,
        /// Height of the vertical walls.
        wall_m: T,
        /// Rise of the ceiling's arc above the walls.
        rise_m: T,
        /// Height of the axis above the floor.
        axis_height_m: T,
    },
    /// Flat floor, vertical walls, a half circle as ceiling.
    Horseshoe {
        /// Width.
        width_m: T,
        /// Height of the vertical walls.
        wall_m: T,
        /// Height of the axis above the floor.
        axis_height_m: T,
    },
    /// Any closed chain, vertices clockwise looking forward.
    Chain {
        /// The vertices; the last is joined to the first.
        vertices: heapless::Vec<ChainVertex<T>, MAX_PIECES>,
    },
}

/// Why a profile cannot be built.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum ProfileError {
    /// A length is zero, negative or not a number.
    #[error("{name} is {value} m; expected a positive length")]
    NotPositive {
        /// Key of the length.
        name: &'static str,
        /// What was given.
        value: f64,
    },
    /// The axis does not lie inside the profile.
    #[error("the tunnel axis (y = z = 0) lies outside the profile")]
    AxisOutside,
    /// Fewer than two vertices, or two that coincide.
    #[error("vertex {vertex} of the chain coincides with the next one")]
    Degenerate {
        /// Number of the vertex, from 0.
        vertex: usize,
    },
    /// The chain runs counter-clockwise looking forward.
    #[error("the chain runs counter-clockwise; list its vertices clockwise looking forward (y right, z down)")]
    CounterClockwise,
    /// More pieces than fit.
    #[error("the chain has more than {MAX_PIECES} pieces")]
    TooManyPieces,
}

impl<T: Real> ProfileSpec<T> {
    /// The same shape with all lengths, those of the axis' place included, times `factor`.
    #[must_use]
    pub fn scaled(&self, factor: T) -> Self {
        match self {
            Self::Circle { radius_m } => Self::Circle { radius_m: *radius_m * factor },
            Self::Rectangle { width_m, height_m, axis_height_m } => Self::Rectangle {
                width_m: *width_m * factor,
                height_m: *height_m * factor,
                axis_height_m: *axis_height_m * factor,
            },
            Self::Underpass { width_m, wall_m, rise_m, axis_height_m } => Self::Underpass {
                width_m: *width_m * factor,
                wall_m: *wall_m * factor,
                rise_m: *rise_m * factor,
                axis_height_m: *axis_height_m * factor,
            },
            Self::Horseshoe { width_m, wall_m, axis_height_m } => Self::Horseshoe {
                width_m: *width_m * factor,
                wall_m: *wall_m * factor,
                axis_height_m: *axis_height_m * factor,
            },
            Self::Chain { vertices } => Self::Chain {
                vertices: vertices
                    .iter()
                    .map(|vertex| ChainVertex {
                        y_m: vertex.y_m * factor,
                        z_m: vertex.z_m * factor,
                        bulge: vertex.bulge,
                    })
                    .collect(),
            },
        }
    }

    /// The same shape in another scalar.
    pub fn cast<U: Real>(&self) -> ProfileSpec<U> {
        let to = |length_m: &T| U::of(length_m.to_f64());
        match self {
            Self::Circle { radius_m } => ProfileSpec::Circle { radius_m: to(radius_m) },
            Self::Rectangle { width_m, height_m, axis_height_m } => ProfileSpec::Rectangle {
                width_m: to(width_m),
                height_m: to(height_m),
                axis_height_m: to(axis_height_m),
            },
            Self::Underpass { width_m, wall_m, rise_m, axis_height_m } => ProfileSpec::Underpass {
                width_m: to(width_m),
                wall_m: to(wall_m),
                rise_m: to(rise_m),
                axis_height_m: to(axis_height_m),
            },
            Self::Horseshoe { width_m, wall_m, axis_height_m } => {
                ProfileSpec::Horseshoe { width_m: to(width_m), wall_m: to(wall_m), axis_height_m: to(axis_height_m) }
            }
            Self::Chain { vertices } => ProfileSpec::Chain {
                vertices: vertices
                    .iter()
                    .map(|vertex| ChainVertex { y_m: to(&vertex.y_m), z_m: to(&vertex.z_m), bulge: to(&vertex.bulge) })
                    .collect(),
            },
        }
    }

    /// Builds the profile.
    ///
    /// # Errors
    /// [`ProfileError`] if a length is not positive or the axis lies outside.
    pub fn build(&self) -> Result<Profile<T>, ProfileError> {
        let zero = T::zero();
        let half = T::of(0.5);
        let vertex = |y_m: T, z_m: T, bulge: T| ChainVertex { y_m, z_m, bulge };
        match self {
            Self::Circle { radius_m } => {
                positive("radius_m", *radius_m)?;
                let shape = Shape::Arc {
                    centre: Vector2::zeros(),
                    radius_m: *radius_m,
                    start_rad: -T::frac_pi_2(),
                    sweep_rad: T::two_pi(),
                };
                let length_m = T::two_pi() * *radius_m;
                let mut pieces = heapless::Vec::new();
                let piece = Piece::new(shape, zero, length_m, Part::Lining);
                pieces.push(piece).map_err(|_| ProfileError::TooManyPieces)?;
                Ok(Profile::new(pieces, length_m))
            }
            Self::Rectangle { width_m, height_m, axis_height_m } => {
                positive("width_m", *width_m)?;
                positive("height_m", *height_m)?;
                let (w, floor) = (*width_m * half, *axis_height_m);
                let top = floor - *height_m;
                build_chain(&[
                    vertex(w, top, zero),
                    vertex(w, floor, zero),
                    vertex(-w, floor, zero),
                    vertex(-w, top, zero),
                ])
            }
            Self::Underpass { width_m, wall_m, rise_m, axis_height_m } => {
                positive("rise_m", *rise_m)?;
                vaulted(*width_m, *wall_m, *rise_m, *axis_height_m)
            }
            Self::Horseshoe { width_m, wall_m, axis_height_m } => {
                vaulted(*width_m, *wall_m, *width_m * half, *axis_height_m)
            }
            Self::Chain { vertices } => build_chain(vertices),
        }
    }
}

fn vaulted<T: Real>(width_m: T, wall_m: T, rise_m: T, axis_height_m: T) -> Result<Profile<T>, ProfileError> {
    positive("width_m", width_m)?;
    positive("wall_m", wall_m)?;
    let w = width_m * T::of(0.5);
    let (floor, spring) = (axis_height_m, axis_height_m - wall_m);
    // tan(sweep / 4) of an arc is its rise over half its chord.
    let bulge = rise_m / w;
    let vertex = |y_m: T, z_m: T, bulge: T| ChainVertex { y_m, z_m, bulge };
    build_chain(&[
        vertex(w, spring, T::zero()),
        vertex(w, floor, T::zero()),
        vertex(-w, floor, T::zero()),
        vertex(-w, spring, bulge),
    ])
}

fn positive<T: Real>(name: &'static str, value: T) -> Result<(), ProfileError> {
    if value > T::zero() && value < T::of(1e6) {
        Ok(())
    } else {
        Err(ProfileError::NotPositive { name, value: value.to_f64() })
    }
}

/// Builds a profile from a closed chain and rotates its arc length so that `s = 0` lies straight above the axis.
fn build_chain<T: Real>(vertices: &[ChainVertex<T>]) -> Result<Profile<T>, ProfileError> {
    let mut pieces: heapless::Vec<Piece<T>, MAX_PIECES> = heapless::Vec::new();
    let mut perimeter_m = T::zero();
    for (index, (from, to)) in vertices.iter().zip(vertices.iter().cycle().skip(1)).enumerate() {
        let start = Vector2::new(from.y_m, from.z_m);
        let end = Vector2::new(to.y_m, to.z_m);
        let (shape, length_m) =
            piece_between(start, end, from.bulge).ok_or(ProfileError::Degenerate { vertex: index })?;
        let mut piece = Piece::new(shape, perimeter_m, length_m, Part::Lining);
        piece.part = part_facing(piece.at(length_m * T::of(0.5)).1);
        pieces.push(piece).map_err(|_| ProfileError::TooManyPieces)?;
        perimeter_m += length_m;
    }
    if signed_area(&pieces) <= T::zero() {
        return Err(ProfileError::CounterClockwise);
    }
    let unrotated = Profile::new(pieces, perimeter_m);
    if !unrotated.contains(Vector2::zeros()) {
        return Err(ProfileError::AxisOutside);
    }
    let crown = unrotated
        .ray_cast(Vector2::zeros(), Vector2::new(T::zero(), -T::one()))
        .ok_or(ProfileError::AxisOutside)?
        .surface;
    rotate_to(&unrotated, crown.piece, crown.s_m)
}

/// Twice the area within the chain of the pieces' ends and middles: positive if it runs clockwise looking forward.
fn signed_area<T: Real>(pieces: &[Piece<T>]) -> T {
    let mut sum = T::zero();
    for piece in pieces {
        let corners = [T::zero(), piece.length_m * T::of(0.5), piece.length_m].map(|along_m| piece.at(along_m).0);
        let [start, middle, end] = corners;
        sum += start.perp(&middle) + middle.perp(&end);
    }
    sum
}

fn piece_between<T: Real>(start: SectionVector<T>, end: SectionVector<T>, bulge: T) -> Option<(Shape<T>, T)> {
    let chord = end - start;
    let chord_m = chord.norm();
    if chord_m <= T::of(1e-6) || !chord_m.is_finite() || !bulge.is_finite() {
        return None;
    }
    if bulge == T::zero() {
        return Some((Shape::Line { start, tangent: chord / chord_m }, chord_m));
    }
    let sweep_rad = bulge.atan() * T::of(4.0);
    let radius_m = chord_m / ((sweep_rad * T::of(0.5)).sin().abs() * T::of(2.0));
    // The centre lies on the chord's bisector, on the inner side for a minor arc that bulges outwards.
    let inward = Vector2::new(-chord.y, chord.x) / chord_m;
    let along_bisector = (T::one() - bulge * bulge) / (bulge * T::of(4.0)) * chord_m;
    let centre = (start + end) * T::of(0.5) + inward * along_bisector;
    let from = start - centre;
    Some((Shape::Arc { centre, radius_m, start_rad: from.y.atan2(from.x), sweep_rad }, sweep_rad.abs() * radius_m))
}

fn part_facing<T: Real>(inward: SectionVector<T>) -> Part {
    if inward.y.abs() >= inward.x.abs() {
        if inward.y > T::zero() { Part::Ceiling } else { Part::Floor }
    } else if inward.x > T::zero() {
        Part::LeftWall
    } else {
        Part::RightWall
    }
}

/// Splits the piece that holds the crown so that the first piece starts there.
fn rotate_to<T: Real>(profile: &Profile<T>, crown_piece: usize, crown_s_m: T) -> Result<Profile<T>, ProfileError> {
    let mut pieces: heapless::Vec<Piece<T>, MAX_PIECES> = heapless::Vec::new();
    let mut push = |mut piece: Piece<T>, start_s_m: T| {
        piece.start_s_m = start_s_m;
        pieces.push(piece).map_err(|_| ProfileError::TooManyPieces)
    };
    let slack = T::of(1e-6);
    let Some(split) = profile.pieces.get(crown_piece) else { return Err(ProfileError::AxisOutside) };
    let before_m = crown_s_m - split.start_s_m;
    let mut s_m = T::zero();
    if split.length_m - before_m > slack {
        push(cut(split, before_m, split.length_m), s_m)?;
        s_m += split.length_m - before_m;
    }
    for piece in profile.pieces.iter().cycle().skip(crown_piece + 1).take(profile.pieces.len() - 1) {
        push(*piece, s_m)?;
        s_m += piece.length_m;
    }
    if before_m > slack {
        push(cut(split, T::zero(), before_m), s_m)?;
    }
    Ok(Profile::new(pieces, profile.perimeter_m))
}

/// The stretch of `piece` between two places along it.
fn cut<T: Real>(piece: &Piece<T>, from_m: T, to_m: T) -> Piece<T> {
    let shape = match piece.shape {
        Shape::Line { start, tangent } => Shape::Line { start: start + tangent * from_m, tangent },
        Shape::Arc { centre, radius_m, start_rad, sweep_rad } => {
            let turn = sweep_rad.signum();
            Shape::Arc {
                centre,
                radius_m,
                start_rad: start_rad + turn * from_m / radius_m,
                sweep_rad: turn * (to_m - from_m) / radius_m,
            }
        }
    };
    Piece::new(shape, piece.start_s_m, to_m - from_m, piece.part)
}
