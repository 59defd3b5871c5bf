//! What is left to see of the seams, measured on the mid lattice.
//!
//! Between neighbouring cells p and q that take the photos A and B, a plain cut shows, beside what the wall itself does from p
//! to q, the step `((B(p) - A(p)) + (B(q) - A(q))) / 2`: the mean difference of the two photos there. The blend M shows
//! `M(q) - M(p) - ((A(q) - A(p)) + (B(q) - B(p))) / 2`, which is the same where M is a plain cut. Steps are averaged, with their
//! sign, along the seam between the same two photos within a coarse cell (about 5 cm): the photos' noise is no step.

use std::collections::BTreeMap;
use std::ops::Range;

use serde::{Deserialize, Serialize};

use super::blend::Composite;
use super::grid::MID_PER_COARSE;
use super::layer::{Layer, Rgbx};
use super::seams::{Labelling, NO_PHOTO};

/// The seams of a panorama.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Seams {
    /// Length of all seams on the wall.
    pub length_m: f64,
    /// Mean size of the step across seams, in grey levels (0 to 255, mean over red, green and blue), of the photos as they are.
    pub step_before: f64,
    /// After exposure, white balance and vignetting are evened out.
    pub step_evened: f64,
    /// After blending: what is in the panorama.
    pub step_blended: f64,
    /// Contrast between neighbouring cells across seams, over that of the photos there: 1 where blending blurs nothing.
    pub contrast_kept: f64,
}

/// Sums over all edges between cells that take different photos; strips add to them.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct SeamSums {
    edges: u64,
    /// Sizes of steps: before, evened, blended.
    steps: [f64; 3],
    /// Of the blend, of the photos.
    contrasts: [f64; 2],
}

/// Signed steps (before, evened, blended; red, green, blue) along the seam between two photos within a coarse cell.
#[derive(Clone, Copy, Default)]
struct Stretch {
    edges: u64,
    steps: [[f64; 3]; 3],
}

/// What is measured: a band's photos, which of them is taken where, and their blend.
pub(super) struct SeamView<'a> {
    /// By their numbers, which grow.
    pub(super) layers: &'a [(u32, &'a Layer)],
    pub(super) labelling: &'a Labelling,
    pub(super) composite: &'a Composite,
}

impl SeamView<'_> {
    /// Measures the seams in some mid rows (and from the last of them to the next). `unevened`: the colour that a photo itself
    /// has at a mid cell (row, column) of which the evened colour is given.
    pub(super) fn measure(&self, rows: Range<usize>, unevened: impl Fn(u32, (usize, usize), Rgbx) -> Rgbx) -> SeamSums {
        let mut sums = SeamSums::default();
        let columns = self.labelling.band.mid_columns();
        let mut stretches: BTreeMap<(usize, u32, u32), Stretch> = BTreeMap::new();
        for row in rows {
            for column in 0..columns {
                for q in [(row, (column + 1) % columns), (row + 1, column)] {
                    let p = (row, column);
                    let (Some(a), Some(b)) = (self.photo(p), self.photo(q)) else { continue };
                    if a == b {
                        continue;
                    }
                    // The same direction across the seam, whichever side comes first.
                    let (near, far, a, b) = if a < b { (p, q, a, b) } else { (q, p, b, a) };
                    let Some([a_near, a_far, b_near, b_far]) = self.colours([(a, near), (a, far), (b, near), (b, far)])
                    else {
                        continue;
                    };
                    let (Some(m_near), Some(m_far)) = (self.blended(near), self.blended(far)) else { continue };
                    let raw = [(a, near, a_near), (a, far, a_far), (b, near, b_near), (b, far, b_far)]
                        .map(|(photo, cell, colour)| unevened(photo, cell, colour));
                    let coarse = row / MID_PER_COARSE * columns + column / MID_PER_COARSE;
                    let stretch = stretches.entry((coarse, a, b)).or_default();
                    stretch.edges += 1;
                    for i in 0..3 {
                        let [before, evened] = [raw, [a_near, a_far, b_near, b_far]]
                            .map(|[an, af, bn, bf]| 0.5 * (bn[i] - an[i] + bf[i] - af[i]));
                        let wall = 0.5 * (a_far[i] - a_near[i] + b_far[i] - b_near[i]);
                        let blend = m_far[i] - m_near[i];
                        for (sum, step) in stretch.steps.iter_mut().zip([before, evened, blend - wall]) {
                            sum[i] += f64::from(step);
                        }
                        sums.contrasts[0] += f64::from(blend.abs());
                        sums.contrasts[1] +=
                            0.5 * f64::from((a_far[i] - a_near[i]).abs() + (b_far[i] - b_near[i]).abs());
                    }
                }
            }
        }
        for stretch in stretches.values() {
            sums.edges += stretch.edges;
            for (sum, step) in sums.steps.iter_mut().zip(stretch.steps) {
                // The mean's size times the number of edges is the sum's size.
                *sum += step.iter().map(|channel| channel.abs()).sum::<f64>() / 3.0;
            }
        }
        sums
    }

    fn cell(&self, (row, column): (usize, usize)) -> Option<usize> {
        let line = row.checked_sub(self.labelling.band.mid_row0())?;
        Some(line * self.labelling.band.mid_columns() + column)
    }

    fn photo(&self, cell: (usize, usize)) -> Option<u32> {
        self.labelling.photos.get(self.cell(cell)?).copied().filter(|photo| *photo != NO_PHOTO)
    }

    fn blended(&self, cell: (usize, usize)) -> Option<Rgbx> {
        self.composite.colour.get(self.cell(cell)?).copied().filter(|colour| colour[3] > 0.0)
    }

    /// Evened colours of photos at cells; `None` if one of them is not seen.
    fn colours(&self, sights: [(u32, (usize, usize)); 4]) -> Option<[Rgbx; 4]> {
        let colour = |(photo, (row, column)): (u32, (usize, usize))| {
            let at = self.layers.binary_search_by_key(&photo, |(photo, _)| *photo).ok()?;
            let layer = self.layers[at].1;
            let region = layer.region.finer();
            let across = (column as i64 - region.column0).rem_euclid(self.labelling.band.mid_columns() as i64) as usize;
            let down = row.checked_sub(region.row0)?;
            let cell = (across < region.columns && down < region.rows).then_some(down * region.columns + across)?;
            (layer.score[cell] > 0.0).then(|| layer.colour[cell])
        };
        let [a, b, c, d] = sights.map(colour);
        Some([a?, b?, c?, d?])
    }
}

impl SeamSums {
    pub(super) fn add(&mut self, other: &Self) {
        self.edges += other.edges;
        for (sum, more) in self.steps.iter_mut().zip(other.steps) {
            *sum += more;
        }
        for (sum, more) in self.contrasts.iter_mut().zip(other.contrasts) {
            *sum += more;
        }
    }

    pub(super) fn figures(&self, mid_m: f64) -> Seams {
        let mean = |sum: f64| sum / self.edges.max(1) as f64;
        let [step_before, step_evened, step_blended] = self.steps.map(mean);
        let contrast_kept = if self.contrasts[1] > 0.0 { self.contrasts[0] / self.contrasts[1] } else { 1.0 };
        Seams { length_m: self.edges as f64 * mid_m, step_before, step_evened, step_blended, contrast_kept }
    }
}

#[cfg(test)]
mod tests {
    use super::super::blend::{Band, blend};
    use super::super::grid::Region;
    use super::*;

    const BAND: Band = Band { columns: 20, row0: 0, rows: 6 };

    fn layer(column0: i64, level: f32) -> Layer {
        let region = Region { column0, columns: 12, row0: 0, rows: 6 };
        let cells = region.finer().len();
        Layer {
            region,
            colour: (0..cells).map(|at| [level + (at / 48 % 3) as f32; 4]).collect(),
            score: vec![1.0; cells],
            octaves: vec![0.0; cells],
            low: vec![[level; 4]; region.len()],
            low_weight: vec![1.0; region.len()],
        }
    }

    #[test]
    fn a_cut_between_two_photos_shows_their_difference() {
        let (left, right) = (layer(0, 100.0), layer(10, 107.0));
        let layers = [(0, &left), (1, &right)];
        let photos = (0..80 * 24).map(|at| u32::from((44..80).contains(&(at % 80)))).collect();
        let labelling = Labelling { band: BAND, photos };
        let (composite, _) = blend(&layers, BAND, &labelling.photos);
        let view = SeamView { layers: &layers, labelling: &labelling, composite: &composite };
        // As if the second photo had been brightened by 5.
        let found =
            view.measure(0..23, |photo, _, colour| colour.map(|level| level - 5.0 * photo as f32)).figures(0.01);
        // The seam before column 44; at the other one, before column 0, the photos do not overlap.
        assert!(found.length_m > 0.2, "{found:?}");
        assert!((found.step_evened - 7.0).abs() < 0.01 && (found.step_before - 2.0).abs() < 0.01, "{found:?}");
        assert!(found.step_blended < 1.0, "{found:?}");
    }
}
