//! The profile's size as the range sensors see it.
//!
//! The size is the survey's metric scale and leaves no trace in the photos, so it is estimated from the many range readings and
//! reported beside the nominal one.

use adit_geometry::profile::Profile;
use nalgebra::Vector2;
use serde::{Deserialize, Serialize};

use super::{TagPrior, section_position};

/// Estimated size over nominal size, about the tunnel's axis.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct SizeEstimate {
    /// Factor on all lengths of the nominal profile.
    pub factor: f64,
    /// Its standard deviation.
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

/// Estimates the factor by least squares over all photos with three beams, each at its own best position.
///
/// A scaled profile is handled by scaling the readings the other way. `None` with fewer than five such photos.
pub fn estimate_size(tags: &[TagPrior], profile: &Profile<f64>, range_m: f64) -> Option<SizeEstimate> {
    let usable: Vec<&TagPrior> = tags.iter().filter(|tag| tag.beams.len() >= 3).collect();
    if usable.len() < 5 {
        return None;
    }
    let cost = |factor: f64| -> f64 { usable.iter().map(|tag| cost_at(tag, profile, range_m, factor)).sum() };
    // Golden-section search: the cost is smooth and, within a tenth, has one minimum.
    let golden = 0.618_033_988_749_895;
    let (mut low, mut high) = (1.0 - SEARCH, 1.0 + SEARCH);
    while high - low > 1e-6 {
        let (inner_low, inner_high) = (high - golden * (high - low), low + golden * (high - low));
        if cost(inner_low) < cost(inner_high) {
            high = inner_high;
        } else {
            low = inner_low;
        }
    }
    let factor = 0.5 * (low + high);
    let step = 0.01;
    let curvature = (cost(factor + step) - 2.0 * cost(factor) + cost(factor - step)) / (step * step);
    (curvature > 0.0).then(|| SizeEstimate { factor, sigma: curvature.powf(-0.5), photos: usable.len() })
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
