//! Which pairs to try, in which order, so that few photos need to be held at a time.

use super::wall::Footprint;

/// Two photos that should see the same wall.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct ExpectedPair {
    /// The earlier and the later photo.
    pub(super) photos: [usize; 2],
    pub(super) overlap: f64,
}

/// Returns the pairs whose footprints share at least `min_overlap`, ordered by the later photo, then the earlier.
///
/// Cost: one comparison of extents for every two photos; block by block only where they meet.
pub(super) fn expected_pairs(
    footprints: &[Option<Footprint>],
    blocks_around: i64,
    min_overlap: f64,
) -> Vec<ExpectedPair> {
    let mut pairs = Vec::new();
    for (later, footprint) in footprints.iter().enumerate() {
        let Some(footprint) = footprint else { continue };
        for (earlier, other) in footprints[..later].iter().enumerate() {
            let Some(other) = other else { continue };
            let starts_before_end = |a: &Footprint, b: &Footprint| a.block0[1] < b.block0[1] + b.size[1] as i64;
            if starts_before_end(footprint, other) && starts_before_end(other, footprint) {
                let overlap = footprint.overlap(other, blocks_around);
                if overlap >= min_overlap {
                    pairs.push(ExpectedPair { photos: [earlier, later], overlap });
                }
            }
        }
    }
    pairs
}

/// For every photo the last later photo that it is paired with; itself if none.
pub(super) fn last_needed(pairs: &[ExpectedPair], photos: usize) -> Vec<usize> {
    let mut last: Vec<usize> = (0..photos).collect();
    for pair in pairs {
        let [earlier, later] = pair.photos;
        last[earlier] = last[earlier].max(later);
    }
    last
}
