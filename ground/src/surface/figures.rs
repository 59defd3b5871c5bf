//! What the surface comes to in numbers.

use adit_geometry::profile::Profile;
use serde::{Deserialize, Serialize};

use super::ring::{Basis, Rings};
use super::strips::Strip;
use crate::adjust::median;
use crate::texture::{Lattice, clock_position};

/// One ring of a round tunnel.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct RingFigures {
    /// Station.
    pub x_m: f64,
    /// Mean radius less the section's.
    pub radius_mm: f64,
    /// Largest less smallest diameter over their mean.
    pub ovality_percent: f64,
    /// Where the largest diameter lies: angle from the crown, clockwise looking forward, 0 to 180.
    pub long_axis_deg: f64,
    /// How far the ring's centre lies right of and below the section's.
    pub shift_mm: [f64; 2],
}

/// A place of the relief.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ReliefExtreme {
    /// Arc length from the crown.
    pub s_m: f64,
    /// Clock position in `[0, 12)`, looking forward.
    pub clock: f64,
    /// Station.
    pub x_m: f64,
    /// Height over the ring, positive inwards.
    pub height_mm: f64,
}

/// What the surface stage made.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SurfaceReport {
    /// Size of a cell.
    pub cell_mm: f64,
    /// Cells around and along.
    pub cells: [usize; 2],
    /// Cells whose height two or more photos agree on.
    pub known_area_m2: f64,
    /// Mean confidence of these.
    pub mean_confidence: f64,
    /// The rings of a round tunnel that were seen nearly all around; empty for other sections.
    pub rings: Vec<RingFigures>,
    /// Median over the rings; absent for other sections.
    pub median_ovality_percent: Option<f64>,
    /// Median height of the ring part over the section: an error of its size (known from ranges alone) shows here.
    pub median_height_mm: f64,
    /// The farthest inwards, and where it is.
    pub highest: ReliefExtreme,
    /// The farthest outwards.
    pub deepest: ReliefExtreme,
    /// The relief that has full colour in relief.png.
    pub full_colour_mm: f64,
    /// Photos used, and how often photos were decoded.
    pub photos_used: usize,
    /// See [`Self::photos_used`].
    pub photos_decoded: usize,
    /// Most bytes of decoded photos at a time.
    pub photo_bytes: usize,
    /// Cells swept (both passes) per second.
    pub cells_per_s: f64,
    /// Photos or masks that could not be used.
    pub losses: Vec<crate::survey::Loss>,
}

/// Extremes and sums, strip by strip.
#[derive(Default)]
pub(super) struct Tally {
    /// Known cells per row.
    pub(super) known: Vec<u32>,
    pub(super) confidence: f64,
    pub(super) highest: ReliefExtreme,
    pub(super) deepest: ReliefExtreme,
}

/// Rings of which less is known have no ovality worth the name.
const RING_SHARE: f64 = 0.75;

/// Extremes are looked for among cells that are known at least so well.
const SURE: f32 = 0.5;

impl Tally {
    pub(super) fn add(&mut self, strip: &Strip, lattice: &Lattice, profile: &Profile<f64>) {
        let rows = strip.confidence.chunks_exact(lattice.columns);
        self.known.extend(rows.map(|row| row.iter().filter(|confidence| **confidence > 0.0).count() as u32));
        for (at, (&relief_m, &confidence)) in strip.relief_m.iter().zip(strip.confidence).enumerate() {
            self.confidence += f64::from(confidence);
            let height_mm = f64::from(relief_m) * 1e3;
            let outside = height_mm > self.highest.height_mm || height_mm < self.deepest.height_mm;
            if confidence >= SURE && outside {
                let (column, row) = (at % lattice.columns, strip.row0 + at / lattice.columns);
                let s_m = lattice.s_m(column as i64);
                let clock = clock_position(profile, s_m);
                let place = ReliefExtreme { s_m, clock, x_m: lattice.x_m(row as i64), height_mm };
                *(if height_mm > 0.0 { &mut self.highest } else { &mut self.deepest }) = place;
            }
        }
    }
}

/// The rings of a round tunnel of which the photos show [`RING_SHARE`]; empty for other sections.
pub(super) fn ring_figures(
    rings: &Rings,
    profile: &Profile<f64>,
    lattice: &Lattice,
    known: &[u32],
) -> Vec<RingFigures> {
    let Basis::Circle { perimeter_m } = Basis::of(profile) else { return Vec::new() };
    let radius_m = perimeter_m / std::f64::consts::TAU;
    let figures = |(index, terms): (usize, &Vec<f64>)| {
        let x_m = rings.x0_m + index as f64 * rings.step_m;
        let row = |x_m: f64| (((x_m - lattice.x0_m) / lattice.step_x_m).max(0.0) as usize).min(known.len());
        let rows = &known[row(x_m - 0.5 * rings.step_m)..row(x_m + 0.5 * rings.step_m)];
        let share = f64::from(rows.iter().sum::<u32>()) / (rows.len().max(1) * lattice.columns) as f64;
        if share < RING_SHARE {
            return None;
        }
        let [offset, crown, right, cos, sin] = *terms.as_slice() else { return None };
        // A height is inwards: the radius shrinks by it, and the longest axis is where the harmonic is lowest.
        let amplitude = cos.hypot(sin);
        Some(RingFigures {
            x_m,
            radius_mm: -offset * 1e3,
            ovality_percent: 200.0 * amplitude / (radius_m - offset),
            long_axis_deg: (-sin).atan2(-cos).to_degrees().rem_euclid(360.0) * 0.5,
            // Up is where cos p = 1, right where sin p = 1; z points down.
            shift_mm: [-right * 1e3, crown * 1e3],
        })
    };
    rings.terms.iter().enumerate().filter_map(figures).collect()
}

pub(super) fn median_ovality(rings: &[RingFigures]) -> Option<f64> {
    let percents: Vec<f64> = rings.iter().map(|ring| ring.ovality_percent).collect();
    (!percents.is_empty()).then(|| median(&percents))
}

/// Median height of the ring part over the lattice.
pub(super) fn median_height_mm(rings: &Rings, profile: &Profile<f64>, lattice: &Lattice) -> f64 {
    /// Rows looked at: rings change slowly.
    const ROWS: usize = 64;
    let rows = (0..lattice.rows).step_by(lattice.rows.div_ceil(ROWS));
    let heights = rows.flat_map(|row| rings.heights(profile, lattice, row, 1));
    median(&heights.map(|height_m| f64::from(height_m) * 1e3).collect::<Vec<_>>())
}

#[cfg(test)]
mod tests {
    use adit_geometry::profile::ProfileSpec;

    use super::*;

    #[test]
    fn a_ring_that_is_wide_low_and_to_the_right_is_said_to_be_so() {
        let profile = ProfileSpec::Circle { radius_m: 3.0 }.build().unwrap();
        // Crown and invert 30 mm inwards, sides 30 mm outwards; everything 5 mm right and 7 mm down.
        let terms = vec![vec![0.0, 0.007, -0.005, 0.03, 0.0]];
        let rings = Rings { x0_m: 0.0, step_m: 0.5, terms };
        let lattice = Lattice { step_s_m: 0.1, step_x_m: 0.1, columns: 188, rows: 4, x0_m: -0.2 };
        assert!(ring_figures(&rings, &profile, &lattice, &[100; 4]).is_empty());
        let [ring] = ring_figures(&rings, &profile, &lattice, &[180; 4])[..] else { panic!("one ring") };
        assert!((ring.ovality_percent - 2.0).abs() < 1e-9 && (ring.long_axis_deg - 90.0).abs() < 1e-9, "{ring:?}");
        assert!((ring.shift_mm[0] - 5.0).abs() < 1e-9 && (ring.shift_mm[1] - 7.0).abs() < 1e-9, "{ring:?}");
    }
}
