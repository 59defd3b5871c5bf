//! RepMatch: RANSAC guides the training of match-consistency curves, which judge all near neighbours.
//!
//! After Lin et al., "`RepMatch`: Robust Feature Matching and Pose for Reconstructing Modern Cities", ECCV 2016, as far as its
//! abstract and the bilateral functions it builds on are published; the numbers are our own. The ratio test throws away
//! almost everything on a wall that repeats itself, for there the second nearest neighbour is as near as the first. Here it
//! only finds the seeds. RANSAC keeps those of one camera motion, and they train two curves: how likely a displacement is at
//! a place, and where a feature should be. Every feature's nearest neighbours are then judged by the curves and the
//! epipolar geometry, and where none of them will do, the features about the predicted place. What is accepted gives a better
//! motion and better curves, and so on until the set stops growing.
//!
//! Features that repeat within reach of the prediction are kept only if the geometry separates the candidates.
//!
//! # Limits
//! Seeds that agree on a motion wrong by a whole period of the wall train curves that are wrong by it too, and nothing here
//! can notice: that needs a third photo, or tags.

use std::collections::HashMap;

use nalgebra::Vector2;
use rayon::prelude::*;

use super::motion::MotionCurves;
use super::ratio::distinct;
use super::verify::Verify;
use super::{Correspondences, Match, Strategy, View};
use crate::features::{Descriptor, Neighbour, nearest};

/// Nearest neighbours of each feature that are judged.
const NEIGHBOURS: usize = 4;

/// Most rounds; the set stops growing after two or three.
const ROUNDS: usize = 5;

/// The set has stopped growing when a round adds less than this part.
const GROWTH: f64 = 0.02;

/// Candidates nearer to each other than this are the same place, pixels.
const SAME_PLACE_PX: f64 = 2.5;

/// Curves of likelihood and motion from RANSAC's inliers, evaluated on all near neighbours.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RepMatch {
    /// Ratio test of the seeds.
    pub seed_ratio: f64,
    /// Ratio above which candidates of one feature count as alike, so that geometry must separate them.
    pub alike_ratio: f64,
    /// Least likelihood of a match.
    pub least_likelihood: f64,
    /// Distance from the motion curve that is allowed, in standard deviations of the training matches ...
    pub gate_sigmas: f64,
    /// ... and within these limits, pixels.
    pub gate_px: [f64; 2],
    /// The geometric test.
    pub verify: Verify,
}

impl Default for RepMatch {
    fn default() -> Self {
        Self {
            seed_ratio: 0.8,
            alike_ratio: 0.85,
            least_likelihood: 0.5,
            gate_sigmas: 4.0,
            gate_px: [3.0, 20.0],
            verify: Verify::default(),
        }
    }
}

impl<D: Descriptor> Strategy<D> for RepMatch {
    fn correspond(&self, first: &View<D>, second: &View<D>) -> Correspondences {
        let neighbours = nearest::<NEIGHBOURS, D>(&first.features.descriptors, &second.features.descriptors);
        let seeds = distinct::<D, NEIGHBOURS>(&neighbours, self.seed_ratio);
        let mut best = self.verify.check(first, second, &seeds);
        let places = Places::new(second);
        for _ in 0..ROUNDS {
            let Some(judge) = Judge::new(self, [first, second], &neighbours, &places, &best) else { break };
            let grown = self.verify.check(first, second, &judge.accepted());
            if grown.matches.len() as f64 <= (1.0 + GROWTH) * best.matches.len() as f64 {
                break;
            }
            best = grown;
        }
        best
    }
}

/// Features of a photo by place.
struct Places {
    cells: HashMap<[i64; 2], Vec<u32>>,
}

/// Side of a cell of [`Places`], pixels.
const CELL_PX: f64 = 16.0;

impl Places {
    fn new<D>(view: &View<D>) -> Self {
        let mut cells: HashMap<[i64; 2], Vec<u32>> = HashMap::new();
        for feature in 0..view.rays.len() as u32 {
            cells.entry(Self::cell(view.pixel(feature))).or_default().push(feature);
        }
        Self { cells }
    }

    fn cell(pixel: Vector2<f64>) -> [i64; 2] {
        pixel.map(|at| (at / CELL_PX).floor() as i64).into()
    }

    /// The features in all cells that touch a square.
    fn about(&self, pixel: Vector2<f64>, half_px: f64) -> impl Iterator<Item = u32> {
        let [low, high] = [-half_px, half_px].map(|by| Self::cell(pixel.add_scalar(by)));
        (low[1]..=high[1])
            .flat_map(move |row| (low[0]..=high[0]).map(move |column| [column, row]))
            .filter_map(|cell| self.cells.get(&cell))
            .flatten()
            .copied()
    }
}

/// A feature of the second photo that may be the one.
#[derive(Clone, Copy)]
struct Candidate {
    to: u32,
    distance: u32,
    pixel: Vector2<f64>,
    /// Distance from the epipolar line and from the motion curve, each over what is allowed, together.
    misfit: f64,
}

/// Decides about matches by the curves that one round's matches train.
struct Judge<'a, D> {
    options: &'a RepMatch,
    views: [&'a View<D>; 2],
    neighbours: &'a [[Neighbour; NEIGHBOURS]],
    places: &'a Places,
    curves: MotionCurves,
    gate_px: f64,
    /// Largest distance between descriptors that is credible, from the training matches.
    most_distance: u32,
}

impl<'a, D: Descriptor> Judge<'a, D> {
    fn new(
        options: &'a RepMatch,
        views: [&'a View<D>; 2],
        neighbours: &'a [[Neighbour; NEIGHBOURS]],
        places: &'a Places,
        trusted: &Correspondences,
    ) -> Option<Self> {
        let [first, second] = views;
        let curves = MotionCurves::train(first, second, &trusted.matches, trusted.two_view.as_ref()?)?;
        let gate_px = (options.gate_sigmas * curves.spread_px).clamp(options.gate_px[0], options.gate_px[1]);
        let mut distances: Vec<u32> = trusted.matches.iter().map(|pair| distance(views, *pair)).collect();
        distances.sort_unstable();
        let most_distance = distances[distances.len() * 9 / 10];
        Some(Self { options, views, neighbours, places, curves, gate_px, most_distance })
    }

    /// One candidate at most for every feature of the first photo, and for every feature of the second.
    fn accepted(&self) -> Vec<Match> {
        let features = self.views[0].rays.len() as u32;
        let mut chosen: Vec<(u32, u32, u32)> = (0..features)
            .into_par_iter()
            .filter_map(|from| self.choice(from).map(|candidate| (candidate.to, candidate.distance, from)))
            .collect();
        chosen.sort_unstable();
        chosen.dedup_by_key(|(to, ..)| *to);
        chosen.into_iter().map(|(to, _, from)| [from, to]).collect()
    }

    /// The feature of the second photo that `from` matches: among its nearest neighbours, else near the predicted place.
    fn choice(&self, from: u32) -> Option<Candidate> {
        let predicted = self.curves.predicted(self.views[0], from)?;
        let near = self.neighbours[from as usize].iter().filter(|neighbour| neighbour.index != u32::MAX);
        let likely: Vec<Candidate> = near
            .filter_map(|neighbour| self.candidate(from, neighbour.index, predicted))
            .filter(|candidate| self.likelihood(from, candidate) >= self.options.least_likelihood)
            .collect();
        if !likely.is_empty() {
            return self.separated(likely);
        }
        let about = self.places.about(predicted, self.gate_px);
        let grown: Vec<Candidate> = about
            .filter_map(|to| self.candidate(from, to, predicted))
            .filter(|candidate| {
                candidate.distance <= self.most_distance
                    && self.likelihood(from, candidate) >= self.options.least_likelihood
            })
            .collect();
        self.separated(grown)
    }

    fn likelihood(&self, from: u32, candidate: &Candidate) -> f64 {
        self.curves.likelihood(self.views[0], self.views[1], [from, candidate.to])
    }

    /// A candidate that the epipolar geometry and the motion curve allow.
    fn candidate(&self, from: u32, to: u32, predicted: Vector2<f64>) -> Option<Candidate> {
        let [first, second] = self.views;
        let pixel = second.pixel(to);
        let off_curve = (pixel - predicted).norm() / self.gate_px;
        if off_curve > 1.0 {
            return None;
        }
        let off_line = self.curves.epipolar_px(first, second, [from, to]) / self.options.verify.threshold_px;
        let distance = distance(self.views, [from, to]);
        (off_line <= 1.0).then(|| Candidate { to, distance, pixel, misfit: off_curve.hypot(off_line) })
    }

    /// The candidate most alike, unless others are about as alike: then the one that fits twice as well as any of them.
    fn separated(&self, mut candidates: Vec<Candidate>) -> Option<Candidate> {
        candidates.sort_by_key(|candidate| (candidate.distance, candidate.to));
        let best = *candidates.first()?;
        let ratio = if D::SQUARED { self.options.alike_ratio.powi(2) } else { self.options.alike_ratio };
        let alike = |other: &&Candidate| f64::from(best.distance) > ratio * f64::from(other.distance);
        let elsewhere = |other: &&Candidate| (other.pixel - best.pixel).norm() > SAME_PLACE_PX;
        let mut rivals: Vec<Candidate> = candidates.iter().filter(alike).filter(elsewhere).copied().collect();
        rivals.push(best);
        rivals.sort_by(|a, b| a.misfit.total_cmp(&b.misfit));
        match rivals[..] {
            [only] => Some(only),
            [first, second, ..] if first.misfit < 0.5 * second.misfit => Some(first),
            _ => None,
        }
    }
}

fn distance<D: Descriptor>(views: [&View<D>; 2], [from, to]: Match) -> u32 {
    views[0].features.descriptors[from as usize].distance(&views[1].features.descriptors[to as usize])
}
