//! The sweep along the tunnel: a strip of rows at a time, with only the photos in memory that the strip needs.

use std::collections::BTreeMap;

use adit_geometry::profile::Profile;
use rayon::prelude::*;

use super::photo::{Pixels, Shot};
use super::ring::Rings;
use super::smooth::{Smoothed, smooth};
use super::sweep::{COARSE_SAMPLES, FINE_SAMPLES, Found, Pass, Scene, TILE, Tile, sweep};
use crate::survey::Loss;
use crate::texture::Lattice;

/// Rows of a strip, in cells.
const STRIP_ROWS: usize = 3 * TILE;
/// Rows computed beyond a strip on either side, so that its edges are smoothed like its middle.
const HALO_ROWS: usize = TILE / 2;

/// From far and blurred to near and sharp. Templates: 100 mm, then 75 mm for cells of 25 mm.
pub(super) const PASSES: [Pass; 2] = [
    Pass { level: 1, samples: COARSE_SAMPLES, template_cells: 4, reach_m: 0.08, step_samples: 0.75, most_steps: 12 },
    Pass { level: 0, samples: FINE_SAMPLES, template_cells: 3, reach_m: 0.015, step_samples: 0.5, most_steps: 5 },
];

/// What stays the same from strip to strip.
pub(super) struct Job<'a> {
    pub(super) shots: &'a [Shot<'a>],
    pub(super) profile: &'a Profile<f64>,
    pub(super) lattice: &'a Lattice,
    pub(super) rings: &'a Rings,
    /// Halvings of photos until their pixels are about as large as a sample.
    pub(super) halvings: u32,
}

/// What the sweep did.
#[derive(Default)]
pub(super) struct Done {
    pub(super) decoded: usize,
    pub(super) cells: u64,
    pub(super) most_bytes: usize,
    pub(super) losses: Vec<Loss>,
}

/// A finished strip.
pub(super) struct Strip<'a> {
    pub(super) row0: usize,
    /// Relief over the ring part, row by row once around, metres.
    pub(super) relief_m: &'a [f32],
    pub(super) confidence: &'a [f32],
}

/// Number of strips.
pub(super) fn strip_count(lattice: &Lattice) -> usize {
    lattice.rows.div_ceil(STRIP_ROWS)
}

/// Sweeps the wall and hands over strip after strip.
pub(super) fn run<E>(job: &Job, mut push: impl FnMut(&Strip) -> Result<(), E>) -> Result<Done, E> {
    let mut done = Done::default();
    let mut cache: BTreeMap<usize, Option<Pixels>> = BTreeMap::new();
    let columns = job.lattice.columns;
    for row0 in (0..job.lattice.rows).step_by(STRIP_ROWS) {
        let rows = STRIP_ROWS.min(job.lattice.rows - row0);
        let first = row0.saturating_sub(HALO_ROWS);
        let end = (row0 + rows + HALO_ROWS).min(job.lattice.rows);
        job.fetch(first, end, &mut cache, &mut done);
        let photos: Vec<(&Shot, &Pixels)> =
            cache.iter().filter_map(|(&index, pixels)| Some((&job.shots[index], pixels.as_ref()?))).collect();
        let ring_m = job.rings.heights(job.profile, job.lattice, first, end - first);
        let smoothed = job.strip(first, end, &photos, &ring_m);
        let own = (row0 - first) * columns..(row0 - first + rows) * columns;
        let relief_m: Vec<f32> = smoothed.height_m[own.clone()]
            .iter()
            .zip(&ring_m[own.clone()])
            .map(|(height, ring)| height - ring)
            .collect();
        done.cells += ((end - first) * columns) as u64;
        push(&Strip { row0, relief_m: &relief_m, confidence: &smoothed.confidence[own] })?;
    }
    Ok(done)
}

impl Job<'_> {
    /// Decodes photos that come near and forgets those that lie behind.
    fn fetch(&self, first: usize, end: usize, cache: &mut BTreeMap<usize, Option<Pixels>>, done: &mut Done) {
        let edges = [first, end].map(|row| self.lattice.x_m(row as i64));
        let near = |index: &usize| {
            let x_m = self.shots[*index].footprint.x_m;
            x_m[0] <= edges[1] && x_m[1] >= edges[0]
        };
        cache.retain(|index, _| near(index));
        let new: Vec<usize> = (0..self.shots.len()).filter(|index| near(index) && !cache.contains_key(index)).collect();
        let decoded: Vec<_> =
            new.into_par_iter().map(|index| (index, self.shots[index].pixels(self.halvings))).collect();
        done.decoded += decoded.len();
        for (index, pixels) in decoded {
            let kept = pixels.map_err(|loss| done.losses.push(loss)).ok();
            cache.insert(index, kept);
        }
        let bytes = cache.values().flatten().map(Pixels::bytes).sum();
        done.most_bytes = done.most_bytes.max(bytes);
    }

    /// Sweeps rows `first..end` coarse to fine.
    fn strip(&self, first: usize, end: usize, photos: &[(&Shot, &Pixels)], ring_m: &[f32]) -> Smoothed {
        let columns = self.lattice.columns;
        let mut smoothed = Smoothed { height_m: ring_m.to_vec(), confidence: vec![0.0; ring_m.len()] };
        for pass in PASSES {
            let known_m = |column: i64, row: i64| {
                let row = (row - first as i64).clamp(0, (end - first) as i64 - 1) as usize;
                smoothed.height_m[row * columns + self.lattice.wrap(column)]
            };
            let scene = Scene { profile: self.profile, lattice: self.lattice, photos, known_m: &known_m };
            let swept: Vec<(Tile, Option<Vec<Found>>)> = tiles(columns, first, end)
                .into_par_iter()
                .map(|tile| {
                    let found = sweep(&scene, &tile, &pass);
                    (tile, found)
                })
                .collect();
            let mut found = vec![Found::default(); ring_m.len()];
            for (tile, cells) in swept {
                let Some(cells) = cells else { continue };
                for (row, line) in (tile.row0 as usize - first..).zip(cells.chunks_exact(tile.columns)) {
                    found[row * columns + tile.column0 as usize..][..tile.columns].copy_from_slice(line);
                }
            }
            smoothed = smooth(&found, ring_m, columns, self.lattice.step_s_m as f32);
        }
        smoothed
    }
}

fn tiles(columns: usize, first: usize, end: usize) -> Vec<Tile> {
    let rows = (first..end).step_by(TILE).map(|row| (row, TILE.min(end - row)));
    let tile = |row: usize, rows: usize, column: usize| Tile {
        column0: column as i64,
        columns: TILE.min(columns - column),
        row0: row as i64,
        rows,
    };
    rows.flat_map(|(row, rows)| (0..columns).step_by(TILE).map(move |column| tile(row, rows, column))).collect()
}
