//! Which photos hang together.

use std::collections::BTreeMap;

use crate::adjust::Tracks;

/// Two photos hang together from this many shared points on.
const LEAST_SHARED: usize = 15;

/// Tells for each photo whether it belongs to the largest group of photos that hang together; nobody does alone.
pub(super) fn registered(points: &Tracks, photos: usize) -> Vec<bool> {
    let mut shared: BTreeMap<(u32, u32), usize> = BTreeMap::new();
    for (_, seen) in points.iter() {
        for (index, one) in seen.iter().enumerate() {
            for other in &seen[index + 1..] {
                *shared.entry((one.photo, other.photo)).or_default() += 1;
            }
        }
    }
    let mut group: Vec<usize> = (0..photos).collect();
    for ((one, other), count) in shared {
        if count >= LEAST_SHARED {
            let (one, other) = (root(&mut group, one as usize), root(&mut group, other as usize));
            group[one] = other;
        }
    }
    let roots: Vec<usize> = (0..photos).map(|photo| root(&mut group, photo)).collect();
    let mut sizes: BTreeMap<usize, usize> = BTreeMap::new();
    for &root in &roots {
        *sizes.entry(root).or_default() += 1;
    }
    let largest = sizes.iter().max_by_key(|(_, size)| **size).filter(|(_, size)| **size > 1).map(|(root, _)| *root);
    roots.into_iter().map(|root| Some(root) == largest).collect()
}

/// Representative of a photo's group (union-find with halving).
fn root(group: &mut [usize], mut photo: usize) -> usize {
    while group[photo] != photo {
        group[photo] = group[group[photo]];
        photo = group[photo];
    }
    photo
}

#[cfg(test)]
mod tests {
    use nalgebra::Point3;

    use super::*;
    use crate::adjust::Observation;

    fn add(points: &mut Tracks, photos: [u32; 2], times: usize) {
        for _ in 0..times {
            points.push(Point3::origin(), photos.map(|photo| Observation { photo, pixel: [0.0; 2] }));
        }
    }

    #[test]
    fn the_largest_chain_of_well_joined_photos_is_registered() {
        let mut points = Tracks::default();
        add(&mut points, [0, 1], 20);
        add(&mut points, [1, 2], 20);
        add(&mut points, [3, 4], 20);
        add(&mut points, [2, 3], LEAST_SHARED - 1);
        assert_eq!(registered(&points, 6), [true, true, true, false, false, false]);
    }

    #[test]
    fn photos_without_shared_points_are_not_registered() {
        assert_eq!(registered(&Tracks::default(), 3), [false; 3]);
    }
}
