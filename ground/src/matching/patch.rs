//! A photo made ready for matching: band-passed on the wall grid, with its reference points.

use nalgebra::Isometry3;

use super::filter::{Band, DECIMATION, Plane, Planes, box_sums, decimate_rows, decimated};
use super::rectify::{Laying, rectify};
use super::texels::Texels;
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
        band.normalise([config.band_small_px, config.band_large_px], config.contrast_floor, planes);
        let usable = usable(band, config.template_px / 2, planes);
        let origin = footprint.block0.map(|block| block * BLOCK as i64);
        let points = reference_points(&band.texels, &usable, origin, config, planes);
        let footprint = without_masked(footprint, &band.seen);
        Self { origin, texels: Texels::new(&band.texels, memory), usable, points, footprint }
    }

    /// Tells whether a template can lie around a place in the window; none can beyond it.
    pub(super) fn is_usable(&self, [column, row]: [i64; 2]) -> bool {
        let (width, height) = (self.texels.width as i64, self.texels.height as i64);
        let inside = column >= 0 && row >= 0 && column < width && row < height;
        inside
            && self.usable[row as usize / DECIMATION * (self.texels.width / DECIMATION) + column as usize / DECIMATION]
    }
}

/// Blocks around which enough of a template has been seen, and has enough contrast.
fn usable(band: &Band, half: usize, planes: &mut Planes) -> Vec<bool> {
    let blocks = (2 * half + 1) as f32 / DECIMATION as f32;
    let area = blocks * blocks;
    let means = decimated(&band.texels, |value| value, planes);
    let mean_squares = decimated(&band.texels, |value| value * value, planes);
    let [counts, sums, squares] = [&band.seen, &means, &mean_squares].map(|plane| template_sums(plane, half, planes));
    let is_usable = |((count, sum), square): ((&f32, &f32), &f32)| {
        *count >= MIN_SEEN * area && square - sum * sum / area > MIN_VARIANCE * area
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
    texels: &Plane,
    usable: &[bool],
    origin: [i64; 2],
    config: &MatchConfig,
    planes: &mut Planes,
) -> Vec<[usize; 2]> {
    // Half-width of the box nearest in size.
    let radius = (config.corner_px as f32 / DECIMATION as f32 - 0.375).round().max(0.0) as usize;
    let means = moments(texels, planes);
    let [xx, xy, yy] = means.each_ref().map(|plane| box_sums(plane, radius, planes));
    planes.give_back(means);
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

/// Means over blocks of the gradients' products: along a row squared, mixed, along a column squared.
fn moments(texels: &Plane, planes: &mut Planes) -> [Plane; 3] {
    [
        moment(texels, |gx, _| gx * gx, planes),
        moment(texels, |gx, gy| gx * gy, planes),
        moment(texels, |_, gy| gy * gy, planes),
    ]
}

fn moment(texels: &Plane, product: impl Fn(f32, f32) -> f32, planes: &mut Planes) -> Plane {
    let (width, height) = (texels.width, texels.height);
    let mut means = planes.take([0; 2]);
    let add = |row: usize, sums: &mut [f32]| {
        if row == 0 || row + 1 == height {
            return;
        }
        let (above, here, below) = (texels.row(row - 1), texels.row(row), texels.row(row + 1));
        let across = here.iter().zip(&here[2..]).zip(above[1..].iter().zip(&below[1..]));
        for (sum, ((left, right), (up, down))) in sums[1..].iter_mut().zip(across) {
            *sum += product(right - left, down - up);
        }
    };
    decimate_rows([width, height], add, &mut means, planes);
    means
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
