//! How often the planned flight's images will show each place of the wall.

use adit_geometry::SectionVector;
use adit_geometry::coverage::{Scene, WallLine};
use adit_geometry::profile::Profile;
use rayon::prelude::*;

use crate::texture::{Coverage, Lattice, Rgba8, measure, picture};

/// Side of the cells that are counted.
const CELL_M: f64 = 0.02;
/// Longest flight that is counted cell by cell. A longer one repeats its middle.
const LONGEST_M: f64 = 30.0;

/// Predicted number of photos per wall cell.
pub(super) struct Prediction {
    pub(super) coverage: Coverage,
    pub(super) picture: Rgba8,
}

/// The stretch of a flight of `length_m` that is counted cell by cell.
pub(super) fn counted_m(length_m: f64) -> f64 {
    length_m.min(LONGEST_M)
}

/// Counts the photos that see each cell of the first `length_m`: of an endless flight, or of `photos` from x = 0 on.
///
/// `lever_forward_m`: the optical centre ahead of the body origin.
pub(super) fn coverage(profile: &Profile<f64>, scene: &Scene<'_, f64>, flown: Flown, length_m: f64) -> Prediction {
    // The lattice takes a quarter of its cells' side.
    let lattice = Lattice::coarse(profile.perimeter_m(), CELL_M / 4.0, 0.0, length_m);
    let lines: Vec<Option<WallLine<f64>>> =
        (0..lattice.columns).map(|column| scene.wall_line(lattice.s_m(column as i64))).collect();
    let mut counts = vec![0_u16; lattice.columns * lattice.rows];
    counts.par_chunks_exact_mut(lattice.columns).enumerate().for_each(|(row, counts)| {
        let x_m = lattice.x_m(row as i64) - flown.lever_forward_m;
        for (count, line) in counts.iter_mut().zip(&lines) {
            let views = line.as_ref().map_or(0, |line| match flown.photos {
                Some(photos) => line.views_at_within(flown.step_m, x_m, photos),
                None => line.views_at(flown.step_m, x_m),
            });
            *count = u16::try_from(views).unwrap_or(u16::MAX);
        }
    });
    let stretch = [0.0, length_m];
    Prediction { coverage: measure(&counts, &lattice, profile, stretch), picture: picture(&counts, &lattice, stretch) }
}

/// A flight along the axis.
#[derive(Clone, Copy, Debug)]
pub(super) struct Flown {
    pub(super) step_m: f64,
    /// `None`: endless.
    pub(super) photos: Option<u32>,
    pub(super) lever_forward_m: f64,
}

/// On the axis.
pub(super) fn axis() -> SectionVector<f64> {
    SectionVector::zeros()
}
