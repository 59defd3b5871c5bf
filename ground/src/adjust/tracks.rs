//! Points and their images, in flat arrays: a point costs 28 bytes, an image 12.

use nalgebra::Point3;
use serde::{Deserialize, Serialize};

/// One image of a point.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Observation {
    /// Index of the photo.
    pub photo: u32,
    /// Pixel `[x, y]`, (0.5, 0.5) = centre of the first pixel. Single precision: half a unit in the last place is 0.0002 px
    /// at 4,000 px, a hundredth of the best match.
    pub pixel: [f32; 2],
}

/// Points and the photos that saw them.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Tracks {
    positions: Vec<Point3<f64>>,
    /// Where the images of each point end.
    ends: Vec<u32>,
    observations: Vec<Observation>,
}

impl Tracks {
    /// Adds a point at `position` (tunnel frame, metres) and its images, each photo at most once.
    pub fn push(&mut self, position: Point3<f64>, observations: impl IntoIterator<Item = Observation>) {
        self.positions.push(position);
        self.observations.extend(observations);
        self.ends.push(self.observations.len() as u32);
    }

    /// Adds all points of `other` behind these.
    pub fn append(&mut self, other: &Self) {
        let before = self.observations.len() as u32;
        self.positions.extend_from_slice(&other.positions);
        self.observations.extend_from_slice(&other.observations);
        self.ends.extend(other.ends.iter().map(|end| before + end));
    }

    /// Makes room for `factor` times as many points and images as there are, so that a long survey does not hold them twice
    /// while they grow.
    pub(crate) fn reserve_times(&mut self, factor: f64) {
        let more = |len: usize| ((factor * len as f64) as usize).saturating_sub(len);
        self.positions.reserve_exact(more(self.positions.len()));
        self.ends.reserve_exact(more(self.ends.len()));
        self.observations.reserve_exact(more(self.observations.len()));
    }

    /// Number of points.
    pub fn len(&self) -> usize {
        self.positions.len()
    }

    /// Whether there is no point.
    pub fn is_empty(&self) -> bool {
        self.positions.is_empty()
    }

    /// Positions of the points.
    pub fn positions(&self) -> &[Point3<f64>] {
        &self.positions
    }

    /// Moves the points.
    pub fn positions_mut(&mut self) -> &mut [Point3<f64>] {
        &mut self.positions
    }

    /// All images, in the order of the points.
    pub fn observations(&self) -> &[Observation] {
        &self.observations
    }

    /// The images of a point.
    pub fn of(&self, point: usize) -> &[Observation] {
        let start = if point == 0 { 0 } else { self.ends[point - 1] };
        &self.observations[start as usize..self.ends[point] as usize]
    }

    /// Points with their images.
    pub fn iter(&self) -> impl ExactSizeIterator<Item = (&Point3<f64>, &[Observation])> {
        self.positions.iter().enumerate().map(|(point, position)| (position, self.of(point)))
    }

    /// Keeps the points that `keep` accepts, with what it leaves of their images.
    pub fn retain(&mut self, mut keep: impl FnMut(&Point3<f64>, &mut Vec<Observation>) -> bool) {
        let mut images = Vec::new();
        let (mut points, mut kept, mut start) = (0, 0, 0);
        for index in 0..self.positions.len() {
            let (position, end) = (self.positions[index], self.ends[index] as usize);
            images.clear();
            images.extend_from_slice(&self.observations[start..end]);
            start = end;
            if keep(&position, &mut images) {
                images.truncate(end - kept);
                self.observations[kept..kept + images.len()].copy_from_slice(&images);
                kept += images.len();
                self.positions[points] = position;
                self.ends[points] = kept as u32;
                points += 1;
            }
        }
        self.positions.truncate(points);
        self.ends.truncate(points);
        self.observations.truncate(kept);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn seen(photo: u32) -> Observation {
        Observation { photo, pixel: [photo as f32, 0.5] }
    }

    #[test]
    fn retaining_drops_images_and_points_and_keeps_the_order() {
        let mut tracks = Tracks::default();
        tracks.push(Point3::new(0.0, 0.0, 0.0), [seen(0), seen(1), seen(2)]);
        tracks.push(Point3::new(1.0, 0.0, 0.0), [seen(1), seen(2)]);
        tracks.push(Point3::new(2.0, 0.0, 0.0), [seen(3), seen(2), seen(4)]);
        tracks.retain(|_, seen| {
            seen.retain(|seen| seen.photo != 1);
            seen.len() >= 2
        });
        let left: Vec<(f64, Vec<u32>)> =
            tracks.iter().map(|(at, seen)| (at.x, seen.iter().map(|seen| seen.photo).collect())).collect();
        assert_eq!(left, [(0.0, vec![0, 2]), (2.0, vec![3, 2, 4])]);
    }
}
