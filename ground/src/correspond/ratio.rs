//! The ratio test.

use super::verify::Verify;
use super::{Correspondences, Match, Strategy, View};
use crate::features::{Descriptor, Neighbour, nearest};

/// Nearest neighbours that are clearly nearer than the second nearest, then RANSAC (Lowe, IJCV 60, 2004, section 7.1).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ratio {
    /// Largest ratio of the nearest distance to the second.
    pub ratio: f64,
    /// The geometric test.
    pub verify: Verify,
}

impl Default for Ratio {
    /// Lowe's 0.8.
    fn default() -> Self {
        Self { ratio: 0.8, verify: Verify::default() }
    }
}

impl<D: Descriptor> Strategy<D> for Ratio {
    fn correspond(&self, first: &View<D>, second: &View<D>) -> Correspondences {
        let neighbours = nearest::<2, D>(&first.features.descriptors, &second.features.descriptors);
        let matches = one_to_one(distinct::<D, 2>(&neighbours, self.ratio), &neighbours);
        self.verify.check(first, second, &matches)
    }
}

/// Returns the features whose nearest neighbour passes the ratio test, with it.
pub(super) fn distinct<D: Descriptor, const K: usize>(neighbours: &[[Neighbour; K]], ratio: f64) -> Vec<Match> {
    let limit = if D::SQUARED { ratio * ratio } else { ratio };
    let passes = |best: &[Neighbour; K]| {
        best[1].index != u32::MAX && f64::from(best[0].distance) < limit * f64::from(best[1].distance)
    };
    (0..).zip(neighbours).filter(|(_, best)| passes(best)).map(|(from, best)| [from, best[0].index]).collect()
}

/// Of several features with the same nearest neighbour, the nearest one keeps it.
pub(super) fn one_to_one<const K: usize>(mut matches: Vec<Match>, neighbours: &[[Neighbour; K]]) -> Vec<Match> {
    matches.sort_by_key(|&[from, to]| (to, neighbours[from as usize][0].distance, from));
    matches.dedup_by_key(|pair| pair[1]);
    matches
}
