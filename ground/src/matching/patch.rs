//! A photo made ready for matching: band-passed on the wall grid, with its reference points.

use nalgebra::Isometry3;

use super::filter::{Plane, box_sums, normalise_band};
use super::rectify::rectify;
use super::wall::{BLOCK, Footprint, WallGrid};
use super::{MatchConfig, Pixels};

/// Least share of a template that must have been seen.
const MIN_SEEN: f32 = 0.9;

/// Least variance of a template of the locally normalised band: below it there is nothing to match.
const MIN_VARIANCE: f32 = 0.02;

/// One photo on its window of the wall grid.
#[derive(Debug)]
pub(super) struct Patch {
    /// Global column and row of the first texel.
    pub(super) origin: [i64; 2],
    /// The normalised band; 0 where not seen.
    pub(super) texels: Plane,
    /// For a template around each texel: 1 over the root of its sum of squared deviations; 0 where no template can lie.
    pub(super) inverse_norm: Plane,
    /// Reference points, column and row in the window.
    pub(super) points: Vec<[usize; 2]>,
    /// Blocks seen, without those that the mask hides.
    pub(super) footprint: Footprint,
}

impl Patch {
    pub(super) fn new(
        grid: &WallGrid<'_>,
        tunnel_from_cam: &Isometry3<f64>,
        footprint: &Footprint,
        pixels: &Pixels<'_>,
        config: &MatchConfig,
    ) -> Self {
        let mut texels = rectify(grid, tunnel_from_cam, footprint, pixels);
        let seen = normalise_band(&mut texels, config.band_small_px, config.band_large_px, config.contrast_floor);
        let inverse_norm = inverse_norms(&texels, &seen, config.template_px / 2);
        let origin = footprint.block0.map(|block| block * BLOCK as i64);
        let points = reference_points(&texels, &inverse_norm, origin, config);
        Self { origin, texels, inverse_norm, points, footprint: without_masked(footprint, &seen) }
    }

    /// Value of [`Self::inverse_norm`] at a place in the window, 0 beyond it.
    pub(super) fn inverse_norm_at(&self, column: i64, row: i64) -> f32 {
        let (width, height) = (self.texels.width as i64, self.texels.height as i64);
        if column < 0 || row < 0 || column >= width || row >= height {
            return 0.0;
        }
        self.inverse_norm.row(row as usize)[column as usize]
    }
}

fn inverse_norms(texels: &Plane, seen: &Plane, half: usize) -> Plane {
    let area = ((2 * half + 1) * (2 * half + 1)) as f32;
    let sums = box_sums(texels, half);
    let counts = box_sums(seen, half);
    let squared = Plane { data: texels.data.iter().map(|value| value * value).collect(), ..*texels };
    let mut out = box_sums(&squared, half);
    for ((value, sum), count) in out.data.iter_mut().zip(&sums.data).zip(&counts.data) {
        let deviation = *value - sum * sum / area;
        let usable = *count >= MIN_SEEN * area && deviation > MIN_VARIANCE * area;
        *value = if usable { 1.0 / deviation.sqrt() } else { 0.0 };
    }
    out
}

/// The best corner (Shi and Tomasi's smaller eigenvalue of the gradients' moments) in each cell of the wall.
fn reference_points(texels: &Plane, inverse_norm: &Plane, origin: [i64; 2], config: &MatchConfig) -> Vec<[usize; 2]> {
    let (width, height) = (texels.width, texels.height);
    let mut moments = [Plane::new(width, height), Plane::new(width, height), Plane::new(width, height)];
    for row in 1..height.saturating_sub(1) {
        let (above, here, below) = (texels.row(row - 1), texels.row(row), texels.row(row + 1));
        let [xx, xy, yy] = &mut moments;
        let (xx, xy, yy) = (xx.row_mut(row), xy.row_mut(row), yy.row_mut(row));
        for column in 1..width.saturating_sub(1) {
            let gx = here[column + 1] - here[column - 1];
            let gy = below[column] - above[column];
            xx[column] = gx * gx;
            xy[column] = gx * gy;
            yy[column] = gy * gy;
        }
    }
    let [xx, xy, yy] = moments.map(|plane| box_sums(&plane, config.corner_px));
    let strength = |index: usize| {
        let (a, b, c) = (xx.data[index], xy.data[index], yy.data[index]);
        0.5 * (a + c) - (0.25 * (a - c) * (a - c) + b * b).sqrt()
    };
    let cell = config.cell_px as i64;
    let (first, last) = ([0, 1].map(|axis| origin[axis].div_euclid(cell)), [width, height]);
    let mut points = Vec::new();
    for cell_row in first[1]..=(origin[1] + last[1] as i64 - 1).div_euclid(cell) {
        for cell_column in first[0]..=(origin[0] + last[0] as i64 - 1).div_euclid(cell) {
            let span = |cell_index: i64, axis: usize, size: usize| {
                let start = (cell_index * cell - origin[axis]).max(0) as usize;
                start..(((cell_index + 1) * cell - origin[axis]) as usize).min(size)
            };
            let mut best = (0.0, None);
            for row in span(cell_row, 1, height) {
                for column in span(cell_column, 0, width) {
                    let index = row * width + column;
                    if inverse_norm.data[index] > 0.0 {
                        let value = strength(index);
                        if value > best.0 {
                            best = (value, Some([column, row]));
                        }
                    }
                }
            }
            points.extend(best.1);
        }
    }
    points
}

/// The footprint without the blocks of which less than half was seen.
fn without_masked(footprint: &Footprint, seen: &Plane) -> Footprint {
    let mut kept = footprint.clone();
    let [blocks_wide, blocks_high] = footprint.size;
    for block_row in 0..blocks_high {
        for block_column in 0..blocks_wide {
            let texels: f32 = (block_row * BLOCK..(block_row + 1) * BLOCK)
                .map(|row| seen.row(row)[block_column * BLOCK..(block_column + 1) * BLOCK].iter().sum::<f32>())
                .sum();
            let slot = &mut kept.seen[block_row * blocks_wide + block_column];
            *slot = *slot && texels >= 0.5 * (BLOCK * BLOCK) as f32;
        }
    }
    kept.count = kept.seen.iter().filter(|&&block| block).count();
    kept
}
