//! Plane sweep over one tile of the wall: at which height do the photos agree?
//!
//! # Method
//! The photos that see a tile best are laid on the wall at heights around the surface known so far; templates are compared
//! by normalised cross-correlation between every two photos, averaged with the pair's parallax as weight (pairs without
//! parallax agree at every height). Collins, "A space-sweep approach to true multi-image matching", CVPR 1996; a parabola
//! through the best height and its neighbours gives the peak. Templates follow the surface known so far, so its slopes
//! do not blur them.

use adit_geometry::profile::Profile;

use super::photo::{Outlook, Pixels, Shot};
use crate::texture::{Lattice, WallPoint, wall_at};

/// Cells along the side of a tile.
pub(super) const TILE: usize = 24;
/// Samples along the side of a cell in the first pass.
pub(super) const COARSE_SAMPLES: usize = 2;
/// Samples along the side of a cell in the second pass.
pub(super) const FINE_SAMPLES: usize = 4;
/// Photos compared at most: five make ten pairs.
const MOST_PHOTOS: usize = 5;
/// Parallax (difference of two slants) that is as good as any more.
const ENOUGH_PARALLAX: f64 = 0.6;
/// Pairs with less parallax say nothing.
const LEAST_PARALLAX: f64 = 0.08;
/// Templates whose grey values vary less are blank: one standard deviation, grey levels.
const LEAST_CONTRAST: f32 = 1.0;
/// Agreement below this is chance.
const LEAST_AGREEMENT: f32 = 0.45;
/// Agreement from this on is full.
const FULL_AGREEMENT: f32 = 0.8;
/// Independent grey values in a template, about: lenses and JPEG blur neighbours into each other.
const INDEPENDENT: f32 = 30.0;
/// A height at which photos agree better by this much than at any other is fully believed: edges along the parallax and
/// patterns that repeat agree at many heights.
const DISTINCT: f32 = 0.15;
/// Heights that shift the photos by less than this against the best one's are no others, samples.
const APART_SAMPLES: f64 = 1.5;
/// A height uncertain by this much is half believed.
const HALF_BELIEVED_M: f32 = 0.005;

/// How finely a pass looks.
#[derive(Clone, Copy, Debug)]
pub(super) struct Pass {
    /// Resolution of the photos: index of the plane.
    pub(super) level: usize,
    /// Samples along the side of a cell: [`COARSE_SAMPLES`] or [`FINE_SAMPLES`].
    pub(super) samples: usize,
    /// Side of a template in cells.
    pub(super) template_cells: usize,
    /// Heights looked at: this far either way of the known surface, at most.
    pub(super) reach_m: f64,
    /// Distance of heights, as a share of a sample's size over the largest parallax.
    pub(super) step_samples: f64,
    /// At most so many heights either way.
    pub(super) most_steps: usize,
}

/// What a sweep found in a cell.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Found {
    /// Height over the profile, metres.
    pub(super) height_m: f32,
    /// One standard deviation.
    pub(super) sigma_m: f32,
    /// 0 = not found.
    pub(super) confidence: f32,
}

/// A box of cells; columns may run over the seam.
#[derive(Clone, Copy, Debug)]
pub(super) struct Tile {
    pub(super) column0: i64,
    pub(super) columns: usize,
    pub(super) row0: i64,
    pub(super) rows: usize,
}

/// Everything around a tile.
pub(super) struct Scene<'a> {
    pub(super) profile: &'a Profile<f64>,
    pub(super) lattice: &'a Lattice,
    /// Photos near by with their pixels.
    pub(super) photos: &'a [(&'a Shot<'a>, &'a Pixels)],
    /// The surface known so far at a cell (column, row), metres over the profile.
    pub(super) known_m: &'a (dyn Fn(i64, i64) -> f32 + Sync),
}

/// A photo chosen for a tile.
struct Chosen<'a> {
    shot: &'a Shot<'a>,
    pixels: &'a Pixels,
    outlook: Outlook,
}

/// Sweeps a tile; row by row what was found in its cells. `None` where fewer than two photos see it.
pub(super) fn sweep(scene: &Scene, tile: &Tile, pass: &Pass) -> Option<Vec<Found>> {
    let chosen = choose(scene, tile);
    let parallax = |a: usize, b: usize| (chosen[a].outlook.slant - chosen[b].outlook.slant).norm();
    let pairs: Vec<(usize, usize, f32)> = (0..chosen.len())
        .flat_map(|b| (0..b).map(move |a| (a, b)))
        .map(|(a, b)| (a, b, parallax(a, b)))
        .filter(|(.., parallax)| *parallax >= LEAST_PARALLAX)
        .map(|(a, b, parallax)| (a, b, parallax.min(ENOUGH_PARALLAX) as f32))
        .collect();
    let largest = pairs.iter().map(|&(a, b, _)| parallax(a, b)).fold(0.0, f64::max);
    if pairs.is_empty() {
        return None;
    }
    let sample_m = scene.lattice.step_s_m / pass.samples as f64;
    let step_m = pass.step_samples * sample_m / largest;
    let steps = ((pass.reach_m / step_m).ceil() as usize).clamp(2, pass.most_steps) as i32;
    let warps: Vec<Warp> = chosen.iter().map(|chosen| Warp::new(scene, tile, pass, chosen)).collect();
    let cells = tile.columns * tile.rows;
    let valid: Vec<Vec<bool>> = warps.iter().map(|warp| warp.valid(tile, pass)).collect();
    let mut scores = Vec::with_capacity(2 * steps as usize + 1);
    for step in -steps..=steps {
        let shades: Vec<Shades> =
            warps.iter().map(|warp| Shades::new(warp, tile, pass, (f64::from(step) * step_m) as f32)).collect();
        let mut sum = vec![(0.0_f32, 0.0_f32); cells];
        for &(a, b, weight) in &pairs {
            let products = shades[a].products(&shades[b], tile, pass);
            for (cell, sum) in sum.iter_mut().enumerate() {
                if valid[a][cell] && valid[b][cell] {
                    sum.0 += weight * correlation(&shades[a], &shades[b], &products, cell).max(0.0);
                    sum.1 += weight;
                }
            }
        }
        scores.push(sum);
    }
    let found = (0..cells).map(|cell| {
        let (column, row) = (cell % tile.columns, cell / tile.columns);
        let known_m = (scene.known_m)(tile.column0 + column as i64, tile.row0 + row as i64);
        let curve: Vec<f32> =
            scores.iter().map(|step| if step[cell].1 > 0.0 { step[cell].0 / step[cell].1 } else { 0.0 }).collect();
        peak(&curve, step_m as f32, (APART_SAMPLES / pass.step_samples).ceil() as usize, known_m)
    });
    Some(found.collect())
}

/// Chooses photos one after another: the one that sees the tile best, then whatever adds the most parallax at good quality.
fn choose<'a>(scene: &Scene<'a>, tile: &Tile) -> Vec<Chosen<'a>> {
    let middle = (tile.column0 + tile.columns as i64 / 2, tile.row0 + tile.rows as i64 / 2);
    let ends = |first: i64, length: usize| [first, first + length as i64 - 1];
    let mut places = vec![middle];
    for column in ends(tile.column0, tile.columns) {
        places.extend(ends(tile.row0, tile.rows).map(|row| (column, row)));
    }
    let lattice = scene.lattice;
    let place = |(column, row): (i64, i64)| {
        (wall_at(scene.profile, lattice.s_m(column)), lattice.x_m(row), f64::from((scene.known_m)(column, row)))
    };
    let walls: Vec<_> = places.into_iter().map(place).collect();
    let mut left: Vec<Chosen> = scene
        .photos
        .iter()
        .filter_map(|&(shot, pixels)| {
            let (wall, x_m, height_m) = &walls[0];
            let mut outlook = shot.outlook(wall, *x_m, *height_m, scene.profile)?;
            let seen = walls.iter().filter(|(wall, x_m, height_m)| {
                let pixel = shot.look(wall, *x_m, *height_m);
                pixel.is_some_and(|[u, v, ..]| pixels.usable.clearance_px(u, v) > 1.0)
            });
            outlook.quality *= seen.count() as f64 / walls.len() as f64;
            (outlook.quality > 0.0).then_some(Chosen { shot, pixels, outlook })
        })
        .collect();
    let mut chosen: Vec<Chosen> = Vec::with_capacity(MOST_PHOTOS);
    while chosen.len() < MOST_PHOTOS && !left.is_empty() {
        let worth = |candidate: &Chosen| {
            let nearest = chosen
                .iter()
                .map(|chosen| (chosen.outlook.slant - candidate.outlook.slant).norm())
                .fold(f64::INFINITY, f64::min);
            candidate.outlook.quality * (nearest / ENOUGH_PARALLAX).min(1.0)
        };
        let best = (0..left.len()).max_by(|&a, &b| worth(&left[a]).total_cmp(&worth(&left[b])));
        let Some(best) = best else { break };
        chosen.push(left.swap_remove(best));
    }
    chosen
}

/// Where a photo shows the samples of a tile and of what its templates need around it.
struct Warp<'a> {
    pixels: &'a Pixels,
    level: usize,
    /// Samples along a side, across and down.
    size: [usize; 2],
    /// Pixel and its motion per metre of height, per sample; NaN where the photo does not show it.
    looks: Vec<[f32; 4]>,
}

impl<'a> Warp<'a> {
    /// Projects the cells' centres and interpolates between them, which is exact to 0.01 px for cells of 25 mm at 3 m.
    fn new(scene: &Scene, tile: &Tile, pass: &Pass, chosen: &Chosen<'a>) -> Self {
        let lattice = scene.lattice;
        let halo = pass.template_cells as i64 / 2 + 1;
        let node_columns = tile.columns + 2 * halo as usize;
        let walls: Vec<WallPoint> = (0..node_columns as i64)
            .map(|column| wall_at(scene.profile, lattice.s_m(tile.column0 - halo + column)))
            .collect();
        let mut nodes = Vec::with_capacity(node_columns * (tile.rows + 2 * halo as usize));
        for row in tile.row0 - halo..tile.row0 + tile.rows as i64 + halo {
            for (column, wall) in (tile.column0 - halo..).zip(&walls) {
                let known_m = f64::from((scene.known_m)(column, row));
                nodes.push(chosen.shot.look(wall, lattice.x_m(row), known_m).unwrap_or([f32::NAN; 4]));
            }
        }
        // The first sample of the first template, in samples from the first cell's edge.
        let first = (pass.samples as f32 - (pass.template_cells * pass.samples) as f32) * 0.5;
        let taps = |length: usize| -> Vec<(usize, f32)> {
            let count = (length - 1 + pass.template_cells) * pass.samples;
            let place = |sample: usize| {
                let cells = (first + sample as f32 + 0.5) / pass.samples as f32 - 0.5 + halo as f32;
                (cells as usize, cells.fract())
            };
            (0..count).map(place).collect()
        };
        let (across, down) = (taps(tile.columns), taps(tile.rows));
        let mut looks = Vec::with_capacity(across.len() * down.len());
        for &(row, lower) in &down {
            for &(column, right) in &across {
                let at = row * node_columns + column;
                let corner = |at: usize, i: usize| nodes[at][i] + right * (nodes[at + 1][i] - nodes[at][i]);
                looks.push(std::array::from_fn(|i| {
                    let upper = corner(at, i);
                    upper + lower * (corner(at + node_columns, i) - upper)
                }));
            }
        }
        Self { pixels: chosen.pixels, level: pass.level, size: [across.len(), down.len()], looks }
    }

    /// Cells whose whole template the photo shows.
    fn valid(&self, tile: &Tile, pass: &Pass) -> Vec<bool> {
        let usable = &self.pixels.usable;
        // NaN is not shown either.
        let hidden: Vec<f32> =
            self.looks.iter().map(|[u, v, ..]| if usable.clearance_px(*u, *v) > 1.0 { 0.0 } else { 1.0 }).collect();
        template_sums(self.size, tile, pass, &hidden, &hidden).into_iter().map(|hidden| hidden == 0.0).collect()
    }
}

/// A photo's grey values on the wall at one height, with the templates' means and standard deviations.
struct Shades {
    size: [usize; 2],
    values: Vec<f32>,
    mean: Vec<f32>,
    deviation: Vec<f32>,
    count: f32,
}

impl Shades {
    fn new(warp: &Warp, tile: &Tile, pass: &Pass, above_m: f32) -> Self {
        let plane = warp.pixels.level(warp.level);
        let values: Vec<f32> =
            warp.looks.iter().map(|[u, v, du, dv]| plane.sample(u + above_m * du, v + above_m * dv)).collect();
        let count = (pass.template_cells * pass.samples).pow(2) as f32;
        let mut mean = template_sums(warp.size, tile, pass, &values, &vec![1.0; values.len()]);
        let mut deviation = template_sums(warp.size, tile, pass, &values, &values);
        for (mean, deviation) in mean.iter_mut().zip(&mut deviation) {
            *mean /= count;
            *deviation = (*deviation / count - *mean * *mean).max(0.0).sqrt();
        }
        Self { size: warp.size, values, mean, deviation, count }
    }

    fn products(&self, other: &Self, tile: &Tile, pass: &Pass) -> Vec<f32> {
        template_sums(self.size, tile, pass, &self.values, &other.values)
    }
}

fn correlation(a: &Shades, b: &Shades, products: &[f32], cell: usize) -> f32 {
    let deviations = [a.deviation[cell], b.deviation[cell]];
    if deviations[0].min(deviations[1]) < LEAST_CONTRAST {
        return 0.0;
    }
    (products[cell] / a.count - a.mean[cell] * b.mean[cell]) / (deviations[0] * deviations[1])
}

/// Sums of `a b` over each cell's template: first over blocks of a cell's size, then over the blocks of a template.
fn template_sums(size: [usize; 2], tile: &Tile, pass: &Pass, a: &[f32], b: &[f32]) -> Vec<f32> {
    let block_columns = size[0] / pass.samples;
    let mut blocks = vec![0.0; block_columns * (size[1] / pass.samples)];
    for (row, (a, b)) in a.chunks_exact(size[0]).zip(b.chunks_exact(size[0])).enumerate() {
        let line = &mut blocks[row / pass.samples * block_columns..][..block_columns];
        match pass.samples {
            COARSE_SAMPLES => add_blocks::<COARSE_SAMPLES>(line, a, b),
            _ => add_blocks::<FINE_SAMPLES>(line, a, b),
        }
    }
    let mut sums = Vec::with_capacity(tile.columns * tile.rows);
    for row in 0..tile.rows {
        for column in 0..tile.columns {
            let lines = (row..row + pass.template_cells).map(|line| &blocks[line * block_columns + column..]);
            sums.push(lines.map(|line| line[..pass.template_cells].iter().sum::<f32>()).sum());
        }
    }
    sums
}

/// Adds the products of a row of samples to its blocks of `N`; a constant, so that it is done four at a time.
fn add_blocks<const N: usize>(blocks: &mut [f32], a: &[f32], b: &[f32]) {
    for ((block, a), b) in blocks.iter_mut().zip(a.as_chunks::<N>().0).zip(b.as_chunks::<N>().0) {
        *block += a.iter().zip(b).map(|(a, b)| a * b).sum::<f32>();
    }
}

/// Finds the height at which the agreement is best.
///
/// # Method
/// Parabola through the best height and its neighbours. Near the peak the agreement falls as the squared difference of
/// templates grows, so least squares give `sigma^2 = (1 - c) / (N k)`: agreement c, curvature k, N independent values. What
/// agrees nearly as well `apart` steps or more away lowers the confidence (the peak-ratio idea of Hu and Mordohai, "A
/// Quantitative Evaluation of Confidence Measures for Stereo Vision", PAMI 2012, on agreements).
fn peak(curve: &[f32], step_m: f32, apart: usize, known_m: f32) -> Found {
    let best = (1..curve.len() - 1).max_by(|&a, &b| curve[a].total_cmp(&curve[b])).unwrap_or(0);
    let (Some(&before), Some(&after)) = (curve.get(best.wrapping_sub(1)), curve.get(best + 1)) else {
        return Found::default();
    };
    let agreement = curve[best];
    let bend = before - 2.0 * agreement + after;
    if agreement < LEAST_AGREEMENT || before > agreement || after > agreement || bend > -1e-4 {
        return Found { height_m: known_m, ..Found::default() };
    }
    let offset = 0.5 * (before - after) / bend;
    let middle = (curve.len() / 2) as f32;
    let curvature = -bend / (step_m * step_m);
    let sigma_m = ((1.0 - agreement).max(0.01) / (INDEPENDENT * curvature)).sqrt();
    let agreed = ((agreement - LEAST_AGREEMENT) / (FULL_AGREEMENT - LEAST_AGREEMENT)).min(1.0);
    let others = curve.iter().enumerate().filter(|(at, _)| at.abs_diff(best) >= apart);
    let second = others.map(|(_, agreement)| *agreement).fold(0.0, f32::max);
    let distinct = ((agreement - second) / DISTINCT).clamp(0.0, 1.0);
    Found {
        height_m: known_m + (best as f32 - middle + offset) * step_m,
        sigma_m,
        confidence: agreed * distinct / (1.0 + (sigma_m / HALF_BELIEVED_M).powi(2)),
    }
}

#[cfg(test)]
mod tests;
