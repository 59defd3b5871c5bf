//! How features move between two photos: curves of likelihood and motion, and the epipolar geometry.

use std::collections::HashSet;

use nalgebra::{Vector2, Vector3};

use super::bilateral::{Curve, CurveOptions};
use super::{Match, View};
use crate::two_view::{Motion, TwoView};

/// Of the matches that train the curves, at most one is taken from each square of this side, pixels.
const THINNING_PX: f64 = 12.0;

/// Most matches that train the curves.
const MOST_TRAINING: usize = 900;

/// Least spread of displacements, pixels: matches of a far, flat wall hardly differ, and are not exact.
const LEAST_SPREAD_PX: f64 = 3.0;

const LIKELIHOOD: CurveOptions = CurveOptions { width: 0.8, smoothness: 3.0, huber: 0.2, controls: 200 };
const MOTION: CurveOptions = CurveOptions { width: 0.8, smoothness: 0.1, huber: 1.5, controls: 150 };

/// The curves, trained on matches that agree with one motion of the camera.
///
/// The camera's own rotation moves features by hundreds of pixels and is known from the two-view geometry: it is taken
/// away first. What the curves describe is the rest, the parallax: small and smooth, whatever the section's shape.
pub(super) struct MotionCurves {
    /// Where each feature of the first photo would be in the second if the camera had only turned.
    turned: Vec<Option<Vector2<f64>>>,
    likelihood: Curve<4, 1>,
    middle: Vector2<f64>,
    motion: Curve<2, 2>,
    /// One standard deviation per axis of the training matches from the motion curve, pixels.
    pub(super) spread_px: f64,
    two_view: TwoView,
    focal_px: f64,
}

impl MotionCurves {
    /// Trains on `matches`; `None` if they are too few or all in one place.
    pub(super) fn train<D>(first: &View<D>, second: &View<D>, matches: &[Match], two_view: &TwoView) -> Option<Self> {
        let rotation = two_view.second_from_first.rotation;
        let turned: Vec<Option<Vector2<f64>>> =
            first.rays.iter().map(|ray| second.camera.project(&(rotation * ray.into_inner()))).collect();
        let training: Vec<[Vector2<f64>; 2]> = thinned(first, matches)
            .into_iter()
            .filter_map(|[from, to]| Some([first.pixel(from), second.pixel(to) - turned[from as usize]?]))
            .collect();
        if training.len() < 8 {
            return None;
        }
        let [place, displacement] = [0, 1].map(|index| Spread::of(training.iter().map(|sample| sample[index])));
        let unit = displacement.deviation.map(|deviation| deviation.max(LEAST_SPREAD_PX));
        let units = [place.deviation.x, place.deviation.y, unit.x, unit.y];
        if units.iter().any(|unit| !(*unit > 0.0)) {
            return None;
        }
        let crowd: Vec<_> = training.iter().map(|[at, moved]| ([at.x, at.y, moved.x, moved.y], [1.0])).collect();
        let likelihood = Curve::train(&crowd, units, &LIKELIHOOD)?;
        let offsets: Vec<_> = training
            .iter()
            .map(|[at, moved]| ([at.x, at.y], [moved.x - displacement.middle.x, moved.y - displacement.middle.y]))
            .collect();
        let motion = Curve::train(&offsets, [units[0], units[1]], &MOTION)?;
        let mut errors: Vec<f64> =
            offsets.iter().map(|(at, offset)| (Vector2::from(motion.at(at)) - Vector2::from(*offset)).norm()).collect();
        errors.sort_by(f64::total_cmp);
        // The median length of a two-dimensional normal error is 1.18 of its deviation per axis.
        let spread_px = errors[errors.len() / 2] / 1.18;
        let focal_px = 0.5 * (second.camera.focal_px[0] + second.camera.focal_px[1]);
        let two_view = two_view.clone();
        Some(Self { turned, likelihood, middle: displacement.middle, motion, spread_px, two_view, focal_px })
    }

    /// Where a feature of the first photo should be in the second.
    pub(super) fn predicted<D>(&self, first: &View<D>, from: u32) -> Option<Vector2<f64>> {
        let at = first.pixel(from);
        Some(self.turned[from as usize]? + self.middle + Vector2::from(self.motion.at(&[at.x, at.y])))
    }

    /// How well a match fits in with the training matches around it, about 0 to 1.
    pub(super) fn likelihood<D>(&self, first: &View<D>, second: &View<D>, [from, to]: Match) -> f64 {
        let Some(turned) = self.turned[from as usize] else { return 0.0 };
        let (at, moved) = (first.pixel(from), second.pixel(to) - turned);
        self.likelihood.at(&[at.x, at.y, moved.x, moved.y])[0]
    }

    /// Distance of a match from its epipolar line, pixels at the photo's centre; 0 if the camera only turned.
    pub(super) fn epipolar_px<D>(&self, first: &View<D>, second: &View<D>, [from, to]: Match) -> f64 {
        epipolar_rad(&self.two_view, &first.ray(from), &second.ray(to)) * self.focal_px
    }
}

/// Angle between the second ray and the plane of the first one and the baseline; 0 if the camera only turned.
pub(super) fn epipolar_rad(two_view: &TwoView, first: &Vector3<f64>, second: &Vector3<f64>) -> f64 {
    if two_view.motion == Motion::PureRotation {
        return 0.0;
    }
    let transform = &two_view.second_from_first;
    let normal = transform.translation.vector.cross(&(transform.rotation * first));
    normal.try_normalize(1e-12).map_or(0.0, |normal| normal.dot(second).abs().asin())
}

/// One match per square of the first photo, and not too many in all.
fn thinned<D>(first: &View<D>, matches: &[Match]) -> Vec<Match> {
    let mut taken = HashSet::new();
    let square = |pair: &Match| first.pixel(pair[0]).map(|at| (at / THINNING_PX) as i64);
    let kept: Vec<Match> = matches.iter().filter(|pair| taken.insert(square(pair))).copied().collect();
    kept.iter().step_by(kept.len().div_ceil(MOST_TRAINING).max(1)).copied().collect()
}

/// Median and standard deviation per axis.
struct Spread {
    middle: Vector2<f64>,
    deviation: Vector2<f64>,
}

impl Spread {
    fn of(values: impl Iterator<Item = Vector2<f64>> + Clone) -> Self {
        let axis = |axis: usize| {
            let mut sorted: Vec<f64> = values.clone().map(|value| value[axis]).collect();
            sorted.sort_by(f64::total_cmp);
            let mean = sorted.iter().sum::<f64>() / sorted.len() as f64;
            let variance = sorted.iter().map(|value| (value - mean).powi(2)).sum::<f64>() / sorted.len() as f64;
            (sorted[sorted.len() / 2], variance.sqrt())
        };
        let (x, y) = (axis(0), axis(1));
        Self { middle: Vector2::new(x.0, y.0), deviation: Vector2::new(x.1, y.1) }
    }
}
