//! A symmetric positive definite matrix in envelope (skyline) storage and its Cholesky factor.
//!
//! The reduced camera system of a tunnel is banded (a photo couples only to photos within one footprint's length)
//! with a few dense rows at the end (mounting, odometer scale). The envelope holds both and Cholesky creates no fill
//! outside it, so the cost is linear in the tunnel's length. George & Liu, "Computer Solution of Large Sparse Positive
//! Definite Systems", 1981, section 4.

/// Lower triangle, row by row, each row from its first structural non-zero to the diagonal.
#[derive(Clone, Debug)]
pub(super) struct Envelope {
    first: Vec<usize>,
    start: Vec<usize>,
    values: Vec<f64>,
}

/// The matrix was not positive definite.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[error("the normal equations are not positive definite at row {row} (pivot {pivot:e})")]
pub struct NotPositiveDefinite {
    /// Row of the failing pivot.
    pub row: usize,
    /// Its value.
    pub pivot: f64,
}

impl Envelope {
    /// A zero matrix whose row `i` starts at column `first[i] <= i`.
    pub(super) fn new(first: Vec<usize>) -> Self {
        let mut start = Vec::with_capacity(first.len() + 1);
        let mut length = 0;
        for (row, &column) in first.iter().enumerate() {
            debug_assert!(column <= row, "row {row} starts right of the diagonal");
            start.push(length);
            length += row + 1 - column;
        }
        start.push(length);
        Self { first, start, values: vec![0.0; length] }
    }

    /// A zero matrix of the same envelope.
    pub(super) fn new_like(other: &Self) -> Self {
        Self { values: vec![0.0; other.values.len()], ..other.clone() }
    }

    pub(super) fn size(&self) -> usize {
        self.first.len()
    }

    /// Adds to an entry of the lower triangle, which must lie in the envelope.
    pub(super) fn add(&mut self, row: usize, column: usize, value: f64) {
        debug_assert!(column <= row && column >= self.first[row], "({row}, {column}) lies outside the envelope");
        self.values[self.start[row] + column - self.first[row]] += value;
    }

    /// Adds a dense block with its corner at `(row, column)`; entries above the diagonal are skipped.
    pub(super) fn add_block<const R: usize, const C: usize>(
        &mut self,
        row: usize,
        column: usize,
        block: &nalgebra::SMatrix<f64, R, C>,
    ) {
        for i in 0..R {
            let last = (row + i + 1).saturating_sub(column).min(C);
            let base = self.start[row + i] + column - self.first[row + i];
            for j in 0..last {
                self.values[base + j] += block[(i, j)];
            }
        }
    }

    /// Adds another matrix of the same envelope.
    pub(super) fn add_all(&mut self, other: &Self) {
        for (sum, value) in self.values.iter_mut().zip(&other.values) {
            *sum += value;
        }
    }

    pub(super) fn diagonal(&self, row: usize) -> f64 {
        self.values[self.start[row + 1] - 1]
    }

    fn row(&self, row: usize) -> &[f64] {
        &self.values[self.start[row]..self.start[row + 1]]
    }

    /// Factors the matrix in place into `L L^T`.
    ///
    /// # Errors
    /// [`NotPositiveDefinite`] names the failing pivot; the matrix is then half overwritten.
    pub(super) fn factor(mut self) -> Result<Factor, NotPositiveDefinite> {
        for i in 0..self.size() {
            let (done, rest) = self.values.split_at_mut(self.start[i]);
            let row = &mut rest[..=i - self.first[i]];
            for j in self.first[i]..i {
                let from = self.first[i].max(self.first[j]);
                let other = &done[self.start[j]..self.start[j + 1]];
                let sum =
                    dot(&row[from - self.first[i]..j - self.first[i]], &other[from - self.first[j]..j - self.first[j]]);
                let pivot = other[j - self.first[j]];
                row[j - self.first[i]] = (row[j - self.first[i]] - sum) / pivot;
            }
            let last = row.len() - 1;
            let pivot = row[last] - dot(&row[..last], &row[..last]);
            if !(pivot > 0.0) {
                return Err(NotPositiveDefinite { row: i, pivot });
            }
            row[last] = pivot.sqrt();
        }
        Ok(Factor(self))
    }
}

/// The Cholesky factor `L` of an [`Envelope`].
#[derive(Clone, Debug)]
pub(super) struct Factor(Envelope);

impl Factor {
    /// Solves `L L^T x = b` in place.
    pub(super) fn solve(&self, b: &mut [f64]) {
        self.solve_from(0, b);
    }

    /// As [`Self::solve`] when all entries of `b` before `from` are zero.
    fn solve_from(&self, from: usize, b: &mut [f64]) {
        let matrix = &self.0;
        for i in from..matrix.size() {
            let first = matrix.first[i].max(from);
            let row = &matrix.row(i)[first - matrix.first[i]..];
            let sum = dot(&row[..i - first], &b[first..i]);
            b[i] = (b[i] - sum) / row[i - first];
        }
        for i in (0..matrix.size()).rev() {
            let row = matrix.row(i);
            let first = matrix.first[i];
            b[i] /= row[i - first];
            let x = b[i];
            for (value, entry) in b[first..i].iter_mut().zip(row) {
                *value -= entry * x;
            }
        }
    }

    /// Returns the square roots of `count` diagonal entries of the inverse from `start` on: standard deviations.
    pub(super) fn sigmas(&self, start: usize, count: usize) -> Vec<f64> {
        let mut unit = vec![0.0; self.0.size()];
        (start..start + count)
            .map(|index| {
                unit.fill(0.0);
                unit[index] = 1.0;
                self.solve_from(index, &mut unit);
                unit[index].max(0.0).sqrt()
            })
            .collect()
    }
}

/// Four partial sums, so that the compiler may vectorise.
fn dot(a: &[f64], b: &[f64]) -> f64 {
    let mut sums = [0.0; 4];
    let (chunks_a, rest_a) = a.as_chunks::<4>();
    let (chunks_b, rest_b) = b.as_chunks::<4>();
    for (x, y) in chunks_a.iter().zip(chunks_b) {
        for lane in 0..4 {
            sums[lane] += x[lane] * y[lane];
        }
    }
    let tail: f64 = rest_a.iter().zip(rest_b).map(|(x, y)| x * y).sum();
    sums.iter().sum::<f64>() + tail
}

#[cfg(test)]
mod tests {
    use super::*;

    fn banded(size: usize, band: usize) -> (Envelope, nalgebra::DMatrix<f64>) {
        let first: Vec<usize> =
            (0..size).map(|row| if row + 1 == size { 0 } else { row.saturating_sub(band) }).collect();
        let mut envelope = Envelope::new(first.clone());
        let mut dense = nalgebra::DMatrix::zeros(size, size);
        for row in 0..size {
            for column in first[row]..=row {
                let value =
                    if row == column { 10.0 + row as f64 } else { ((row * 7 + column * 3) % 5) as f64 * 0.3 - 0.5 };
                envelope.add(row, column, value);
                dense[(row, column)] = value;
                dense[(column, row)] = value;
            }
        }
        (envelope, dense)
    }

    #[test]
    fn solves_a_banded_system_with_a_dense_last_row() {
        let (envelope, dense) = banded(23, 4);
        let expected = nalgebra::DVector::from_fn(23, |row, _| (row as f64 * 0.7).sin());
        let mut b: Vec<f64> = (&dense * &expected).iter().copied().collect();
        envelope.factor().unwrap().solve(&mut b);
        for (solved, expected) in b.iter().zip(expected.iter()) {
            assert!((solved - expected).abs() < 1e-12, "{solved} {expected}");
        }
    }

    #[test]
    fn sigmas_are_the_roots_of_the_inverse_diagonal() {
        let (envelope, dense) = banded(17, 3);
        let inverse = dense.try_inverse().unwrap();
        let sigmas = envelope.factor().unwrap().sigmas(5, 6);
        for (offset, sigma) in sigmas.iter().enumerate() {
            assert!((sigma * sigma - inverse[(5 + offset, 5 + offset)]).abs() < 1e-12);
        }
    }

    #[test]
    fn an_indefinite_matrix_names_the_failing_row() {
        let mut envelope = Envelope::new(vec![0, 0]);
        envelope.add(0, 0, 1.0);
        envelope.add(1, 0, 2.0);
        envelope.add(1, 1, 1.0);
        assert_eq!(envelope.factor().unwrap_err().row, 1);
    }
}
