//! A photo made ready for matching: band-passed on the wall grid, with its reference points.

use nalgebra::Isometry3;

use super::filter::{Band, DECIMATION, Plane, Planes, box_sums, decimated};
use super::rectify::{Laying, rectify};
use super::texels::{STEPS, Texels};
use super::wall::{BLOCK, Footprint, WallGrid};
use super::{MatchConfig, Pixels};

/// Least share of a template that must have been seen.
const MIN_SEEN: f32 = 0.9;

/// Least variance of a template of the locally normalised band: below it there is nothing to match.
pub(super) const MIN_VARIANCE: f32 = 0.02;

/// Working memory of a photo on its way to the wall grid.
#[derive(Debug, Default)]
pub(super) struct Bench {
    laying: Laying,
    band: Band,
    planes: Planes,
}

/// One photo on its window of the wall grid.
#[derive(Debug)]
pub(super) struct Patch {
    /// Global column and row of the first texel.
    pub(super) origin: [i64; 2],
    /// The normalised band; 0 where not seen.
    pub(super) texels: Texels,
    /// Around which blocks of [`DECIMATION`] squared texels a template can lie, row by row.
    usable: Vec<bool>,
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
        pixels: &Pixels,
        config: &MatchConfig,
        Bench { laying, band, planes }: &mut Bench,
        memory: Vec<i8>,
    ) -> Self {
        rectify(grid, tunnel_from_cam, footprint, pixels, laying, &mut band.texels);
        let sigmas_px = [config.band_small_px, config.band_large_px];
        let texels = band.normalise(sigmas_px, config.contrast_floor, planes, memory);
        let [means, mean_squares, gradients @ ..] = moments(&texels, planes);
        let usable = usable(&band.seen, [means, mean_squares], config.template_px / 2, planes);
        let origin = footprint.block0.map(|block| block * BLOCK as i64);
        let points = reference_points(gradients, &usable, origin, config, planes);
        let footprint = without_masked(footprint, &band.seen);
        Self { origin, texels, usable, points, footprint }
    }

    /// Tells whether a template can lie around a place in the window; none can beyond it.
    pub(super) fn is_usable(&self, [column, row]: [i64; 2]) -> bool {
        let (width, height) = (self.texels.width as i64, self.texels.height as i64);
        let inside = column >= 0 && row >= 0 && column < width && row < height;
        inside
            && self.usable[row as usize / DECIMATION * (self.texels.width / DECIMATION) + column as usize / DECIMATION]
    }
}

/// Means over blocks of the texels, of their squares, and of the products of their gradients: along a row squared, mixed, along
/// a column squared.
fn moments(texels: &Texels, planes: &mut Planes) -> [Plane; 5] {
    let (width, height) = (texels.width, texels.height);
    decimated(
        [width, height],
        #[inline(always)]
        |row, [sums, squares, xx, xy, yy]| {
            let here = texels.row(row);
            for ((sum, square), &texel) in sums.iter_mut().zip(squares).zip(here) {
                let texel = f32::from(texel);
                *sum += texel;
                *square += texel * texel;
            }
            if row == 0 || row + 1 == height {
                return;
            }
            let inner = 1..width - 1;
            let (up, down) = (&texels.row(row - 1)[inner.clone()], &texels.row(row + 1)[inner.clone()]);
            let across = here.iter().zip(&here[2..]).zip(up.iter().zip(down));
            let products = xx[inner.clone()].iter_mut().zip(&mut xy[inner.clone()]).zip(&mut yy[inner]);
            for (((xx, xy), yy), ((&left, &right), (&up, &down))) in products.zip(across) {
                let gradient = [f32::from(right) - f32::from(left), f32::from(down) - f32::from(up)];
                *xx += gradient[0] * gradient[0];
                *xy += gradient[0] * gradient[1];
                *yy += gradient[1] * gradient[1];
            }
        },
        planes,
    )
}

/// Blocks around which enough of a template has been seen, and has enough contrast.
fn usable(seen: &Plane, [means, mean_squares]: [Plane; 2], half: usize, planes: &mut Planes) -> Vec<bool> {
    let blocks = (2 * half + 1) as f32 / DECIMATION as f32;
    let area = blocks * blocks;
    let [counts, sums, squares] = [seen, &means, &mean_squares].map(|plane| template_sums(plane, half, planes));
    let is_usable = |((count, sum), square): ((&f32, &f32), &f32)| {
        *count >= MIN_SEEN * area && square - sum * sum / area > MIN_VARIANCE * STEPS * STEPS * area
    };
    let usable = counts.data.iter().zip(&sums.data).zip(&squares.data).map(is_usable).collect();
    planes.give_back([means, mean_squares, counts, sums, squares]);
    usable
}

/// Sums over a template around each block's middle: between those of the boxes of whole blocks that are just smaller and larger.
///
/// The share that must be seen decides how near to a photo's border, where matches tell most about its rotation, points can lie.
fn template_sums(plane: &Plane, half: usize, planes: &mut Planes) -> Plane {
    let radius = half as f32 / DECIMATION as f32 - 0.375;
    let smaller = radius.max(0.0).floor();
    let areas = [smaller, smaller + 1.0, radius.max(0.0)].map(|radius| (2.0 * radius + 1.0) * (2.0 * radius + 1.0));
    let share = (areas[2] - areas[0]) / (areas[1] - areas[0]);
    let [mut sums, larger] = [0, 1].map(|more| box_sums(plane, smaller as usize + more, planes));
    for (sum, larger) in sums.data.iter_mut().zip(&larger.data) {
        *sum += share * (larger - *sum);
    }
    planes.give_back([larger]);
    sums
}

/// The best corner (Shi and Tomasi's smaller eigenvalue of the gradients' moments) in each cell of the wall, to a block.
fn reference_points(
    moments: [Plane; 3],
    usable: &[bool],
    origin: [i64; 2],
    config: &MatchConfig,
    planes: &mut Planes,
) -> Vec<[usize; 2]> {
    // Half-width of the box nearest in size.
    let radius = (config.corner_px as f32 / DECIMATION as f32 - 0.375).round().max(0.0) as usize;
    let [xx, xy, yy] = moments.each_ref().map(|plane| box_sums(plane, radius, planes));
    planes.give_back(moments);
    let strength = |index: usize| {
        let (a, b, c) = (xx.data[index], xy.data[index], yy.data[index]);
        0.5 * (a + c) - (0.25 * (a - c) * (a - c) + b * b).sqrt()
    };
    let size = [xx.width, xx.height];
    let cell = (config.cell_px / DECIMATION).max(1) as i64;
    let first = origin.map(|texel| texel.div_euclid(DECIMATION as i64));
    let cells = |axis: usize| {
        let last = first[axis] + size[axis] as i64 - 1;
        first[axis].div_euclid(cell)..=last.div_euclid(cell)
    };
    let blocks = |cell_index: i64, axis: usize| {
        let start = (cell_index * cell - first[axis]).max(0) as usize;
        start..(((cell_index + 1) * cell - first[axis]) as usize).min(size[axis])
    };
    let mut points = Vec::new();
    for cell_row in cells(1) {
        for cell_column in cells(0) {
            let mut best = (0.0, None);
            for row in blocks(cell_row, 1) {
                for column in blocks(cell_column, 0) {
                    let index = row * size[0] + column;
                    if usable[index] {
                        let value = strength(index);
                        if value > best.0 {
                            best = (value, Some([column, row].map(|block| block * DECIMATION + DECIMATION / 2)));
                        }
                    }
                }
            }
            points.extend(best.1);
        }
    }
    planes.give_back([xx, xy, yy]);
    points
}

/// The footprint without the blocks of which less than half was seen.
fn without_masked(footprint: &Footprint, seen: &Plane) -> Footprint {
    let mut kept = footprint.clone();
    let [blocks_wide, blocks_high] = footprint.size;
    let parts = BLOCK / DECIMATION;
    for block_row in 0..blocks_high {
        for block_column in 0..blocks_wide {
            let shares: f32 = (block_row * parts..(block_row + 1) * parts)
                .map(|row| seen.row(row)[block_column * parts..(block_column + 1) * parts].iter().sum::<f32>())
                .sum();
            if shares < 0.5 * (parts * parts) as f32 {
                kept.seen.set(block_row * blocks_wide + block_column, false);
            }
        }
    }
    kept.count = kept.seen.count_ones(..);
    kept
}
