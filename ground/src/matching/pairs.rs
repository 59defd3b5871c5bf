//! Which pairs to try, in which order, so that few photos need to be held at a time.

use super::wall::Footprint;

/// Two photos that should see the same wall.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct ExpectedPair {
    /// The earlier and the later photo.
    pub(super) photos: [usize; 2],
    pub(super) overlap: f64,
}

/// Returns the pairs whose footprints share at least `min_overlap`, ordered by the later photo, then the earlier; for each
/// photo the `max_partners` earlier ones of greatest overlap.
///
/// Cost: one comparison of extents for every two photos; block by block only where they meet.
pub(super) fn expected_pairs(
    footprints: &[Option<Footprint>],
    blocks_around: i64,
    min_overlap: f64,
    max_partners: usize,
) -> Vec<ExpectedPair> {
    let mut pairs = Vec::new();
    for (later, footprint) in footprints.iter().enumerate() {
        let Some(footprint) = footprint else { continue };
        let start = pairs.len();
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
        if pairs.len() - start > max_partners {
            pairs[start..].sort_by(|a, b| b.overlap.total_cmp(&a.overlap));
            pairs.truncate(start + max_partners);
            pairs[start..].sort_by_key(|pair| pair.photos);
        }
    }
    pairs
}

/// For every photo the last photo for whose sake it must be held, itself included; `None` if it is in no pair.
pub(super) fn last_needed(pairs: &[ExpectedPair], photos: usize) -> Vec<Option<usize>> {
    let mut last = vec![None; photos];
    for pair in pairs {
        let later = pair.photos[1];
        for photo in pair.photos {
            last[photo] = last[photo].max(Some(later));
        }
    }
    last
}

#[cfg(test)]
mod tests {
    use fixedbitset::FixedBitSet;

    use super::*;

    fn footprint(first_row: i64) -> Footprint {
        let (size, mut seen) = ([2, 10], FixedBitSet::with_capacity(20));
        seen.insert_range(..);
        Footprint { block0: [0, first_row], size, seen, count: 20, distance_m: 3.0 }
    }

    #[test]
    fn pairs_come_ordered_by_their_later_photo_and_need_their_overlap() {
        let footprints = [Some(footprint(0)), Some(footprint(4)), None, Some(footprint(8))];
        let photos: Vec<_> = expected_pairs(&footprints, 50, 0.3, 9).iter().map(|pair| pair.photos).collect();
        assert_eq!(photos, [[0, 1], [1, 3]]);
        assert_eq!(last_needed(&expected_pairs(&footprints, 50, 0.3, 9), 4), [Some(1), Some(3), None, Some(3)]);
    }

    #[test]
    fn of_too_many_partners_those_of_greatest_overlap_stay() {
        let footprints = [0, 3, 1, 2, 2].map(|first_row| Some(footprint(first_row)));
        let pairs = expected_pairs(&footprints, 50, 0.1, 2);
        let of_last: Vec<_> = pairs.iter().filter(|pair| pair.photos[1] == 4).map(|pair| pair.photos[0]).collect();
        assert_eq!(of_last.len(), 2);
        assert!(of_last.contains(&3) && !of_last.contains(&0));
        assert!(pairs.is_sorted_by_key(|pair| [pair.photos[1], pair.photos[0]]));
    }

    #[test]
    fn footprints_a_turn_apart_are_the_same() {
        let footprints = [footprint(0), Footprint { block0: [50, 0], ..footprint(0) }].map(Some);
        assert_eq!(expected_pairs(&footprints, 50, 0.9, 9).len(), 1);
    }
}
