//! The order of the unknowns, chosen so that the reduced matrix is narrow.

use std::collections::VecDeque;

use super::envelope::TILE;
use crate::adjust::tracks::Tracks;

/// Where every unknown stands: cameras in an order that keeps coupled ones together, then the shared unknowns.
#[derive(Clone, Debug)]
pub(in crate::adjust) struct Layout {
    per_camera: usize,
    /// Position of each camera in the order.
    positions: Vec<u32>,
    /// First coupled position of the camera at each position.
    first: Vec<u32>,
    shared: usize,
    /// Points in the order of the first camera that sees them.
    points: Vec<u32>,
}

impl Layout {
    /// Works out the order from which cameras see the same point, and `links` besides.
    ///
    /// Reverse Cuthill-McKee, from both ends of the camera graph in turn (George & Liu, 1981, section 4.3), or the cameras'
    /// own order where that is no wider.
    pub(in crate::adjust) fn new(
        tracks: &Tracks,
        per_camera: usize,
        cameras: usize,
        shared: usize,
        links: &[[u32; 2]],
    ) -> Self {
        let neighbours = neighbours(tracks, cameras, links);
        let own: Vec<u32> = (0..cameras as u32).collect();
        let reordered = reverse_cuthill_mckee(&neighbours);
        let (mut positions, mut first) = (own.clone(), first_coupled(&own, &neighbours));
        let other = first_coupled(&reordered, &neighbours);
        if stored(&other) < stored(&first) {
            (positions, first) = (reordered, other);
        }
        let seen_from = |point: u32| tracks.of(point as usize).iter().map(|seen| positions[seen.photo as usize]);
        let mut points: Vec<u32> = (0..tracks.len() as u32).collect();
        points.sort_by_cached_key(|&point| (seen_from(point).min(), seen_from(point).max()));
        Self { per_camera, positions, first, shared, points }
    }

    pub(super) fn cameras(&self) -> usize {
        self.positions.len()
    }

    pub(super) fn position(&self, camera: usize) -> usize {
        self.positions[camera] as usize
    }

    /// First unknown of a camera.
    pub(in crate::adjust) fn camera(&self, camera: usize) -> usize {
        self.position(camera) * self.per_camera
    }

    /// A shared unknown.
    pub(in crate::adjust) fn shared(&self, index: usize) -> usize {
        self.cameras() * self.per_camera + index
    }

    /// Points in the order in which they are visited.
    pub(super) fn points(&self) -> &[u32] {
        &self.points
    }

    /// Blocks of the reduced matrix: height and first coupled block.
    pub(super) fn shape(&self) -> impl Iterator<Item = (usize, usize)> {
        let cameras = self.first.iter().map(|&first| (self.per_camera, first as usize));
        cameras.chain((self.shared > 0).then(|| (padded(self.shared), 0)))
    }

    /// Rows that only fill the last tile.
    pub(super) fn padding(&self) -> std::ops::Range<usize> {
        self.shared(self.shared)..self.shared(padded(self.shared))
    }
}

/// Rows of a block that holds `unknowns`.
pub(super) fn padded(unknowns: usize) -> usize {
    unknowns.next_multiple_of(TILE)
}

/// Cameras that share a point or a link, without repetition.
fn neighbours(tracks: &Tracks, cameras: usize, links: &[[u32; 2]]) -> Vec<Vec<u32>> {
    let (points, starts) = points_by_camera(tracks, cameras);
    let mut neighbours: Vec<Vec<u32>> = vec![Vec::new(); cameras];
    for &[one, other] in links {
        neighbours[one as usize].push(other);
        neighbours[other as usize].push(one);
    }
    let mut met = vec![u32::MAX; cameras];
    for (camera, neighbours) in neighbours.iter_mut().enumerate() {
        met[camera] = camera as u32;
        neighbours.retain(|&other| std::mem::replace(&mut met[other as usize], camera as u32) != camera as u32);
        for &point in &points[starts[camera]..starts[camera + 1]] {
            for seen in tracks.of(point as usize) {
                if std::mem::replace(&mut met[seen.photo as usize], camera as u32) != camera as u32 {
                    neighbours.push(seen.photo);
                }
            }
        }
    }
    neighbours
}

/// The points that each camera sees, camera by camera, and where each camera's begin.
fn points_by_camera(tracks: &Tracks, cameras: usize) -> (Vec<u32>, Vec<usize>) {
    let mut starts = vec![0; cameras + 1];
    for seen in tracks.observations() {
        starts[seen.photo as usize + 1] += 1;
    }
    for camera in 0..cameras {
        starts[camera + 1] += starts[camera];
    }
    let mut next = starts.clone();
    let mut points = vec![0; tracks.observations().len()];
    for point in 0..tracks.len() {
        for seen in tracks.of(point) {
            let place = &mut next[seen.photo as usize];
            points[*place] = point as u32;
            *place += 1;
        }
    }
    (points, starts)
}

/// Position of every camera, groups that hang together one after the other.
fn reverse_cuthill_mckee(neighbours: &[Vec<u32>]) -> Vec<u32> {
    let mut order: Vec<u32> = Vec::with_capacity(neighbours.len());
    let mut placed = vec![false; neighbours.len()];
    for start in 0..neighbours.len() {
        if placed[start] {
            continue;
        }
        // A camera at an end of the group: the last that a search from anywhere reaches, twice.
        let mut end = start as u32;
        for _ in 0..2 {
            end = breadth_first(neighbours, end, &mut vec![false; neighbours.len()]).last().copied().unwrap_or(end);
        }
        order.extend(breadth_first(neighbours, end, &mut placed));
    }
    let mut positions = vec![0; order.len()];
    for (position, &camera) in order.iter().rev().enumerate() {
        positions[camera as usize] = position as u32;
    }
    positions
}

/// Cameras by breadth-first search, those with fewest neighbours first.
fn breadth_first(neighbours: &[Vec<u32>], start: u32, placed: &mut [bool]) -> Vec<u32> {
    let mut order = Vec::new();
    let mut queue = VecDeque::from([start]);
    placed[start as usize] = true;
    while let Some(camera) = queue.pop_front() {
        order.push(camera);
        let mut next: Vec<u32> =
            neighbours[camera as usize].iter().copied().filter(|&other| !placed[other as usize]).collect();
        next.sort_unstable_by_key(|&other| (neighbours[other as usize].len(), other));
        for &other in &next {
            placed[other as usize] = true;
        }
        queue.extend(next);
    }
    order
}

/// First position coupled with each position.
fn first_coupled(positions: &[u32], neighbours: &[Vec<u32>]) -> Vec<u32> {
    let mut first: Vec<u32> = (0..positions.len() as u32).collect();
    for (camera, neighbours) in neighbours.iter().enumerate() {
        let position = positions[camera];
        let earliest = neighbours.iter().map(|&other| positions[other as usize]).min().unwrap_or(position);
        first[position as usize] = earliest.min(position);
    }
    first
}

/// Number of blocks stored.
fn stored(first: &[u32]) -> usize {
    first.iter().enumerate().map(|(position, &first)| position + 1 - first as usize).sum()
}

#[cfg(test)]
mod tests {
    use nalgebra::Point3;

    use super::*;
    use crate::adjust::tracks::Observation;

    /// Points that two cameras see each.
    fn pairs(pairs: &[[u32; 2]]) -> Tracks {
        let mut tracks = Tracks::default();
        for pair in pairs {
            tracks.push(Point3::origin(), pair.map(|photo| Observation { photo, pixel: [0.0; 2] }));
        }
        tracks
    }

    #[test]
    fn a_way_out_and_back_stays_narrow() {
        // Camera 99 - i stands where camera i stood.
        let mut seen: Vec<[u32; 2]> = (0..99).map(|camera| [camera, camera + 1]).collect();
        seen.extend((0..50).map(|camera| [camera, 99 - camera]));
        let layout = Layout::new(&pairs(&seen), 6, 100, 0, &[]);
        let widest = layout.shape().enumerate().map(|(position, (_, first))| position - first).max().unwrap();
        assert!(widest <= 4, "{widest}");
    }

    #[test]
    fn every_camera_has_its_own_position_and_couplings_lie_in_the_envelope() {
        let seen = [[0, 5], [5, 2], [7, 7], [3, 1], [1, 6]];
        let layout = Layout::new(&pairs(&seen), 6, 8, 2, &[[2, 3]]);
        let mut positions: Vec<usize> = (0..8).map(|camera| layout.position(camera)).collect();
        let first: Vec<usize> = layout.shape().map(|(_, first)| first).collect();
        for [one, other] in seen.into_iter().chain([[2, 3]]) {
            let (one, other) = (layout.position(one as usize), layout.position(other as usize));
            assert!(first[one.max(other)] <= one.min(other));
        }
        positions.sort_unstable();
        assert_eq!(positions, (0..8).collect::<Vec<_>>());
        assert_eq!(layout.padding(), 50..51);
    }
}
