//! Grid-based motion statistics.
//!
//! Bian et al., "GMS: Grid-based Motion Statistics for Fast, Ultra-robust Feature Correspondence", CVPR 2017, with the
//! details of the authors' program: a right match has others around it that go to the same place, a wrong one has not.

use super::ratio::distinct;
use super::verify::Verify;
use super::{Correspondences, Match, Strategy, View};
use crate::features::{Descriptor, nearest};

/// Cells per axis of the first photo.
const CELLS: usize = 20;

/// The neighbours of a cell, itself included, `[column, row]`.
const AROUND: [[i64; 2]; 9] = [[-1, -1], [0, -1], [1, -1], [-1, 0], [0, 0], [1, 0], [-1, 1], [0, 1], [1, 1]];

/// The eight neighbours clockwise, as places in [`AROUND`]: an eighth of a turn moves each to the next.
const CLOCKWISE: [usize; 8] = [0, 1, 2, 5, 8, 7, 6, 3];

/// Sizes of the second photo's cells against the first's that are tried where the scale is free.
const SCALES: [f64; 5] = [1.0, 0.5, std::f64::consts::FRAC_1_SQRT_2, std::f64::consts::SQRT_2, 2.0];

/// Matches that move together with their surroundings, then RANSAC.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Gms {
    /// Support, in square roots of the matches around, that a pair of cells needs (6 for all nearest neighbours, 3 to 4
    /// after a ratio test).
    pub factor: f64,
    /// Ratio test before; 1 takes every nearest neighbour.
    pub ratio: f64,
    /// Try eight turns of the second photo.
    pub free_rotation: bool,
    /// Try five sizes of the second photo.
    pub free_scale: bool,
    /// The geometric test.
    pub verify: Verify,
}

impl Default for Gms {
    /// The authors' factor for unfiltered matches; upright photos of one camera, so no turn and no size to try.
    fn default() -> Self {
        Self { factor: 6.0, ratio: 1.0, free_rotation: false, free_scale: false, verify: Verify::default() }
    }
}

impl<D: Descriptor> Strategy<D> for Gms {
    fn correspond(&self, first: &View<D>, second: &View<D>) -> Correspondences {
        let neighbours = nearest::<2, D>(&first.features.descriptors, &second.features.descriptors);
        let all = distinct::<D, 2>(&neighbours, self.ratio);
        let places: Vec<[[f64; 2]; 2]> =
            all.iter().map(|&[from, to]| [relative(first, from), relative(second, to)]).collect();
        let kept = self.consistent(&places);
        // Several features may have the same nearest neighbour: the nearest of them has it.
        let mut matches: Vec<Match> = all.iter().zip(&kept).filter(|(_, kept)| **kept).map(|(pair, _)| *pair).collect();
        matches.sort_by_key(|&[from, to]| (to, neighbours[from as usize][0].distance));
        matches.dedup_by_key(|pair| pair[1]);
        self.verify.check(first, second, &matches)
    }
}

/// Place of a feature in its photo, 0 to 1 on both axes.
fn relative<D>(view: &View<D>, feature: u32) -> [f64; 2] {
    let pixel = view.pixel(feature);
    [pixel.x / f64::from(view.camera.width_px), pixel.y / f64::from(view.camera.height_px)]
}

impl Gms {
    /// Tells which matches (places in both photos, 0 to 1) have support, at the turn and size that support most.
    fn consistent(&self, places: &[[[f64; 2]; 2]]) -> Vec<bool> {
        let turns = if self.free_rotation { 0..8 } else { 0..1 };
        let scales = if self.free_scale { &SCALES[..] } else { &SCALES[..1] };
        let settings = scales.iter().flat_map(|&scale| turns.clone().map(move |turn| (scale, turn)));
        let results = settings.map(|(scale, turn)| self.consistent_at(places, scale, turn));
        let count = |kept: &Vec<bool>| kept.iter().filter(|kept| **kept).count();
        // The first of equals, so that the plain setting goes before any other.
        results.reduce(|best, next| if count(&next) > count(&best) { next } else { best }).unwrap_or_default()
    }

    /// The same at one size and turn: a match is kept if it has support on any of four grids, half a cell apart.
    fn consistent_at(&self, places: &[[[f64; 2]; 2]], scale: f64, turn: usize) -> Vec<bool> {
        let right = ((CELLS as f64 * scale).round() as usize).max(1);
        let mut kept = vec![false; places.len()];
        for shift in [[0.0, 0.0], [0.5, 0.0], [0.0, 0.5], [0.5, 0.5]] {
            let cells: Vec<Option<[usize; 2]>> = places
                .iter()
                .map(|[first, second]| Some([shifted_cell(*first, shift)?, cell(*second, right)?]))
                .collect();
            let votes = Votes::new(&cells, right);
            let partners: Vec<Option<usize>> =
                (0..CELLS * CELLS).map(|left| votes.partner(left, turn, self.factor)).collect();
            for (kept, cells) in kept.iter_mut().zip(&cells) {
                *kept |= cells.is_some_and(|[left, right]| partners[left] == Some(right));
            }
        }
        kept
    }
}

fn cell(place: [f64; 2], cells: usize) -> Option<usize> {
    let [column, row] = place.map(|at| (at * cells as f64).floor());
    let inside = |at: f64| at >= 0.0 && at < cells as f64;
    (inside(column) && inside(row)).then(|| row as usize * cells + column as usize)
}

/// The cell of a grid moved by part of a cell; what falls before its first cell is left to the other grids.
fn shifted_cell(place: [f64; 2], shift: [f64; 2]) -> Option<usize> {
    let moved: [f64; 2] = std::array::from_fn(|axis| place[axis] + shift[axis] / CELLS as f64);
    let is_whole = (0..2).all(|axis| shift[axis] == 0.0 || moved[axis] * CELLS as f64 >= 1.0);
    if is_whole { cell(moved, CELLS) } else { None }
}

/// How many matches go from each cell to each.
struct Votes {
    right: usize,
    /// `[left cell][right cell]`.
    counts: Vec<u32>,
    /// Matches that leave each left cell.
    leaving: Vec<u32>,
}

impl Votes {
    fn new(cells: &[Option<[usize; 2]>], right: usize) -> Self {
        let mut votes = Self { right, counts: vec![0; CELLS * CELLS * right * right], leaving: vec![0; CELLS * CELLS] };
        for &[left, to] in cells.iter().flatten() {
            votes.counts[left * right * right + to] += 1;
            votes.leaving[left] += 1;
        }
        votes
    }

    fn to(&self, left: usize) -> &[u32] {
        &self.counts[left * self.right * self.right..][..self.right * self.right]
    }

    /// The right cell that most matches of a left one go to, if the cells around both agree often enough.
    fn partner(&self, left: usize, turn: usize, factor: f64) -> Option<usize> {
        if self.leaving[left] == 0 {
            return None;
        }
        let (best, _) =
            self.to(left).iter().enumerate().max_by_key(|(index, count)| (**count, std::cmp::Reverse(*index)))?;
        let (mut score, mut around, mut pairs) = (0, 0, 0);
        for place in 0..AROUND.len() {
            let neighbours = neighbour(left, place, CELLS).zip(neighbour(best, turned(place, turn), self.right));
            if let Some((left, right)) = neighbours {
                score += self.to(left)[right];
                around += self.leaving[left];
                pairs += 1;
            }
        }
        let mean = f64::from(around) / f64::from(pairs);
        (f64::from(score) >= factor * mean.sqrt()).then_some(best)
    }
}

fn neighbour(cell: usize, place: usize, cells: usize) -> Option<usize> {
    let [dx, dy] = AROUND[place];
    let (column, row) = ((cell % cells) as i64 + dx, (cell / cells) as i64 + dy);
    let inside = |at: i64| (0..cells as i64).contains(&at);
    (inside(column) && inside(row)).then(|| row as usize * cells + column as usize)
}

/// Where a place of [`AROUND`] comes to lie after `turn` eighths of a turn clockwise.
fn turned(place: usize, turn: usize) -> usize {
    CLOCKWISE.iter().position(|&at| at == place).map_or(place, |index| CLOCKWISE[(index + turn) % 8])
}

#[cfg(test)]
mod tests {
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    use super::*;

    /// 1500 matches that follow `map` and 3000 that go anywhere; the first are right.
    fn places(map: impl Fn([f64; 2]) -> [f64; 2]) -> Vec<[[f64; 2]; 2]> {
        let mut rng = ChaCha8Rng::seed_from_u64(4);
        let mut draw = || [rng.random_range(0.0..1.0), rng.random_range(0.0..1.0)];
        let mut all = Vec::new();
        while all.len() < 1500 {
            let from: [f64; 2] = draw();
            let to = map(from);
            if to.iter().all(|at| (0.0..1.0).contains(at)) {
                all.push([from, to]);
            }
        }
        all.extend((0..3000).map(|_| [draw(), draw()]));
        all
    }

    fn shares(gms: &Gms, places: &[[[f64; 2]; 2]]) -> [f64; 2] {
        let kept = gms.consistent(places);
        let share = |part: &[bool]| part.iter().filter(|kept| **kept).count() as f64 / part.len() as f64;
        [share(&kept[..1500]), share(&kept[1500..])]
    }

    #[test]
    fn matches_that_move_together_stay_and_scattered_ones_go() {
        let [right, wrong] = shares(&Gms::default(), &places(|[x, y]| [x + 0.22, y + 0.06]));
        assert!(right > 0.9 && wrong < 0.02, "{right} {wrong}");
        let [nothing, _] = shares(&Gms { factor: 60.0, ..Gms::default() }, &places(|[x, y]| [x + 0.22, y + 0.06]));
        assert!(nothing < 0.01, "{nothing}");
    }

    #[test]
    fn a_turned_or_grown_photo_needs_the_free_setting() {
        let quarter = places(|[x, y]| [1.0 - y, x]);
        let [plain, _] = shares(&Gms::default(), &quarter);
        let [free, wrong] = shares(&Gms { free_rotation: true, ..Gms::default() }, &quarter);
        assert!(free > 0.9 && free > plain + 0.2 && wrong < 0.05, "{plain} {free} {wrong}");
        let grown = places(|[x, y]| [0.5 + 2.0 * (x - 0.5), 0.5 + 2.0 * (y - 0.5)]);
        let [plain, _] = shares(&Gms::default(), &grown);
        let [free, _] = shares(&Gms { free_scale: true, ..Gms::default() }, &grown);
        assert!(free > 0.8 && free > plain + 0.1, "{plain} {free}");
    }
}
