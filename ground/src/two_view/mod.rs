//! Relative pose of two photos from rays towards the same points.
//!
//! Two models compete: a general motion (essential matrix, five-point solver) and a pure rotation, because a vehicle that
//! stands turns its camera almost on the spot and then an essential matrix fits with any translation. RANSAC with local
//! optimisation finds each (Chum, Matas & Kittler, "Locally Optimized RANSAC", 2003; cost truncated as in Torr &
//! Zisserman's MSAC, 2000), Torr's geometric robust information criterion decides ("Bayesian model estimation and
//! selection for epipolar geometry and generic manifold fitting", IJCV 2002). COLMAP tells its pairs apart in the same
//! way.
//!
//! Rays are unit vectors in the `cam` frames, so any lens will do. All errors are angles: the smallest total shift of both
//! rays that makes the pair fit.
//!
//! Limits: points on one plane are seen alike from two relative poses, and both may put all points before both cameras;
//! the answer is then one of the two. Depth decides, but the curvature of a tunnel of 3 m radius does not over a step of a
//! decimetre: the twin, 2 degrees away with a direction across the true one, fits within half a pixel of noise. Which
//! pairs agree is right all the same; who needs the pose of neighbours must know something more.

mod essential;
mod five_point;
mod polynomial;
mod rotation;
#[cfg(test)]
mod tests;

use nalgebra::{Isometry3, Matrix3, Translation3, UnitQuaternion, UnitVector3};
use rand::SeedableRng;
use rand::seq::index;
use rand_chacha::ChaCha8Rng;

use essential::{decompose, essential_of, refine, sampson_rad, truncated_cost};
use five_point::essential_matrices;
use rotation::{best_rotation, squared_error};

/// Pairs of rays that a general motion needs.
const ESSENTIAL_SAMPLE: usize = 5;
/// Pairs of rays that a rotation needs.
const ROTATION_SAMPLE: usize = 2;
/// Fewest pairs that must agree with a model beyond its sample: fewer agree with some model by chance.
const LEAST_SUPPORT: usize = 10;
/// Steps of the local optimisation of a new best model, and of the last refinement.
const LOCAL_STEPS: usize = 4;
const FINAL_STEPS: usize = 30;

/// How [`estimate`] searches.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TwoViewOptions {
    /// Largest error of a pair that agrees with the model.
    pub threshold_rad: f64,
    /// Probability that a sample without outliers is among those drawn.
    pub confidence: f64,
    /// Most samples drawn per model.
    pub max_iterations: usize,
    /// Seed of the generator that draws them: the same seed gives the same answer.
    pub seed: u64,
}

impl Default for TwoViewOptions {
    /// Four milliradians: two pixels of a photo of 0.75 megapixels and 94 degrees.
    fn default() -> Self {
        Self { threshold_rad: 0.004, confidence: 0.9999, max_iterations: 5000, seed: 0 }
    }
}

/// The kind of motion between two photos.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Motion {
    /// The optical centre moved.
    General,
    /// The optical centre stayed, as far as the rays can tell.
    PureRotation,
}

/// Relative pose of two photos.
#[derive(Clone, Debug, PartialEq)]
pub struct TwoView {
    /// Pose of the first camera in the second; the translation has length one, or zero for a pure rotation.
    pub second_from_first: Isometry3<f64>,
    /// Which model explains the rays best.
    pub motion: Motion,
    /// For each pair of rays whether it agrees with the model.
    pub inliers: Vec<bool>,
    /// Root mean square error of the pairs that agree.
    pub rms_rad: f64,
}

/// Finds the relative pose of two photos from pairs of rays `[in first cam, in second cam]`, of which many may be wrong.
///
/// `None` if fewer than 15 pairs agree with any motion.
///
/// # Cost
/// About 25 microseconds per sample plus 15 ns per pair and candidate; 300 samples at 50 % outliers.
pub fn estimate(rays: &[[UnitVector3<f64>; 2]], options: &TwoViewOptions) -> Option<TwoView> {
    let mut random = ChaCha8Rng::seed_from_u64(options.seed);
    let general = general_motion(rays, options, &mut random);
    let rotation = pure_rotation(rays, options, &mut random);
    let errors_of = |pose: &Isometry3<f64>| -> Vec<f64> {
        let essential = essential_of(pose);
        rays.iter().map(|pair| sampson_rad(&essential, pair).powi(2)).collect()
    };
    let general = general.map(|pose| (pose, errors_of(&pose)));
    let rotation = rotation.map(|rotation| {
        let pose = Isometry3::from_parts(Translation3::identity(), rotation);
        (pose, rays.iter().map(|pair| squared_error(&rotation, pair)).collect::<Vec<f64>>())
    });
    let motion = match (&general, &rotation) {
        (Some((_, general)), Some((_, rotation))) => select(general, rotation, options.threshold_rad),
        (Some(_), None) => Motion::General,
        (None, Some(_)) => Motion::PureRotation,
        (None, None) => return None,
    };
    let (second_from_first, errors) = match motion {
        Motion::General => general?,
        Motion::PureRotation => rotation?,
    };
    let limit = options.threshold_rad * options.threshold_rad;
    let inliers: Vec<bool> = errors.iter().map(|error| *error < limit).collect();
    let count = inliers.iter().filter(|inlier| **inlier).count();
    let sum: f64 = errors.iter().filter(|error| **error < limit).sum();
    (count >= ESSENTIAL_SAMPLE + LEAST_SUPPORT).then(|| TwoView {
        second_from_first,
        motion,
        inliers,
        rms_rad: (sum / count as f64).sqrt(),
    })
}

/// Torr's criterion over the pairs that either model explains: for outliers of both it would compare nothing but penalties.
fn select(general: &[f64], rotation: &[f64], threshold_rad: f64) -> Motion {
    let limit = threshold_rad * threshold_rad;
    let mut explained: Vec<(f64, f64)> =
        general.iter().copied().zip(rotation.iter().copied()).filter(|(g, r)| g.min(*r) < limit).collect();
    // Noise by the general model, which fits either way: median of a normal's absolute value.
    explained.sort_by(|a, b| a.0.total_cmp(&b.0));
    let Some(median) = explained.get(explained.len() / 2) else { return Motion::General };
    let variance = (median.0 * 1.4826_f64.powi(2)).clamp(limit * 1e-4, limit * 0.25);
    // Data of four dimensions, manifolds of three and two, five and three parameters.
    let penalty = (explained.len() as f64 * 4.0).ln();
    let criterion = |errors: &mut dyn Iterator<Item = f64>, dimensions: f64, parameters: f64| {
        let fit: f64 = errors.map(|error| (error / variance).min(2.0 * (4.0 - dimensions))).sum();
        fit + 4.0_f64.ln() * dimensions * explained.len() as f64 + penalty * parameters
    };
    let of_general = criterion(&mut explained.iter().map(|(g, _)| *g), 3.0, 5.0);
    let of_rotation = criterion(&mut explained.iter().map(|(_, r)| *r), 2.0, 3.0);
    if of_rotation < of_general { Motion::PureRotation } else { Motion::General }
}

/// Samples still needed so that one of `size` pairs without outliers is drawn with the confidence asked for.
fn samples_needed(inlier_share: f64, size: usize, options: &TwoViewOptions) -> usize {
    let clean = inlier_share.powi(size as i32);
    let needed = (1.0 - options.confidence).ln() / (1.0 - clean).ln();
    if needed.is_finite() { (needed.ceil() as usize).min(options.max_iterations) } else { options.max_iterations }
}

/// Essential matrix by RANSAC with local optimisation, as a pose with unit translation.
fn general_motion(
    rays: &[[UnitVector3<f64>; 2]],
    options: &TwoViewOptions,
    random: &mut ChaCha8Rng,
) -> Option<Isometry3<f64>> {
    if rays.len() < ESSENTIAL_SAMPLE {
        return None;
    }
    let limit = options.threshold_rad * options.threshold_rad;
    let mut best: Option<Isometry3<f64>> = None;
    let mut best_cost = limit * rays.len() as f64;
    // A sample's model competes with samples' models: none would beat one that was refined, be that in a wrong minimum.
    let mut best_raw_cost = best_cost;
    let mut needed = options.max_iterations;
    let mut drawn = 0;
    while drawn < needed {
        drawn += 1;
        let chosen = index::sample(random, rays.len(), ESSENTIAL_SAMPLE);
        let sample: [[UnitVector3<f64>; 2]; ESSENTIAL_SAMPLE] = std::array::from_fn(|i| rays[chosen.index(i)]);
        for essential in essential_matrices(&sample) {
            let Some(cost) = cost_below(&essential, rays, limit, best_raw_cost) else { continue };
            best_raw_cost = cost;
            let inliers = rays.iter().filter(|pair| sampson_rad(&essential, pair).powi(2) < limit);
            let Some(pose) = decompose(&essential, &inliers) else { continue };
            let refined = refine(&pose, rays, options.threshold_rad, LOCAL_STEPS);
            let cost = truncated_cost(&essential_of(&refined), rays, options.threshold_rad);
            if cost >= best_cost {
                continue;
            }
            (best, best_cost) = (Some(refined), cost);
            let share = 1.0 - best_cost / (limit * rays.len() as f64);
            needed = samples_needed(share, ESSENTIAL_SAMPLE, options);
        }
    }
    // The local optimisation may have passed through a direction where depths change sign: decided anew.
    let essential = essential_of(&best?);
    let pose = decompose(&essential, &rays.iter().filter(|pair| sampson_rad(&essential, pair).powi(2) < limit))?;
    Some(refine(&pose, rays, options.threshold_rad, FINAL_STEPS))
}

/// The truncated cost, or `None` as soon as it reaches `bound`.
fn cost_below(essential: &Matrix3<f64>, rays: &[[UnitVector3<f64>; 2]], limit: f64, bound: f64) -> Option<f64> {
    let mut cost = 0.0;
    for pair in rays {
        cost += sampson_rad(essential, pair).powi(2).min(limit);
        if cost >= bound {
            return None;
        }
    }
    Some(cost)
}

/// Rotation by RANSAC with local optimisation.
fn pure_rotation(
    rays: &[[UnitVector3<f64>; 2]],
    options: &TwoViewOptions,
    random: &mut ChaCha8Rng,
) -> Option<UnitQuaternion<f64>> {
    if rays.len() < ROTATION_SAMPLE {
        return None;
    }
    let limit = options.threshold_rad * options.threshold_rad;
    let cost_of = |rotation: &UnitQuaternion<f64>| -> f64 {
        rays.iter().map(|pair| squared_error(rotation, pair).min(limit)).sum()
    };
    let mut best = None;
    let mut best_cost = limit * rays.len() as f64;
    let mut needed = options.max_iterations;
    let mut drawn = 0;
    while drawn < needed {
        drawn += 1;
        let chosen = index::sample(random, rays.len(), ROTATION_SAMPLE);
        let Some(mut rotation) = best_rotation(chosen.iter().map(|i| &rays[i])) else { continue };
        if cost_of(&rotation) >= best_cost {
            continue;
        }
        for _ in 0..LOCAL_STEPS {
            let inliers = rays.iter().filter(|pair| squared_error(&rotation, pair) < limit);
            let Some(better) = best_rotation(inliers) else { break };
            rotation = better;
        }
        best_cost = cost_of(&rotation).min(best_cost);
        best = Some(rotation);
        needed = samples_needed(1.0 - best_cost / (limit * rays.len() as f64), ROTATION_SAMPLE, options);
    }
    best
}
