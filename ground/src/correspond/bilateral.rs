//! Smooth functions trained on scattered samples: sums of Gaussians at control points.
//!
//! The machinery of bilateral functions (Lin et al., "Bilateral Functions for Global Motion Modeling", ECCV 2014) and of
//! motion coherence before it: minimise `sum_j huber(y_j - f(p_j)) + smoothness |f|^2` over `f(p) = sum_i w_i k(p, p_i)`
//! with `k(p, q) = exp(-|p - q|^2 / width^2)` and the norm that belongs to this kernel.

use nalgebra::{DMatrix, DVector};

/// Passes of reweighted least squares; robust weights have settled after these.
const PASSES: usize = 4;

/// What a curve is made of.
#[derive(Clone, Copy, Debug)]
pub(super) struct CurveOptions {
    /// Distance at which a control point's influence has fallen to 1/e, in units of the coordinates.
    pub(super) width: f64,
    /// Weight of smoothness. For a function that is to be 1, about the number of samples near each other that bring it half
    /// way up.
    pub(super) smoothness: f64,
    /// Error from which a sample counts linearly only, in units of the values.
    pub(super) huber: f64,
    /// Most control points.
    pub(super) controls: usize,
}

/// A function of `N` coordinates with `M` values.
#[derive(Clone, Debug)]
pub(super) struct Curve<const N: usize, const M: usize> {
    unit: [f64; N],
    width: f64,
    /// In units.
    controls: Vec<[f64; N]>,
    /// One row per control point.
    weights: DMatrix<f64>,
}

impl<const N: usize, const M: usize> Curve<N, M> {
    /// Trains on samples (place, value), whose coordinates are measured in `unit`. Zero far from every sample.
    ///
    /// `None` without samples, or if the equations are singular.
    pub(super) fn train(samples: &[([f64; N], [f64; M])], unit: [f64; N], options: &CurveOptions) -> Option<Self> {
        let stride = samples.len().div_ceil(options.controls.max(1)).max(1);
        let scaled: Vec<[f64; N]> = samples.iter().map(|(place, _)| scaled(place, &unit)).collect();
        let controls: Vec<[f64; N]> = scaled.iter().step_by(stride).copied().collect();
        let matrix = |rows: &[[f64; N]]| {
            DMatrix::from_fn(rows.len(), controls.len(), |row, column| {
                kernel(&rows[row], &controls[column], options.width)
            })
        };
        let design = matrix(&scaled);
        // A grain on the diagonal, for control points that coincide.
        let penalty = matrix(&controls) * options.smoothness + DMatrix::identity(controls.len(), controls.len()) * 1e-6;
        let values = DMatrix::from_fn(samples.len(), M, |row, column| samples[row].1[column]);
        let mut robust = DVector::repeat(samples.len(), 1.0);
        let mut weights = DMatrix::zeros(controls.len(), M);
        for _ in 0..PASSES {
            let mut weighted = design.clone();
            for (mut row, weight) in weighted.row_iter_mut().zip(&robust) {
                row *= *weight;
            }
            let transposed = weighted.transpose();
            weights = (&transposed * &design + &penalty).cholesky()?.solve(&(&transposed * &values));
            let errors = &design * &weights - &values;
            for (weight, error) in robust.iter_mut().zip(errors.row_iter()) {
                *weight = (options.huber / error.norm().max(1e-12)).min(1.0);
            }
        }
        Some(Self { unit, width: options.width, controls, weights })
    }

    /// Returns the value at a place.
    pub(super) fn at(&self, place: &[f64; N]) -> [f64; M] {
        let place = scaled(place, &self.unit);
        let mut value = [0.0; M];
        for (row, control) in self.controls.iter().enumerate() {
            let influence = kernel(&place, control, self.width);
            for (column, value) in value.iter_mut().enumerate() {
                *value += influence * self.weights[(row, column)];
            }
        }
        value
    }
}

fn scaled<const N: usize>(place: &[f64; N], unit: &[f64; N]) -> [f64; N] {
    std::array::from_fn(|axis| place[axis] / unit[axis])
}

fn kernel<const N: usize>(a: &[f64; N], b: &[f64; N], width: f64) -> f64 {
    let squared: f64 = a.iter().zip(b).map(|(a, b)| (a - b) * (a - b)).sum();
    (-squared / (width * width)).exp()
}

#[cfg(test)]
mod tests {
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    use super::*;

    #[test]
    fn a_curve_follows_its_samples_past_a_fifth_of_strays() {
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        let truth = |x: f64, y: f64| 20.0 + 5.0 * (x / 2.0).sin() + 3.0 * y;
        let samples: Vec<([f64; 2], [f64; 1])> = (0..500)
            .map(|index| {
                let (x, y) = (rng.random_range(0.0..6.0), rng.random_range(0.0..4.0));
                let stray = if index % 5 == 0 { rng.random_range(-30.0..30.0) } else { 0.0 };
                ([x, y], [truth(x, y) + stray])
            })
            .collect();
        let options = CurveOptions { width: 1.0, smoothness: 0.01, huber: 0.3, controls: 120 };
        let curve = Curve::train(&samples, [2.0, 2.0], &options).unwrap();
        for (x, y) in [(1.0, 1.0), (3.0, 2.0), (5.0, 3.0)] {
            let [value] = curve.at(&[x, y]);
            assert!((value - truth(x, y)).abs() < 0.6, "{value} instead of {}", truth(x, y));
        }
    }

    #[test]
    fn likelihood_is_high_in_a_crowd_low_alone_and_nothing_far_away() {
        let crowd = (0..40).map(|i| ([0.1 * f64::from(i % 8), 0.1 * f64::from(i / 8), 10.0, 0.0], [1.0]));
        let alone = ([0.3, 0.3, 90.0, 0.0], [1.0]);
        let samples: Vec<_> = crowd.chain([alone]).collect();
        let options = CurveOptions { width: 1.0, smoothness: 3.0, huber: 0.2, controls: 100 };
        let curve = Curve::train(&samples, [1.0, 1.0, 10.0, 10.0], &options).unwrap();
        let at = |place: [f64; 4]| curve.at(&place)[0];
        assert!(at([0.4, 0.2, 11.0, 0.5]) > 0.9);
        assert!(at([0.3, 0.3, 90.0, 0.0]) < 0.3);
        assert!(at([5.0, 5.0, 10.0, 0.0]).abs() < 0.01);
    }
}
