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
        let x_m = lattice.x_m(row as i64);
        for (count, line) in counts.iter_mut().zip(&lines) {
            *count = line.as_ref().map_or(0, |line| flown.views(line, x_m));
        }
    });
    let stretch = [0.0, length_m];
    Prediction { coverage: measure(&counts, &lattice, profile, stretch), picture: picture(&counts, &lattice, stretch) }
}

/// A flight along the axis.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Flown {
    pub(crate) step_m: f64,
    /// `None`: endless.
    pub(crate) photos: Option<u32>,
    pub(crate) lever_forward_m: f64,
}

impl Flown {
    /// How many of its photos show the wall line's place at `x_m`: by the footprints' formula, as the board's bound has it.
    /// Where the photos really were, `live::strip` counts by projection; the two are held against each other there.
    pub(crate) fn views(self, line: &WallLine<f64>, x_m: f64) -> u16 {
        let x_m = x_m - self.lever_forward_m;
        let views = match self.photos {
            Some(photos) => line.views_at_within(self.step_m, x_m, photos),
            None => line.views_at(self.step_m, x_m),
        };
        u16::try_from(views).unwrap_or(u16::MAX)
    }
}

/// On the axis.
pub(super) fn axis() -> SectionVector<f64> {
    SectionVector::zeros()
}
