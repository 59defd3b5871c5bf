//! Binary descriptors: which of two blurred pixels is brighter, 256 times.
//!
//! Pairs are drawn once from a round Gaussian (Calonder et al., "BRIEF", ECCV 2010, variant G II); turned with the corner's
//! direction in steps of 12 degrees where asked (Rublee et al., "ORB", ICCV 2011).

use std::f64::consts::TAU;

use super::{BriefDescriptor, Orientation};
use crate::raster::Grey;

/// Radius of the disc that the pairs lie in, pixels of the image they are compared in.
pub(super) const RADIUS: i64 = 15;

/// Blur before the comparison, pixels: single pixels would compare noise.
pub(super) const BLUR_PX: f32 = 2.0;

/// Directions that are told apart.
const TURNS: usize = 30;

/// The pairs, `[column, row]` twice, for each direction.
pub(super) struct Pattern {
    turned: Vec<[[[i64; 2]; 2]; 256]>,
}

impl Pattern {
    pub(super) fn new(orientation: Orientation) -> Self {
        let pairs = pairs();
        let turns = if orientation == Orientation::Free { TURNS } else { 1 };
        let turned = (0..turns)
            .map(|turn| {
                let (sin, cos) = (turn as f64 / TURNS as f64 * TAU).sin_cos();
                pairs.map(|pair| {
                    pair.map(|[x, y]| {
                        let (x, y) = (x as f64, y as f64);
                        [(cos * x - sin * y).round() as i64, (sin * x + cos * y).round() as i64]
                    })
                })
            })
            .collect();
        Self { turned }
    }

    /// Returns the descriptor at a pixel at least `RADIUS + 1` inside the blurred image.
    pub(super) fn describe(&self, blurred: &Grey, column: usize, row: usize, angle_rad: f32) -> BriefDescriptor {
        let turn = (f64::from(angle_rad) / TAU * self.turned.len() as f64).round() as i64;
        let pairs = &self.turned[turn.rem_euclid(self.turned.len() as i64) as usize];
        let middle = (row * blurred.width + column) as i64;
        let value = |[dx, dy]: [i64; 2]| blurred.data[(middle + dy * blurred.width as i64 + dx) as usize];
        let mut words = [0_u64; 4];
        for (word, pairs) in words.iter_mut().zip(pairs.as_chunks::<64>().0) {
            for (bit, [first, second]) in pairs.iter().enumerate() {
                *word |= u64::from(value(*first) < value(*second)) << bit;
            }
        }
        words
    }
}

/// Direction from a corner to the centroid of the brightness around it, radians.
pub(super) fn centroid_angle_rad(image: &Grey, column: usize, row: usize) -> f32 {
    let (mut across, mut down) = (0.0, 0.0);
    for dy in -RADIUS..=RADIUS {
        for dx in -RADIUS..=RADIUS {
            if dx * dx + dy * dy <= RADIUS * RADIUS {
                let value = image.data[((row as i64 + dy) * image.width as i64 + column as i64 + dx) as usize];
                across += dx as f32 * value;
                down += dy as f32 * value;
            }
        }
    }
    down.atan2(across)
}

/// 256 pairs of different points within the disc, each coordinate nearly normal with a fifth of the patch's side.
fn pairs() -> [[[i64; 2]; 2]; 256] {
    let mut state = 0x0AD1_7000_u64;
    // Whole numbers only, so that descriptors are the same on every machine.
    let mut coordinate = || {
        // The sum of twelve evenly drawn numbers is nearly normal; their spread makes a deviation of 6.2 pixels.
        let sum: i64 = (0..12).map(|_| (splitmix(&mut state) >> 33).rem_euclid(6201) as i64 - 3100).sum();
        (sum + sum.signum() * 500) / 1000
    };
    let mut point = || loop {
        let point = [coordinate(), coordinate()];
        if point[0] * point[0] + point[1] * point[1] <= RADIUS * RADIUS {
            return point;
        }
    };
    std::array::from_fn(|_| {
        loop {
            let pair = [point(), point()];
            if pair[0] != pair[1] {
                return pair;
            }
        }
    })
}

/// `SplitMix64` (Steele, Lea and Flood, OOPSLA 2014).
fn splitmix(state: &mut u64) -> u64 {
    *state = state.wrapping_add(0x9E37_79B9_7F4A_7C15);
    let mut z = *state;
    z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    z ^ (z >> 31)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_pairs_spread_as_the_paper_s_best_pattern_does() {
        let pairs = pairs();
        let coordinates: Vec<f64> = pairs.iter().flatten().flatten().map(|&value| value as f64).collect();
        let mean = coordinates.iter().sum::<f64>() / 1024.0;
        let deviation = (coordinates.iter().map(|value| (value - mean).powi(2)).sum::<f64>() / 1024.0).sqrt();
        // 6.2 before the disc cuts the tails off.
        assert!(mean.abs() < 0.6 && (5.2..6.3).contains(&deviation), "{mean} {deviation}");
    }
}
