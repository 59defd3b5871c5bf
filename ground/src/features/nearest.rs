//! Nearest neighbours among descriptors, by comparing every two.
//!
//! With a few thousand features per photo, comparing all is exact, needs no index, and takes a tenth of a second; the
//! blocks below keep both sides in the first-level cache.

use rayon::prelude::*;

use super::{BriefDescriptor, SiftDescriptor};
use crate::vectors::vectorised;

/// Queries that one task compares with everything.
const QUERIES: usize = 32;

/// Descriptors that all queries of a task are compared with before the next ones.
const BLOCK: usize = 128;

/// A descriptor found in another photo.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Neighbour {
    /// Its index there.
    pub index: u32,
    /// Its [`Descriptor::distance`].
    pub distance: u32,
}

/// What can be compared.
pub trait Descriptor: Copy + Sync {
    /// Distances are squares of what a ratio test compares (and of what is proportional to length).
    const SQUARED: bool;

    /// Returns how different two descriptors are.
    fn distance(&self, other: &Self) -> u32;
}

impl Descriptor for SiftDescriptor {
    const SQUARED: bool = true;

    #[expect(clippy::inline_always, reason = "inlined into the dispatch, else it is compiled without its vectors")]
    #[inline(always)]
    fn distance(&self, other: &Self) -> u32 {
        // In this form the compiler finds the instruction that multiplies and adds pairs of 16 bits. Nothing can overflow;
        // the checks for it in a build for tests would cost all vectors.
        let add_square = |sum: i32, (&a, &b): (&u8, &u8)| {
            let difference = i32::from(i16::from(a).wrapping_sub(i16::from(b)));
            sum.wrapping_add(difference.wrapping_mul(difference))
        };
        self.iter().zip(other).fold(0, add_square) as u32
    }
}

impl Descriptor for BriefDescriptor {
    const SQUARED: bool = false;

    #[expect(clippy::inline_always, reason = "inlined into the dispatch, else it is compiled without its vectors")]
    #[inline(always)]
    fn distance(&self, other: &Self) -> u32 {
        self.iter().zip(other).map(|(a, b)| (a ^ b).count_ones()).sum()
    }
}

/// Returns the `K` nearest of `others` for every descriptor, nearest first (the lower index first among equals).
///
/// Fewer than `K` others leave the rest with the greatest distance and index.
pub fn nearest<const K: usize, D: Descriptor>(descriptors: &[D], others: &[D]) -> Vec<[Neighbour; K]> {
    let mut found = vec![[Neighbour { index: u32::MAX, distance: u32::MAX }; K]; descriptors.len()];
    found.par_chunks_mut(QUERIES).zip(descriptors.par_chunks(QUERIES)).for_each(|(found, queries)| {
        vectorised(
            #[inline(always)]
            || search(found, queries, others),
        );
    });
    found
}

#[expect(clippy::inline_always, reason = "inlined into the dispatch, else it is compiled without its vectors")]
#[inline(always)]
fn search<const K: usize, D: Descriptor>(found: &mut [[Neighbour; K]], queries: &[D], others: &[D]) {
    for (block, candidates) in others.chunks(BLOCK).enumerate() {
        for (best, query) in found.iter_mut().zip(queries) {
            for (offset, candidate) in candidates.iter().enumerate() {
                let distance = query.distance(candidate);
                if distance < best[K - 1].distance {
                    insert(best, Neighbour { index: (block * BLOCK + offset) as u32, distance });
                }
            }
        }
    }
}

/// Puts a neighbour nearer than the last in its place.
fn insert<const K: usize>(best: &mut [Neighbour; K], neighbour: Neighbour) {
    let mut place = K - 1;
    while place > 0 && neighbour.distance < best[place - 1].distance {
        best[place] = best[place - 1];
        place -= 1;
    }
    best[place] = neighbour;
}

#[cfg(test)]
mod tests {
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    use super::*;

    #[test]
    fn the_nearest_are_those_of_a_plain_search_in_f64() {
        let mut rng = ChaCha8Rng::seed_from_u64(5);
        let mut draw = |count: usize| -> Vec<SiftDescriptor> {
            (0..count).map(|_| std::array::from_fn(|_| rng.random_range(0..=255))).collect()
        };
        let (queries, others) = (draw(70), draw(301));
        let found = nearest::<3, _>(&queries, &others);
        for (query, best) in queries.iter().zip(&found) {
            let mut distances: Vec<(u32, u32)> = others
                .iter()
                .enumerate()
                .map(|(index, other)| {
                    let sum: f64 = query.iter().zip(other).map(|(&a, &b)| (f64::from(a) - f64::from(b)).powi(2)).sum();
                    (sum as u32, index as u32)
                })
                .collect();
            distances.sort_unstable();
            let expected: Vec<(u32, u32)> = distances[..3].to_vec();
            assert_eq!(best.map(|neighbour| (neighbour.distance, neighbour.index)).to_vec(), expected);
        }
    }

    #[test]
    fn binary_descriptors_differ_by_their_number_of_unequal_bits() {
        let (none, some) = ([0_u64; 4], [0b1011, 0, 1 << 63, 0]);
        assert_eq!(none.distance(&some), 4);
        assert_eq!(nearest::<2, _>(&[none], &[some])[0][1].index, u32::MAX);
    }
}
