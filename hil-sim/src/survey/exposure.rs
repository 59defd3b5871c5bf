//! A camera that does not hold its exposure: slow drift over a factor of two, sudden jumps, a wandering white balance.

use std::f64::consts::{LN_2, TAU};

use crate::seed::{Random, Stream};

/// Photos from one brightest to the next.
const PERIOD_PHOTOS: f64 = 40.0;
/// Chance per photo that the exposure jumps, and how far (log of the gain, one standard deviation).
const JUMP: (f64, f64) = (0.1, 0.15);
/// Largest drift of red and blue against green (log of the gain), and the photos of a period of each.
const WHITE_BALANCE: f64 = 0.08;
const RED_BLUE_PERIODS_PHOTOS: [f64; 2] = [27.0, 34.0];

/// Factors on each photo's red, green and blue gains, on the light before the sRGB curve.
pub(super) fn drift(photos: usize, seed: u64) -> Vec<[f64; 3]> {
    let mut random = Random::new(seed, Stream::Exposure);
    let phases = [(); 3].map(|()| random.uniform(0.0, TAU));
    let mut jump = 0.0;
    (0..photos)
        .map(|photo| {
            if random.chance(JUMP.0) {
                jump = random.gauss(JUMP.1);
            }
            let wave = |period: f64, phase: f64| (TAU * photo as f64 / period + phase).sin();
            let log = 0.5 * LN_2 * wave(PERIOD_PHOTOS, phases[0]) + jump;
            let [red, blue] = [0, 1].map(|i| log + WHITE_BALANCE * wave(RED_BLUE_PERIODS_PHOTOS[i], phases[i + 1]));
            [red, log, blue].map(f64::exp)
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_exposure_drifts_over_a_factor_of_two_and_jumps() {
        let factors = drift(120, 1);
        let green: Vec<f64> = factors.iter().map(|factor| factor[1].ln()).collect();
        let span = green.iter().copied().fold(f64::MIN, f64::max) - green.iter().copied().fold(f64::MAX, f64::min);
        assert!((LN_2..LN_2 + 1.0).contains(&span), "{span}");
        // The drift alone moves by 5 % from photo to photo at most.
        let jumps = green.windows(2).filter(|pair| (pair[1] - pair[0]).abs() > 0.1).count();
        assert!((3..30).contains(&jumps), "{jumps}");
        let white = factors.iter().map(|factor| (factor[0] / factor[2]).ln().abs()).fold(0.0, f64::max);
        assert!((0.08..0.17).contains(&white), "{white}");
    }
}
