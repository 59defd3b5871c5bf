//! Monotone alignment of captures and photos with gaps on either side, as probabilities.
//!
//! A lattice of (captures used, photos used). Three moves: a pair, a capture without photo, a photo without capture. The
//! forward and backward sums over all paths give the probability of every pair, so that what is ambiguous is known to be.
//! Rabiner, "A tutorial on hidden Markov models", Proc. IEEE 1989, for the sums; a photo without capture never follows a
//! capture without photo (except at an open end), so that every pairing is one path only, and a second photo is judged
//! against the capture that it repeats.

use super::clock::{Clock, Stamp};

/// A capture as the alignment sees it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Shot {
    /// Board time of the exposure.
    pub(super) time_s: f64,
    /// Probability that the camera took a photo.
    pub(super) photo_share: f64,
    /// Probability that it took a second one right after.
    pub(super) echo_share: f64,
}

/// What the ends of a block mean.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Ends {
    /// The captures are a whole flight; only photos may lie before and after it.
    WholeFlight,
    /// Captures and photos may both go on beyond.
    Open,
}

/// Photos further in time from a capture than this are not looked at.
const BAND_S: f64 = 8.0;
/// A photo that nobody asked for, in flight and not right after a capture.
const STRAY_SHARE: f64 = 5e-5;
/// A photo before the first or after the last capture; a capture beyond the photos where [`Ends::Open`].
const OUTSIDE_SHARE: f64 = 0.1;
/// A double shot comes within this time after the first.
const ECHO_S: (f64, f64) = (0.1, 1.5);
/// What a photo without a time says about any pairing.
const NO_STAMP: f64 = 0.5;

/// Probabilities of pairs under one clock.
pub(super) struct Alignment {
    /// Logarithm of the probability of everything seen, under this clock.
    pub(super) ln_evidence: f64,
    /// `(shot, photo, probability)` for every pair above one in a thousand, in order of the shots.
    pub(super) pairs: Vec<(usize, usize, f64)>,
}

/// Sums over all pairings of `shots` with `photos` (their stamps, where they have one) under `clock`.
pub(super) fn align(shots: &[Shot], photos: &[Option<Stamp>], clock: &Clock, ends: Ends) -> Alignment {
    let lattice = Lattice::new(shots, photos, clock, ends);
    let forward = lattice.forward();
    let backward = lattice.backward();
    let ln_evidence = end(&forward);
    let mut pairs = Vec::new();
    if ln_evidence.is_finite() {
        for row in 1..=shots.len() {
            for column in lattice.columns(row) {
                let at = lattice.index(row, column);
                let probability = (forward[at][PAIR] + backward[at][PAIR] - ln_evidence).exp();
                if probability > 1e-3 {
                    pairs.push((row - 1, column - 1, probability));
                }
            }
        }
    }
    Alignment { ln_evidence, pairs }
}

/// The last move before a cell.
const PAIR: usize = 0;
const MISSED: usize = 1;
const SURPLUS: usize = 2;

/// Logarithms per last move.
type Cell = [f64; 3];

const NEVER: Cell = [f64::NEG_INFINITY; 3];

struct Lattice<'a> {
    shots: &'a [Shot],
    photos: &'a [Option<Stamp>],
    clock: &'a Clock,
    ends: Ends,
    /// First and last column of every row, and where the row starts in memory.
    rows: Vec<(usize, usize, usize)>,
    cells: usize,
}

impl<'a> Lattice<'a> {
    fn new(shots: &'a [Shot], photos: &'a [Option<Stamp>], clock: &'a Clock, ends: Ends) -> Self {
        let times_s = interpolated(photos);
        let count_before = |time_s: f64| times_s.partition_point(|&photo_s| photo_s < time_s);
        // Without a single stamp there is no band.
        let timed = photos.iter().any(Option::is_some);
        let camera_s = |shot: usize| shots.get(shot).filter(|_| timed).map(|shot| clock.camera_time_s(shot.time_s));
        let mut rows = Vec::with_capacity(shots.len() + 1);
        let (mut low, mut high, mut cells) = (0, 0, 0);
        for row in 0..=shots.len() {
            let before = row.checked_sub(1).and_then(camera_s).map_or(0, |time_s| count_before(time_s - BAND_S));
            let after = camera_s(row).map_or(photos.len(), |time_s| count_before(time_s + BAND_S));
            low = before.max(low);
            high = after.max(high).max(low);
            rows.push((low, high, cells));
            cells += high - low + 1;
        }
        Self { shots, photos, clock, ends, rows, cells }
    }

    fn columns(&self, row: usize) -> std::ops::RangeInclusive<usize> {
        let (low, high, _) = self.rows[row];
        low.max(1)..=high
    }

    fn index(&self, row: usize, column: usize) -> usize {
        let (low, _, start) = self.rows[row];
        start + column - low
    }

    fn holds(&self, row: usize, column: usize) -> bool {
        let (low, high, _) = self.rows[row];
        (low..=high).contains(&column)
    }

    /// At the ends photos come that belong to no capture.
    fn is_open(&self, row: usize) -> bool {
        row == 0 || row == self.shots.len()
    }

    fn ln_pair(&self, shot: usize, photo: usize) -> f64 {
        let shot = &self.shots[shot];
        let fit = self.photos[photo].as_ref().map_or(NO_STAMP, |stamp| self.clock.probability(stamp, shot.time_s));
        (shot.photo_share * fit).max(1e-300).ln()
    }

    fn ln_missed(&self, shot: usize, column: usize) -> f64 {
        let missed = 1.0 - self.shots[shot].photo_share;
        let outside = self.ends == Ends::Open && (column == 0 || column == self.photos.len());
        (if outside { missed.max(OUTSIDE_SHARE) } else { missed }).max(1e-300).ln()
    }

    fn ln_surplus(&self, row: usize, photo: usize) -> f64 {
        if self.is_open(row) {
            return OUTSIDE_SHARE.ln();
        }
        let shot = &self.shots[row - 1];
        let exposed_s = self.clock.camera_time_s(shot.time_s);
        let echo = self.photos[photo]
            .as_ref()
            .map_or(NO_STAMP, |stamp| stamp.probability_between(exposed_s + ECHO_S.0, exposed_s + ECHO_S.1));
        (shot.echo_share * echo + STRAY_SHARE).ln()
    }

    fn forward(&self) -> Vec<Cell> {
        let mut cells = vec![NEVER; self.cells];
        cells[0][PAIR] = 0.0;
        for row in 0..=self.shots.len() {
            let (low, high, _) = self.rows[row];
            for column in low..=high {
                let at = self.index(row, column);
                if row > 0 && column > 0 && self.holds(row - 1, column - 1) {
                    let from = &cells[self.index(row - 1, column - 1)];
                    cells[at][PAIR] = sum3(from) + self.ln_pair(row - 1, column - 1);
                }
                if row > 0 && self.holds(row - 1, column) {
                    let from = &cells[self.index(row - 1, column)];
                    cells[at][MISSED] = sum3(from) + self.ln_missed(row - 1, column);
                }
                if column > low {
                    let from = &cells[at - 1];
                    let before = if self.is_open(row) { sum3(from) } else { sum2(from[PAIR], from[SURPLUS]) };
                    cells[at][SURPLUS] = before + self.ln_surplus(row, column - 1);
                }
            }
        }
        cells
    }

    /// Logarithm of the sum over all ways from a cell to the end, by the move that led to the cell.
    fn backward(&self) -> Vec<Cell> {
        let mut cells = vec![NEVER; self.cells];
        let last = self.shots.len();
        if let Some(end) = cells.last_mut() {
            *end = [0.0; 3];
        }
        for row in (0..=last).rev() {
            let (low, high, _) = self.rows[row];
            for column in (low..=high).rev() {
                let at = self.index(row, column);
                if row == last && column == high {
                    continue;
                }
                let mut by_pair = f64::NEG_INFINITY;
                if row < last && column < self.photos.len() && self.holds(row + 1, column + 1) {
                    by_pair = cells[self.index(row + 1, column + 1)][PAIR] + self.ln_pair(row, column);
                }
                let mut by_missed = f64::NEG_INFINITY;
                if row < last && self.holds(row + 1, column) {
                    by_missed = cells[self.index(row + 1, column)][MISSED] + self.ln_missed(row, column);
                }
                let mut by_surplus = f64::NEG_INFINITY;
                if column < high {
                    by_surplus = cells[at + 1][SURPLUS] + self.ln_surplus(row, column);
                }
                let without_surplus = sum2(by_pair, by_missed);
                let all = sum2(without_surplus, by_surplus);
                cells[at] = [all, if self.is_open(row) { all } else { without_surplus }, all];
            }
        }
        cells
    }
}

/// Logarithm of the sum over all paths: the last row's last column is that of all photos, for the row has no upper limit.
fn end(forward: &[Cell]) -> f64 {
    forward.last().map_or(f64::NEG_INFINITY, sum3)
}

/// Times of photos for the lattice's band; photos without one lie between their neighbours. Never decreasing.
fn interpolated(photos: &[Option<Stamp>]) -> Vec<f64> {
    let known: Vec<(usize, f64)> =
        photos.iter().enumerate().filter_map(|(i, stamp)| Some((i, stamp.as_ref()?.middle_s()))).collect();
    let mut latest_s = f64::NEG_INFINITY;
    (0..photos.len())
        .map(|i| {
            let next = known.partition_point(|&(k, _)| k < i);
            let time_s = match (next.checked_sub(1).map(|k| known[k]), known.get(next)) {
                (_, Some(&(k, time_s))) if k == i => time_s,
                (Some((k0, t0)), Some(&(k1, t1))) => t0 + (t1 - t0) * (i - k0) as f64 / (k1 - k0) as f64,
                (Some((_, time_s)), None) | (None, Some(&(_, time_s))) => time_s,
                (None, None) => 0.0,
            };
            latest_s = latest_s.max(time_s);
            latest_s
        })
        .collect()
}

fn sum2(a: f64, b: f64) -> f64 {
    let (low, high) = if a < b { (a, b) } else { (b, a) };
    if low == f64::NEG_INFINITY { high } else { high + (low - high).exp().ln_1p() }
}

fn sum3(cell: &Cell) -> f64 {
    sum2(sum2(cell[0], cell[1]), cell[2])
}

#[cfg(test)]
mod tests {
    use super::*;

    fn shots(times_s: &[f64]) -> Vec<Shot> {
        times_s.iter().map(|&time_s| Shot { time_s, photo_share: 0.98, echo_share: 0.01 }).collect()
    }

    fn stamps(times_s: &[f64]) -> Vec<Option<Stamp>> {
        times_s.iter().map(|t| Some(Stamp { from_s: t.floor(), resolution_s: 1.0 })).collect()
    }

    const CLOCK: Clock = Clock { offset_s: 0.0, drift: 0.0, middle_s: 0.0, sigma_s: 0.02, latency_sigma_s: 0.08 };

    fn sure_pairs(shots: &[Shot], photos: &[Option<Stamp>]) -> Vec<(usize, usize)> {
        let alignment = align(shots, photos, &CLOCK, Ends::WholeFlight);
        alignment.pairs.iter().filter(|pair| pair.2 > 0.9).map(|pair| (pair.0, pair.1)).collect()
    }

    #[test]
    fn a_missed_shot_and_a_surplus_photo_are_left_alone() {
        let board = shots(&[0.3, 2.4, 4.5, 6.6, 8.7, 10.8]);
        // The shot at 4.5 was missed, that at 8.7 fired twice.
        let photos = stamps(&[0.3, 2.4, 6.6, 8.7, 9.3, 10.8]);
        assert_eq!(sure_pairs(&board, &photos), [(0, 0), (1, 1), (3, 2), (4, 3), (5, 5)]);
    }

    #[test]
    fn photos_before_and_after_the_flight_are_left_alone() {
        let board = shots(&[20.5, 22.5, 24.5]);
        let photos = stamps(&[1.0, 5.0, 20.5, 22.5, 24.5, 60.0, 70.0]);
        assert_eq!(sure_pairs(&board, &photos), [(0, 2), (1, 3), (2, 4)]);
    }

    #[test]
    fn a_photo_without_a_time_is_paired_by_its_place() {
        let board = shots(&[0.5, 2.5, 4.5]);
        let mut photos = stamps(&[0.5, 2.5, 4.5]);
        photos[1] = None;
        assert_eq!(sure_pairs(&board, &photos), [(0, 0), (1, 1), (2, 2)]);
    }

    #[test]
    fn the_probabilities_of_a_shot_s_pairs_never_exceed_one() {
        let board = shots(&[0.5, 1.0, 1.5, 2.0]);
        let photos = stamps(&[0.5, 1.2, 1.4, 2.0, 2.2]);
        let alignment = align(&board, &photos, &CLOCK, Ends::Open);
        for shot in 0..4 {
            let sum: f64 = alignment.pairs.iter().filter(|pair| pair.0 == shot).map(|pair| pair.2).sum();
            assert!(sum <= 1.0 + 1e-9, "{sum}");
        }
    }

    /// Sums all ways from a cell to the end, and those that pair shot 1 with photo 1.
    fn walk(
        lattice: &Lattice<'_>,
        row: usize,
        column: usize,
        last: usize,
        ln: f64,
        pair: Option<(usize, usize)>,
        sums: &mut (f64, f64),
    ) {
        if row == 3 && column == 4 {
            sums.0 += ln.exp();
            if pair == Some((usize::MAX, 0)) {
                sums.1 += ln.exp();
            }
            return;
        }
        if row < 3 && column < 4 {
            let found = if (row, column) == (1, 1) { Some((usize::MAX, 0)) } else { pair };
            walk(lattice, row + 1, column + 1, PAIR, ln + lattice.ln_pair(row, column), found, sums);
        }
        if row < 3 {
            walk(lattice, row + 1, column, MISSED, ln + lattice.ln_missed(row, column), pair, sums);
        }
        if column < 4 && (last != MISSED || lattice.is_open(row)) {
            walk(lattice, row, column + 1, SURPLUS, ln + lattice.ln_surplus(row, column), pair, sums);
        }
    }

    /// All pairings one by one, against the lattice's sums.
    #[test]
    fn the_sums_agree_with_listing_every_pairing() {
        let board = shots(&[0.9, 1.6, 2.7]);
        let photos = stamps(&[1.0, 1.4, 2.1, 2.9]);
        let clock = CLOCK;
        let lattice = Lattice::new(&board, &photos, &clock, Ends::WholeFlight);
        let mut sums = (0.0, 0.0);
        walk(&lattice, 0, 0, PAIR, 0.0, None, &mut sums);
        let alignment = align(&board, &photos, &CLOCK, Ends::WholeFlight);
        assert!((alignment.ln_evidence - sums.0.ln()).abs() < 1e-9);
        let listed = alignment.pairs.iter().find(|pair| (pair.0, pair.1) == (1, 1)).map_or(0.0, |pair| pair.2);
        assert!((listed - sums.1 / sums.0).abs() < 1e-9, "{listed} {}", sums.1 / sums.0);
    }
}
