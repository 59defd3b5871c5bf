//! The camera's clock against the board's, and how well a photo's time stamp fits a moment.

/// The time that a camera wrote into a photo: the moment lies in `[from_s, from_s + resolution_s)` of its clock.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Stamp {
    /// Start of the interval, in seconds since 1970 of the camera's clock (whatever that shows).
    pub(super) from_s: f64,
    /// 1 s where the camera writes whole seconds.
    pub(super) resolution_s: f64,
}

impl Stamp {
    pub(super) fn middle_s(&self) -> f64 {
        self.from_s + 0.5 * self.resolution_s
    }

    /// Probability of this stamp for a photo taken at `time_s` of the camera's clock, give or take `sigma_s`.
    fn probability(&self, time_s: f64, sigma_s: f64) -> f64 {
        let below = |bound_s: f64| normal_cdf((bound_s - time_s) / sigma_s);
        (below(self.from_s + self.resolution_s) - below(self.from_s)).max(0.0)
    }

    /// Probability of this stamp for a photo taken at any time between the two, all alike.
    pub(super) fn probability_between(&self, from_s: f64, to_s: f64) -> f64 {
        let overlap_s = (self.from_s + self.resolution_s).min(to_s) - self.from_s.max(from_s);
        (overlap_s / (to_s - from_s)).max(0.0)
    }
}

/// Camera time as a function of board time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Clock {
    /// Camera time minus board time at `middle_s`.
    pub(super) offset_s: f64,
    /// How much faster the camera's clock runs.
    pub(super) drift: f64,
    /// Board time at which the offset holds.
    pub(super) middle_s: f64,
    /// One standard deviation of the offset.
    pub(super) sigma_s: f64,
    /// One standard deviation of the exposure's delay.
    pub(super) latency_sigma_s: f64,
}

/// Spreads of the exposure around the board's best-known time that are tried; unknown per camera, so the photos decide.
pub(super) const LATENCY_SIGMAS_S: [f64; 4] = [0.015, 0.03, 0.06, 0.12];
/// Spread before the photos have decided.
const FIRST_LATENCY_SIGMA_S: f64 = 0.08;
/// Now and then a camera is later than usual, by up to so much.
const LATE_SHARE: f64 = 0.002;
const LATE_S: f64 = 1.0;
/// The offset is refined down to this.
const MIN_STEP_S: f64 = 0.01;
/// More pairs than this add nothing to the clock.
const MOST_REFINING_PAIRS: usize = 600;
/// One standard deviation of two quartz clocks against each other.
const DRIFT_SIGMA: f64 = 60e-6;

impl Clock {
    /// A guess that is off by up to half of a histogram's window.
    pub(super) fn guess(offset_s: f64, middle_s: f64) -> Self {
        Self { offset_s, drift: 0.0, middle_s, sigma_s: 0.5, latency_sigma_s: FIRST_LATENCY_SIGMA_S }
    }

    /// Camera time of a moment of the board's clock.
    pub(super) fn camera_time_s(&self, board_s: f64) -> f64 {
        board_s + self.offset_s + self.drift * (board_s - self.middle_s)
    }

    /// Probability of a stamp for a photo commanded at `board_s`.
    pub(super) fn probability(&self, stamp: &Stamp, board_s: f64) -> f64 {
        let time_s = self.camera_time_s(board_s);
        let usual = stamp.probability(time_s, self.latency_sigma_s.hypot(self.sigma_s));
        let late = stamp.probability_between(time_s, time_s + LATE_S);
        (1.0 - LATE_SHARE) * usual + LATE_SHARE * late
    }

    /// Fits offset and drift to pairs of board time and stamp: least squares on the middles of the stamps' intervals
    /// (whose error is uniform), with the drift held near zero by what quartz can do. `None` without pairs.
    pub(super) fn fit(pairs: &[(f64, Stamp)]) -> Option<Self> {
        if pairs.is_empty() {
            return None;
        }
        let count = pairs.len() as f64;
        let middle_s = pairs.iter().map(|pair| pair.0).sum::<f64>() / count;
        let first_s = pairs.first().map_or(0.0, |(board_s, stamp)| stamp.middle_s() - board_s);
        // Relative to the first, because offsets are of the order of 1e9 s.
        let residual_s = |pair: &(f64, Stamp)| pair.1.middle_s() - pair.0 - first_s;
        let mean_s = pairs.iter().map(residual_s).sum::<f64>() / count;
        let variance = pairs.iter().map(|pair| pair.1.resolution_s.powi(2) / 12.0).sum::<f64>() / count
            + FIRST_LATENCY_SIGMA_S * FIRST_LATENCY_SIGMA_S;
        let (mut tt, mut tr) = (variance / (DRIFT_SIGMA * DRIFT_SIGMA), 0.0);
        for pair in pairs {
            let from_middle_s = pair.0 - middle_s;
            tt += from_middle_s * from_middle_s;
            tr += from_middle_s * (residual_s(pair) - mean_s);
        }
        let sigma_s = (variance / count).sqrt();
        let latency_sigma_s = FIRST_LATENCY_SIGMA_S;
        Some(Self { offset_s: first_s + mean_s, drift: tr / tt, middle_s, sigma_s, latency_sigma_s })
    }

    /// Moves offset and drift to where the stamps are most probable.
    ///
    /// Least squares takes the error of a whole second as noise. But every second's boundary that falls between two photos
    /// says more, and some hundreds of them fix the offset to about the latency's own spread over their number. A
    /// shrinking grid, because the likelihood is made of steps.
    #[must_use]
    pub(super) fn refined(self, pairs: &[(f64, Stamp)]) -> Self {
        let step = pairs.len().div_ceil(MOST_REFINING_PAIRS).max(1);
        let pairs: Vec<&(f64, Stamp)> = pairs.iter().step_by(step).collect();
        let half_span_s = pairs.iter().map(|pair| (pair.0 - self.middle_s).abs()).fold(1.0, f64::max);
        let ln_likelihood = |clock: &Self| -> f64 {
            let sharp = Self { sigma_s: 0.0, ..*clock };
            let prior = -0.5 * (clock.drift / DRIFT_SIGMA).powi(2);
            prior + pairs.iter().map(|pair| (sharp.probability(&pair.1, pair.0) + 1e-9).ln()).sum::<f64>()
        };
        let mut best = (ln_likelihood(&self), self);
        let mut reach_s = 3.0 * self.sigma_s;
        while reach_s > MIN_STEP_S {
            let centre = best.1;
            for (offset_step, drift_step) in (-3..=3).flat_map(|a| (-3..=3).map(move |b| (f64::from(a), f64::from(b))))
            {
                let tried = Self {
                    offset_s: centre.offset_s + reach_s * offset_step / 3.0,
                    drift: centre.drift + reach_s / half_span_s * drift_step / 3.0,
                    ..centre
                };
                let ln = ln_likelihood(&tried);
                if ln > best.0 {
                    best = (ln, tried);
                }
            }
            reach_s *= 0.5;
        }
        Self { sigma_s: self.sigma_s.min(MIN_STEP_S), ..best.1 }
    }
}

/// Offsets worth trying, best first: those at which many differences of stamp and board time agree, half a second apart.
///
/// All differences go into a histogram. A regular rhythm gives a comb with one tooth per period (and at one photo per
/// second no teeth at all), so no peaks are asked for, only high counts: the true offset is among the highest, because any
/// other has fewer captures opposite a photo.
pub(super) fn candidate_offsets(board_s: &[f64], stamps: &[Stamp], most: usize) -> Vec<f64> {
    const BIN_S: f64 = 0.25;
    /// A stamp of a whole second spreads its pair over this many bins.
    const WINDOW: usize = 4;
    /// Candidates are at least this many bins apart; the fit finds its way over half of that.
    const APART: usize = 2;
    /// More bins than this (a season) means that the stamps are not of one flight.
    const MOST_BINS: f64 = 3.2e7;
    let extent = |values: &mut dyn Iterator<Item = f64>| {
        values.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), value| (low.min(value), high.max(value)))
    };
    let (board_low, board_high) = extent(&mut board_s.iter().copied());
    let (stamp_low, stamp_high) = extent(&mut stamps.iter().map(Stamp::middle_s));
    let lowest_s = stamp_low - board_high;
    let bins = (stamp_high - board_low - lowest_s) / BIN_S;
    if !(0.0..MOST_BINS).contains(&bins) {
        return Vec::new();
    }
    let mut counts = vec![0_u32; bins as usize + WINDOW + 1];
    for stamp in stamps {
        for board in board_s {
            counts[((stamp.middle_s() - board - lowest_s) / BIN_S) as usize + WINDOW / 2] += 1;
        }
    }
    let sums: Vec<u32> = counts.windows(WINDOW).map(|window| window.iter().sum()).collect();
    let top = sums.iter().copied().max().unwrap_or_default();
    let mut places: Vec<usize> = (0..sums.len()).filter(|&i| sums[i] * 2 >= top.max(1)).collect();
    places.sort_by_key(|&i| (std::cmp::Reverse(sums[i]), i));
    let mut chosen: Vec<usize> = Vec::new();
    for i in places {
        if chosen.iter().all(|other| other.abs_diff(i) >= APART) {
            chosen.push(i);
            if chosen.len() == most {
                break;
            }
        }
    }
    chosen.iter().map(|&i| lowest_s + i as f64 * BIN_S).collect()
}

/// Standard normal distribution function, absolute error below 1.5e-7.
///
/// Abramowitz and Stegun, Handbook of Mathematical Functions, 7.1.26.
fn normal_cdf(x: f64) -> f64 {
    let z = x.abs() / std::f64::consts::SQRT_2;
    let t = 1.0 / (1.0 + 0.327_591_1 * z);
    let polynomial =
        t * (0.254_829_592 + t * (-0.284_496_736 + t * (1.421_413_741 + t * (-1.453_152_027 + t * 1.061_405_429))));
    let upper = 0.5 * polynomial * (-z * z).exp();
    if x > 0.0 { 1.0 - upper } else { upper }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn whole_second(time_s: f64) -> Stamp {
        Stamp { from_s: time_s.floor(), resolution_s: 1.0 }
    }

    #[test]
    fn the_normal_distribution_has_its_tabled_values() {
        for (x, expected) in [(0.0, 0.5), (1.0, 0.841_344_7), (-1.96, 0.024_997_9), (3.0, 0.998_650_1)] {
            assert!((normal_cdf(x) - expected).abs() < 2e-7, "{x}: {}", normal_cdf(x));
        }
    }

    #[test]
    fn a_clock_is_fitted_from_whole_seconds() {
        let camera = |board_s: f64| 1.5e9 + 0.37 + board_s * (1.0 + 50e-6);
        let pairs: Vec<(f64, Stamp)> = (0..800)
            .map(|i| f64::from(i) * 1.537 + f64::from(i % 7) * 0.05)
            .map(|board_s| (board_s, whole_second(camera(board_s))))
            .collect();
        let clock = Clock::fit(&pairs).unwrap();
        for board_s in [0.0, 600.0, 1200.0] {
            assert!((clock.camera_time_s(board_s) - camera(board_s)).abs() < 0.04, "{clock:?}");
        }
    }

    #[test]
    fn the_true_offset_is_among_the_candidates_of_a_regular_rhythm() {
        let board_s: Vec<f64> = (0..100).map(|i| f64::from(i) * 1.5).collect();
        let stamps: Vec<Stamp> = board_s.iter().skip(3).map(|t| whole_second(t + 1.5e9 + 0.2)).collect();
        let candidates = candidate_offsets(&board_s, &stamps, 12);
        assert!(candidates.iter().any(|offset_s| (offset_s - 1.5e9 - 0.2).abs() < 0.75), "{candidates:?}");
    }

    #[test]
    fn stamps_years_apart_give_no_candidate() {
        let stamps = [whole_second(0.0), whole_second(1.5e9)];
        assert_eq!(candidate_offsets(&[0.0, 1.0], &stamps, 12), Vec::<f64>::new());
    }
}
