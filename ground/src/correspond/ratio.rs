//! The ratio test.

use super::verify::Verify;
use super::{Correspondences, Match, Strategy, View};
use crate::features::{Descriptor, Neighbour, nearest};

/// Nearest neighbours that are clearly nearer than the second nearest, then RANSAC (Lowe, IJCV 60, 2004, section 7.1).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ratio {
    /// Largest ratio of the nearest distance to the second.
    pub ratio: f64,
    /// Both must be each other's nearest.
    pub cross_check: bool,
    /// The geometric test.
    pub verify: Verify,
}

impl Default for Ratio {
    /// Lowe's 0.8.
    fn default() -> Self {
        Self { ratio: 0.8, cross_check: true, verify: Verify::default() }
    }
}

impl<D: Descriptor> Strategy<D> for Ratio {
    fn correspond(&self, first: &View<D>, second: &View<D>) -> Correspondences {
        let forth = nearest::<2, D>(&first.features.descriptors, &second.features.descriptors);
        let mut matches = distinct::<D, 2>(&forth, self.ratio);
        if self.cross_check {
            let back = nearest::<1, D>(&second.features.descriptors, &first.features.descriptors);
            matches.retain(|&[from, to]| back[to as usize][0].index == from);
        }
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
