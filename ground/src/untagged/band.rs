//! A symmetric positive definite matrix whose entries lie near the diagonal.
//!
//! Photos are linked with photos up to a turn away only, so the factor costs the same per photo however long the tunnel.

/// Lower triangle; row `i` holds columns `i - width ..= i`.
#[derive(Clone, Debug)]
pub(super) struct Band {
    width: usize,
    rows: Vec<f64>,
}

/// The Cholesky factor `L` of a [`Band`].
pub(super) struct Factor(Band);

impl Band {
    pub(super) fn new(size: usize, width: usize) -> Self {
        Self { width, rows: vec![0.0; size * (width + 1)] }
    }

    fn size(&self) -> usize {
        self.rows.len() / (self.width + 1)
    }

    fn index(&self, row: usize, column: usize) -> usize {
        debug_assert!(column <= row && row - column <= self.width, "({row}, {column}) lies outside the band");
        row * (self.width + 1) + self.width - (row - column)
    }

    fn get(&self, row: usize, column: usize) -> f64 {
        self.rows[self.index(row, column)]
    }

    /// Adds to the entry and its mirror image.
    pub(super) fn add(&mut self, row: usize, column: usize, value: f64) {
        let index = self.index(row.max(column), row.min(column));
        self.rows[index] += value;
    }

    /// Multiplies the diagonal.
    pub(super) fn scale_diagonal(&mut self, factor: f64) {
        for row in 0..self.size() {
            let index = self.index(row, row);
            self.rows[index] *= factor;
        }
    }

    /// `L L^T`; the failing row if the matrix is not positive definite.
    pub(super) fn factor(mut self) -> Result<Factor, usize> {
        for i in 0..self.size() {
            let first = i.saturating_sub(self.width);
            for j in first..=i {
                let from = first.max(j.saturating_sub(self.width));
                let (a, b) = (self.index(i, from), self.index(j, from));
                let length = j - from;
                let sum: f64 = self.rows[a..a + length].iter().zip(&self.rows[b..b + length]).map(|(x, y)| x * y).sum();
                let rest = self.get(i, j) - sum;
                let index = self.index(i, j);
                if j < i {
                    self.rows[index] = rest / self.get(j, j);
                } else if rest > 0.0 {
                    self.rows[index] = rest.sqrt();
                } else {
                    return Err(i);
                }
            }
        }
        Ok(Factor(self))
    }
}

impl Factor {
    /// Solves in place.
    pub(super) fn solve(&self, b: &mut [f64]) {
        let Self(matrix) = self;
        for i in 0..b.len() {
            let first = i.saturating_sub(matrix.width);
            let sum: f64 = (first..i).map(|j| matrix.get(i, j) * b[j]).sum();
            b[i] = (b[i] - sum) / matrix.get(i, i);
        }
        for i in (0..b.len()).rev() {
            b[i] /= matrix.get(i, i);
            let x = b[i];
            for (j, value) in b.iter_mut().enumerate().take(i).skip(i.saturating_sub(matrix.width)) {
                *value -= matrix.get(i, j) * x;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn solves_what_a_dense_solver_solves_and_names_the_row_of_an_indefinite_matrix() {
        let (size, width) = (23, 4);
        let mut band = Band::new(size, width);
        let mut dense = nalgebra::DMatrix::zeros(size, size);
        for row in 0..size {
            for column in row.saturating_sub(width)..=row {
                let value = if row == column { 9.0 + row as f64 } else { ((row * 7 + column * 3) % 5) as f64 * 0.3 };
                band.add(column, row, value);
                dense[(row, column)] = value;
                dense[(column, row)] = value;
            }
        }
        let expected = nalgebra::DVector::from_fn(size, |row, _| (row as f64 * 0.7).sin());
        let mut b: Vec<f64> = (&dense * &expected).iter().copied().collect();
        band.clone().factor().map_err(|row| format!("row {row}")).unwrap().solve(&mut b);
        assert!(b.iter().zip(expected.iter()).all(|(solved, expected)| (solved - expected).abs() < 1e-12));
        band.add(7, 7, -100.0);
        assert_eq!(band.factor().err(), Some(7));
    }
}
