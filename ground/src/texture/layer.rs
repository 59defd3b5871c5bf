//! One photo laid on the wall, at the two resolutions on which photos are blended.

use super::grid::{Lattice, MID_PER_COARSE, Region};
use super::sample::Mips;
use super::seams::SEAM_SHARE;
use super::tone::ToneCurve;
use super::usable::Usable;
use super::view::{Footprint, Sight, View};
use crate::surface::SurfaceWindow;

/// A photo takes no part where its quality is below this share of the best photo's.
const USEFUL_SHARE: f32 = 0.5;

/// How far (in mid cells) colours are carried beyond what the photo shows, so that interpolation finds neighbours.
const BLEED_CELLS: usize = 2;

/// Colours as red, green, blue and something else.
pub(super) type Rgbx = [f32; 4];

/// The fine band needs of a photo only what is near cells where its quality is this share of the best photo's: less than
/// [`SEAM_SHARE`], because quality changes within a coarse cell.
const CROP_SHARE: f32 = SEAM_SHARE - 0.1;

/// By how many coarse cells the needed part reaches beyond their centres.
const CROP_REACH_CELLS: f32 = 2.0;

/// The quality of the best photo, per cell of the coarse lattice.
pub(super) struct BestScores<'a> {
    pub(super) lattice: &'a Lattice,
    pub(super) scores: &'a [f32],
}

/// A photo's box of the mid lattice and of the coarse one.
pub(super) struct Layer {
    /// In cells of the coarse lattice.
    pub(super) region: Region,
    /// Colour at the common exposure, per mid cell.
    pub(super) colour: Vec<Rgbx>,
    /// Quality per mid cell; 0 = not usable.
    pub(super) score: Vec<f32>,
    /// Base-2 logarithm of a texel's size in photo pixels, per mid cell.
    pub(super) octaves: Vec<f32>,
    /// Colour averaged over a coarse cell and its surroundings.
    pub(super) low: Vec<Rgbx>,
    /// Weight of `low` when photos are blended.
    pub(super) low_weight: Vec<f32>,
}

/// What [`Layer::new`] needs to know of a photo.
pub(super) struct LayerSource<'a> {
    pub(super) view: &'a View,
    pub(super) usable: &'a Usable,
    pub(super) mips: &'a Mips,
    pub(super) curve: &'a ToneCurve,
}

/// Where on the coarse lattice a photo is among the good ones.
pub(super) struct Useful {
    pub(super) region: Region,
    /// Weight in the low band, per cell of the region.
    pub(super) weights: Vec<f32>,
    /// First and last column and row of the photo that the fine band may need.
    pub(super) crop_px: [[f32; 2]; 2],
}

impl Layer {
    /// Lays the photo on the wall where it is useful.
    pub(super) fn new(
        source: &LayerSource,
        useful: &Useful,
        surface: &SurfaceWindow,
        coarse: &Lattice,
        texel_m: f64,
    ) -> Self {
        let region = useful.region;
        let mid = coarse.finer();
        let mid_region = region.finer();
        let sights = source.view.sights(surface, source.usable, &mid, &mid_region);
        let mid_m = mid.step_s_m as f32;
        let mut colour: Vec<Rgbx> =
            sights.iter().map(|sight| if sight.score > 0.0 { shade(source, sight, mid_m) } else { [0.0; 4] }).collect();
        let seen: Vec<bool> = sights.iter().map(|sight| sight.score > 0.0).collect();
        let low = low_pass(&colour, &seen, &region);
        bleed(&mut colour, seen, mid_region.columns, BLEED_CELLS);
        let texel_m = texel_m as f32;
        Self {
            region,
            colour,
            score: sights.iter().map(|sight| sight.score).collect(),
            octaves: sights.iter().map(|sight| (texel_m * sight.mean_density_per_m).max(1e-3).log2()).collect(),
            low,
            low_weight: useful.weights.clone(),
        }
    }
}

/// A photo's corrected colour at a place, averaged over about `size_m` of wall.
pub(super) fn shade(source: &LayerSource, sight: &Sight, size_m: f32) -> Rgbx {
    let octaves = (size_m * sight.mean_density_per_m).max(1e-3).log2();
    let colour = source.mips.sample(sight.pixel[0], sight.pixel[1], octaves);
    source.curve.evened(colour, sight.pixel)
}

/// Finds the box of coarse cells where the photo is good enough, and its weight in the low band there; `None` if it is
/// nowhere.
pub(super) fn useful(
    view: &View,
    footprint: &Footprint,
    usable: &Usable,
    surface: &SurfaceWindow,
    best: &BestScores,
) -> Option<Useful> {
    let whole = footprint.region(best.lattice);
    let sights = view.sights(surface, usable, best.lattice, &whole);
    let share = |column: usize, row: usize| {
        let score = sights[row * whole.columns + column].score;
        let at = (whole.row0 + row) * best.lattice.columns + best.lattice.wrap(whole.column0 + column as i64);
        if score > 0.0 { score / best.scores[at].max(score) } else { 0.0 }
    };
    let mut crop_px = [[f32::INFINITY; 2], [f32::NEG_INFINITY; 2]];
    let (mut columns, mut rows) = (whole.columns..0, whole.rows..0);
    for row in 0..whole.rows {
        for column in 0..whole.columns {
            if share(column, row) >= USEFUL_SHARE {
                columns = columns.start.min(column)..columns.end.max(column + 1);
                rows = rows.start.min(row)..rows.end.max(row + 1);
            }
            if share(column, row) >= CROP_SHARE {
                let sight = &sights[row * whole.columns + column];
                let most_per_m = sight.mean_density_per_m.powi(2) / sight.density_per_m;
                let reach_px = CROP_REACH_CELLS * best.lattice.step_s_m as f32 * most_per_m;
                for (axis, at_px) in sight.pixel.into_iter().enumerate() {
                    crop_px[0][axis] = crop_px[0][axis].min(at_px - reach_px);
                    crop_px[1][axis] = crop_px[1][axis].max(at_px + reach_px);
                }
            }
        }
    }
    if columns.is_empty() {
        return None;
    }
    // One cell more on each side: weights are zero there, which ends interpolation smoothly.
    let columns = columns.start.saturating_sub(1)..(columns.end + 1).min(whole.columns);
    let rows = rows.start.saturating_sub(1)..(rows.end + 1).min(whole.rows);
    let region = Region {
        column0: whole.column0 + columns.start as i64,
        columns: columns.len(),
        row0: whole.row0 + rows.start,
        rows: rows.len(),
    };
    let weights = rows
        .flat_map(|row| columns.clone().map(move |column| (column, row)))
        .map(|(column, row)| ((share(column, row) - USEFUL_SHARE) / (1.0 - USEFUL_SHARE)).max(0.0).powi(2))
        .collect();
    Some(Useful { region, weights, crop_px })
}

/// Averages mid cells into coarse ones with a tent two coarse cells wide.
fn low_pass(colour: &[Rgbx], seen: &[bool], region: &Region) -> Vec<Rgbx> {
    const TENT: [f32; 2 * MID_PER_COARSE] = [1.0, 3.0, 5.0, 7.0, 7.0, 5.0, 3.0, 1.0];
    let mid = region.finer();
    let mut low = Vec::with_capacity(region.len());
    let mut known = Vec::with_capacity(region.len());
    let window = |cell: usize, end: usize| {
        let first = (cell * MID_PER_COARSE) as i64 - MID_PER_COARSE as i64 / 2;
        TENT.iter().enumerate().filter_map(move |(tap, weight)| {
            let at = first + tap as i64;
            (at >= 0 && at < end as i64).then_some((at as usize, *weight))
        })
    };
    for row in 0..region.rows {
        for column in 0..region.columns {
            let mut sum = [0.0; 4];
            let mut total = 0.0;
            for (line, weight_down) in window(row, mid.rows) {
                for (tap, weight_across) in window(column, mid.columns) {
                    let at = line * mid.columns + tap;
                    if seen[at] {
                        let weight = weight_down * weight_across;
                        total += weight;
                        for (sum, value) in sum.iter_mut().zip(colour[at]) {
                            *sum += weight * value;
                        }
                    }
                }
            }
            known.push(total > 0.0);
            low.push(if total > 0.0 { sum.map(|value| value / total) } else { sum });
        }
    }
    bleed(&mut low, known, region.columns, region.columns.max(region.rows));
    low
}

/// Fills unknown cells next to known ones with their mean, `rounds` times or until nothing is left.
pub(super) fn bleed(colour: &mut [Rgbx], mut known: Vec<bool>, columns: usize, rounds: usize) {
    let rows = colour.len() / columns;
    for _ in 0..rounds {
        let mut filled = Vec::new();
        for at in (0..colour.len()).filter(|&at| !known[at]) {
            let (column, row) = (at % columns, at / columns);
            let mut sum = [0.0; 4];
            let mut count = 0.0;
            for line in row.saturating_sub(1)..(row + 2).min(rows) {
                for tap in column.saturating_sub(1)..(column + 2).min(columns) {
                    if known[line * columns + tap] {
                        count += 1.0;
                        for (sum, value) in sum.iter_mut().zip(colour[line * columns + tap]) {
                            *sum += value;
                        }
                    }
                }
            }
            if count > 0.0 {
                filled.push((at, sum.map(|value| value / count)));
            }
        }
        if filled.is_empty() {
            break;
        }
        for (at, value) in filled {
            colour[at] = value;
            known[at] = true;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bleeding_carries_colours_outwards_cell_by_cell() {
        let mut colour = vec![[0.0; 4]; 25];
        let mut known = vec![false; 25];
        (colour[12], known[12]) = ([9.0; 4], true);
        bleed(&mut colour, known.clone(), 5, 1);
        assert_eq!((colour[6], colour[0]), ([9.0; 4], [0.0; 4]));
        bleed(&mut colour, known, 5, 9);
        assert_eq!(colour[0], [9.0; 4]);
    }

    #[test]
    fn the_low_pass_of_a_constant_is_the_constant_up_to_the_border() {
        let region = Region { column0: -1, columns: 4, row0: 0, rows: 3 };
        let cells = region.finer().len();
        let seen = (0..cells).map(|at| at % 3 != 0).collect::<Vec<_>>();
        let low = low_pass(&vec![[5.0; 4]; cells], &seen, &region);
        assert!(low.iter().all(|value| (value[0] - 5.0).abs() < 1e-5));
    }
}
