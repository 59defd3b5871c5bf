//! How noisy the tags are, by the adjusted poses, against what `[sigma]` in survey.toml says.
//!
//! The frame of the result (roll on a circle, place in the section) rests on the tags. If they are noisier than they say, so is
//! the frame; the last adjustment therefore takes the greater of both.

use adit_geometry::profile::Profile;
use nalgebra::{Isometry3, Vector3};

use crate::adjust::{Shared, median};
use crate::matching::ViewPose;
use crate::prior::TagPrior;

/// Median of the absolute value of a standard normal.
const NORMAL_MEDIAN: f64 = 0.6745;
/// Fewer readings tell nothing.
const LEAST_READINGS: usize = 10;
/// Share of the readings' number, as a root, by which chance alone may raise the estimate: three standard deviations of a median
/// deviation (1.17 / sqrt(n) relative).
const CHANCE: f64 = 3.5;

/// Noise over stated noise, at least 1.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct TagNoise {
    /// Of the rotation about the tunnel's x, y and z.
    pub(super) rotation: [f64; 3],
    /// Of the ranges.
    pub(super) range: f64,
}

impl TagNoise {
    /// Estimates it from photos that the matches hold (`placed`); `views` are what the tags predict.
    pub(super) fn new(
        tags: &[TagPrior],
        views: &[ViewPose],
        poses: &[Isometry3<f64>],
        placed: &[bool],
        shared: &Shared,
        profile: &Profile<f64>,
        range_m: f64,
    ) -> Self {
        let held = || (0..tags.len()).filter(|&photo| placed[photo]);
        let turned = |photo: usize| {
            let error = (poses[photo].rotation * views[photo].tunnel_from_cam.rotation.inverse()).scaled_axis();
            error.component_div(&Vector3::from(tags[photo].rotation_sigma_rad))
        };
        let rotations: Vec<Vector3<f64>> = held().map(turned).collect();
        let rotation = [0, 1, 2].map(|axis| times(&rotations.iter().map(|error| error[axis]).collect::<Vec<_>>()));
        let mut ranges = Vec::new();
        for photo in held() {
            // The body's origin: the lever arm back from the optical centre.
            let pose = &poses[photo];
            let view = pose.rotation * Vector3::z();
            let body = pose.translation.vector - view * shared.lever_m[0] - Vector3::x() * shared.lever_m[1];
            for beam in &tags[photo].beams {
                if let Some(hit) = profile.ray_cast(body.yz(), beam.direction.yz()) {
                    ranges.push((hit.distance * shared.profile_size - beam.measured_m) / range_m);
                }
            }
        }
        Self { rotation, range: times(&ranges) }
    }
}

/// Standard deviation of the values by their median deviation, at least 1; 1 if it may be chance.
fn times(values: &[f64]) -> f64 {
    if values.len() < LEAST_READINGS {
        return 1.0;
    }
    let chance = 1.0 + CHANCE / (values.len() as f64).sqrt();
    let middle = median(values);
    let deviations: Vec<f64> = values.iter().map(|value| (value - middle).abs()).collect();
    let times = median(&deviations) / NORMAL_MEDIAN;
    if times > chance { times } else { 1.0 }
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;
    use rand_distr::{Distribution, Normal};

    use super::*;

    #[test]
    fn noise_of_the_stated_size_counts_as_one_and_three_times_as_three() {
        let mut random = ChaCha8Rng::seed_from_u64(5);
        let normal = Normal::new(0.0, 1.0).unwrap();
        let mut draw = |sigma: f64| -> Vec<f64> { (0..60).map(|_| sigma * normal.sample(&mut random)).collect() };
        assert_eq!(times(&draw(1.0)), 1.0);
        let three = times(&draw(3.0));
        assert!((2.2..3.8).contains(&three), "{three}");
        assert_eq!(times(&[100.0; 3]), 1.0);
    }
}
