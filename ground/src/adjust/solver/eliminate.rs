//! The first pass: the normal equations with the points eliminated.

use std::ops::Range;

use nalgebra::{Matrix3, Vector3};
use pulp::{Arch, Simd, WithSimd};
use rayon::prelude::*;

use super::envelope::{Envelope, SLACK};
use super::kernels::{Share, lower, reduce, update};
use super::order::{Layout, padded};
use super::{Model, Sight, State, Weighting};
use crate::adjust::loss::Loss;
use crate::adjust::tracks::Tracks;

/// Chunks whose sums are in memory at the same time, for each thread.
const WAVE: usize = 4;

/// What stays the same from one linearisation to the next.
pub(super) struct System {
    chunks: Vec<Chunk>,
    matrix: Option<Envelope>,
    /// Of the chunks of a wave: memory fresh from the system costs more than most of the work.
    sums: Vec<Sums>,
}

/// Points that are summed up together, and the cameras that see them.
struct Chunk {
    /// In the layout's order.
    points: Range<usize>,
    /// Position of the first camera.
    low: usize,
    /// For every camera from there on, the first coupled one, counted from `low`.
    first: Vec<u32>,
}

/// The equations at a state, for a given damping.
pub(super) struct Equations {
    /// Cameras and shared unknowns, points eliminated.
    pub(super) matrix: Envelope,
    /// Gradient before the points are eliminated, and after.
    pub(super) gradient: Vec<f64>,
    pub(super) reduced_gradient: Vec<f64>,
    /// Diagonal before damping and before the points are eliminated.
    pub(super) diagonal: Vec<f64>,
    pub(super) cost: f64,
}

impl Equations {
    /// Largest entry of the gradient of cameras and shared unknowns.
    pub(super) fn gradient_max(&self) -> f64 {
        self.gradient.iter().fold(0.0, |largest, value| largest.max(value.abs()))
    }
}

impl System {
    pub(super) fn new(layout: &Layout, tracks: &Tracks) -> Self {
        let size = (tracks.len() / 32).clamp(128, 1024);
        let starts = (0..tracks.len()).step_by(size);
        let chunks: Vec<_> =
            starts.map(|start| Chunk::new(start..(start + size).min(tracks.len()), layout, tracks)).collect();
        let wave = (WAVE * rayon::current_num_threads()).min(chunks.len());
        let sums = std::iter::repeat_with(Sums::default).take(wave).collect();
        Self { chunks, matrix: Some(Envelope::new(layout.shape())), sums }
    }

    /// Takes the storage of a solved matrix back.
    pub(super) fn give_back(&mut self, storage: Envelope) {
        self.matrix = Some(storage);
    }

    /// Equations with Levenberg-Marquardt damping `lambda` on the diagonal.
    pub(super) fn eliminate<M: Model<C, K>, const C: usize, const K: usize>(
        &mut self,
        model: &M,
        layout: &Layout,
        weighting: &Weighting,
        state: &State<M::Estimate>,
        lambda: f64,
    ) -> Equations {
        let mut matrix = self.matrix.take().unwrap_or_else(|| Envelope::new(layout.shape()));
        matrix.clear();
        let size = matrix.size();
        let [gradient, reduced_gradient, diagonal] = [(); 3].map(|()| vec![0.0; size]);
        let mut equations = Equations { matrix, gradient, reduced_gradient, diagonal, cost: 0.0 };
        let shared = model.point_shared().map(|index| index.map(|index| layout.shared(index)));
        for wave in self.chunks.chunks(self.sums.len().max(1)) {
            wave.par_iter().zip(&mut self.sums).for_each(|(chunk, sums)| {
                Arch::new().dispatch(EliminateChunk { chunk, model, layout, weighting, state, lambda, sums });
            });
            for (chunk, sums) in wave.iter().zip(&self.sums) {
                sums.add_to(&mut equations, chunk.low, &shared, C);
            }
        }
        add_priors(model, layout, &state.estimate, weighting.information.is_some(), &mut equations);
        for row in 0..size {
            equations.reduced_gradient[row] += equations.gradient[row];
            equations.matrix.add(row, row, lambda * equations.diagonal[row]);
        }
        for row in layout.padding() {
            equations.matrix.add(row, row, 1.0);
        }
        equations
    }
}

impl Chunk {
    fn new(points: Range<usize>, layout: &Layout, tracks: &Tracks) -> Self {
        let positions = |point: u32| tracks.of(point as usize).iter().map(|seen| layout.position(seen.photo as usize));
        let all = layout.points()[points.clone()].iter();
        let low = all.clone().flat_map(|&point| positions(point)).min().unwrap_or(0);
        let end = all.clone().flat_map(|&point| positions(point)).max().map_or(low, |last| last + 1);
        let mut first: Vec<u32> = (0..(end - low) as u32).collect();
        for &point in all {
            let earliest = positions(point).min().map_or(0, |position| (position - low) as u32);
            for position in positions(point) {
                first[position - low] = first[position - low].min(earliest);
            }
        }
        Self { points, low, first }
    }
}

/// The sums of one chunk: its cameras, then the `K` shared unknowns.
#[derive(Default)]
struct Sums {
    matrix: Envelope,
    gradient: Vec<f64>,
    reduction: Vec<f64>,
    diagonal: Vec<f64>,
    cost: f64,
}

impl Sums {
    /// Makes them the zero sums of a chunk.
    fn reset(&mut self, chunk: &Chunk, per_camera: usize, shared: usize) {
        let cameras = chunk.first.iter().map(|&first| (per_camera, first as usize));
        self.matrix.reset(cameras.chain((shared > 0).then(|| (padded(shared), 0))));
        for sums in [&mut self.gradient, &mut self.reduction, &mut self.diagonal] {
            sums.clear();
            sums.resize(self.matrix.size(), 0.0);
        }
        self.cost = 0.0;
    }

    /// Adds to the whole, whose rows of the shared unknowns are given.
    fn add_to(&self, equations: &mut Equations, low: usize, shared: &[Option<usize>], per_camera: usize) {
        let shift = low * per_camera;
        let cameras = self.matrix.size() - if shared.is_empty() { 0 } else { padded(shared.len()) };
        let row_of = |row: usize| if row < cameras { Some(row + shift) } else { *shared.get(row - cameras)? };
        let vectors = [
            (&self.gradient, &mut equations.gradient),
            (&self.reduction, &mut equations.reduced_gradient),
            (&self.diagonal, &mut equations.diagonal),
        ];
        for (from, to) in vectors {
            for (row, value) in from.iter().enumerate() {
                if let Some(row) = row_of(row) {
                    to[row] += value;
                }
            }
        }
        for (index, block) in self.matrix.blocks().iter().enumerate() {
            for offset in 0..block.height {
                let Some(row) = row_of(block.row + offset) else { continue };
                let (to, to_offset) = equations.matrix.locate(row);
                let end = cameras.min(block.row + block.height);
                let values = self.matrix.part(index, offset, block.column()..end);
                let target = equations.matrix.part_mut(to, to_offset, block.column() + shift..end + shift);
                for (sum, value) in target.iter_mut().zip(values) {
                    *sum += value;
                }
                for column in end..block.row + block.height {
                    let Some(to_column) = row_of(column).filter(|&to_column| to_column <= row) else { continue };
                    let value = self.matrix.part(index, offset, column..column + 1)[0];
                    equations.matrix.part_mut(to, to_offset, to_column..to_column + 1)[0] += value;
                }
            }
        }
        equations.cost += self.cost;
    }
}

/// The point's own equations.
#[derive(Clone, Copy)]
pub(super) struct PointSums {
    pub(super) own: Matrix3<f64>,
    pub(super) gradient: Vector3<f64>,
}

impl PointSums {
    pub(super) const ZERO: Self =
        Self { own: Matrix3::new(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0), gradient: Vector3::new(0.0, 0.0, 0.0) };

    /// Inverse of the damped curvature; zero, so that the point rests, where it has none.
    pub(super) fn inverse(&self, lambda: f64) -> Matrix3<f64> {
        let damped = self.own + Matrix3::from_diagonal(&(self.own.diagonal() * lambda));
        damped.try_inverse().unwrap_or_else(Matrix3::zeros)
    }
}

struct EliminateChunk<'a, M: Model<C, K>, const C: usize, const K: usize> {
    chunk: &'a Chunk,
    model: &'a M,
    layout: &'a Layout,
    weighting: &'a Weighting,
    state: &'a State<M::Estimate>,
    lambda: f64,
    sums: &'a mut Sums,
}

impl<M: Model<C, K>, const C: usize, const K: usize> WithSimd for EliminateChunk<'_, M, C, K> {
    type Output = ();

    #[expect(clippy::inline_always, reason = "inlined into the dispatch, else it is compiled without its vectors")]
    #[inline(always)]
    fn with_simd<S: Simd>(mut self, simd: S) {
        self.sums.reset(self.chunk, C, K);
        let mut shares: Vec<Share<C>> = Vec::new();
        for &point in &self.layout.points()[self.chunk.points.clone()] {
            self.eliminate_point(simd, point as usize, &mut shares);
        }
    }
}

impl<M: Model<C, K>, const C: usize, const K: usize> EliminateChunk<'_, M, C, K> {
    #[expect(clippy::inline_always, reason = "inlined into the dispatch, else it is compiled without its vectors")]
    #[inline(always)]
    fn eliminate_point<S: Simd>(&mut self, simd: S, point: usize, shares: &mut Vec<Share<C>>) {
        let sums = &mut *self.sums;
        let (estimate, position) = (&self.state.estimate, &self.state.points[point]);
        let mut own = PointSums::ZERO;
        let mut shared: Share<K> = Share::new(self.chunk.first.len());
        let mut sighted = 0;
        for seen in self.model.tracks().of(point) {
            let Some(mut sight) = self.model.sight(estimate, position, seen) else {
                sums.cost += self.weighting.cost(None);
                continue;
            };
            sums.cost += self.weighting.whiten(&mut sight);
            let block = self.layout.position(seen.photo as usize) - self.chunk.low;
            if sighted == shares.len() {
                shares.push(Share::new(0));
            }
            let share = &mut shares[sighted];
            share.block = block;
            linearise(simd, &sight, &mut own, (share, &mut shared), sums);
            sighted += 1;
        }
        let shares = &mut shares[..sighted];
        if let Some(prior) = self.model.point_prior(estimate, position) {
            sums.cost += 0.5 * prior.residual * prior.residual;
            own.own += prior.by_point.transpose() * prior.by_point;
            own.gradient += prior.by_point.transpose() * prior.residual;
            if K > 0 {
                let row = shared.block * C;
                for a in 0..K {
                    let slope = prior.by_shared[a];
                    sums.gradient[row + a] += slope * prior.residual;
                    sums.diagonal[row + a] += slope * slope;
                    shared.slopes[0][a] = slope;
                    shared.by_unknown[a][0] = slope;
                    for k in 0..3 {
                        shared.coupling[k][a] += slope * prior.by_point[k];
                    }
                }
            }
        }
        let inverse = own.inverse(self.lambda);
        let pull = inverse * own.gradient;
        for share in shares.iter_mut() {
            reduce(share, &inverse);
        }
        reduce(&mut shared, &inverse);
        for (index, share) in shares.iter().enumerate() {
            let own = share.block * C;
            let (target, stride) = sums.matrix.corner_mut(share.block, own);
            update(simd, target, stride, &share.by_unknown, &share.slopes, C);
            update(simd, target, stride, &share.reduced, &share.coupling, C);
            for other in &shares[..index] {
                let (row, column) = if share.block < other.block { (other, share) } else { (share, other) };
                let (target, stride) = sums.matrix.corner_mut(row.block, column.block * C);
                update(simd, target, stride, &row.reduced, &column.coupling, C);
                if other.block == share.block {
                    // A camera that sees the point twice: the other half of the square.
                    update(simd, target, stride, &other.reduced, &share.coupling, C);
                }
            }
            lower(&mut sums.reduction[own..own + C], share, &pull);
            if K > 0 {
                let (target, stride) = sums.matrix.corner_mut(shared.block, own);
                update(simd, target, stride, &shared.reduced, &share.coupling, C);
            }
        }
        if K > 0 {
            let row = shared.block * C;
            let (target, stride) = sums.matrix.corner_mut(shared.block, row);
            update(simd, target, stride, &shared.by_unknown, &shared.slopes, K);
            update(simd, target, stride, &shared.reduced, &shared.coupling, K);
            lower(&mut sums.reduction[row..row + K], &shared, &pull);
        }
    }
}

/// Adds one whitened observation to the sums; makes `share` its camera's share of the point, and adds to `shared`'s.
#[expect(clippy::inline_always, reason = "inlined into the dispatch, else it is compiled without its vectors")]
#[inline(always)]
fn linearise<S: Simd, const C: usize, const K: usize>(
    simd: S,
    sight: &Sight<C, K>,
    own: &mut PointSums,
    (share, shared): (&mut Share<C>, &mut Share<K>),
    sums: &mut Sums,
) {
    let Sight { residual, by_point, .. } = sight;
    own.own += by_point.transpose() * by_point;
    own.gradient += by_point.transpose() * residual;
    let block = share.block;
    for a in 0..C {
        let slopes = [sight.by_camera[(0, a)], sight.by_camera[(1, a)]];
        (share.slopes[0][a], share.slopes[1][a]) = (slopes[0], slopes[1]);
        share.by_unknown[a] = slopes;
        sums.gradient[block * C + a] += slopes[0] * residual.x + slopes[1] * residual.y;
        sums.diagonal[block * C + a] += slopes[0] * slopes[0] + slopes[1] * slopes[1];
        for k in 0..3 {
            share.coupling[k][a] = slopes[0] * by_point[(0, k)] + slopes[1] * by_point[(1, k)];
        }
    }
    if K > 0 {
        let row = shared.block * C;
        let mut lanes = [[0.0; SLACK]; 2];
        let mut by_unknown = [[0.0; 2]; K];
        for a in 0..K {
            let slopes = [sight.by_shared[(0, a)], sight.by_shared[(1, a)]];
            (lanes[0][a], lanes[1][a]) = (slopes[0], slopes[1]);
            by_unknown[a] = slopes;
            sums.gradient[row + a] += slopes[0] * residual.x + slopes[1] * residual.y;
            sums.diagonal[row + a] += slopes[0] * slopes[0] + slopes[1] * slopes[1];
            for k in 0..3 {
                shared.coupling[k][a] += slopes[0] * by_point[(0, k)] + slopes[1] * by_point[(1, k)];
            }
        }
        let (target, stride) = sums.matrix.corner_mut(shared.block, row);
        update(simd, target, stride, &by_unknown, &lanes, K);
        let (target, stride) = sums.matrix.corner_mut(shared.block, block * C);
        update(simd, target, stride, &by_unknown, &share.slopes, C);
    }
}

/// Adds what is said about cameras and shared unknowns alone.
fn add_priors<M: Model<C, K>, const C: usize, const K: usize>(
    model: &M,
    layout: &Layout,
    estimate: &M::Estimate,
    information: bool,
    equations: &mut Equations,
) {
    let Equations { matrix, gradient, diagonal, cost: total, .. } = equations;
    // Of the few losses that there are.
    let mut known = vec![(Loss::Squared, 1.0)];
    model.priors(estimate, layout, &mut |row| {
        let (cost, mut weight) = row.loss.at(row.residual * row.residual);
        if information {
            let place = known.iter().position(|(loss, _)| *loss == row.loss).unwrap_or_else(|| {
                known.push((row.loss, row.loss.information(1)));
                known.len() - 1
            });
            weight = if row.loss.believes(row.residual * row.residual) { known[place].1 } else { 0.0 };
        }
        *total += cost;
        for &(index, a) in row.slopes {
            gradient[index] += a * row.residual * weight;
            diagonal[index] += a * a * weight;
            let (block, offset) = matrix.locate(index);
            for &(column, b) in row.slopes.iter().filter(|(column, _)| *column <= index) {
                matrix.part_mut(block, offset, column..column + 1)[0] += a * b * weight;
            }
        }
    });
}
