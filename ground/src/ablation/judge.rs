//! What the variants are judged by.

use anyhow::{Context, Result};
use nalgebra::Point3;

use crate::adjust::Tracks;
use crate::evaluate::{PoseEvaluation, compare_poses};
use crate::poses::{PhotoPose, read_poses};
use crate::survey::Survey;

/// Edge of a cell of the wall that is held out as a whole, metres: well above what two runs of the matching, whose points
/// differ by millimetres, place differently.
const CELL_M: f64 = 0.1;
/// One cell in so many is held out.
const CELLS: i64 = 10;

/// True poses and held-out points, the same for all variants.
pub(super) struct Judge {
    truth: Option<Vec<PhotoPose>>,
    pub(super) held_out: Tracks,
}

impl Judge {
    pub(super) fn new(survey: &Survey, held_out: Tracks) -> Result<Self> {
        let path = survey.folder.join("truth/poses.csv");
        let truth = path.is_file().then(|| read_poses(&path)).transpose().context("true poses")?;
        Ok(Self { truth, held_out })
    }

    pub(super) fn against_truth(&self, poses: &[PhotoPose]) -> Option<PoseEvaluation> {
        Some(compare_poses(poses, self.truth.as_deref()?))
    }
}

/// The points in the cells that are held out, or those in all others.
pub(super) fn hold_out(tracks: &Tracks, held_out: bool) -> Tracks {
    let mut chosen = tracks.clone();
    chosen.retain(|position, _| is_held_out(position) == held_out);
    chosen
}

/// Every tenth cell along any of the axes, so that cells are spread evenly over a wall of any direction.
fn is_held_out(position: &Point3<f64>) -> bool {
    let [x, y, z] = [position.x, position.y, position.z].map(|at_m| (at_m / CELL_M).floor() as i64);
    (x + 3 * y + 7 * z).rem_euclid(CELLS) == 0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_tenth_of_any_wall_is_held_out_and_the_rest_is_not() {
        for wall in [|s: f64| [1.0, s], |s: f64| [s, -2.0], |s: f64| [3.0 * s.sin(), 3.0 * s.cos()]] {
            let mut tracks = Tracks::default();
            for i in 0..200 {
                for j in 0..200 {
                    let [y, z] = wall(f64::from(j) * 0.0301);
                    tracks.push(Point3::new(f64::from(i) * 0.0302 - 2.0, y, z), []);
                }
            }
            let (out, rest) = (hold_out(&tracks, true), hold_out(&tracks, false));
            assert_eq!(out.len() + rest.len(), 40_000);
            assert!((3_600..4_400).contains(&out.len()), "{}", out.len());
        }
    }
}
