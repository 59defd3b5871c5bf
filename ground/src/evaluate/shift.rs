//! How far the panorama lies from the truth's texture, patch by patch.
//!
//! Patches of 1 m are compared by normalised cross-correlation of high-passed grey values, from coarse (1/8) to full
//! resolution, with a quadratic peak. Only pixels that both sides cover count, so holes and edges need no filling
//! (which is why this is not done in the frequency domain).

use nalgebra::{Matrix2, Vector2};
use rayon::prelude::*;
use serde::Serialize;

use super::poses::Spread;
use super::wall_image::WallImage;
use crate::adjust::median;

/// Edge of a patch.
const PATCH_M: f64 = 1.0;
/// Shifts up to this are found. One degree of roll, which nothing but the tags holds on a circle, is 52 mm at 3 m.
const SEARCH_M: f64 = 0.2;
/// Halvings before the first search.
const LEVELS: usize = 3;
/// A patch with a smaller covered share is left out.
const MIN_SHARE: f64 = 0.6;
/// A patch whose best correlation is lower has no match.
const MIN_CORRELATION: f64 = 0.4;
/// Places that are followed from the coarsest level; half as many at each finer one.
const CANDIDATES: usize = 16;
/// Half width of the high-pass window at each level.
const HIGH_PASS_PX: usize = 8;

/// Panorama against truth, in millimetres on the wall.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ShiftEvaluation {
    /// Patches that are covered well enough to be compared.
    pub patches: usize,
    /// Of these, patches that were found again.
    pub matched: usize,
    /// Length of the shifts as they are.
    pub absolute_mm: Spread,
    /// The common offset (medians): along the arc length and along the axis.
    pub common_s_mm: f64,
    /// See [`Self::common_s_mm`].
    pub common_x_mm: f64,
    /// Length of the shifts after the common offset is taken away.
    pub relative_mm: Spread,
}

/// Measures the panorama's shift against the truth. Positive means that the panorama shows a thing too far along.
pub(super) fn measure_shift(panorama: &WallImage, truth: &WallImage) -> ShiftEvaluation {
    let patch_px = (PATCH_M * 1000.0 / panorama.grid.mm_per_px).round().max(16.0) as usize;
    let origins: Vec<(usize, usize)> = (0..panorama.grid.height_px / patch_px)
        .flat_map(|row| (0..panorama.grid.width_px / patch_px).map(move |column| (column * patch_px, row * patch_px)))
        .collect();
    let found: Vec<Option<[f64; 2]>> = origins
        .par_iter()
        .filter_map(|&origin| Patch::cut(panorama, truth, origin, patch_px))
        .map(|patch| patch.find_shift().map(|shift_px| shift_px.map(|px| px * panorama.grid.mm_per_px)))
        .collect();
    let shifts: Vec<[f64; 2]> = found.iter().flatten().copied().collect();
    let common = [0, 1].map(|axis| median(&shifts.iter().map(|shift| shift[axis]).collect::<Vec<_>>()));
    let length = |shift: &[f64; 2], origin: [f64; 2]| (shift[0] - origin[0]).hypot(shift[1] - origin[1]);
    ShiftEvaluation {
        patches: found.len(),
        matched: shifts.len(),
        absolute_mm: Spread::of(shifts.iter().map(|shift| length(shift, [0.0; 2]))),
        common_s_mm: common[0],
        common_x_mm: common[1],
        relative_mm: Spread::of(shifts.iter().map(|shift| length(shift, common))),
    }
}

/// A square of samples with a weight of 0 or 1 each.
#[derive(Clone)]
struct Tile {
    edge_px: usize,
    value: Vec<f32>,
    weight: Vec<f32>,
}

impl Tile {
    fn from_fn(edge_px: usize, sample: impl Fn(usize, usize) -> Option<f32>) -> Self {
        let samples = (0..edge_px * edge_px).map(|i| sample(i % edge_px, i / edge_px));
        let (value, weight) = samples.map(|sample| sample.map_or((0.0, 0.0), |v| (v, 1.0))).unzip();
        Self { edge_px, value, weight }
    }

    fn share(&self) -> f64 {
        self.weight.iter().map(|&w| f64::from(w)).sum::<f64>() / self.weight.len().max(1) as f64
    }

    /// Means of 2 x 2 pixels; a mean counts where at least two of the four do.
    fn halved(&self) -> Self {
        let edge_px = self.edge_px / 2;
        Self::from_fn(edge_px, |column, row| {
            let (mut sum, mut weights) = (0.0, 0.0);
            for (dx, dy) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
                let i = (2 * row + dy) * self.edge_px + 2 * column + dx;
                sum += self.value[i] * self.weight[i];
                weights += self.weight[i];
            }
            (weights >= 2.0).then(|| sum / weights)
        })
    }

    /// Takes away the mean of the covered pixels around each pixel, so that lamp and exposure do not count.
    fn high_passed(&self) -> Self {
        let edge = self.edge_px;
        let mut sums = vec![(0.0_f64, 0.0_f64); (edge + 1) * (edge + 1)];
        for row in 0..edge {
            let mut line = (0.0, 0.0);
            for column in 0..edge {
                let i = row * edge + column;
                line.0 += f64::from(self.value[i] * self.weight[i]);
                line.1 += f64::from(self.weight[i]);
                let above = sums[row * (edge + 1) + column + 1];
                sums[(row + 1) * (edge + 1) + column + 1] = (above.0 + line.0, above.1 + line.1);
            }
        }
        let mut out = self.clone();
        for row in 0..edge {
            let rows = (row.saturating_sub(HIGH_PASS_PX), (row + HIGH_PASS_PX + 1).min(edge));
            for column in 0..edge {
                let columns = (column.saturating_sub(HIGH_PASS_PX), (column + HIGH_PASS_PX + 1).min(edge));
                let corner = |r: usize, c: usize| sums[r * (edge + 1) + c];
                let (a, b) = (corner(rows.1, columns.1), corner(rows.0, columns.0));
                let (c, d) = (corner(rows.0, columns.1), corner(rows.1, columns.0));
                let weight = a.1 + b.1 - c.1 - d.1;
                let i = row * edge + column;
                if self.weight[i] > 0.0 && weight > 0.0 {
                    out.value[i] -= ((a.0 + b.0 - c.0 - d.0) / weight) as f32;
                }
            }
        }
        out
    }

    fn pyramid(self) -> Vec<Self> {
        let mut levels = vec![self];
        for level in 0..LEVELS {
            levels.push(levels[level].halved());
        }
        levels.iter().map(Self::high_passed).collect()
    }
}

/// A patch of the panorama and the truth around it, as pyramids.
pub(crate) struct Patch {
    panorama: Vec<Tile>,
    truth: Vec<Tile>,
    margin_px: usize,
}

impl Patch {
    /// `None` if too little of it is covered.
    fn cut(panorama: &WallImage, truth: &WallImage, origin: (usize, usize), patch_px: usize) -> Option<Self> {
        let metres_per_px = panorama.grid.mm_per_px / 1000.0;
        let (s0_m, x0_m) = panorama.grid.place(origin.0, origin.1);
        let at = |origin_m: f64, px: isize| origin_m + px as f64 * metres_per_px;
        Self::new(
            patch_px,
            (SEARCH_M / metres_per_px) as usize,
            |column, row| panorama.pixel(origin.0 + column, origin.1 + row),
            |column, row| truth.sample(at(s0_m, column), at(x0_m, row)),
        )
    }

    /// A patch of `patch_px` pixels and what it is looked for in, up to `search_px` pixels away. `None` if too little of either is
    /// covered.
    pub(crate) fn new(
        patch_px: usize,
        search_px: usize,
        ours: impl Fn(usize, usize) -> Option<f32>,
        theirs: impl Fn(isize, isize) -> Option<f32>,
    ) -> Option<Self> {
        let ours = Tile::from_fn(patch_px, ours);
        if ours.share() < MIN_SHARE {
            return None;
        }
        let step = 1 << LEVELS;
        let margin_px = search_px.div_ceil(step) * step;
        let theirs = Tile::from_fn(patch_px + 2 * margin_px, |column, row| {
            theirs(column as isize - margin_px as isize, row as isize - margin_px as isize)
        });
        (theirs.share() >= MIN_SHARE).then(|| Self { panorama: ours.pyramid(), truth: theirs.pyramid(), margin_px })
    }

    /// Shift of the panorama against the truth in pixels (column, row).
    ///
    /// Rows of bricks repeat every few centimetres and look alike when coarse, so the best few places go down together
    /// and the finest level decides.
    pub(crate) fn find_shift(&self) -> Option<[f64; 2]> {
        let reach = (self.margin_px >> LEVELS) as isize;
        let mut places = self.search(LEVELS, &[[0, 0]], reach, CANDIDATES);
        for level in (0..LEVELS).rev() {
            let centres: Vec<[isize; 2]> = places.iter().map(|place| place.map(|px| px * 2)).collect();
            places = self.search(level, &centres, 1, CANDIDATES >> (LEVELS - level));
        }
        self.refine(*places.first()?)
    }

    /// The best places within `reach` of any of `centres`, best first, none beside a better one.
    fn search(&self, level: usize, centres: &[[isize; 2]], reach: isize, count: usize) -> Vec<[isize; 2]> {
        let mut scored = Vec::new();
        for centre in centres {
            for (dy, dx) in (-reach..=reach).flat_map(|dy| (-reach..=reach).map(move |dx| (dy, dx))) {
                let offset = [centre[0] + dx, centre[1] + dy];
                if let Some(score) = self.correlation(level, offset) {
                    scored.push((score, offset));
                }
            }
        }
        scored.sort_by(|a, b| b.0.total_cmp(&a.0));
        let mut best: Vec<[isize; 2]> = Vec::new();
        for (_, offset) in scored {
            let apart = |other: &[isize; 2]| (other[0] - offset[0]).abs().max((other[1] - offset[1]).abs()) > 1;
            if best.len() < count.max(1) && best.iter().all(apart) {
                best.push(offset);
            }
        }
        best
    }

    /// Peak of the quadratic through the nine values around the best; oblique peaks need its mixed term.
    /// The truth's offset with its sign turned is the panorama's shift.
    fn refine(&self, best: [isize; 2]) -> Option<[f64; 2]> {
        let score = |dx: isize, dy: isize| self.correlation(0, [best[0] + dx, best[1] + dy]);
        let top = score(0, 0).filter(|&score| score >= MIN_CORRELATION)?;
        let (left, right, up, down) = (score(-1, 0)?, score(1, 0)?, score(0, -1)?, score(0, 1)?);
        let gradient = Vector2::new(right - left, down - up) * 0.5;
        let mixed = (score(1, 1)? - score(-1, 1)? - score(1, -1)? + score(-1, -1)?) * 0.25;
        let bend = Matrix2::new(left - 2.0 * top + right, mixed, mixed, up - 2.0 * top + down);
        let peak = if bend.determinant() > 0.0 { -(bend.try_inverse()? * gradient) } else { Vector2::zeros() };
        Some([0, 1].map(|axis| -(best[axis] as f64 + peak[axis].clamp(-1.0, 1.0))))
    }

    /// Normalised correlation of the patch with the truth, the truth's window moved by `offset`.
    fn correlation(&self, level: usize, offset: [isize; 2]) -> Option<f64> {
        let (ours, theirs) = (&self.panorama[level], &self.truth[level]);
        let margin = (self.margin_px >> level) as isize;
        let (column0, row0) = (offset[0] + margin, offset[1] + margin);
        let last = (theirs.edge_px - ours.edge_px) as isize;
        if column0 < 0 || row0 < 0 || column0 > last || row0 > last {
            return None;
        }
        let mut sums = Sums::default();
        for row in 0..ours.edge_px {
            let start = row * ours.edge_px;
            let other = (row + row0 as usize) * theirs.edge_px + column0 as usize;
            let ours_row = start..start + ours.edge_px;
            let theirs_row = other..other + ours.edge_px;
            sums.add_row(
                (&ours.value[ours_row.clone()], &ours.weight[ours_row]),
                (&theirs.value[theirs_row.clone()], &theirs.weight[theirs_row]),
            );
        }
        sums.correlation(MIN_SHARE * 0.5 * (ours.edge_px * ours.edge_px) as f64)
    }
}

/// Weighted sums of a correlation.
#[derive(Default)]
struct Sums {
    n: f64,
    a: f64,
    b: f64,
    aa: f64,
    bb: f64,
    ab: f64,
}

impl Sums {
    fn add_row(&mut self, (a, a_weight): (&[f32], &[f32]), (b, b_weight): (&[f32], &[f32])) {
        // Eight lanes, so that the sums can be done side by side.
        let mut lanes = [[0.0_f32; 8]; 6];
        for start in (0..a.len()).step_by(8) {
            for (lane, i) in (start..(start + 8).min(a.len())).enumerate() {
                let w = a_weight[i] * b_weight[i];
                let (wa, wb) = (w * a[i], w * b[i]);
                for (sum, term) in lanes.iter_mut().zip([w, wa, wb, wa * a[i], wb * b[i], wa * b[i]]) {
                    sum[lane] += term;
                }
            }
        }
        let [n, sa, sb, aa, bb, ab] = lanes.map(|lane| f64::from(lane.iter().sum::<f32>()));
        self.n += n;
        self.a += sa;
        self.b += sb;
        self.aa += aa;
        self.bb += bb;
        self.ab += ab;
    }

    fn correlation(&self, min_weight: f64) -> Option<f64> {
        if self.n < min_weight {
            return None;
        }
        let variance_a = self.aa - self.a * self.a / self.n;
        let variance_b = self.bb - self.b * self.b / self.n;
        let product = variance_a * variance_b;
        (product > 1e-9).then(|| (self.ab - self.a * self.b / self.n) / product.sqrt())
    }
}

#[cfg(test)]
mod tests {
    use super::super::wall_image::WallGrid;
    use super::*;

    /// A wall without period: sums of sines of incommensurable wavelengths from 2 cm to 1 m.
    fn wall(s_m: f64, x_m: f64) -> f64 {
        let waves = [(61.0, 13.0), (-29.0, 71.0), (113.0, -47.0), (7.3, 5.1), (171.0, 97.0), (-19.0, 23.0)];
        waves.iter().enumerate().map(|(i, (a, b))| (s_m * a + x_m * b + i as f64).sin() * 18.0).sum::<f64>() + 128.0
    }

    fn grid(mm_per_px: f64) -> WallGrid {
        WallGrid {
            mm_per_px,
            width_px: (4000.0 / mm_per_px) as usize,
            height_px: (3000.0 / mm_per_px) as usize,
            x0_m: -0.5,
            s0_m: 0.0,
            perimeter_m: 4.0,
        }
    }

    #[test]
    fn a_known_shift_is_measured_to_a_twentieth_of_a_pixel() {
        let truth = WallImage::from_fn(grid(4.0), |s, x| Some(wall(s, x) as u8));
        for (ds_m, dx_m) in [(0.0, 0.0), (0.0213, -0.0071), (-0.0902, 0.1304)] {
            let shifted = WallImage::from_fn(grid(4.0), |s, x| {
                // Inside only, because this wall does not close around the seam; darker and with a hole.
                ((0.3..3.7).contains(&s) && !(1.2..1.5).contains(&s)).then(|| (wall(s - ds_m, x - dx_m) * 0.7) as u8)
            });
            let found = measure_shift(&shifted, &truth);
            assert!(found.matched >= 4, "{found:?}");
            assert!((found.common_s_mm - ds_m * 1000.0).abs() < 0.2, "{found:?} for {ds_m}");
            assert!((found.common_x_mm - dx_m * 1000.0).abs() < 0.2, "{found:?} for {dx_m}");
            assert!(found.relative_mm.max < 0.2, "{found:?}");
            assert!((found.absolute_mm.median - ds_m.hypot(dx_m) * 1000.0).abs() < 0.2, "{found:?}");
        }
    }

    #[test]
    fn a_wall_that_is_not_the_truth_s_is_not_matched() {
        let truth = WallImage::from_fn(grid(8.0), |s, x| Some(wall(s, x) as u8));
        let other = WallImage::from_fn(grid(8.0), |s, x| Some(wall(x * 1.7 + 9.0, s * 1.3) as u8));
        let found = measure_shift(&other, &truth);
        assert!(found.matched * 4 <= found.patches, "{found:?}");
    }

    #[test]
    fn a_panorama_without_a_covered_patch_has_none() {
        let truth = WallImage::from_fn(grid(8.0), |s, x| Some(wall(s, x) as u8));
        let empty = WallImage::from_fn(grid(8.0), |_, _| None);
        assert_eq!(measure_shift(&empty, &truth).patches, 0);
    }
}
