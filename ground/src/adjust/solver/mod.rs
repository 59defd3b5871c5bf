//! Levenberg-Marquardt for bundle adjustment: cameras of `C` unknowns, points of three, and unknowns that all share, of which
//! `K` may appear in what is said about points.
//!
//! One iteration takes two passes over the observations. The first linearises them and eliminates each point from the normal
//! equations at once (Schur complement; Triggs et al., "Bundle Adjustment: A Modern Synthesis", 2000, section 6); the second
//! linearises again to move the points, and gives the cost of the new estimate. Nothing is stored per observation, so memory
//! is that of the reduced matrix: linearising twice costs less time than 288 bytes per observation cost in memory traffic.
//!
//! Points are visited in chunks of fixed size, ordered along the cameras, each with its own sums over the few cameras that it
//! touches, joined in order: the result does not depend on the number of threads.

mod cholesky;
mod eliminate;
mod envelope;
mod kernels;
mod move_points;
mod order;

use std::ops::Range;

use nalgebra::{Matrix2x3, Point3, RowVector3, SMatrix, SVector, Vector2};
use rayon::prelude::*;

pub(crate) use cholesky::Factor;
pub use cholesky::NotPositiveDefinite;
use eliminate::{Equations, System};
pub(crate) use envelope::Envelope;
use move_points::TASK;
pub(super) use order::Layout;

use super::loss::Loss;
use super::tracks::{Observation, Tracks};

/// Damping beyond which no descent is to be had.
const LAMBDA_MAX: f64 = 1e12;
const LAMBDA_MIN: f64 = 1e-9;
/// Relative decrease of the cost from which on the minimum is near: there iterations with the weights alone creep along what
/// only doubtful sightings hold.
const NEAR: f64 = 1e-2;
/// Where the loss's curvature fails, the minimum is so many times nearer before it is tried again.
const NEARER: f64 = 0.1;
/// Curvature along a residual, as a share of its weight, that is assumed where the loss has less.
const LEAST_STEEPNESS: f64 = 0.1;

/// One linearised observation: residual in pixels, and its derivatives.
pub(super) struct Sight<const C: usize, const K: usize> {
    pub(super) residual: Vector2<f64>,
    pub(super) by_camera: SMatrix<f64, 2, C>,
    pub(super) by_point: Matrix2x3<f64>,
    pub(super) by_shared: SMatrix<f64, 2, K>,
}

/// What is known about a point beforehand: one residual in standard deviations.
pub(super) struct PointPrior<const K: usize> {
    pub(super) residual: f64,
    pub(super) by_point: RowVector3<f64>,
    pub(super) by_shared: SVector<f64, K>,
}

/// One residual about cameras and shared unknowns, in standard deviations, with its slopes by unknown.
pub(super) struct PriorRow<'a> {
    pub(super) residual: f64,
    pub(super) loss: Loss,
    /// Unknown by [`Layout`], slope.
    pub(super) slopes: &'a [(usize, f64)],
}

/// The measurements of one problem, as the solver sees them.
pub(super) trait Model<const C: usize, const K: usize>: Sync {
    /// Cameras and shared unknowns.
    type Estimate: Clone + Send + Sync;

    fn cameras(&self) -> usize;
    fn tracks(&self) -> &Tracks;
    /// Number of shared unknowns, all of them free.
    fn shared(&self) -> usize;
    /// Which shared unknown each of the `K` is; `None` for one that is fixed.
    fn point_shared(&self) -> [Option<usize>; K];
    /// Pairs of cameras that priors couple.
    fn links(&self) -> Vec<[u32; 2]>;
    /// `None` if the point cannot be seen.
    fn sight(&self, estimate: &Self::Estimate, point: &Point3<f64>, seen: &Observation) -> Option<Sight<C, K>>;
    /// The residual alone.
    fn residual(&self, estimate: &Self::Estimate, point: &Point3<f64>, seen: &Observation) -> Option<Vector2<f64>>;
    fn point_prior(&self, estimate: &Self::Estimate, point: &Point3<f64>) -> Option<PointPrior<K>>;
    /// Everything that is said about cameras and shared unknowns alone.
    fn priors(&self, estimate: &Self::Estimate, layout: &Layout, emit: &mut dyn FnMut(&PriorRow<'_>));
    /// The estimate after a step.
    fn stepped(&self, estimate: &Self::Estimate, step: &Step<'_>) -> Self::Estimate;
}

/// A step of cameras and shared unknowns.
pub(super) struct Step<'a> {
    pub(super) layout: &'a Layout,
    pub(super) values: &'a [f64],
}

impl Step<'_> {
    pub(super) fn camera<const C: usize>(&self, camera: usize) -> SVector<f64, C> {
        SVector::from_column_slice(&self.values[self.layout.camera(camera)..][..C])
    }

    pub(super) fn shared(&self, index: usize) -> f64 {
        self.values[self.layout.shared(index)]
    }
}

/// How much observations are trusted.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Weighting {
    /// One standard deviation, pixels.
    pub(super) pixel_px: f64,
    pub(super) loss: Loss,
    /// For covariances: what a residual that is believed weighs, see [`Loss::information`].
    pub(super) information: Option<f64>,
    /// Linearises with the loss's own curvature, not with its weight: quick where the minimum is near, lost where it is far.
    pub(super) curved: bool,
}

impl Weighting {
    /// Cost of a residual in pixels. A point that cannot be seen costs as much as one far off.
    fn cost(&self, residual: Option<&Vector2<f64>>) -> f64 {
        const UNSEEN_PX: f64 = 1e4;
        let squared_px = residual.map_or(UNSEEN_PX * UNSEEN_PX, Vector2::norm_squared);
        self.loss.at(squared_px / self.pixel_px.powi(2)).0
    }

    /// Makes a sight one of plain least squares, with the loss's slope and, if [`Self::curved`], its curvature, and returns its
    /// cost (Triggs et al., section 4.3).
    #[expect(clippy::inline_always, reason = "inlined into the dispatch, else it is compiled without its vectors")]
    #[inline(always)]
    fn whiten<const C: usize, const K: usize>(&self, sight: &mut Sight<C, K>) -> f64 {
        let information = self.pixel_px.powi(-2);
        let squared_px = sight.residual.norm_squared();
        let squared = squared_px * information;
        let (cost, weight) = self.loss.at(squared);
        let weight = match self.information {
            Some(believed) if self.loss.believes(squared) => believed,
            Some(_) => 0.0,
            None => weight,
        };
        let scale = (weight * information).sqrt();
        let along = if self.curved { self.loss.steepness(squared).max(LEAST_STEEPNESS).sqrt() } else { 1.0 };
        if along < 1.0 {
            let flatter = sight.residual * ((along - 1.0) / squared_px);
            let residual = sight.residual.transpose();
            sight.by_camera += flatter * (residual * sight.by_camera);
            sight.by_point += flatter * (residual * sight.by_point);
            sight.by_shared += flatter * (residual * sight.by_shared);
        }
        sight.by_camera *= scale;
        sight.by_point *= scale;
        sight.by_shared *= scale;
        sight.residual *= scale / along;
        cost
    }
}

/// Cameras and shared unknowns, and the points in the order of the tracks.
#[derive(Clone, Debug)]
pub(super) struct State<E> {
    pub(super) estimate: E,
    pub(super) points: Vec<Point3<f64>>,
}

/// When to stop.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Limits {
    pub(super) iterations: usize,
    /// Relative decrease of the cost.
    pub(super) decrease: f64,
    /// Relative decrease that, where it is only predicted and the step then raises the cost, is none: where a wall's faces meet,
    /// and where a point leaves the photo, the cost has kinks that no linear model sees.
    pub(super) kink: f64,
    /// Damping to start with, as a share of the diagonal.
    pub(super) damping: f64,
}

/// How an iteration ended.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Minimised {
    pub(super) outcome: super::Outcome,
    /// Linear systems solved.
    pub(super) iterations: usize,
    pub(super) cost: f64,
}

/// A problem with its structure worked out.
pub(super) struct Solver<'m, M, const C: usize, const K: usize> {
    model: &'m M,
    layout: Layout,
    system: System,
}

impl<'m, M: Model<C, K>, const C: usize, const K: usize> Solver<'m, M, C, K> {
    pub(super) fn new(model: &'m M) -> Self {
        let layout = Layout::new(model.tracks(), C, model.cameras(), model.shared(), &model.links());
        let system = System::new(&layout, model.tracks());
        Self { model, layout, system }
    }

    /// The cost of a state.
    pub(super) fn cost(&self, weighting: &Weighting, state: &State<M::Estimate>) -> f64 {
        move_points::cost(self.model, &self.layout, weighting, state)
    }

    /// Reprojection error of every observation that projects, pixels, in the order of the tracks. Single precision: there are
    /// millions of them, and of interest is their median.
    pub(super) fn errors_px(&self, state: &State<M::Estimate>) -> Vec<f32> {
        let tracks = self.model.tracks();
        let of_points = |points: Range<usize>| -> Vec<f32> {
            let of_point = |point: usize| {
                let of_one =
                    move |seen| Some(self.model.residual(&state.estimate, &state.points[point], seen)?.norm() as f32);
                tracks.of(point).iter().filter_map(of_one)
            };
            points.flat_map(of_point).collect()
        };
        let tasks = (0..tracks.len().div_ceil(TASK)).into_par_iter();
        let errors: Vec<Vec<f32>> =
            tasks.map(|task| of_points(task * TASK..((task + 1) * TASK).min(tracks.len()))).collect();
        errors.concat()
    }

    /// Levenberg-Marquardt with Nielsen's damping (Madsen, Nielsen & Tingleff, "Methods for Non-Linear Least Squares Problems",
    /// 2004, section 3.2), scaled by the diagonal.
    ///
    /// # Errors
    /// [`NotPositiveDefinite`] if the damped equations cannot be solved.
    pub(super) fn minimise(
        &mut self,
        weighting: &Weighting,
        state: &mut State<M::Estimate>,
        limits: Limits,
    ) -> Result<Minimised, NotPositiveDefinite> {
        let (mut lambda, mut growth) = (limits.damping, 2.0);
        let ended = |outcome, iterations, cost| Ok(Minimised { outcome, iterations, cost });
        let mut cost = f64::INFINITY;
        let mut weighting = *weighting;
        let mut near = NEAR;
        for iteration in 1..=limits.iterations {
            let equations = self.system.eliminate(self.model, &self.layout, &weighting, state, lambda);
            cost = equations.cost;
            let settled = equations.gradient_max() <= 1e-6 * (1.0 + cost);
            let step = self.solve(equations)?;
            let moved = move_points::step(self.model, &self.layout, &weighting, state, &step, lambda);
            let decrease = cost - moved.cost;
            let gain = decrease / moved.predicted;
            if decrease > 0.0 && gain > 1e-3 {
                *state = moved.state;
                lambda = (lambda * (1.0 - (2.0 * gain - 1.0).powi(3)).max(1.0 / 3.0)).max(LAMBDA_MIN);
                growth = 2.0;
                weighting.curved = decrease <= near * cost;
                if decrease <= limits.decrease * cost {
                    return ended(super::Outcome::Converged, iteration, moved.cost);
                }
                cost = moved.cost;
            } else if weighting.curved {
                // The same again with the weights.
                weighting.curved = false;
                near *= NEARER;
            } else if moved.predicted <= limits.kink * cost {
                return ended(super::Outcome::Converged, iteration, cost);
            } else {
                lambda *= growth;
                growth *= 2.0;
                if lambda > LAMBDA_MAX {
                    let outcome = if settled { super::Outcome::Converged } else { super::Outcome::Stuck };
                    return ended(outcome, iteration, cost);
                }
            }
        }
        ended(super::Outcome::IterationLimit, limits.iterations, cost)
    }

    /// Solves for the step of cameras and shared unknowns.
    fn solve(&mut self, equations: Equations) -> Result<CameraStep, NotPositiveDefinite> {
        let Equations { matrix, gradient, reduced_gradient, diagonal, .. } = equations;
        let factor = Factor::new(matrix)?;
        let mut values: Vec<f64> = reduced_gradient.iter().map(|value| -value).collect();
        factor.solve(&mut values);
        self.system.give_back(factor.into_storage());
        Ok(CameraStep { values, gradient, diagonal })
    }

    /// Covariance of every camera, by camera, and of the shared unknowns, points and all else adjusted along.
    ///
    /// # Errors
    /// [`NotPositiveDefinite`] if something is not determined.
    pub(super) fn covariances(
        &mut self,
        weighting: &Weighting,
        state: &State<M::Estimate>,
    ) -> Result<Covariances<C>, NotPositiveDefinite> {
        let weighting = Weighting { information: Some(weighting.loss.information(2)), ..*weighting };
        let equations = self.system.eliminate(self.model, &self.layout, &weighting, state, 0.0);
        let blocks = Factor::new(equations.matrix)?.inverse_diagonal();
        let camera = |camera: usize| SMatrix::from_fn(|i, j| blocks[self.layout.position(camera)][(i, j)]);
        let shared = blocks.get(self.layout.cameras());
        Ok(Covariances {
            cameras: (0..self.layout.cameras()).map(camera).collect(),
            shared: (0..self.model.shared()).map(|i| shared.map_or(0.0, |block| block[(i, i)])).collect(),
        })
    }
}

/// See [`Solver::covariances`].
pub(super) struct Covariances<const C: usize> {
    pub(super) cameras: Vec<SMatrix<f64, C, C>>,
    /// Variances of the shared unknowns.
    pub(super) shared: Vec<f64>,
}

/// A step with what predicts its decrease.
pub(super) struct CameraStep {
    values: Vec<f64>,
    /// Of cameras and shared unknowns, points not eliminated.
    gradient: Vec<f64>,
    /// Of the matrix, points not eliminated.
    diagonal: Vec<f64>,
}
