//! What a point leaves behind in the equations of the cameras that see it, in whole vectors.

use nalgebra::{Matrix3, Vector3};
use pulp::Simd;

use super::envelope::SLACK;

/// A point's share of one camera (or of the shared unknowns), ready for the kernels.
pub(super) struct Share<const N: usize> {
    pub(super) block: usize,
    /// Derivatives of the two whitened residuals by the share's unknowns, padded for whole vectors, and the same by unknown.
    pub(super) slopes: [[f64; SLACK]; 2],
    pub(super) by_unknown: [[f64; 2]; N],
    /// Columns of the coupling with the point, padded, and rows of it times the point's own inverse, negative.
    pub(super) coupling: [[f64; SLACK]; 3],
    pub(super) reduced: [[f64; 3]; N],
}

impl<const N: usize> Share<N> {
    pub(super) fn new(block: usize) -> Self {
        Self {
            block,
            slopes: [[0.0; SLACK]; 2],
            by_unknown: [[0.0; 2]; N],
            coupling: [[0.0; SLACK]; 3],
            reduced: [[0.0; 3]; N],
        }
    }
}

/// Multiplies the coupling with the inverse of the point's own curvature, negative.
#[expect(clippy::inline_always, reason = "inlined into the dispatch, else it is compiled without its vectors")]
#[inline(always)]
pub(super) fn reduce<const N: usize>(share: &mut Share<N>, inverse: &Matrix3<f64>) {
    for a in 0..N {
        for k in 0..3 {
            share.reduced[a][k] = -(0..3).map(|l| share.coupling[l][a] * inverse[(l, k)]).sum::<f64>();
        }
    }
}

/// Subtracts the coupling times the point's own step from the gradient.
pub(super) fn lower<const N: usize>(gradient: &mut [f64], share: &Share<N>, pull: &Vector3<f64>) {
    for (a, value) in gradient.iter_mut().enumerate() {
        *value -= (0..3).map(|k| share.coupling[k][a] * pull[k]).sum::<f64>();
    }
}

/// `target[row][column] += sum over r of factors[row][r] * lanes[r][column]`, in whole vectors: lanes beyond `width` are zero.
#[expect(clippy::inline_always, reason = "inlined into the dispatch, else it is compiled without its vectors")]
#[inline(always)]
pub(super) fn update<S: Simd, const R: usize, const N: usize>(
    simd: S,
    target: &mut [f64],
    stride: usize,
    factors: &[[f64; R]; N],
    lanes: &[[f64; SLACK]; R],
    width: usize,
) {
    let vectors = width.div_ceil(S::F64_LANES);
    for vector in 0..vectors {
        let start = vector * S::F64_LANES;
        let columns: [S::f64s; R] =
            std::array::from_fn(|r| S::as_simd_f64s(&lanes[r][start..start + S::F64_LANES]).0[0]);
        for (row, factors) in factors.iter().enumerate() {
            let place = row * stride + start;
            let sum = &mut S::as_mut_simd_f64s(&mut target[place..place + S::F64_LANES]).0[0];
            for r in 0..R {
                *sum = simd.mul_add_e_f64s(simd.splat_f64s(factors[r]), columns[r], *sum);
            }
        }
    }
}
