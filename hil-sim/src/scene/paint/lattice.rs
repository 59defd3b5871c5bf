//! Band-limited noise and averaged edges: the pieces that the patterns are made of.

use super::Patch;

/// Value noise on a lattice that closes around the section.
///
/// A single octave; contributions fade out as the lattice cell nears the patch, so that nothing finer than the patch
/// remains. Cost: about 10 ns.
#[derive(Clone, Copy, Debug)]
pub(super) struct Octave {
    seed: u32,
    cells: i32,
    per_s_m: f64,
    per_x_m: f64,
    cell_m: f32,
}

impl Octave {
    /// Noise with cells of about `cell_m`, fitted to the perimeter.
    pub(super) fn new(seed: u64, stream: u64, perimeter_m: f64, cell_m: f64) -> Self {
        Self::stretched(seed, stream, perimeter_m, cell_m, cell_m)
    }

    /// Noise with cells of about `cell_s_m` along the section and exactly `cell_x_m` along the tunnel.
    pub(super) fn stretched(seed: u64, stream: u64, perimeter_m: f64, cell_s_m: f64, cell_x_m: f64) -> Self {
        let cells = (perimeter_m / cell_s_m).round().max(1.0);
        Self {
            seed: crate::scene::noise::derive_seed(seed, stream) as u32,
            cells: cells as i32,
            per_s_m: cells / perimeter_m,
            per_x_m: 1.0 / cell_x_m,
            cell_m: cell_s_m.min(cell_x_m) as f32,
        }
    }

    /// The noise at a patch, in `[-1, 1]`; 0 where the patch is coarser than the lattice.
    pub(super) fn at(&self, patch: &Patch) -> f32 {
        // Value noise with cells c holds little above the frequency 1/c; a patch of size p averages out what is
        // above 1/p.
        let weight = self.cell_m / patch.size_m() - 0.5;
        if weight <= 0.0 {
            return 0.0;
        }
        self.full(patch.s_m, patch.x_m) * weight.min(1.0)
    }

    /// Tells whether the noise hardly changes within a patch, so that its middle stands for the whole.
    fn is_coarse(&self, patch: &Patch) -> bool {
        self.cell_m >= COARSE_CELLS * patch.size_m()
    }

    /// The noise without regard to the patch, for structures larger than any patch.
    pub(super) fn full(&self, s_m: f64, x_m: f64) -> f32 {
        let (c0, u) = split(s_m * self.per_s_m);
        let (below, v) = split(x_m * self.per_x_m);
        let (fu, fv) = (fade(u), fade(v));
        let left = wrap(c0, self.cells);
        let right = if left + 1 == self.cells { 0 } else { left + 1 };
        // A column's bits are mixed once and serve both of its corners.
        let (left, right) = (hash(self.seed, left, 0), hash(self.seed, right, 0));
        let corner = |column: u32, row: i32| {
            let bits = (column ^ (row as u32).wrapping_mul(0x9e37_79b1)).wrapping_mul(0x7feb_352d);
            signed((bits ^ (bits >> 15)).wrapping_mul(0x846c_a68b))
        };
        let (a, b) = (corner(left, below), corner(right, below));
        let (c, d) = (corner(left, below + 1), corner(right, below + 1));
        let (low, high) = (a + (b - a) * fu, c + (d - c) * fu);
        low + (high - low) * fv
    }
}

/// Octaves with cells of at least so many patch sizes are evaluated once per patch.
const COARSE_CELLS: f32 = 4.0;

/// Weighted octaves, finest first, in two parts: what changes within a patch and what does not.
#[derive(Clone, Debug)]
pub(super) struct Octaves<const N: usize>(pub(super) [(Octave, f32); N]);

impl<const N: usize> Octaves<N> {
    /// Sum of the octaves that hardly change within `whole`.
    pub(super) fn coarse(&self, whole: &Patch) -> f32 {
        let coarse = self.0.iter().filter(|(octave, _)| octave.is_coarse(whole));
        coarse.map(|(octave, amplitude)| amplitude * octave.at(whole)).sum()
    }

    /// Sum of the octaves that [`Self::coarse`] leaves out, at a sample within `whole`.
    pub(super) fn fine(&self, whole: &Patch, sample: &Patch) -> f32 {
        let fine = self.0.iter().filter(|(octave, _)| !octave.is_coarse(whole));
        fine.map(|(octave, amplitude)| amplitude * octave.at(sample)).sum()
    }
}

/// Whole and fractional part, rounding down; without the library call that `floor` is on baseline x86-64.
fn split(value: f64) -> (i32, f32) {
    let truncated = value as i32;
    let whole = truncated - i32::from(value < f64::from(truncated));
    (whole, (value - f64::from(whole)) as f32)
}

fn wrap(value: i32, count: i32) -> i32 {
    if value >= 0 && value < count { value } else { value.rem_euclid(count) }
}

fn fade(t: f32) -> f32 {
    t * t * t * (t * (t * 6.0 - 15.0) + 10.0)
}

/// 32 random bits that belong to a lattice place.
pub(super) fn hash(seed: u32, column: i32, row: i32) -> u32 {
    let mut bits =
        seed ^ (column as u32).wrapping_mul(0x9e37_79b1) ^ (row as u32).wrapping_mul(0x85eb_ca77).rotate_left(13);
    bits = (bits ^ (bits >> 16)).wrapping_mul(0x7feb_352d);
    bits = (bits ^ (bits >> 15)).wrapping_mul(0x846c_a68b);
    bits ^ (bits >> 16)
}

/// Random bits as a number in `[-1, 1)`.
pub(super) fn signed(bits: u32) -> f32 {
    (bits >> 8) as f32 * (1.0 / 8_388_608.0) - 1.0
}

/// Random bits as a number in `[0, 1)`.
pub(super) fn unit(bits: u32) -> f32 {
    (bits >> 8) as f32 * (1.0 / 16_777_216.0)
}

/// Share of a patch of size `size_m` around `centre_m` that lies within `[from_m, to_m]`.
pub(super) fn share_within(centre_m: f32, size_m: f32, from_m: f32, to_m: f32) -> f32 {
    let half_m = 0.5 * size_m;
    let overlap_m = (centre_m + half_m).min(to_m) - (centre_m - half_m).max(from_m);
    (overlap_m / size_m.max(1e-9)).clamp(0.0, 1.0)
}

/// Place within a regular grid of cells: the cell's number and the distance from its centre.
pub(super) fn cell(place_m: f64, pitch_m: f64) -> (i32, f32) {
    let (number, share) = split(place_m / pitch_m);
    (number, (share - 0.5) * pitch_m as f32)
}

/// Share of a patch that lies in the joints of width `joint_m` between cells of a regular grid.
pub(super) fn share_in_joint(from_centre_m: f32, size_m: f32, pitch_m: f32, joint_m: f32) -> f32 {
    if size_m > pitch_m {
        return joint_m / pitch_m;
    }
    let half_m = 0.5 * pitch_m;
    share_within(from_centre_m.abs(), size_m, half_m - 0.5 * joint_m, half_m + 0.5 * joint_m)
}

/// 0 below `from`, 1 above `to`, smooth between.
pub(super) fn smooth_step(from: f32, to: f32, value: f32) -> f32 {
    let t = ((value - from) / (to - from)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

/// The number of cells of about `pitch_m` that go around, made even so that a half bond closes; and their true pitch.
pub(super) fn even_count(perimeter_m: f64, pitch_m: f64) -> (i32, f64) {
    let count = ((perimeter_m / (2.0 * pitch_m)).round() * 2.0).max(2.0);
    (count as i32, perimeter_m / count)
}

/// Brings a cell number into one turn.
pub(super) fn around(number: i32, count: i32) -> i32 {
    wrap(number, count)
}
