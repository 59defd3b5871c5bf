//! From saddles to a board: a grid grown from a corner, neighbour by neighbour.
//!
//! Nothing global is assumed, for a wide lens bends the board: the next corner lies where the last step, or the step beside
//! it, leads (within a third of that step), and the edge on the way there has dark on one side and bright on the other, by
//! turns as on a chessboard. In the manner of Geiger et al., "Automatic camera and range sensor calibration using a single
//! shot" (ICRA 2012), grown instead of optimised.

use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::f64::consts::{PI, TAU};

use nalgebra::Vector2;

use super::super::{Board, Pattern};
use super::saddle::{Field, LEAST_CONTRAST, Saddle};

/// A corner lies within this share of a step from where it is expected.
const TOLERANCE: f64 = 0.35;
/// First neighbours lie within this angle of a corner's line, and it of theirs.
const CONE_RAD: f64 = 0.45;
/// First neighbours are looked for among so many of the nearest saddles.
const NEAREST: usize = 24;
/// Contrast across an edge against that of its corners.
const EDGE_SHARE: f64 = 0.25;
/// The sides of an edge are looked at so far beside it, in squares; markers leave less white.
const BESIDE: f64 = 0.15;
const BESIDE_MARKERS: f64 = 0.06;
/// Seeds tried before giving up.
const SEEDS: usize = 60;
/// A hole in a grid is filled by a corner of this share of the contrast asked for elsewhere.
const FAINT: f64 = 0.5;

pub(super) type Cell = [i32; 2];
const STEPS: [Cell; 4] = [[1, 0], [0, 1], [-1, 0], [0, -1]];

/// Corners by cell: neighbours in the grid are neighbours on the board.
#[derive(Clone, Debug, Default)]
pub(super) struct Grid {
    pub(super) corners: BTreeMap<Cell, Vector2<f64>>,
}

impl Grid {
    /// Smallest and largest cell.
    pub(super) fn bounds(&self) -> [Cell; 2] {
        self.corners.keys().fold([[i32::MAX; 2], [i32::MIN; 2]], |[low, high], cell| {
            [[0, 1].map(|axis| low[axis].min(cell[axis])), [0, 1].map(|axis| high[axis].max(cell[axis]))]
        })
    }

    /// Columns and rows of the box around all corners.
    pub(super) fn size(&self) -> [usize; 2] {
        if self.corners.is_empty() {
            return [0, 0];
        }
        let [low, high] = self.bounds();
        [0, 1].map(|axis| (high[axis] - low[axis] + 1) as usize)
    }

    /// The same corners after so many quarter turns of the cells clockwise.
    pub(super) fn turned(&self, turns: u8) -> Self {
        Self { corners: self.corners.iter().map(|(cell, at)| (Self::turned_cell(*cell, turns), *at)).collect() }
    }

    pub(super) fn turned_cell([x, y]: Cell, turns: u8) -> Cell {
        match turns % 4 {
            0 => [x, y],
            1 => [-y, x],
            2 => [-x, -y],
            _ => [y, -x],
        }
    }

    /// With columns and rows in the sense of a board seen from its front.
    fn seen_from_front(self) -> Self {
        let way = |step: Cell| {
            let ways = self.corners.iter().filter_map(|(cell, at)| Some(self.corners.get(&add(*cell, step))? - at));
            ways.sum::<Vector2<f64>>()
        };
        if way([1, 0]).perp(&way([0, 1])) > 0.0 {
            return self;
        }
        Self { corners: self.corners.into_iter().map(|([x, y], at)| ([y, x], at)).collect() }
    }
}

/// The largest grid among the saddles; as many corners as the board has are enough.
pub(super) fn largest_grid(field: &Field, saddles: &[Saddle], board: &Board) -> Grid {
    let beside = match board.pattern {
        Pattern::Chessboard => BESIDE,
        Pattern::Charuco(_) => BESIDE_MARKERS,
    };
    let grower = Grower { field, saddles, beside };
    let mut seeds: Vec<usize> = (0..saddles.len()).collect();
    seeds.sort_by(|a, b| saddles[*b].contrast.total_cmp(&saddles[*a].contrast));
    let mut seen = BTreeSet::new();
    let mut best = Grid::default();
    let mut tries = 0;
    for seed in seeds {
        if tries == SEEDS || best.corners.len() >= board.corners() {
            break;
        }
        if seen.contains(&seed) {
            continue;
        }
        let Some(start) = grower.start(seed) else { continue };
        tries += 1;
        let (mut grid, used) = grower.grow(start);
        seen.extend(used);
        grower.fill_holes(&mut grid);
        if grid.corners.len() > best.corners.len() {
            best = grid;
        }
    }
    best.seen_from_front()
}

struct Grower<'a> {
    field: &'a Field,
    saddles: &'a [Saddle],
    /// How far beside an edge its two sides are looked at, in squares.
    beside: f64,
}

impl Grower<'_> {
    /// A corner and the neighbours found along its two lines; `None` with fewer than one along each.
    fn start(&self, seed: usize) -> Option<BTreeMap<Cell, usize>> {
        let corner = &self.saddles[seed];
        let mut nearest: Vec<usize> = (0..self.saddles.len()).filter(|&other| other != seed).collect();
        let distance = |other: usize| (self.saddles[other].at - corner.at).norm_squared();
        let count = NEAREST.min(nearest.len());
        if count < 2 {
            return None;
        }
        nearest.select_nth_unstable_by(count - 1, |a, b| distance(*a).total_cmp(&distance(*b)));
        nearest.truncate(count);
        nearest.sort_by(|a, b| distance(*a).total_cmp(&distance(*b)));
        let mut grid = BTreeMap::from([([0, 0], seed)]);
        let [first, second] = corner.lines_rad;
        // The second line a quarter turn or so after the first, whichever way: cells keep one sense.
        for (step, angle) in STEPS.into_iter().zip([first, second, first + PI, second + PI]) {
            let along = |other: usize| {
                let way = self.saddles[other].at - corner.at;
                let direction = way.y.atan2(way.x);
                let lines = self.saddles[other].lines_rad;
                turn_between(direction, angle, TAU) < CONE_RAD
                    && lines.iter().any(|line| turn_between(*line, direction, PI) < CONE_RAD)
                    && self.is_edge(seed, other)
            };
            if let Some(&found) = nearest.iter().find(|&&other| along(other)) {
                grid.insert(step, found);
            }
        }
        let has = |axis: usize| grid.keys().any(|cell| cell[axis] != 0);
        (has(0) && has(1)).then_some(grid)
    }

    /// Adds neighbours until there are none; also the saddles that were used.
    fn grow(&self, mut grid: BTreeMap<Cell, usize>) -> (Grid, Vec<usize>) {
        let mut used: BTreeSet<usize> = grid.values().copied().collect();
        let mut open: VecDeque<Cell> = grid.keys().copied().collect();
        while let Some(cell) = open.pop_front() {
            for step in STEPS {
                let next = add(cell, step);
                if grid.contains_key(&next) {
                    continue;
                }
                let place = |cell: &Cell| grid.get(cell).map(|&saddle| self.saddles[saddle].at);
                let Some((expected, length)) = predicted(&place, cell, step) else { continue };
                let off = |saddle: usize| (self.saddles[saddle].at - expected).norm();
                let near = (0..self.saddles.len()).filter(|saddle| !used.contains(saddle));
                let best =
                    near.filter(|&saddle| off(saddle) < TOLERANCE * length).min_by(|a, b| off(*a).total_cmp(&off(*b)));
                if let Some(best) = best.filter(|&best| self.is_edge(grid[&cell], best)) {
                    grid.insert(next, best);
                    used.insert(best);
                    // Cells that had no step to go by may have one now.
                    open.extend(STEPS.map(|step| add(next, step)).iter().filter(|cell| grid.contains_key(*cell)));
                    open.push_back(next);
                }
            }
        }
        let corners = grid.into_iter().map(|(cell, saddle)| (cell, self.saddles[saddle].at)).collect();
        (Grid { corners }, used.into_iter().collect())
    }

    /// Looks again, with less contrast, where a corner is missing inside the box of the others.
    fn fill_holes(&self, grid: &mut Grid) {
        let [low, high] = grid.bounds();
        let missing: Vec<Cell> = (low[0]..=high[0])
            .flat_map(|x| (low[1]..=high[1]).map(move |y| [x, y]))
            .filter(|cell| !grid.corners.contains_key(cell))
            .collect();
        // Twice: a hole may lead to the next.
        for cell in missing.iter().chain(&missing) {
            if grid.corners.contains_key(cell) {
                continue;
            }
            let place = |cell: &Cell| grid.corners.get(cell).copied();
            let guesses: Vec<(Vector2<f64>, f64)> = STEPS
                .into_iter()
                .filter_map(|step| predicted(&place, [cell[0] - step[0], cell[1] - step[1]], step))
                .collect();
            if guesses.len() < 2 {
                continue;
            }
            let expected = guesses.iter().map(|(at, _)| at).sum::<Vector2<f64>>() / guesses.len() as f64;
            let found = self.field.saddle_near(expected, FAINT * LEAST_CONTRAST);
            if let Some(saddle) = found.filter(|saddle| (saddle.at - expected).norm() < TOLERANCE * guesses[0].1) {
                grid.corners.insert(*cell, saddle.at);
            }
        }
    }

    /// Tells whether all along the way between two corners one side is dark and the other bright: so it is from a corner to the
    /// next, and not to the one after it, where the sides change.
    fn is_edge(&self, from: usize, to: usize) -> bool {
        let (from, to) = (&self.saddles[from], &self.saddles[to]);
        let way = to.at - from.at;
        let side = Vector2::new(-way.y, way.x) * self.beside;
        let across = |share: f64| {
            let on = from.at + way * share;
            Some(self.field.value(on + side)? - self.field.value(on - side)?)
        };
        let least = EDGE_SHARE * from.contrast.min(to.contrast);
        let inner = [0.35, 0.5, 0.65].map(across);
        let Some(sum) = inner.into_iter().sum::<Option<f64>>() else { return false };
        let sign = sum.signum();
        inner.into_iter().flatten().all(|value| sign * value > least)
    }
}

/// Where the corner a step from `cell` should be, and the length of that step: as far as the step before, or as the one beside.
fn predicted(place: &impl Fn(&Cell) -> Option<Vector2<f64>>, cell: Cell, step: Cell) -> Option<(Vector2<f64>, f64)> {
    let here = place(&cell)?;
    let before = place(&[cell[0] - step[0], cell[1] - step[1]]).map(|before| here - before);
    let beside = [[step[1], step[0]], [-step[1], -step[0]]].into_iter().find_map(|aside| {
        let start = add(cell, aside);
        Some(place(&add(start, step))? - place(&start)?)
    });
    let way = match (before, beside) {
        (Some(before), Some(beside)) => (before + beside) * 0.5,
        (Some(way), None) | (None, Some(way)) => way,
        (None, None) => return None,
    };
    Some((here + way, way.norm()))
}

pub(super) fn add(cell: Cell, step: Cell) -> Cell {
    [cell[0] + step[0], cell[1] + step[1]]
}

/// Angle between two directions, where `period` is a whole turn or a half.
fn turn_between(a_rad: f64, b_rad: f64, period: f64) -> f64 {
    let difference = (a_rad - b_rad).rem_euclid(period);
    difference.min(period - difference)
}
