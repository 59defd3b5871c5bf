//! Robust losses of a residual given in standard deviations.

use serde::{Deserialize, Serialize};

/// A loss `rho(r^2)`; scales `k` are in standard deviations. Zhang, "Parameter Estimation Techniques", 1997, table 1.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Loss {
    /// `r^2 / 2`: the best for Gaussian noise, ruined by one wrong match.
    Squared,
    /// Quadratic to `k`, linear beyond.
    Huber(f64),
    /// `k^2 / 2 ln(1 + r^2 / k^2)`.
    Cauchy(f64),
    /// `k^2 r^2 / (2 (k^2 + r^2))`: a wrong match costs no more than `k^2 / 2`.
    GemanMcClure(f64),
}

impl Loss {
    /// Returns `(cost, weight)` of a squared residual; the weight is the derivative of the cost by `r^2 / 2`.
    pub fn at(self, squared: f64) -> (f64, f64) {
        match self {
            Self::Squared => (0.5 * squared, 1.0),
            Self::Huber(k) if squared <= k * k => (0.5 * squared, 1.0),
            Self::Huber(k) => {
                let r = squared.sqrt();
                (k * r - 0.5 * k * k, k / r)
            }
            Self::Cauchy(k) => {
                let ratio = squared / (k * k);
                (0.5 * k * k * ratio.ln_1p(), 1.0 / (1.0 + ratio))
            }
            Self::GemanMcClure(k) => {
                let ratio = k * k / (k * k + squared);
                (0.5 * squared * ratio, ratio * ratio)
            }
        }
    }

    /// Returns the loss's second derivative along the residual over its weight: 1 where it is quadratic, negative where it is so
    /// flat that a linear model of it has no minimum.
    pub fn steepness(self, squared: f64) -> f64 {
        match self {
            Self::Squared => 1.0,
            Self::Huber(k) => f64::from(u8::from(squared <= k * k)),
            Self::Cauchy(k) => 1.0 - 2.0 * squared / (k * k + squared),
            Self::GemanMcClure(k) => 1.0 - 4.0 * squared / (k * k + squared),
        }
    }

    /// The same loss with a scale `factor` times as wide.
    #[must_use]
    pub fn widened(self, factor: f64) -> Self {
        match self {
            Self::Squared => Self::Squared,
            Self::Huber(k) => Self::Huber(k * factor),
            Self::Cauchy(k) => Self::Cauchy(k * factor),
            Self::GemanMcClure(k) => Self::GemanMcClure(k * factor),
        }
    }

    /// The scale; infinite for the squared loss.
    pub fn scale(self) -> f64 {
        match self {
            Self::Squared => f64::INFINITY,
            Self::Huber(k) | Self::Cauchy(k) | Self::GemanMcClure(k) => k,
        }
    }

    /// Tells whether a squared residual is believed to be noise, not a wrong match: its weight is at least a quarter (which for
    /// [`Self::GemanMcClure`] means that it lies within `k`).
    pub fn believes(self, squared: f64) -> bool {
        self.at(squared).1 >= 0.25
    }

    /// Returns the information of one residual that is believed, over that of least squares.
    ///
    /// An M-estimate's covariance for Gaussian noise is `E[psi psi^T] / E[d psi / d r]^2` times that of least squares, `psi = w r`
    /// (Huber & Ronchetti, "Robust Statistics", 2009, section 6.3), with the means over a standard normal residual of
    /// `dimension` 1 or 2. Its inverse, shared among those that are believed, is the answer: 0.90 for Geman-McClure with `k
    /// = 3` in two dimensions. The weights themselves would be optimistic: residuals that the estimate fits closely because
    /// nothing else contradicts them have weights near one.
    pub fn information(self, dimension: usize) -> f64 {
        // Midpoint rule over the norm r of the residual, out to where nothing is left; the density's normalisation cancels.
        const STEP: f64 = 1e-3;
        let (mut slope, mut square, mut believed) = (0.0, 0.0, 0.0);
        let n = dimension as f64;
        for index in 0..10_000 {
            let r = (f64::from(index) + 0.5) * STEP;
            let density = r.powi(dimension as i32 - 1) * (-0.5 * r * r).exp();
            let [w, ahead, behind] = [r, r + 0.5 * STEP, r - 0.5 * STEP].map(|r| self.at(r * r).1);
            square += density * (w * r).powi(2) / n;
            // The mean of d psi_a / d r_a over all directions.
            slope += density * (w + (ahead - behind) / STEP * r / n);
            believed += density * f64::from(u8::from(self.believes(r * r)));
        }
        slope * slope / (square * believed)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const ALL: [Loss; 4] = [Loss::Squared, Loss::Huber(1.5), Loss::Cauchy(2.0), Loss::GemanMcClure(3.0)];

    #[test]
    fn the_steepness_is_the_second_derivative_over_the_weight() {
        for loss in ALL {
            for residual in [0.2, 0.9, 2.0, 10.0_f64] {
                let slope = |r: f64| r * loss.at(r * r).1;
                let second = (slope(residual + 1e-6) - slope(residual - 1e-6)) / 2e-6;
                let squared = residual * residual;
                let difference = loss.steepness(squared) - second / loss.at(squared).1;
                assert!(difference.abs() < 1e-6, "{loss:?} at {residual}");
            }
        }
    }

    #[test]
    fn a_weight_is_the_slope_of_its_cost() {
        for loss in ALL {
            for squared in [0.01, 0.5, 4.0, 100.0] {
                let slope = loss.at(squared + 1e-6).0 - loss.at(squared - 1e-6).0;
                assert!((slope / 1e-6 - loss.at(squared).1).abs() < 1e-5, "{loss:?} at {squared}");
            }
        }
    }

    #[test]
    fn least_squares_needs_no_correction_and_a_wide_loss_hardly_any() {
        for dimension in [1, 2] {
            assert!((Loss::Squared.information(dimension) - 1.0).abs() < 1e-6);
            for loss in ALL {
                assert!((loss.widened(100.0).information(dimension) - 1.0).abs() < 2e-3, "{loss:?}");
            }
        }
    }

    #[test]
    fn the_information_of_a_robust_mean_agrees_with_its_scatter() {
        use rand::SeedableRng;
        use rand_distr::{Distribution, StandardNormal};
        // The robust mean of 40 two-dimensional normal samples, many times.
        let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(1);
        for loss in [Loss::GemanMcClure(3.0), Loss::GemanMcClure(1.5), Loss::Cauchy(2.0)] {
            let (mut scatter, mut claimed) = (0.0, 0.0);
            for _ in 0..4000 {
                let samples: Vec<[f64; 2]> =
                    (0..40).map(|_| [StandardNormal.sample(&mut random), StandardNormal.sample(&mut random)]).collect();
                let mut mean = [0.0; 2];
                for _ in 0..60 {
                    let (mut sum, mut total) = ([0.0; 2], 0.0);
                    for sample in &samples {
                        let w = loss.at((sample[0] - mean[0]).powi(2) + (sample[1] - mean[1]).powi(2)).1;
                        total += w;
                        sum = [sum[0] + w * sample[0], sum[1] + w * sample[1]];
                    }
                    mean = [sum[0] / total, sum[1] / total];
                }
                let squared = |sample: &[f64; 2]| (sample[0] - mean[0]).powi(2) + (sample[1] - mean[1]).powi(2);
                let believed = samples.iter().filter(|sample| loss.believes(squared(sample))).count();
                scatter += 0.5 * (mean[0] * mean[0] + mean[1] * mean[1]) / 4000.0;
                claimed += 1.0 / (loss.information(2) * believed as f64) / 4000.0;
            }
            assert!((scatter / claimed - 1.0).abs() < 0.06, "{loss:?}: {scatter} against {claimed}");
        }
    }
}
