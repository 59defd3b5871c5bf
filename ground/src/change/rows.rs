//! Values over the unrolled wall, and their means around each place.

use std::ops::Range;

use rayon::prelude::*;

/// Values on rows of a grid, once around; NaN where not seen.
pub(super) struct Rows {
    pub(super) columns: usize,
    pub(super) data: Vec<f32>,
}

impl Rows {
    /// `value` gets column and row.
    pub(super) fn from_fn(columns: usize, rows: Range<usize>, value: impl Fn(usize, usize) -> f32 + Sync) -> Self {
        let data = rows
            .into_par_iter()
            .flat_map_iter(|row| {
                let value = &value;
                (0..columns).map(move |column| value(column, row))
            })
            .collect();
        Self { columns, data }
    }

    pub(super) fn rows(&self) -> usize {
        self.data.len() / self.columns
    }

    pub(super) fn map(&self, other: &Self, f: impl Fn(f32, f32) -> f32 + Sync) -> Self {
        let data = self.data.par_iter().zip(&other.data).map(|(a, b)| f(*a, *b)).collect();
        Self { columns: self.columns, data }
    }

    /// Mean of the seen values within `reach` texels, around the wall; NaN where the middle is not seen.
    pub(super) fn mean(&self, reach: usize) -> Self {
        self.mean_without(reach, &[])
    }

    /// The same over the values that are not skipped (none are if `skipped` is empty).
    pub(super) fn mean_without(&self, reach: usize, skipped: &[bool]) -> Self {
        let sums = self.sums(reach, skipped);
        let mean = |(&here, [sum, count]): (&f32, [f32; 2])| if here.is_nan() { f32::NAN } else { sum / count };
        Self { columns: self.columns, data: self.data.iter().zip(sums).map(mean).collect() }
    }

    /// Share of the square within `reach` texels that is seen; what lies beyond the rows is not.
    pub(super) fn seen_share(&self, reach: usize) -> Self {
        let square = (2 * reach + 1).pow(2) as f32;
        let data = self.sums(reach, &[]).into_iter().map(|[_, count]| count / square).collect();
        Self { columns: self.columns, data }
    }

    /// Sum and number of the seen values within `reach` texels of each place, around the wall.
    fn sums(&self, reach: usize, skipped: &[bool]) -> Vec<[f32; 2]> {
        let (columns, rows) = (self.columns, self.rows());
        let across = reach.min((columns - 1) / 2);
        let along: Vec<[f32; 2]> = (0..rows)
            .into_par_iter()
            .flat_map_iter(|row| {
                let line = &self.data[row * columns..(row + 1) * columns];
                let term = move |column: usize| {
                    let value = line[column % columns];
                    let skip = skipped.get(row * columns + column % columns).is_some_and(|&skip| skip);
                    if skip || value.is_nan() { [0.0, 0.0] } else { [value, 1.0] }
                };
                let mut sum = (0..2 * across).map(|offset| term(columns + offset - across)).fold([0.0; 2], add);
                (0..columns).map(move |column| {
                    sum = add(sum, term(column + across));
                    let here = sum;
                    let gone = term(column + columns - across);
                    sum = [sum[0] - gone[0], sum[1] - gone[1]];
                    here
                })
            })
            .collect();
        // Down the rows in double precision: a running sum over many rows would drift in single.
        let mut running = vec![[0.0_f64; 2]; columns];
        let shift = |running: &mut [[f64; 2]], row: usize, sign: f64| {
            for (sum, term) in running.iter_mut().zip(&along[row * columns..(row + 1) * columns]) {
                *sum = [sum[0] + sign * f64::from(term[0]), sum[1] + sign * f64::from(term[1])];
            }
        };
        (0..reach.min(rows)).for_each(|row| shift(&mut running, row, 1.0));
        let mut sums = Vec::with_capacity(self.data.len());
        for row in 0..rows {
            if row + reach < rows {
                shift(&mut running, row + reach, 1.0);
            }
            if let Some(gone) = row.checked_sub(reach + 1) {
                shift(&mut running, gone, -1.0);
            }
            sums.extend(running.iter().map(|sum| sum.map(|sum| sum as f32)));
        }
        sums
    }
}

fn add(a: [f32; 2], b: [f32; 2]) -> [f32; 2] {
    [a[0] + b[0], a[1] + b[1]]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn means_are_those_of_the_seen_values_around_the_wall() {
        let rows =
            Rows::from_fn(7, 0..5, |column, row| if column == 3 { f32::NAN } else { (column * row * row) as f32 });
        let (mean, share) = (rows.mean(1), rows.seen_share(1));
        for (at, (&mean, &share)) in mean.data.iter().zip(&share.data).enumerate() {
            let (row, column) = (at / 7, at % 7);
            let near = (row.saturating_sub(1)..(row + 2).min(5))
                .flat_map(|row| [6, 7, 8].map(|step| (row, (column + step) % 7)));
            let seen: Vec<f32> =
                near.map(|(row, column)| rows.data[row * 7 + column]).filter(|value| !value.is_nan()).collect();
            let expected = seen.iter().sum::<f32>() / seen.len() as f32;
            assert!(if column == 3 { mean.is_nan() } else { (mean - expected).abs() < 1e-4 }, "{row} {column}: {mean}");
            assert!((share - seen.len() as f32 / 9.0).abs() < 1e-6, "{row} {column}: {share}");
        }
    }
}
