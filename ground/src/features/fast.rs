//! Corners by the segment test (FAST-9, Rosten and Drummond, ECCV 2006), scored for every pixel at once.

use rayon::prelude::*;

use crate::raster::Raster;
use crate::vectors::vectorised;

/// Radius of the circle, pixels.
pub(super) const RADIUS: usize = 3;

/// The circle of 16 pixels, clockwise from the top, `[column, row]`.
const CIRCLE: [[i64; 2]; 16] = [
    [0, -3],
    [1, -3],
    [2, -2],
    [3, -1],
    [3, 0],
    [3, 1],
    [2, 2],
    [1, 3],
    [0, 3],
    [-1, 3],
    [-2, 2],
    [-3, 1],
    [-3, 0],
    [-3, -1],
    [-2, -2],
    [-1, -3],
];

/// Pixels scored together: two of the widest vectors of bytes in use.
const GROUP: usize = 64;

/// A corner.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Corner {
    pub(super) column: usize,
    pub(super) row: usize,
    /// Greatest threshold at which it still is a corner, grey levels.
    pub(super) score: u8,
}

/// Returns the corners of at least `least` whose score no neighbour exceeds, in order of rows.
pub(super) fn corners(image: &Raster<u8, 1>, least: u8) -> Vec<Corner> {
    let (width, height) = (image.width, image.height);
    if width <= 2 * RADIUS || height <= 2 * RADIUS {
        return Vec::new();
    }
    let mut scores = vec![0_u8; width * height];
    scores.par_chunks_exact_mut(width).enumerate().for_each(|(row, line)| {
        if row >= RADIUS && row + RADIUS < height {
            vectorised(
                #[inline(always)]
                || score_row(image, row, line),
            );
        }
    });
    let in_row = |row: usize| {
        let scores = &scores;
        (RADIUS..width - RADIUS).filter_map(move |column| {
            let at = row * width + column;
            let score = scores[at];
            // Of equal neighbours the first one stays.
            let is_best = || {
                let before = [at - width - 1, at - width, at - width + 1, at - 1];
                let after = [at + 1, at + width - 1, at + width, at + width + 1];
                before.iter().all(|&near| scores[near] < score) && after.iter().all(|&near| scores[near] <= score)
            };
            (score >= least.max(1) && is_best()).then_some(Corner { column, row, score })
        })
    };
    (RADIUS..height - RADIUS).into_par_iter().flat_map_iter(in_row).collect()
}

#[expect(clippy::inline_always, reason = "inlined into the dispatch, else it is compiled without its vectors")]
#[inline(always)]
fn score_row(image: &Raster<u8, 1>, row: usize, scores: &mut [u8]) {
    let width = image.width;
    let last = width - RADIUS;
    let mut column = RADIUS;
    while column < last {
        // The last group overlaps the one before it rather than run over the border.
        let start = if column + GROUP <= last { column } else { last.saturating_sub(GROUP).max(RADIUS) };
        let count = (last - start).min(GROUP);
        let at = row * width + start;
        let pixels = |offset: i64| {
            let mut group = [0_u8; GROUP];
            let first = (at as i64 + offset) as usize;
            group[..count].copy_from_slice(&image.data[first..first + count]);
            group
        };
        let centre = pixels(0);
        let circle = CIRCLE.map(|[dx, dy]| pixels(dy * width as i64 + dx));
        let brighter = arc_score(&circle.map(|near| zip(&near, &centre, u8::saturating_sub)));
        let darker = arc_score(&circle.map(|near| zip(&centre, &near, u8::saturating_sub)));
        let score = zip(&brighter, &darker, Ord::max);
        scores[start..start + count].copy_from_slice(&score[..count]);
        column = start + count;
    }
}

/// The best of the 16 arcs of nine: the largest, over arcs, of the smallest difference on it.
#[expect(clippy::inline_always, reason = "inlined into the dispatch, else it is compiled without its vectors")]
#[inline(always)]
fn arc_score(differences: &[[u8; GROUP]; 16]) -> [u8; GROUP] {
    let shrink = |of: &[[u8; GROUP]; 16], step: usize| -> [[u8; GROUP]; 16] {
        std::array::from_fn(|i| zip(&of[i], &of[(i + step) % 16], Ord::min))
    };
    let eights = shrink(&shrink(&shrink(differences, 1), 2), 4);
    let mut best = [0; GROUP];
    for (i, eight) in eights.iter().enumerate() {
        best = zip(&best, &zip(eight, &differences[(i + 8) % 16], Ord::min), Ord::max);
    }
    best
}

#[expect(clippy::inline_always, reason = "inlined into the dispatch, else it is compiled without its vectors")]
#[inline(always)]
fn zip(a: &[u8; GROUP], b: &[u8; GROUP], f: impl Fn(u8, u8) -> u8) -> [u8; GROUP] {
    std::array::from_fn(|i| f(a[i], b[i]))
}

#[cfg(test)]
mod tests {
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    use super::*;

    /// The segment test as it is defined: nine in a row of the circle all brighter, or all darker, by more than `threshold`.
    fn is_corner(image: &Raster<u8, 1>, column: usize, row: usize, threshold: i32) -> bool {
        let value =
            |dx: i64, dy: i64| i32::from(image.at((column as i64 + dx) as usize, (row as i64 + dy) as usize)[0]);
        let differences = CIRCLE.map(|[dx, dy]| value(dx, dy) - value(0, 0));
        (0..16).any(|first| {
            let arc = || (0..9).map(|i| differences[(first + i) % 16]);
            arc().all(|d| d > threshold) || arc().all(|d| d < -threshold)
        })
    }

    #[test]
    fn the_score_is_the_threshold_up_to_which_the_segment_test_holds() {
        let mut rng = ChaCha8Rng::seed_from_u64(2);
        for width in [41, 150] {
            // Smooth enough to have corners of all strengths.
            let coarse: Vec<u8> = (0..400).map(|_| rng.random_range(0..=255)).collect();
            let mut image = Raster::<u8, 1>::new(width, 30);
            for row in 0..30 {
                for column in 0..width {
                    image.set(column, row, [coarse[row / 4 * 40 + column / 4]]);
                }
            }
            let mut line = vec![0; width];
            let mut corners = 0;
            for row in RADIUS..30 - RADIUS {
                score_row(&image, row, &mut line);
                for (column, &score) in line.iter().enumerate().take(width - RADIUS).skip(RADIUS) {
                    let score = i32::from(score);
                    assert!(!is_corner(&image, column, row, score));
                    assert!(score == 0 || is_corner(&image, column, row, score - 1));
                    corners += i32::from(score > 0);
                }
            }
            assert!(corners > 20);
        }
    }
}
