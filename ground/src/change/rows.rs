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
        let (columns, rows) = (self.columns, self.rows());
        let along: Vec<[f32; 2]> = (0..rows)
            .into_par_iter()
            .flat_map_iter(|row| {
                let line = &self.data[row * columns..(row + 1) * columns];
                let term = move |column: usize| {
                    let value = line[column % columns];
                    let skip = skipped.get(row * columns + column % columns).is_some_and(|&skip| skip);
                    if skip || value.is_nan() { [0.0, 0.0] } else { [value, 1.0] }
                };
                let reach = reach.min((columns - 1) / 2);
                let mut sum = (0..2 * reach).map(|offset| term(columns + offset - reach)).fold([0.0; 2], add);
                (0..columns).map(move |column| {
                    sum = add(sum, term(column + reach));
                    let here = sum;
                    let gone = term(column + columns - reach);
                    sum = [sum[0] - gone[0], sum[1] - gone[1]];
                    here
                })
            })
            .collect();
        let column_mean = |index: usize| {
            let (row, column) = (index / columns, index % columns);
            if self.data[index].is_nan() {
                return f32::NAN;
            }
            let near = row.saturating_sub(reach)..(row + reach + 1).min(rows);
            let [sum, count] = near.map(|row| along[row * columns + column]).fold([0.0; 2], add);
            sum / count
        };
        let data = (0..self.data.len()).into_par_iter().map(column_mean).collect();
        Self { columns, data }
    }
}

fn add(a: [f32; 2], b: [f32; 2]) -> [f32; 2] {
    [a[0] + b[0], a[1] + b[1]]
}
