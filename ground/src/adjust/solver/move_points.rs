//! The second pass: the step of every point once the cameras' is known, and the cost of the new state.

use nalgebra::{Point3, SVector, Vector3};
use rayon::prelude::*;

use super::eliminate::PointSums;
use super::order::Layout;
use super::{CameraStep, Model, State, Step, Weighting};

/// Points per task.
pub(super) const TASK: usize = 512;

/// A state after a damped step.
pub(super) struct Moved<E> {
    pub(super) state: State<E>,
    pub(super) cost: f64,
    /// Decrease of the cost that the linear model predicts.
    pub(super) predicted: f64,
}

/// The cost of a state.
pub(super) fn cost<M: Model<C, K>, const C: usize, const K: usize>(
    model: &M,
    layout: &Layout,
    weighting: &Weighting,
    state: &State<M::Estimate>,
) -> f64 {
    let costs: Vec<f64> = state
        .points
        .par_chunks(TASK)
        .enumerate()
        .map(|(task, points)| {
            let costs = points.iter().enumerate();
            costs.map(|(i, point)| point_cost(model, weighting, &state.estimate, task * TASK + i, point)).sum()
        })
        .collect();
    costs.iter().sum::<f64>() + prior_cost(model, layout, &state.estimate)
}

fn prior_cost<M: Model<C, K>, const C: usize, const K: usize>(
    model: &M,
    layout: &Layout,
    estimate: &M::Estimate,
) -> f64 {
    let mut cost = 0.0;
    model.priors(estimate, layout, &mut |row| cost += row.loss.at(row.residual * row.residual).0);
    cost
}

fn point_cost<M: Model<C, K>, const C: usize, const K: usize>(
    model: &M,
    weighting: &Weighting,
    estimate: &M::Estimate,
    index: usize,
    point: &Point3<f64>,
) -> f64 {
    let seen = model.tracks().of(index).iter();
    let prior = model.point_prior(estimate, point).map_or(0.0, |prior| 0.5 * prior.residual * prior.residual);
    prior + seen.map(|seen| weighting.cost(model.residual(estimate, point, seen).as_ref())).sum::<f64>()
}

/// Takes the step.
pub(super) fn step<M: Model<C, K>, const C: usize, const K: usize>(
    model: &M,
    layout: &Layout,
    weighting: &Weighting,
    state: &State<M::Estimate>,
    cameras: &CameraStep,
    lambda: f64,
) -> Moved<M::Estimate> {
    let taken = Step { layout, values: &cameras.values };
    let estimate = model.stepped(&state.estimate, &taken);
    let by_camera: Vec<SVector<f64, C>> = (0..layout.cameras()).map(|camera| taken.camera(camera)).collect();
    let indices = model.point_shared();
    let shared: SVector<f64, K> = SVector::from_fn(|k, _| indices[k].map_or(0.0, |index| taken.shared(index)));
    let mut points = state.points.clone();
    let sums: Vec<[f64; 2]> = points
        .par_chunks_mut(TASK)
        .enumerate()
        .map(|(task, points)| {
            let mut sums = [0.0; 2];
            for (i, point) in points.iter_mut().enumerate() {
                let index = task * TASK + i;
                let own = point_sums(model, weighting, &state.estimate, index, point, &by_camera, &shared);
                let inverse = own.0.inverse(lambda);
                let step = -(inverse * own.0.gradient);
                let damped = own.0.own.diagonal().component_mul(&step) * lambda;
                *point += step;
                sums[0] += point_cost(model, weighting, &estimate, index, point);
                sums[1] += 0.5 * step.dot(&(damped - own.1));
            }
            sums
        })
        .collect();
    let mut cost = prior_cost(model, layout, &estimate);
    // `-(g.d + d.H d / 2)` with `H d = -g - lambda diag(H) d`, that is `d.(lambda diag(H) d - g) / 2`.
    let mut predicted = 0.0;
    for ((step, gradient), diagonal) in cameras.values.iter().zip(&cameras.gradient).zip(&cameras.diagonal) {
        predicted += 0.5 * step * (lambda * diagonal * step - gradient);
    }
    for [points_cost, points_predicted] in sums {
        cost += points_cost;
        predicted += points_predicted;
    }
    Moved { state: State { estimate, points }, cost, predicted }
}

/// The point's own equations with the cameras' step on their right side, and its gradient without.
fn point_sums<M: Model<C, K>, const C: usize, const K: usize>(
    model: &M,
    weighting: &Weighting,
    estimate: &M::Estimate,
    index: usize,
    point: &Point3<f64>,
    cameras: &[SVector<f64, C>],
    shared: &SVector<f64, K>,
) -> (PointSums, Vector3<f64>) {
    let mut sums = PointSums::ZERO;
    let mut gradient = Vector3::zeros();
    for seen in model.tracks().of(index) {
        let Some(mut sight) = model.sight(estimate, point, seen) else { continue };
        weighting.whiten(&mut sight);
        let moved = sight.residual + sight.by_camera * cameras[seen.photo as usize] + sight.by_shared * shared;
        let slope = sight.by_point.transpose();
        sums.own += slope * sight.by_point;
        sums.gradient += slope * moved;
        gradient += slope * sight.residual;
    }
    if let Some(prior) = model.point_prior(estimate, point) {
        let slope = prior.by_point.transpose();
        sums.own += slope * prior.by_point;
        sums.gradient += slope * (prior.residual + prior.by_shared.dot(shared));
        gradient += slope * prior.residual;
    }
    (sums, gradient)
}
