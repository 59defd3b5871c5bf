//! The profile's size as the range sensors see it.
//!
//! The size is the survey's metric scale and leaves no trace in the photos, so it is estimated from the many range readings and
//! reported beside the nominal one.

use adit_geometry::profile::Profile;
use nalgebra::Vector2;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::{TagPrior, section_position};

/// Estimated size over nominal size, about the tunnel's axis.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct SizeEstimate {
    /// Factor on all lengths of the nominal profile.
    pub factor: f64,
    /// Its standard deviation, with what does not average out.
    pub sigma: f64,
    /// Photos that took part: those with three body-fixed ranges.
    pub photos: usize,
}

impl SizeEstimate {
    /// Tells whether the ranges contradict the nominal size by more than three standard deviations.
    pub fn contradicts_nominal(&self) -> bool {
        (self.factor - 1.0).abs() > 3.0 * self.sigma
    }
}

const SEARCH: f64 = 0.1;
/// What all readings have in common and more of them do not average away, as a share of the size: a sensor's own bias, and
/// beams that are not square to the wall. Those of an unmeasured attitude of 1.5 degrees about two axes alone read 0.07 % long.
const SYSTEMATIC: f64 = 1e-3;

/// Estimates the factor by least squares over all photos with three beams, each at its own best position.
///
/// A scaled profile is handled by scaling the readings the other way. `None` with fewer than five such photos.
pub fn estimate_size(tags: &[TagPrior], profile: &Profile<f64>, range_m: f64) -> Option<SizeEstimate> {
    let usable: Vec<&TagPrior> = tags.iter().filter(|tag| tag.beams.len() >= 3).collect();
    if usable.len() < 5 {
        return None;
    }
    let cost = |factor: f64| -> f64 {
        let costs: Vec<f64> = usable.par_iter().map(|tag| cost_at(tag, profile, range_m, factor)).collect();
        costs.iter().sum()
    };
    // Golden-section search: the cost is smooth and, within a tenth, has one minimum.
    let golden = 0.618_033_988_749_895;
    let (mut low, mut high) = (1.0 - SEARCH, 1.0 + SEARCH);
    let inner = |low: f64, high: f64| [high - golden * (high - low), low + golden * (high - low)];
    let mut costs = inner(low, high).map(cost);
    while high - low > 1e-5 {
        let [inner_low, inner_high] = inner(low, high);
        if costs[0] < costs[1] {
            high = inner_high;
            costs = [cost(inner(low, high)[0]), costs[0]];
        } else {
            low = inner_low;
            costs = [costs[1], cost(inner(low, high)[1])];
        }
    }
    let factor = 0.5 * (low + high);
    let step = 0.01;
    let curvature = (cost(factor + step) - 2.0 * cost(factor) + cost(factor - step)) / (step * step);
    (curvature > 0.0).then(|| SizeEstimate {
        factor,
        sigma: curvature.powf(-0.5).hypot(SYSTEMATIC),
        photos: usable.len(),
    })
}

/// Robust cost of one photo's readings at its best position in the scaled profile.
fn cost_at(tag: &TagPrior, profile: &Profile<f64>, range_m: f64, factor: f64) -> f64 {
    let mut scaled = tag.clone();
    for beam in &mut scaled.beams {
        beam.measured_m /= factor;
    }
    let sigma_m = range_m / factor;
    let worst = 4.5 * scaled.beams.len() as f64;
    let Some(fix) = section_position(&scaled, profile, sigma_m, Vector2::zeros()) else { return worst };
    let residuals = scaled.beams.iter().map(|beam| {
        let Some(hit) = profile.ray_cast(fix.offset_m, beam.direction.yz()) else { return 4.5 };
        let squared = ((hit.distance - beam.measured_m) / sigma_m).powi(2);
        0.5 * squared * 9.0 / (9.0 + squared)
    });
    residuals.sum()
}

#[cfg(test)]
mod tests {
    use adit_geometry::profile::ProfileSpec;
    use nalgebra::Vector3;
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;
    use rand_distr::{Distribution, StandardNormal};

    use super::*;
    use crate::prior::Beam;

    const RANGE_M: f64 = 0.02;

    /// By the ranges of `photos` in a square of 4 m that is `built` times as large, from a body whose pitch and yaw of 1.5 degrees
    /// nobody measured.
    fn estimate(photos: usize, built: f64) -> SizeEstimate {
        let mut random = ChaCha8Rng::seed_from_u64(3);
        let mut normal = move |sigma: f64| {
            let value: f64 = StandardNormal.sample(&mut random);
            sigma * value
        };
        let profile = ProfileSpec::Rectangle { width_m: 4.0, height_m: 4.0, axis_height_m: 2.0 }.build().unwrap();
        let mut tag = || {
            let (y_m, z_m) = (normal(0.1), normal(0.1));
            let (pitch_rad, yaw_rad, roll_rad) = (normal(0.026), normal(0.026), normal(0.026));
            let beams = [
                (-Vector3::z(), 2.0 * built + z_m, pitch_rad),
                (Vector3::y(), 2.0 * built - y_m, yaw_rad),
                (-Vector3::y(), 2.0 * built + y_m, yaw_rad),
            ];
            let read = |(direction, square_m, tilt_rad): (Vector3<f64>, f64, f64), noise_m: f64| Beam {
                direction,
                measured_m: square_m / (tilt_rad.cos() * roll_rad.cos()) + noise_m,
            };
            TagPrior {
                shaft_rad: 0.0,
                rotation_sigma_rad: [0.03; 3],
                attitude_rad: None,
                beams: beams.map(|beam| read(beam, normal(RANGE_M))).to_vec(),
                range_head_m: None,
                odometer_m: None,
            }
        };
        let tags: Vec<TagPrior> = (0..photos).map(|_| tag()).collect();
        estimate_size(&tags, &profile, RANGE_M).unwrap()
    }

    #[test]
    fn what_does_not_average_out_contradicts_nothing_however_many_photos_there_are() {
        let size = estimate(5000, 1.0);
        assert!(size.factor > 1.0004, "beams of a tilted body read long: {size:?}");
        assert!(!size.contradicts_nominal(), "{size:?}");
    }

    #[test]
    fn a_section_built_one_percent_larger_is_found_to_a_tenth_of_a_percent() {
        let size = estimate(230, 1.01);
        assert!((size.factor - 1.01).abs() < 1e-3 && size.contradicts_nominal(), "{size:?}");
    }
}
