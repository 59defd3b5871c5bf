//! Hash-based noise on integer lattices: a function of seed and place, so that no order of evaluation changes it.
//!
//! Source of the mixer: the finaliser of `SplitMix64` (Steele, Lea, Flood, "Fast splittable pseudorandom number
//! generators", OOPSLA 2014).

/// Mixes 64 bits so that every input bit moves every output bit with probability near one half.
pub fn mix(mut bits: u64) -> u64 {
    bits = (bits ^ (bits >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    bits = (bits ^ (bits >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    bits ^ (bits >> 31)
}

/// Returns 64 random bits that belong to lattice place (column, row) under `seed`.
pub fn lattice_bits(seed: u64, column: i64, row: i64) -> u64 {
    let along = mix(seed.wrapping_add((column as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15)));
    mix(along ^ (row as u64).wrapping_mul(0xc2b2_ae3d_27d4_eb4f))
}

/// Returns the seed of an independent stream named by `stream`.
pub fn derive_seed(seed: u64, stream: u64) -> u64 {
    mix(seed ^ mix(stream.wrapping_add(0x9e37_79b9_7f4a_7c15)))
}

/// Maps random bits to `[0, 1)` with 24 bits of resolution.
pub fn unit(bits: u64) -> f32 {
    (bits >> 40) as f32 * (1.0 / 16_777_216.0)
}

/// Maps random bits to `[-1, 1)`.
pub fn signed_unit(bits: u64) -> f32 {
    unit(bits) * 2.0 - 1.0
}

/// A value-noise sample and its derivatives with respect to the lattice coordinates.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct NoiseSample {
    /// In `[-1, 1]`.
    pub value: f64,
    /// Derivative along the first coordinate.
    pub d_column: f64,
    /// Derivative along the second coordinate.
    pub d_row: f64,
}

/// Value noise with quintic fade (C2), lattice spacing 1, periodic in the first coordinate with `period` cells.
///
/// `period = 0` means not periodic. The slope is at most 3.75 per cell in either direction.
pub fn value_noise(seed: u64, column: f64, row: f64, period: i64) -> NoiseSample {
    let (c0, r0) = (column.floor(), row.floor());
    let (u, v) = (column - c0, row - r0);
    let wrap = |c: i64| if period > 0 { c.rem_euclid(period) } else { c };
    let corner = |dc: i64, dr: i64| f64::from(signed_unit(lattice_bits(seed, wrap(c0 as i64 + dc), r0 as i64 + dr)));
    let (a, b, c, d) = (corner(0, 0), corner(1, 0), corner(0, 1), corner(1, 1));
    let fade = |t: f64| t * t * t * (t * (t * 6.0 - 15.0) + 10.0);
    let slope = |t: f64| 30.0 * t * t * (t * (t - 2.0) + 1.0);
    let (fu, fv) = (fade(u), fade(v));
    let twist = a - b - c + d;
    NoiseSample {
        value: a + (b - a) * fu + (c - a) * fv + twist * fu * fv,
        d_column: slope(u) * (b - a + twist * fv),
        d_row: slope(v) * (c - a + twist * fu),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn value_noise_is_periodic_and_its_derivatives_match_differences() {
        for step in 0..200 {
            let (column, row) = (f64::from(step) * 0.173 - 9.0, f64::from(step) * 0.311 - 20.0);
            let here = value_noise(7, column, row, 12);
            let around = value_noise(7, column + 12.0, row, 12);
            assert!((here.value - around.value).abs() < 1e-12);
            let h = 1e-6;
            let along = value_noise(7, column + h, row, 12).value - value_noise(7, column - h, row, 12).value;
            let across = value_noise(7, column, row + h, 12).value - value_noise(7, column, row - h, 12).value;
            assert!((along / (2.0 * h) - here.d_column).abs() < 1e-6);
            assert!((across / (2.0 * h) - here.d_row).abs() < 1e-6);
        }
    }
}
