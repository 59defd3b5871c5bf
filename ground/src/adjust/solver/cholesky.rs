//! The Cholesky factor of an [`Envelope`], solutions, and those entries of the inverse that lie in the envelope.

use std::ops::Range;

use nalgebra::DMatrix;
use pulp::{Arch, Simd, WithSimd};
use rayon::prelude::*;

use super::envelope::{Block, Envelope, TILE};

/// Blocks of rows whose products with all earlier blocks are worked out side by side.
const PANEL: usize = 8;

/// The matrix was not positive definite.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[error("the normal equations are not positive definite at row {row} (pivot {pivot:e})")]
pub struct NotPositiveDefinite {
    /// Row of the failing pivot.
    pub row: usize,
    /// Its value.
    pub pivot: f64,
}

/// The Cholesky factor `L`, in the envelope of its matrix.
#[derive(Clone, Debug)]
pub(crate) struct Factor(Envelope);

impl Factor {
    /// Factors a matrix in place into `L L^T`.
    ///
    /// # Errors
    /// [`NotPositiveDefinite`] names the failing pivot.
    pub(crate) fn new(mut matrix: Envelope) -> Result<Self, NotPositiveDefinite> {
        let count = matrix.blocks().len();
        for start in (0..count).step_by(PANEL) {
            let panel = start..(start + PANEL).min(count);
            let (blocks, done, own) = matrix.split_run(panel.clone());
            own.into_par_iter().zip(panel.clone()).for_each(|(own, index)| {
                Arch::new().dispatch(Ahead { block: &blocks[index], own, before: &blocks[..start], done });
            });
            Arch::new().dispatch(Within { matrix: &mut matrix, panel })?;
        }
        Ok(Self(matrix))
    }

    /// Gives the storage back, for the next matrix of the same envelope.
    pub(super) fn into_storage(self) -> Envelope {
        self.0
    }

    /// Solves `L L^T x = b` in place.
    pub(crate) fn solve(&self, b: &mut [f64]) {
        let blocks = self.0.blocks();
        for (index, block) in blocks.iter().enumerate() {
            for offset in 0..block.height {
                let (row, i) = (self.0.row(index, offset), block.row + offset);
                let before = i - block.column();
                let sum: f64 = row[..before].iter().zip(&b[block.column()..i]).map(|(l, x)| l * x).sum();
                b[i] = (b[i] - sum) / row[before];
            }
        }
        for (index, block) in blocks.iter().enumerate().rev() {
            for offset in (0..block.height).rev() {
                let (row, i) = (self.0.row(index, offset), block.row + offset);
                let before = i - block.column();
                b[i] /= row[before];
                let x = b[i];
                for (value, l) in b[block.column()..i].iter_mut().zip(row) {
                    *value -= l * x;
                }
            }
        }
    }

    /// Returns the diagonal blocks of the inverse, in the order of the rows.
    ///
    /// Takahashi's recursion: entries of the inverse inside the envelope need only entries inside it, so the cost is that of
    /// a few factorisations, linear in the tunnel's length. Erisman & Tinney, "On Computing Certain Elements of the Inverse
    /// of a Sparse Matrix", 1975.
    pub(super) fn inverse_diagonal(&self) -> Vec<DMatrix<f64>> {
        let blocks = self.0.blocks();
        let mut inverse = self.0.clone();
        // Rows below a column block, found as their first column is passed.
        let mut below: Vec<Vec<usize>> = vec![Vec::new(); blocks.len()];
        for (index, block) in blocks.iter().enumerate() {
            for column in &mut below[block.first..index] {
                column.push(index);
            }
        }
        let mut diagonal = vec![DMatrix::zeros(0, 0); blocks.len()];
        for column in (0..blocks.len()).rev() {
            diagonal[column] = self.invert_column(column, &below[column], &mut inverse);
        }
        diagonal
    }

    /// Fills a block column of the inverse, given all later ones.
    fn invert_column(&self, column: usize, below: &[usize], inverse: &mut Envelope) -> DMatrix<f64> {
        let blocks = self.0.blocks();
        let Block { row: first, height: width, .. } = blocks[column];
        let own = DMatrix::from_fn(width, width, |i, j| {
            if j <= i { self.0.part(column, i, first + j..first + j + 1)[0] } else { 0.0 }
        });
        // A pivot is positive, or the factor would not exist.
        let own_inverse = own
            .solve_lower_triangular(&DMatrix::identity(width, width))
            .unwrap_or_else(|| DMatrix::zeros(width, width));
        // X = L_below L_own^-1, as one block per row block.
        let scaled: Vec<DMatrix<f64>> = below
            .iter()
            .map(|&index| {
                let part = DMatrix::from_fn(blocks[index].height, width, |i, j| {
                    self.0.part(index, i, first + j..first + j + 1)[0]
                });
                part * &own_inverse
            })
            .collect();
        let mut products: Vec<DMatrix<f64>> =
            below.iter().map(|&index| DMatrix::zeros(blocks[index].height, width)).collect();
        for (i, &row) in below.iter().enumerate() {
            for (j, &other) in below[..=i].iter().enumerate() {
                if blocks[row].first > other {
                    continue;
                }
                let Block { row: start, height, .. } = blocks[other];
                let known = DMatrix::from_fn(blocks[row].height, height, |a, b| {
                    let (a, b) = if row == other && b > a { (b, a) } else { (a, b) };
                    inverse.part(row, a, start + b..start + b + 1)[0]
                });
                products[i].gemm(-1.0, &known, &scaled[j], 1.0);
                if i != j {
                    products[j].gemm_tr(-1.0, &known, &scaled[i], 1.0);
                }
            }
        }
        let mut square = own_inverse.tr_mul(&own_inverse);
        for (index, (&row, product)) in below.iter().zip(&products).enumerate() {
            square.gemm_tr(-1.0, &scaled[index], product, 1.0);
            for a in 0..blocks[row].height {
                let target = inverse.part_mut(row, a, first..first + width);
                for (b, value) in target.iter_mut().enumerate() {
                    *value = product[(a, b)];
                }
            }
        }
        for a in 0..width {
            for b in 0..width {
                inverse.part_mut(column, a, first + b..first + b + 1)[0] = square[(a, b)];
            }
        }
        square
    }
}

/// Solves for the rows of a block over the blocks before it of which the rows are done.
struct Ahead<'a> {
    block: &'a Block,
    own: &'a mut [f64],
    before: &'a [Block],
    done: &'a [f64],
}

impl WithSimd for Ahead<'_> {
    type Output = ();

    #[expect(clippy::inline_always, reason = "inlined into the dispatch, else it is compiled without its vectors")]
    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        for before in self.before.get(self.block.first..).unwrap_or_default() {
            subtract_products(simd, self.block, self.own, before, self.done);
            solve_right(self.block, self.own, before, self.done);
        }
    }
}

/// Factors the rest of a panel, of which the blocks ahead of it are worked out.
struct Within<'a> {
    matrix: &'a mut Envelope,
    panel: Range<usize>,
}

impl WithSimd for Within<'_> {
    type Output = Result<(), NotPositiveDefinite>;

    #[expect(clippy::inline_always, reason = "inlined into the dispatch, else it is compiled without its vectors")]
    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> Self::Output {
        for index in self.panel.clone() {
            let (blocks, done, own) = self.matrix.split_at(index);
            let block = blocks[index];
            for before in &blocks[block.first.max(self.panel.start)..index] {
                subtract_products(simd, &block, own, before, done);
                solve_right(&block, own, before, done);
            }
            factor_square(simd, &block, own)?;
        }
        Ok(())
    }
}

/// Subtracts the products of the rows of `block` and of `before` over the columns ahead of `before`.
#[expect(clippy::inline_always, reason = "inlined into the dispatch, else it is compiled without its vectors")]
#[inline(always)]
fn subtract_products<S: Simd>(simd: S, block: &Block, own: &mut [f64], before: &Block, done: &[f64]) {
    let from = block.column().max(before.column());
    let length = before.row - from;
    if length == 0 {
        return;
    }
    let start = block.at(0, block.column());
    for a in (0..block.height).step_by(TILE) {
        let rows = [0, 1, 2].map(|i| block.at(a + i, from) - start);
        for b in (0..before.height).step_by(TILE) {
            let others = [0, 1, 2].map(|i| before.at(b + i, from));
            let sums =
                products(simd, rows.map(|row| &own[row..row + length]), others.map(|row| &done[row..row + length]));
            for (row, sums) in rows.iter().zip(sums) {
                let target = row + length + b;
                for (value, sum) in own[target..target + TILE].iter_mut().zip(sums) {
                    *value -= sum;
                }
            }
        }
    }
}

/// Solves `X L^T = A` for the columns of `before`, in place; the rows of `block` side by side, since each waits for itself only.
fn solve_right(block: &Block, own: &mut [f64], before: &Block, done: &[f64]) {
    let start = block.at(0, block.column());
    for b in 0..before.height {
        let other = before.at(b, before.row);
        let other = &done[other..=other + b];
        let reciprocal = 1.0 / other[b];
        for a in 0..block.height {
            let row = block.at(a, before.row) - start;
            let row = &mut own[row..=row + b];
            let sum: f64 = row[..b].iter().zip(other).map(|(x, l)| x * l).sum();
            row[b] = (row[b] - sum) * reciprocal;
        }
    }
}

/// Factors a block's own square, after the products over the columns ahead of it.
#[expect(clippy::inline_always, reason = "inlined into the dispatch, else it is compiled without its vectors")]
#[inline(always)]
fn factor_square<S: Simd>(simd: S, block: &Block, own: &mut [f64]) -> Result<(), NotPositiveDefinite> {
    let start = block.at(0, block.column());
    let length = block.row - block.column();
    let ahead = |offset: usize| block.at(offset, block.column()) - start;
    for a in (0..block.height).step_by(TILE) {
        for b in (0..=a).step_by(TILE) {
            let sums = products(
                simd,
                [0, 1, 2].map(|i| &own[ahead(a + i)..ahead(a + i) + length]),
                [0, 1, 2].map(|i| &own[ahead(b + i)..ahead(b + i) + length]),
            );
            for (i, sums) in sums.iter().enumerate() {
                let target = ahead(a + i) + length + b;
                for (value, sum) in own[target..target + TILE].iter_mut().zip(sums) {
                    *value -= sum;
                }
            }
        }
    }
    for a in 0..block.height {
        let (above, rows) = own.split_at_mut(ahead(a));
        let row = &mut rows[length..length + block.height];
        for b in 0..a {
            let other = &above[ahead(b) + length..][..=b];
            let sum: f64 = row[..b].iter().zip(other).map(|(x, l)| x * l).sum();
            row[b] = (row[b] - sum) / other[b];
        }
        let pivot = row[a] - row[..a].iter().map(|x| x * x).sum::<f64>();
        if !(pivot > 0.0) {
            return Err(NotPositiveDefinite { row: block.row + a, pivot });
        }
        row[a] = pivot.sqrt();
    }
    Ok(())
}

/// The nine scalar products of three rows with three others of the same length.
#[expect(clippy::inline_always, reason = "inlined into the dispatch, else it is compiled without its vectors")]
#[inline(always)]
fn products<S: Simd>(simd: S, rows: [&[f64]; TILE], others: [&[f64]; TILE]) -> [[f64; TILE]; TILE] {
    let ([a0, a1, a2], tails_a) = split::<S>(rows);
    let ([b0, b1, b2], tails_b) = split::<S>(others);
    let mut sums = [[simd.splat_f64s(0.0); TILE]; TILE];
    let mut add = |a: [S::f64s; TILE], b: [S::f64s; TILE]| {
        for (sums, a) in sums.iter_mut().zip(a) {
            for (sum, b) in sums.iter_mut().zip(b) {
                *sum = simd.mul_add_e_f64s(a, b, *sum);
            }
        }
    };
    for (((((a0, a1), a2), b0), b1), b2) in a0.iter().zip(a1).zip(a2).zip(b0).zip(b1).zip(b2) {
        add([*a0, *a1, *a2], [*b0, *b1, *b2]);
    }
    if !tails_a[0].is_empty() {
        add(tails_a.map(|tail| simd.partial_load_f64s(tail)), tails_b.map(|tail| simd.partial_load_f64s(tail)));
    }
    sums.map(|row| row.map(|sum| simd.reduce_sum_f64s(sum)))
}

#[expect(clippy::inline_always, reason = "inlined into the dispatch, else it is compiled without its vectors")]
#[inline(always)]
fn split<S: Simd>(rows: [&[f64]; TILE]) -> ([&[S::f64s]; TILE], [&[f64]; TILE]) {
    let [(a, x), (b, y), (c, z)] = rows.map(S::as_simd_f64s);
    ([a, b, c], [x, y, z])
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Blocks of 6 with a band of `band` blocks and a full last block of 3.
    fn banded(blocks: usize, band: usize) -> (Envelope, DMatrix<f64>) {
        let shape = (0..blocks).map(|block: usize| (6, block.saturating_sub(band))).chain([(TILE, 0)]);
        let mut envelope = Envelope::new(shape);
        let size = envelope.size();
        let mut dense = DMatrix::zeros(size, size);
        for row in 0..size {
            let first = envelope.blocks()[envelope.locate(row).0].column();
            for column in first..=row {
                let value = if row == column { 30.0 } else { ((row * 7 + column * 3) % 5) as f64 * 0.3 - 0.5 };
                envelope.add(row, column, value);
                dense[(row, column)] = value;
                dense[(column, row)] = value;
            }
        }
        (envelope, dense)
    }

    #[test]
    fn solves_a_banded_system_with_a_dense_last_block() {
        let (envelope, dense) = banded(9, 3);
        let expected = nalgebra::DVector::from_fn(dense.nrows(), |row, _| (row as f64 * 0.7).sin());
        let mut b: Vec<f64> = (&dense * &expected).iter().copied().collect();
        Factor::new(envelope).unwrap().solve(&mut b);
        for (solved, expected) in b.iter().zip(expected.iter()) {
            assert!((solved - expected).abs() < 1e-12, "{solved} {expected}");
        }
    }

    #[test]
    fn inverse_blocks_are_those_of_the_dense_inverse() {
        let (envelope, dense) = banded(8, 2);
        let inverse = dense.try_inverse().unwrap();
        let blocks = envelope.blocks().to_vec();
        for (block, found) in blocks.iter().zip(Factor::new(envelope).unwrap().inverse_diagonal()) {
            let expected = inverse.view((block.row, block.row), (block.height, block.height));
            assert!((found - expected).amax() < 1e-12, "block at row {}", block.row);
        }
    }

    #[test]
    fn an_indefinite_matrix_names_the_failing_row() {
        let mut envelope = Envelope::new([(TILE, 0)]);
        envelope.add(0, 0, 1.0);
        envelope.add(1, 0, 2.0);
        envelope.add(1, 1, 1.0);
        envelope.add(2, 2, 1.0);
        assert_eq!(Factor::new(envelope).unwrap_err().row, 1);
    }
}
