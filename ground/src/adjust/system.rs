//! The normal equations with the points eliminated (Schur complement).
//!
//! Points are visited in a fixed number of chunks, each with its own sum, joined in order: the result does not depend on the
//! number of threads. Triggs et al., "Bundle Adjustment: A Modern Synthesis", 2000, section 6.

use nalgebra::{DVector, Matrix3, Point3, SMatrix, Vector3, Vector6};
use rayon::prelude::*;

use super::envelope::{Envelope, Factor, NotPositiveDefinite};
use super::factors::{
    body_centre, geman_mcclure, odometer_anchor, odometer_step, ranges, reprojection, rotation_prior, surface,
};
use super::problem::{Point, Problem, Shared, Weights};

/// Unknowns per camera.
const CAMERA: usize = 6;
/// Shared unknowns: mounting (3), odometer scale (1).
const SHARED: usize = 4;
const CHUNKS: usize = 8;
/// Range readings are Geman-McClure at this many standard deviations: a beam may meet a pipe, a person, a spray of water.
const RANGE_ROBUST: f64 = 3.0;
/// Keeps a photo that nothing else holds near its prior pose; ten times looser than the worst prior.
const LOOSE_POSITION_M: f64 = 0.5;

/// An estimate: everything that a step changes.
#[derive(Clone, Debug)]
pub(super) struct State {
    pub(super) poses: Vec<nalgebra::Isometry3<f64>>,
    pub(super) points: Vec<Point3<f64>>,
    pub(super) shared: Shared,
}

/// The linearised problem around a state.
pub(super) struct System {
    /// Camera and shared unknowns, points eliminated for the given damping later.
    reduced: Envelope,
    gradient: DVector<f64>,
    points: Vec<PointBlocks>,
    pub(super) cost: f64,
}

struct PointBlocks {
    /// Curvature of the point itself.
    own: Matrix3<f64>,
    gradient: Vector3<f64>,
    /// Photo and its coupling with the point.
    couplings: Vec<(usize, SMatrix<f64, CAMERA, 3>)>,
}

/// The system without its points.
struct Eliminated {
    /// Of the reduced matrix.
    factor: Factor,
    /// Of the points' own blocks.
    inverses: Vec<Matrix3<f64>>,
    /// Reduced gradient.
    gradient: DVector<f64>,
}

/// A damped step.
pub(super) struct Step {
    pub(super) cameras: DVector<f64>,
    pub(super) points: Vec<Vector3<f64>>,
    /// Decrease of the cost that the linear model predicts.
    pub(super) predicted: f64,
}

/// Builds the linearised problem.
pub(super) fn linearise(problem: &Problem<'_>, weights: &Weights, state: &State) -> System {
    let first = envelope_of(&problem.points, state.poses.len());
    let per_chunk = problem.points.len().div_ceil(CHUNKS).max(1);
    let chunks: Vec<(Envelope, DVector<f64>, Vec<PointBlocks>, f64)> = problem
        .points
        .par_chunks(per_chunk)
        .zip(state.points.par_chunks(per_chunk))
        .map(|(points, positions)| linearise_points(problem, weights, state, points, positions, &first))
        .collect();
    let size = first.len();
    let mut system =
        System { reduced: Envelope::new(first), gradient: DVector::zeros(size), points: Vec::new(), cost: 0.0 };
    for (envelope, gradient, blocks, cost) in chunks {
        system.reduced.add_all(&envelope);
        system.gradient += gradient;
        system.points.extend(blocks);
        system.cost += cost;
    }
    system.cost += add_tags(problem, state, &mut Sink::Equations(&mut system.reduced, &mut system.gradient));
    system
}

/// The cost alone.
pub(super) fn cost(problem: &Problem<'_>, weights: &Weights, state: &State) -> f64 {
    let points: Vec<f64> = problem
        .points
        .par_iter()
        .zip(&state.points)
        .map(|(point, position)| {
            let mut cost = 0.0;
            for observation in &point.observations {
                let pose = &state.poses[observation.photo];
                cost += match problem.camera.project(&pose.inverse_transform_point(position).coords) {
                    Some(pixel) => {
                        let squared = (pixel - observation.pixel).norm_squared() / weights.pixel_px.powi(2);
                        geman_mcclure(squared, weights.robust).0
                    }
                    None => 0.5 * weights.robust.powi(2),
                };
            }
            let surface = surface(problem.profile, position, weights.surface_m).map_or(0.0, |(residual, _)| residual);
            cost + 0.5 * surface * surface
        })
        .collect();
    points.iter().sum::<f64>() + add_tags(problem, state, &mut Sink::Nothing)
}

/// First column of every row: the earliest photo that shares a point (or the odometer's previous photo); shared rows are full.
fn envelope_of(points: &[Point], photos: usize) -> Vec<usize> {
    let mut earliest: Vec<usize> = (0..photos).map(|photo| photo.saturating_sub(1)).collect();
    for point in points {
        let Some(first) = point.observations.iter().map(|observation| observation.photo).min() else { continue };
        for observation in &point.observations {
            earliest[observation.photo] = earliest[observation.photo].min(first);
        }
    }
    let cameras = earliest.iter().flat_map(|photo| [photo * CAMERA; CAMERA]);
    cameras.chain([0; SHARED]).collect()
}

fn linearise_points(
    problem: &Problem<'_>,
    weights: &Weights,
    state: &State,
    points: &[Point],
    positions: &[Point3<f64>],
    first: &[usize],
) -> (Envelope, DVector<f64>, Vec<PointBlocks>, f64) {
    let mut envelope = Envelope::new(first.to_vec());
    let mut gradient = DVector::zeros(first.len());
    let mut total = 0.0;
    let blocks = points
        .iter()
        .zip(positions)
        .map(|(point, position)| {
            let mut blocks = PointBlocks { own: Matrix3::zeros(), gradient: Vector3::zeros(), couplings: Vec::new() };
            for observation in &point.observations {
                let pose = &state.poses[observation.photo];
                let Some((error, by_camera, by_point)) =
                    reprojection(problem.camera, pose, position, &observation.pixel)
                else {
                    total += 0.5 * weights.robust.powi(2);
                    continue;
                };
                let information = weights.pixel_px.powi(-2);
                let (cost, weight) = geman_mcclure(error.norm_squared() * information, weights.robust);
                total += cost;
                let weight = weight * information;
                let row = observation.photo * CAMERA;
                envelope.add_block(row, row, &(by_camera.transpose() * by_camera * weight));
                add_segment(&mut gradient, row, &(by_camera.transpose() * error * weight));
                blocks.own += by_point.transpose() * by_point * weight;
                blocks.gradient += by_point.transpose() * error * weight;
                blocks.couplings.push((observation.photo, by_camera.transpose() * by_point * weight));
            }
            if let Some((residual, slope)) = surface(problem.profile, position, weights.surface_m) {
                total += 0.5 * residual * residual;
                blocks.own += slope.transpose() * slope;
                blocks.gradient += slope.transpose() * residual;
            }
            blocks.couplings.sort_unstable_by_key(|(photo, _)| *photo);
            blocks
        })
        .collect();
    (envelope, gradient, blocks, total)
}

fn add_segment(gradient: &mut DVector<f64>, row: usize, values: &Vector6<f64>) {
    for (offset, value) in values.iter().enumerate() {
        gradient[row + offset] += value;
    }
}

/// Where the tags' residuals go.
enum Sink<'a> {
    Nothing,
    Equations(&'a mut Envelope, &'a mut DVector<f64>),
}

impl Sink<'_> {
    /// Adds one scalar residual with a sparse row of derivatives `(unknown, value)`.
    fn add(&mut self, residual: f64, weight: f64, slopes: &[(usize, f64)]) {
        let Self::Equations(matrix, gradient) = self else { return };
        for &(row, a) in slopes {
            gradient[row] += a * residual * weight;
            for &(column, b) in slopes {
                if column <= row {
                    matrix.add(row, column, a * b * weight);
                }
            }
        }
    }
}

/// Adds what the tags say and returns its cost.
fn add_tags(problem: &Problem<'_>, state: &State, sink: &mut Sink<'_>) -> f64 {
    let shared_row = state.poses.len() * CAMERA;
    let mut cost = 0.0;
    let mut plain = |sink: &mut Sink<'_>, residual: f64, slopes: &[(usize, f64)]| {
        sink.add(residual, 1.0, slopes);
        cost += 0.5 * residual * residual;
    };
    let mut robust_cost = 0.0;
    let mut previous: Option<(usize, f64)> = None;
    for (photo, (tag, pose)) in problem.tags.iter().zip(&state.poses).enumerate() {
        let row = photo * CAMERA;
        let rotation = rotation_prior(tag, problem.rig, &problem.sigma, &pose.rotation, &state.shared);
        for axis in 0..3 {
            let mut slopes = [(0, 0.0); 6];
            for unknown in 0..3 {
                slopes[unknown] = (row + unknown, rotation.by_rotation[(axis, unknown)]);
                slopes[3 + unknown] = (shared_row + unknown, rotation.by_mount[(axis, unknown)]);
            }
            plain(sink, rotation.residual[axis], &slopes);
        }
        for range in ranges(tag, problem.rig, problem.profile, problem.sigma.range_m, pose, &state.shared) {
            let (cost, weight) = geman_mcclure(range.residual.powi(2), RANGE_ROBUST);
            robust_cost += cost;
            let slopes = [(row + 4, range.by_centre[1]), (row + 5, range.by_centre[2])];
            sink.add(range.residual, weight, &slopes);
        }
        for axis in 0..3 {
            let drift = pose.translation.vector[axis] - problem.poses[photo].translation.vector[axis];
            plain(sink, drift / LOOSE_POSITION_M, &[(row + 3 + axis, 1.0 / LOOSE_POSITION_M)]);
        }
        if let Some(reading_m) = tag.odometer_m {
            let x_m = body_centre(problem.rig, pose, &state.shared).x;
            if let Some((before, before_m)) = previous {
                let moved_m = x_m - body_centre(problem.rig, &state.poses[before], &state.shared).x;
                let step = odometer_step(before_m, reading_m, moved_m, &state.shared);
                let slopes = [(before * CAMERA + 3, -step.by_x), (row + 3, step.by_x), (shared_row + 3, step.by_scale)];
                plain(sink, step.residual, &slopes);
            } else {
                let (residual, by_x) = odometer_anchor(reading_m, x_m);
                plain(sink, residual, &[(row + 3, by_x)]);
            }
            previous = Some((photo, reading_m));
        }
    }
    let nominal = Vector3::from(problem.rig.mount_rotvec_rad);
    for axis in 0..3 {
        let residual = (state.shared.mount_rotvec[axis] - nominal[axis]) / problem.sigma.mount_rad;
        plain(sink, residual, &[(shared_row + axis, 1.0 / problem.sigma.mount_rad)]);
    }
    let scale_sigma = problem.sigma.odometer_m_per_m;
    plain(sink, state.shared.odometer_scale / scale_sigma, &[(shared_row + 3, 1.0 / scale_sigma)]);
    cost + robust_cost
}

impl System {
    /// Largest entry of the cameras' gradient.
    pub(super) fn gradient_max(&self) -> f64 {
        self.gradient.amax()
    }

    /// Solves for the step with Levenberg-Marquardt damping `lambda` on the diagonal.
    ///
    /// # Errors
    /// [`NotPositiveDefinite`] if even the damped system cannot be factored.
    pub(super) fn step(&self, lambda: f64) -> Result<Step, NotPositiveDefinite> {
        let Eliminated { factor, inverses, gradient: mut cameras } = self.eliminate(lambda)?;
        cameras.neg_mut();
        factor.solve(cameras.as_mut_slice());
        let points: Vec<Vector3<f64>> = self
            .points
            .par_iter()
            .zip(&inverses)
            .map(|(blocks, inverse)| {
                let mut right = -blocks.gradient;
                for (photo, coupling) in &blocks.couplings {
                    right -= coupling.transpose() * cameras.fixed_rows::<CAMERA>(photo * CAMERA);
                }
                inverse * right
            })
            .collect();
        let predicted = self.predicted_decrease(lambda, &cameras, &points);
        Ok(Step { cameras, points, predicted })
    }

    /// Returns the factor of the reduced system without damping: its inverse is the covariance of cameras and shared unknowns.
    ///
    /// # Errors
    /// [`NotPositiveDefinite`] if something is not determined.
    pub(super) fn information(&self) -> Result<Factor, NotPositiveDefinite> {
        Ok(self.eliminate(0.0)?.factor)
    }

    fn eliminate(&self, lambda: f64) -> Result<Eliminated, NotPositiveDefinite> {
        let mut reduced = self.reduced.clone();
        let mut gradient = self.gradient.clone();
        for row in 0..reduced.size() {
            reduced.add(row, row, lambda * reduced.diagonal(row));
        }
        let inverses: Vec<Matrix3<f64>> = self
            .points
            .iter()
            .map(|blocks| {
                let damped = blocks.own + Matrix3::from_diagonal(&(blocks.own.diagonal() * lambda));
                damped.try_inverse().unwrap_or_else(Matrix3::zeros)
            })
            .collect();
        let per_chunk = self.points.len().div_ceil(CHUNKS).max(1);
        let empty = Envelope::new_like(&self.reduced);
        let sums: Vec<(Envelope, DVector<f64>)> = self
            .points
            .par_chunks(per_chunk)
            .zip(inverses.par_chunks(per_chunk))
            .map(|(points, inverses)| {
                let mut sum = (empty.clone(), DVector::zeros(gradient.len()));
                for (blocks, inverse) in points.iter().zip(inverses) {
                    eliminate_point(blocks, inverse, &mut sum.0, &mut sum.1);
                }
                sum
            })
            .collect();
        for (matrix, vector) in sums {
            reduced.add_all(&matrix);
            gradient += vector;
        }
        Ok(Eliminated { factor: reduced.factor()?, inverses, gradient })
    }

    /// `-(g.d + 0.5 d.H d)` with `H d = -g - lambda diag(H) d`, that is `0.5 d.(lambda diag(H) d - g)`.
    fn predicted_decrease(&self, lambda: f64, cameras: &DVector<f64>, points: &[Vector3<f64>]) -> f64 {
        let mut sum = 0.0;
        for (row, step) in cameras.iter().enumerate() {
            sum += step * (lambda * self.reduced.diagonal(row) * step - self.gradient[row]);
        }
        for (blocks, step) in self.points.iter().zip(points) {
            let damped = blocks.own.diagonal().component_mul(step) * lambda;
            sum += step.dot(&(damped - blocks.gradient));
        }
        0.5 * sum
    }
}

fn eliminate_point(blocks: &PointBlocks, inverse: &Matrix3<f64>, matrix: &mut Envelope, gradient: &mut DVector<f64>) {
    for (index, (row, coupling)) in blocks.couplings.iter().enumerate() {
        let weighted = -(coupling * inverse);
        add_segment(gradient, row * CAMERA, &(weighted * blocks.gradient));
        for (column, other) in &blocks.couplings[..=index] {
            matrix.add_block(row * CAMERA, column * CAMERA, &(weighted * other.transpose()));
        }
    }
}
