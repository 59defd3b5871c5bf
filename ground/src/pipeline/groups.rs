//! Which photos hang together.

use std::collections::BTreeMap;

use adit_geometry::camera::Camera;
use nalgebra::{Isometry3, Point3, Vector2};

use crate::adjust::{Observation, Tracks};

/// Two photos hang together from this many shared points on.
const LEAST_SHARED: usize = 15;

/// Tells for each photo whether it belongs to the largest group of photos that hang together; nobody does alone.
pub(crate) fn registered(tracks: &Tracks, photos: usize) -> Vec<bool> {
    let mut shared: BTreeMap<[usize; 2], usize> = BTreeMap::new();
    for (_, seen) in tracks.iter() {
        for (index, one) in seen.iter().enumerate() {
            for other in &seen[index + 1..] {
                *shared.entry([one.photo as usize, other.photo as usize]).or_default() += 1;
            }
        }
    }
    let joined = shared.into_iter().filter(|(_, count)| *count >= LEAST_SHARED).map(|(photos, _)| photos);
    hanging_together(joined, photos)
}

/// Tells for each photo whether it belongs to the largest group that `joined` pairs hold together; nobody does alone.
pub(super) fn hanging_together(joined: impl IntoIterator<Item = [usize; 2]>, photos: usize) -> Vec<bool> {
    let mut groups = Groups::new(photos);
    for pair in joined {
        groups.join(pair);
    }
    let roots: Vec<usize> = (0..photos).map(|photo| groups.root(photo)).collect();
    let mut sizes: BTreeMap<usize, usize> = BTreeMap::new();
    for &root in &roots {
        *sizes.entry(root).or_default() += 1;
    }
    let largest = sizes.iter().max_by_key(|(_, size)| **size).filter(|(_, size)| **size > 1).map(|(root, _)| *root);
    roots.into_iter().map(|root| Some(root) == largest).collect()
}

/// Photos, or other things with a number, in groups (union-find with halving).
pub(crate) struct Groups(Vec<usize>);

impl Groups {
    /// Every photo alone.
    pub(crate) fn new(photos: usize) -> Self {
        Self((0..photos).collect())
    }

    /// Joins the groups of two photos; false if they are one already.
    pub(crate) fn join(&mut self, photos: [usize; 2]) -> bool {
        let [one, other] = photos.map(|photo| self.root(photo));
        self.0[one] = other;
        one != other
    }

    /// Representative of a photo's group.
    pub(crate) fn root(&mut self, mut photo: usize) -> usize {
        while self.0[photo] != photo {
            self.0[photo] = self.0[self.0[photo]];
            photo = self.0[photo];
        }
        photo
    }
}

/// What an adjustment makes of a pair's matches.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct PairShare {
    /// Matches.
    pub(super) all: usize,
    /// Of these, with an error beyond the limit in one of both photos.
    pub(super) disputed: usize,
}

impl PairShare {
    /// Half of the matches or more: the mark of a photo that slipped by a brick.
    pub(super) fn is_disputed(self) -> bool {
        2 * self.disputed >= self.all
    }
}

/// Counts, for every pair of a reference photo (a track's first observation) and a photo that found its point, the matches
/// whose error is beyond `limit_px`.
pub(super) fn pair_shares(
    tracks: &Tracks,
    poses: &[Isometry3<f64>],
    camera: &Camera<f64>,
    limit_px: f64,
) -> BTreeMap<[u32; 2], PairShare> {
    let is_off = |position: &Point3<f64>, seen: &Observation| {
        let in_cam = poses[seen.photo as usize].inverse_transform_point(position).coords;
        let error = |pixel: Vector2<f64>| (pixel - Vector2::from(seen.pixel.map(f64::from))).norm();
        camera.project(&in_cam).is_none_or(|pixel| error(pixel) > limit_px)
    };
    let mut shares: BTreeMap<[u32; 2], PairShare> = BTreeMap::new();
    for (position, seen) in tracks.iter() {
        let Some((reference, others)) = seen.split_first() else { continue };
        let reference_is_off = is_off(position, reference);
        for other in others {
            let photos = [reference.photo.min(other.photo), reference.photo.max(other.photo)];
            let share = shares.entry(photos).or_default();
            share.all += 1;
            share.disputed += usize::from(reference_is_off || is_off(position, other));
        }
    }
    shares
}

#[cfg(test)]
mod tests {
    use super::*;

    fn seen_by(tracks: &mut Tracks, photos: &[u32], times: usize) {
        for _ in 0..times {
            let seen = photos.iter().map(|&photo| Observation { photo, pixel: [0.0; 2] });
            tracks.push(Point3::origin(), seen);
        }
    }

    #[test]
    fn the_largest_chain_of_well_joined_photos_is_registered() {
        let mut tracks = Tracks::default();
        seen_by(&mut tracks, &[0, 1], 20);
        seen_by(&mut tracks, &[1, 2], 20);
        seen_by(&mut tracks, &[3, 4], 20);
        seen_by(&mut tracks, &[2, 3], LEAST_SHARED - 1);
        assert_eq!(registered(&tracks, 6), [true, true, true, false, false, false]);
    }

    #[test]
    fn photos_without_shared_points_are_not_registered() {
        assert_eq!(registered(&Tracks::default(), 3), [false; 3]);
    }
}
