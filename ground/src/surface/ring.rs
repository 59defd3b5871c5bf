//! The smooth part of the wall's height: what rings do as a whole.

use adit_geometry::profile::Profile;
use serde::{Deserialize, Serialize};

use crate::texture::Lattice;

/// Most functions that a section's ring part is made of.
const MOST_TERMS: usize = 16;

/// How a height around the section is made of a few numbers.
///
/// # Method
/// A circle has radius, shift and ovality: `1, cos p, sin p, cos 2p, sin 2p` over `p = 2 pi s / perimeter`. Other
/// sections have, for each planar piece, offset and tilt, for each arc also its second Legendre polynomial: flatter or
/// rounder than drawn.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Basis {
    /// One closed arc.
    Circle { perimeter_m: f64 },
    /// Start and length of each piece, and whether it is planar.
    Pieces(Vec<(f64, f64, bool)>),
}

impl Basis {
    pub(super) fn of(profile: &Profile<f64>) -> Self {
        let pieces = profile.pieces();
        let planar = pieces.iter().filter(|piece| piece.is_planar()).count();
        // A circle is built of arcs alone, all of the same centre.
        if planar == 0 {
            return Self::Circle { perimeter_m: profile.perimeter_m() };
        }
        Self::Pieces(pieces.iter().map(|piece| (piece.start_s_m(), piece.length_m(), piece.is_planar())).collect())
    }

    /// Number of terms.
    pub(super) fn terms(&self) -> usize {
        match self {
            Self::Circle { .. } => 5,
            Self::Pieces(pieces) => pieces.iter().map(|(.., planar)| if *planar { 2 } else { 3 }).sum(),
        }
    }

    /// The terms' values at an arc length in `[0, perimeter)`.
    pub(super) fn at(&self, s_m: f64) -> Vec<f64> {
        match self {
            Self::Circle { perimeter_m } => {
                let (sin, cos) = (s_m / perimeter_m * std::f64::consts::TAU).sin_cos();
                vec![1.0, cos, sin, cos * cos - sin * sin, 2.0 * sin * cos]
            }
            Self::Pieces(pieces) => {
                let mut values = Vec::with_capacity(MOST_TERMS);
                let here = pieces.iter().rposition(|(start_m, ..)| *start_m <= s_m).unwrap_or(0);
                for (index, (start_m, length_m, planar)) in pieces.iter().enumerate() {
                    let place = ((s_m - start_m) / length_m * 2.0 - 1.0).clamp(-1.0, 1.0);
                    let full = [1.0, place, 1.5 * place * place - 0.5];
                    let used = if *planar { 2 } else { 3 };
                    values.extend(full[..used].iter().map(|value| if index == here { *value } else { 0.0 }));
                }
                values
            }
        }
    }
}

/// The ring part along the tunnel: terms at equally spaced stations, linear between.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Rings {
    /// Station of the first ring's middle.
    pub x0_m: f64,
    /// Distance of the rings.
    pub step_m: f64,
    /// Per ring the coefficients of the basis, metres.
    pub terms: Vec<Vec<f64>>,
}

impl Rings {
    /// Coefficients at a station.
    pub(super) fn at(&self, x_m: f64) -> Vec<f64> {
        let place = ((x_m - self.x0_m) / self.step_m).clamp(0.0, self.terms.len().saturating_sub(1) as f64);
        let (index, share) = (place as usize, place.fract());
        let Some(first) = self.terms.get(index) else { return Vec::new() };
        let next = self.terms.get(index + 1).unwrap_or(first);
        first.iter().zip(next).map(|(a, b)| a + share * (b - a)).collect()
    }

    /// Heights of the ring part on rows of a lattice, metres.
    pub(super) fn heights(&self, profile: &Profile<f64>, lattice: &Lattice, row0: usize, rows: usize) -> Vec<f32> {
        let basis = Basis::of(profile);
        let columns: Vec<Vec<f64>> = (0..lattice.columns).map(|column| basis.at(lattice.s_m(column as i64))).collect();
        let mut heights = Vec::with_capacity(rows * lattice.columns);
        for row in row0..row0 + rows {
            let terms = self.at(lattice.x_m(row as i64));
            heights.extend(columns.iter().map(|column| dot(column, &terms) as f32));
        }
        heights
    }
}

pub(super) fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}
