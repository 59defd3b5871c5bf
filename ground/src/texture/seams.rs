//! Where one photo gives way to another: along low differences between the two.
//!
//! Every mid cell takes one of the photos that show it nearly best. The choice minimises, over the lattice, the quality
//! given up plus, between neighbours that take different photos, the difference of the two photos there (the seam cost
//! of Kwatra et al., "Graphcut Textures", 2003). From a first choice rows and columns are improved in turn, each exactly by
//! dynamic programming with its neighbours held (Viterbi; the circular rows held at one cell), alternate ones at a time, so
//! that the cost never rises and threads do not matter. Such sweeps do not move a seam as a whole, so they start twice, and
//! the cheaper end is taken: from the best photo everywhere, and from rows chosen one after the other, each against the one
//! above. It is no global optimum. Rows that an earlier strip has settled stay as they are: strips agree, and memory holds
//! one strip.

use rayon::prelude::*;

use super::blend::Band;
use super::layer::Layer;

/// A photo may be taken where its quality is at least this share of the best photo's.
pub(super) const SEAM_SHARE: f32 = 0.8;
/// Grey levels of difference along one cell of a seam that are worth giving up all quality in one cell: an equally good
/// photo costs nothing, one with 10 % fewer pixels per metre 1 level.
const QUALITY_COST: f32 = 10.0;
/// Cost of a seam per cell beside the difference, grey levels: keeps seams short where photos agree anyway.
const LENGTH_COST: f32 = 0.5;
/// Cost per cell of a seam between photos that do not both show the place, grey levels.
const BLIND_COST: f32 = 20.0;
/// Rounds over rows and columns; a third moves less than 1 % of the seams.
const ROUNDS: usize = 2;
/// How far the choice is carried beyond what any photo shows, in mid cells.
pub(super) const BLEED_CELLS: usize = 2;

/// No photo shows the cell.
pub(super) const NO_PHOTO: u32 = u32::MAX;
const NO_CHOICE: u8 = u8::MAX;

/// The photo (its number among the candidates) taken in each mid cell of a band, all around the wall.
pub(super) struct Labelling {
    pub(super) band: Band,
    pub(super) photos: Vec<u32>,
}

/// A photo that a cell may take.
#[derive(Clone, Copy)]
struct Alternative {
    photo: u32,
    cost: f32,
    colour: [f32; 3],
}

/// What the cells of a row may take.
struct RowAlternatives {
    /// Where each cell's begin in `all`; one more at the end.
    first: Vec<u32>,
    all: Vec<Alternative>,
}

impl RowAlternatives {
    fn new(layers: &[(u32, &Layer)], row: usize, columns: usize) -> Self {
        let scores = |layer: &Layer| {
            let region = layer.region.finer();
            (region.row0..region.row_end()).contains(&row).then(|| {
                let start = (row - region.row0) * region.columns;
                (region.column0, start..start + region.columns)
            })
        };
        let wrapped = |column0: i64, offset: usize| (column0 + offset as i64).rem_euclid(columns as i64) as usize;
        let mut best = vec![0.0_f32; columns];
        for (_, layer) in layers {
            let Some((column0, cells)) = scores(layer) else { continue };
            for (offset, &score) in layer.score[cells].iter().enumerate() {
                let at = wrapped(column0, offset);
                best[at] = best[at].max(score);
            }
        }
        let mut found: Vec<(usize, Alternative)> = Vec::new();
        for &(photo, layer) in layers {
            let Some((column0, cells)) = scores(layer) else { continue };
            for (offset, cell) in cells.enumerate() {
                let at = wrapped(column0, offset);
                let score = layer.score[cell];
                if score > 0.0 && score >= SEAM_SHARE * best[at] {
                    let [red, green, blue, _] = layer.colour[cell];
                    let cost = QUALITY_COST * (1.0 - score / best[at]);
                    found.push((at, Alternative { photo, cost, colour: [red, green, blue] }));
                }
            }
        }
        let mut first = vec![0; columns + 1];
        for (at, _) in &found {
            first[at + 1] += 1;
        }
        for column in 0..columns {
            first[column + 1] += first[column];
        }
        // Stable, so that a cell's options stay in the order of the photos.
        found.sort_by_key(|(at, _)| *at);
        Self { first, all: found.into_iter().map(|(_, option)| option).collect() }
    }

    fn at(&self, column: usize) -> &[Alternative] {
        &self.all[self.first[column] as usize..self.first[column + 1] as usize]
    }
}

/// Cost between neighbouring cells that take their `i`-th and `j`-th option.
fn seam_cost(one: &[Alternative], i: usize, other: &[Alternative], j: usize) -> f32 {
    let (a, b) = (&one[i], &other[j]);
    if a.photo == b.photo {
        return 0.0;
    }
    let differences = [
        one.iter().find(|option| option.photo == b.photo).map(|option| difference(a, option)),
        other.iter().find(|option| option.photo == a.photo).map(|option| difference(b, option)),
    ];
    let known = differences.iter().flatten().count();
    let sum: f32 = differences.iter().flatten().sum();
    LENGTH_COST + if known > 0 { sum / known as f32 } else { BLIND_COST }
}

fn difference(a: &Alternative, b: &Alternative) -> f32 {
    a.colour.iter().zip(b.colour).map(|(a, b)| (a - b).abs()).sum::<f32>() / 3.0
}

/// Chooses the cheapest option for each cell of a chain of neighbours; `costs`: of all cells' options, one after another.
fn cheapest_chain(cells: &[&[Alternative]], costs: &[f32]) -> Vec<u8> {
    let mut totals = costs.to_vec();
    let mut back = vec![0_u8; costs.len()];
    let mut start = 0;
    let mut before: &[Alternative] = &[];
    for options in cells {
        let from = start - before.len();
        for j in 0..options.len() {
            let ways = (0..before.len()).map(|i| (i, totals[from + i] + seam_cost(before, i, options, j)));
            if let Some((i, total)) = ways.min_by(|a, b| a.1.total_cmp(&b.1)) {
                back[start + j] = i as u8;
                totals[start + j] += total;
            }
        }
        start += options.len();
        before = options;
    }
    let mut chosen = vec![NO_CHOICE; cells.len()];
    let mut forced = None;
    let mut end = costs.len();
    for (cell, options) in cells.iter().enumerate().rev() {
        let start = end - options.len();
        let cheapest = (start..end).min_by(|&a, &b| totals[a].total_cmp(&totals[b])).map(|at| at - start);
        if let Some(choice) = forced.or(cheapest) {
            chosen[cell] = choice as u8;
            let linked = cell > 0 && !cells[cell - 1].is_empty();
            forced = linked.then(|| usize::from(back[start + choice]));
        }
        end = start;
    }
    chosen
}

/// A band's options and what is chosen of them.
#[derive(Clone)]
struct Lattice<'a> {
    columns: usize,
    options: &'a [RowAlternatives],
    chosen: Vec<u8>,
}

impl Lattice<'_> {
    fn alternatives(&self, row: usize, column: usize) -> &[Alternative] {
        self.options[row].at(column)
    }

    /// Adds to `costs` (of one cell's options) those between the cell and a neighbour as it is.
    fn add_neighbour(&self, cell: (usize, usize), neighbour: (usize, usize), costs: &mut [f32]) {
        let (own, other) = (self.alternatives(cell.0, cell.1), self.alternatives(neighbour.0, neighbour.1));
        let chosen = self.chosen[neighbour.0 * self.columns + neighbour.1];
        if chosen != NO_CHOICE {
            for (i, cost) in costs.iter_mut().enumerate() {
                *cost += seam_cost(own, i, other, usize::from(chosen));
            }
        }
    }

    /// The best choice for a row with the rows beside it held; its first cell is held too, because the row is a circle.
    fn row(&self, row: usize) -> Vec<u8> {
        let cells: Vec<&[Alternative]> = (0..self.columns).map(|column| self.alternatives(row, column)).collect();
        let mut costs: Vec<f32> = self.options[row].all.iter().map(|option| option.cost).collect();
        let mut start = 0;
        for (column, options) in cells.iter().enumerate() {
            let own = &mut costs[start..start + options.len()];
            if row > 0 {
                self.add_neighbour((row, column), (row - 1, column), own);
            }
            if row + 1 < self.options.len() {
                self.add_neighbour((row, column), (row + 1, column), own);
            }
            if column == 0 {
                let held = self.chosen[row * self.columns];
                for (i, cost) in own.iter_mut().enumerate() {
                    if i != usize::from(held) {
                        *cost = f32::INFINITY;
                    }
                }
            } else if column + 1 == self.columns {
                self.add_neighbour((row, column), (row, 0), own);
            }
            start += options.len();
        }
        cheapest_chain(&cells, &costs)
    }

    /// The best choice for a column from row `from` on, with everything else held.
    fn column(&self, column: usize, from: usize) -> Vec<u8> {
        let cells: Vec<&[Alternative]> = (from..self.options.len()).map(|row| self.alternatives(row, column)).collect();
        let mut costs = Vec::new();
        for (row, options) in (from..).zip(&cells) {
            let start = costs.len();
            costs.extend(options.iter().map(|option| option.cost));
            let own = &mut costs[start..];
            self.add_neighbour((row, column), (row, (column + 1) % self.columns), own);
            self.add_neighbour((row, column), (row, (column + self.columns - 1) % self.columns), own);
            if row == from && row > 0 {
                self.add_neighbour((row, column), (row - 1, column), own);
            }
        }
        cheapest_chain(&cells, &costs)
    }

    /// Takes the best photo in each cell of the rows from `from` on.
    fn take_best(&mut self, from: usize) {
        for at in from * self.columns..self.chosen.len() {
            let options = self.alternatives(at / self.columns, at % self.columns);
            let best = (0..options.len()).min_by(|&a, &b| options[a].cost.total_cmp(&options[b].cost));
            self.chosen[at] = best.map_or(NO_CHOICE, |choice| choice as u8);
        }
    }

    /// What the rows from `from` on cost.
    fn cost(&self, from: usize) -> f64 {
        let cell = |row: usize, column: usize| {
            let options = self.alternatives(row, column);
            let chosen = usize::from(self.chosen[row * self.columns + column]);
            let mut cost = options.get(chosen)?.cost;
            let left = (row, (column + self.columns - 1) % self.columns);
            for neighbour in [Some(left), row.checked_sub(1).map(|above| (above, column))].into_iter().flatten() {
                let other = self.alternatives(neighbour.0, neighbour.1);
                let taken = self.chosen[neighbour.0 * self.columns + neighbour.1];
                if taken != NO_CHOICE {
                    cost += seam_cost(options, chosen, other, usize::from(taken));
                }
            }
            Some(f64::from(cost))
        };
        let row_cost = |row: usize| -> f64 { (0..self.columns).filter_map(|column| cell(row, column)).sum() };
        (from..self.options.len()).map(row_cost).sum()
    }

    /// Chooses rows from `from` on, each with regard to the one above.
    fn descend(&mut self, from: usize) {
        for row in from..self.options.len() {
            let first = self.alternatives(row, 0);
            let mut costs: Vec<f32> = first.iter().map(|alternative| alternative.cost).collect();
            if row > 0 {
                self.add_neighbour((row, 0), (row - 1, 0), &mut costs);
            }
            let cheapest = (0..costs.len()).min_by(|&a, &b| costs[a].total_cmp(&costs[b]));
            self.chosen[row * self.columns] = cheapest.map_or(NO_CHOICE, |choice| choice as u8);
            let found = self.row(row);
            self.chosen[row * self.columns..][..self.columns].copy_from_slice(&found);
        }
    }

    fn optimise(&mut self, from: usize) {
        for _ in 0..ROUNDS {
            for parity in 0..2 {
                let rows: Vec<usize> = (from..self.options.len()).filter(|row| row % 2 == parity).collect();
                let found: Vec<Vec<u8>> = rows.par_iter().map(|&row| self.row(row)).collect();
                for (row, found) in rows.into_iter().zip(found) {
                    self.chosen[row * self.columns..][..self.columns].copy_from_slice(&found);
                }
            }
            // Columns are a multiple of four, so that the last and the first are of different parity.
            for parity in 0..2 {
                let columns: Vec<usize> = (parity..self.columns).step_by(2).collect();
                let found: Vec<Vec<u8>> = columns.par_iter().map(|&column| self.column(column, from)).collect();
                for (column, found) in columns.into_iter().zip(found) {
                    for (row, choice) in (from..).zip(found) {
                        self.chosen[row * self.columns + column] = choice;
                    }
                }
            }
        }
    }
}

impl Labelling {
    /// Chooses for a band; rows that `before`, the choice of the strip above, holds too are taken from there.
    pub(super) fn new(layers: &[(u32, &Layer)], band: Band, before: Option<&Self>) -> Self {
        let (columns, row0) = (band.mid_columns(), band.mid_row0());
        let options: Vec<RowAlternatives> = (row0..row0 + band.mid_rows())
            .into_par_iter()
            .map(|row| RowAlternatives::new(layers, row, columns))
            .collect();
        let settled = before.map_or(&[][..], |before| before.since_row(row0));
        let settled_rows = settled.len() / columns;
        let mut lattice = Lattice { columns, options: &options, chosen: vec![NO_CHOICE; columns * band.mid_rows()] };
        for (at, photo) in settled.iter().enumerate() {
            let options = lattice.options[at / columns].at(at % columns);
            let choice = options.iter().position(|option| option.photo == *photo);
            lattice.chosen[at] = choice.map_or(NO_CHOICE, |choice| choice as u8);
        }
        let mut descended = lattice.clone();
        lattice.take_best(settled_rows);
        descended.descend(settled_rows);
        lattice.optimise(settled_rows);
        descended.optimise(settled_rows);
        if descended.cost(settled_rows) < lattice.cost(settled_rows) {
            lattice = descended;
        }
        let chosen = |at: usize| {
            let options = lattice.options[at / columns].at(at % columns);
            options.get(usize::from(lattice.chosen[at])).map_or(NO_PHOTO, |option| option.photo)
        };
        let mut photos = settled.to_vec();
        photos.extend((settled.len()..columns * band.mid_rows()).map(chosen));
        Self { band, photos }
    }

    /// Cells from a row on, if they begin in this choice.
    fn since_row(&self, row: usize) -> &[u32] {
        let start = row.checked_sub(self.band.mid_row0()).map(|rows| rows * self.band.mid_columns());
        start.and_then(|start| self.photos.get(start..)).unwrap_or(&[])
    }

    /// The choice carried on by [`BLEED_CELLS`] beyond what any photo shows.
    pub(super) fn grown(&self) -> Vec<u32> {
        (0..BLEED_CELLS).fold(self.photos.clone(), |photos, _| grow(&photos, self.band.mid_columns()))
    }
}

/// Gives cells without a photo that of a neighbour.
fn grow(photos: &[u32], columns: usize) -> Vec<u32> {
    let rows = photos.len() / columns;
    let mut grown = photos.to_vec();
    grown.par_chunks_mut(columns).enumerate().for_each(|(row, line)| {
        for (column, photo) in line.iter_mut().enumerate().filter(|(_, photo)| **photo == NO_PHOTO) {
            let across = [(column + columns - 1) % columns, column, (column + 1) % columns];
            *photo = (row.saturating_sub(1)..(row + 2).min(rows))
                .flat_map(|line| across.map(|column| photos[line * columns + column]))
                .min()
                .unwrap_or(NO_PHOTO);
        }
    });
    grown
}

#[cfg(test)]
mod tests {
    use super::super::grid::Region;
    use super::*;

    const BAND: Band = Band { columns: 12, row0: 0, rows: 4 };

    /// A photo over all rows and columns `from..to` (mid cells), its colour and its quality a function of the mid column and row.
    fn layer(
        columns: std::ops::Range<usize>,
        colour: impl Fn(usize, usize) -> f32,
        score: impl Fn(usize) -> f32,
    ) -> Layer {
        let region = Region { column0: columns.start as i64 / 4, columns: columns.len() / 4, row0: 0, rows: BAND.rows };
        let cells = (0..BAND.mid_rows()).flat_map(|row| columns.clone().map(move |column| (row, column)));
        Layer {
            region,
            colour: cells.clone().map(|(row, column)| [colour(column, row); 4]).collect(),
            score: cells.map(|(_, column)| score(column)).collect(),
            octaves: Vec::new(),
            low: Vec::new(),
            low_weight: Vec::new(),
        }
    }

    /// Two photos over half the circle: they agree but for a stripe of ten columns around the place where their qualities are equal.
    fn photos() -> [Layer; 2] {
        let odd = |column: usize| if (19..29).contains(&column) { 30.0 } else { 0.0 };
        let left = layer(0..48, |_, _| 100.0, |column| if column < 40 { 1.0 - 0.004 * column as f32 } else { 0.0 });
        let right = layer(
            0..48,
            move |column, _| 100.0 + odd(column),
            |column| if column >= 8 { 0.808 + 0.004 * column as f32 } else { 0.0 },
        );
        [left, right]
    }

    #[test]
    fn a_seam_keeps_away_from_where_two_photos_differ() {
        let [left, right] = photos();
        let labelling = Labelling::new(&[(3, &left), (7, &right)], BAND, None);
        for row in labelling.photos.chunks_exact(48) {
            let seam = row.iter().position(|&photo| photo == 7).unwrap();
            // Equal quality at column 24, in the middle of the stripe; the seam goes to its nearer end.
            assert!((18..=19).contains(&seam) || (29..=30).contains(&seam), "{row:?}");
        }
    }

    #[test]
    fn without_differences_the_better_photo_is_taken() {
        let [left, _] = photos();
        let right = layer(0..48, |_, _| 100.0, |column| 0.808 + 0.004 * column as f32);
        let labelling = Labelling::new(&[(0, &left), (1, &right)], BAND, None);
        let seam = labelling.photos[..48].iter().position(|&photo| photo == 1).unwrap();
        assert!((22..=26).contains(&seam), "{seam}");
    }

    #[test]
    fn what_an_earlier_strip_chose_stays() {
        let [left, right] = photos();
        let upper = Band { rows: 2, ..BAND };
        let mut before = Labelling::new(&[(0, &left), (1, &right)], upper, None);
        before.photos.fill(0);
        let after = Labelling::new(&[(0, &left), (1, &right)], BAND, Some(&before));
        assert_eq!(after.photos[..before.photos.len()], before.photos);
        assert!(after.photos[before.photos.len()..].contains(&1));
    }

    #[test]
    fn a_chain_costs_no_more_than_any_other_choice() {
        let option = |photo: u32, cost: f32, level: f32| Alternative { photo, cost, colour: [level; 3] };
        let cells: Vec<Vec<Alternative>> = (0..6_usize)
            .map(|cell| {
                (0..3_u32)
                    .map(|photo| {
                        option(
                            photo,
                            ((cell * 7 + photo as usize * 5) % 11) as f32,
                            ((cell * 3 + photo as usize * 8) % 13) as f32,
                        )
                    })
                    .collect()
            })
            .collect();
        let slices: Vec<&[Alternative]> = cells.iter().map(Vec::as_slice).collect();
        let costs: Vec<f32> = cells.iter().flatten().map(|option| option.cost).collect();
        let total = |chosen: &[u8]| {
            let own: f32 = chosen.iter().zip(&cells).map(|(&at, cell)| cell[usize::from(at)].cost).sum();
            let pairs: f32 =
                (1..6).map(|k| seam_cost(slices[k - 1], chosen[k - 1].into(), slices[k], chosen[k].into())).sum();
            own + pairs
        };
        let found = total(&cheapest_chain(&slices, &costs));
        for code in 0..729_u32 {
            let other: Vec<u8> = (0..6).map(|cell| (code / 3_u32.pow(cell) % 3) as u8).collect();
            assert!(found <= total(&other) + 1e-4, "{found} against {other:?}");
        }
    }

    #[test]
    fn cells_without_a_photo_take_a_neighbours() {
        let mut photos = vec![NO_PHOTO; 25];
        photos[12] = 5;
        let grown = grow(&photos, 5);
        assert_eq!(grown.iter().filter(|&&photo| photo == 5).count(), 9);
    }
}
