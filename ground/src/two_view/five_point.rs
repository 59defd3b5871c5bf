//! Essential matrices through five pairs of rays.
//!
//! Nistér, "An Efficient Solution to the Five-Point Relative Pose Problem", PAMI 26(6), 2004, section 3. Unlike linear
//! solvers it does not degenerate when all points lie on a plane, which a flat tunnel wall is.

use nalgebra::{Matrix3, SMatrix, UnitVector3, Vector3};

use super::polynomial::real_roots;

/// Unknowns `x`, `y`, `z` and the constant 1, as factors of a monomial.
const X: usize = 0;
const Y: usize = 1;
const Z: usize = 2;
const ONE: usize = 3;

/// Monomials up to the third degree in the order of Nistér's table; those of the first half are eliminated.
const CUBIC: [[usize; 3]; 20] = [
    [X, X, X],
    [Y, Y, Y],
    [X, X, Y],
    [X, Y, Y],
    [X, X, Z],
    [X, X, ONE],
    [Y, Y, Z],
    [Y, Y, ONE],
    [X, Y, Z],
    [X, Y, ONE],
    [X, Z, Z],
    [X, Z, ONE],
    [X, ONE, ONE],
    [Y, Z, Z],
    [Y, Z, ONE],
    [Y, ONE, ONE],
    [Z, Z, Z],
    [Z, Z, ONE],
    [Z, ONE, ONE],
    [ONE, ONE, ONE],
];

/// Where the product of three factors stands in [`CUBIC`].
const CUBIC_INDEX: [[[usize; 4]; 4]; 4] = {
    let mut index = [[[0; 4]; 4]; 4];
    let mut i = 0;
    while i < CUBIC.len() {
        let [a, b, c] = CUBIC[i];
        index[a][b][c] = i;
        index[a][c][b] = i;
        index[b][a][c] = i;
        index[b][c][a] = i;
        index[c][a][b] = i;
        index[c][b][a] = i;
        i += 1;
    }
    index
};

/// A polynomial of first degree: factors of `x`, `y`, `z`, 1.
type Linear = [f64; 4];
/// A product of two, not yet symmetric: entry `[a][b]` belongs to `a b`.
type Quadratic = [[f64; 4]; 4];

fn multiply_add(sum: &mut Quadratic, a: &Linear, b: &Linear, factor: f64) {
    for (row, a) in sum.iter_mut().zip(a) {
        for (entry, b) in row.iter_mut().zip(b) {
            *entry += factor * a * b;
        }
    }
}

/// Adds `factor a b` to a row of coefficients in the order of [`CUBIC`].
fn multiply_add_cubic(sum: &mut [f64; 20], a: &Quadratic, b: &Linear, factor: f64) {
    for (i, row) in a.iter().enumerate() {
        for (j, entry) in row.iter().enumerate() {
            for (k, b) in b.iter().enumerate() {
                sum[CUBIC_INDEX[i][j][k]] += factor * entry * b;
            }
        }
    }
}

/// Returns every essential matrix `E` (Frobenius norm arbitrary) with `second^T E first = 0` for five pairs of rays.
///
/// At most ten. Empty if the rays are degenerate (two pairs equal, for one).
pub(super) fn essential_matrices(rays: &[[UnitVector3<f64>; 2]; 5]) -> Vec<Matrix3<f64>> {
    let basis = null_space(rays);
    let Some(reduced) = eliminate(&constraints(&basis)) else { return Vec::new() };
    let rows = [
        z_polynomials(&reduced[4], &reduced[5]),
        z_polynomials(&reduced[6], &reduced[7]),
        z_polynomials(&reduced[8], &reduced[9]),
    ];
    let roots = real_roots(&determinant(&rows));
    roots.into_iter().filter_map(|z| solution(&basis, &rows, z)).collect()
}

/// Four matrices that span all `E` with `second^T E first = 0`, as nine vectors row by row.
fn null_space(rays: &[[UnitVector3<f64>; 2]; 5]) -> [Matrix3<f64>; 4] {
    // Full orthogonal factor of the equations' transpose: its last four columns are orthogonal to all five.
    let mut equations = SMatrix::<f64, 9, 9>::zeros();
    for (mut column, [first, second]) in equations.column_iter_mut().zip(rays) {
        let outer = second.into_inner() * first.transpose();
        column.copy_from_slice(outer.transpose().as_slice());
    }
    let q = equations.qr().q();
    std::array::from_fn(|i| Matrix3::from_row_iterator(q.column(5 + i).iter().copied()))
}

/// The ten cubic constraints `det E = 0` and `E E^T E - trace(E E^T) E / 2 = 0` on `E = x X + y Y + z Z + W`.
fn constraints(basis: &[Matrix3<f64>; 4]) -> [[f64; 20]; 10] {
    let e: [[Linear; 3]; 3] =
        std::array::from_fn(|row| std::array::from_fn(|column| std::array::from_fn(|k| basis[k][(row, column)])));
    let mut product = [[Quadratic::default(); 3]; 3];
    for (i, row) in product.iter_mut().enumerate() {
        for (j, entry) in row.iter_mut().enumerate() {
            for (a, b) in e[i].iter().zip(&e[j]) {
                multiply_add(entry, a, b, 1.0);
            }
        }
    }
    let mut trace = Quadratic::default();
    for (i, row) in product.iter().enumerate() {
        for (sum, entry) in trace.iter_mut().flatten().zip(row[i].iter().flatten()) {
            *sum += entry;
        }
    }
    let mut result = [[0.0; 20]; 10];
    for i in 0..3 {
        for j in 0..3 {
            let row = &mut result[3 * i + j];
            for (entry, b) in product[i].iter().zip(&e) {
                multiply_add_cubic(row, entry, &b[j], 1.0);
            }
            multiply_add_cubic(row, &trace, &e[i][j], -0.5);
        }
    }
    for (i, factor) in e[0].iter().enumerate() {
        let (j, k) = ((i + 1) % 3, (i + 2) % 3);
        let mut minor = Quadratic::default();
        multiply_add(&mut minor, &e[1][j], &e[2][k], 1.0);
        multiply_add(&mut minor, &e[1][k], &e[2][j], -1.0);
        multiply_add_cubic(&mut result[9], &minor, factor, 1.0);
    }
    result
}

/// Solves for the first ten monomials: `monomial[i] = -row[i] . (last ten monomials)`.
fn eliminate(constraints: &[[f64; 20]; 10]) -> Option<[[f64; 10]; 10]> {
    let left = SMatrix::<f64, 10, 10>::from_fn(|i, j| constraints[i][j]);
    let right = SMatrix::<f64, 10, 10>::from_fn(|i, j| constraints[i][10 + j]);
    let solved = left.lu().solve(&right)?;
    Some(std::array::from_fn(|i| std::array::from_fn(|j| solved[(i, j)])))
}

/// A polynomial in `z` of degree four, lowest power first.
type InZ = [f64; 5];

/// `row - z next`, whose leading monomials cancel: factors of `x`, `y`, 1 as polynomials in `z`.
fn z_polynomials(row: &[f64; 10], next: &[f64; 10]) -> [InZ; 3] {
    let mut result = [[0.0; 5]; 3];
    for (polynomial, (offset, degree)) in result.iter_mut().zip([(0, 2), (3, 2), (6, 3)]) {
        for power in 0..=degree {
            polynomial[power] += row[offset + degree - power];
            polynomial[power + 1] -= next[offset + degree - power];
        }
    }
    result
}

/// Determinant of the 3 x 3 matrix of polynomials: degree ten, highest power first.
fn determinant(rows: &[[InZ; 3]; 3]) -> [f64; 11] {
    let mut sum = [0.0; 11];
    for (a, b, c, sign) in
        [(0, 1, 2, 1.0), (1, 2, 0, 1.0), (2, 0, 1, 1.0), (2, 1, 0, -1.0), (1, 0, 2, -1.0), (0, 2, 1, -1.0)]
    {
        for (i, p) in rows[0][a].iter().enumerate() {
            for (j, q) in rows[1][b].iter().enumerate() {
                for (k, r) in rows[2][c].iter().enumerate() {
                    // Columns x and y have degree three, the last four: no product reaches beyond ten.
                    if let Some(entry) = 10_usize.checked_sub(i + j + k) {
                        sum[entry] += sign * p * q * r;
                    }
                }
            }
        }
    }
    sum
}

/// The essential matrix of a root: `(x, y, 1)` is orthogonal to all three rows.
fn solution(basis: &[Matrix3<f64>; 4], rows: &[[InZ; 3]; 3], z: f64) -> Option<Matrix3<f64>> {
    let at = |p: &InZ| p.iter().rev().fold(0.0, |sum, c| sum * z + c);
    let rows: [Vector3<f64>; 3] = std::array::from_fn(|i| Vector3::from_fn(|j, _| at(&rows[i][j])).normalize());
    let candidates = [rows[0].cross(&rows[1]), rows[1].cross(&rows[2]), rows[2].cross(&rows[0])];
    let best = candidates.into_iter().max_by(|a, b| a.norm_squared().total_cmp(&b.norm_squared()))?;
    let essential = basis[0] * (best.x / best.z) + basis[1] * (best.y / best.z) + basis[2] * z + basis[3];
    essential.iter().all(|entry| entry.is_finite()).then_some(essential)
}

#[cfg(test)]
mod tests {
    use nalgebra::{Point3, UnitQuaternion};
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    use super::*;

    /// Five rays of points three metres ahead (on a plane if `flat`) and the true essential matrix of unit norm.
    fn scene(seed: u64, flat: bool) -> ([[UnitVector3<f64>; 2]; 5], Matrix3<f64>) {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let mut draw = |size: f64| Vector3::from_fn(|_, _| random.random_range(-size..size));
        let rotation = UnitQuaternion::from_scaled_axis(draw(0.5));
        let translation = draw(1.0);
        let rays = std::array::from_fn(|_| {
            let spread = draw(2.0);
            let point = Point3::new(spread.x, spread.y, if flat { 3.0 } else { 3.0 + 0.4 * spread.z });
            let second = rotation * point.coords + translation;
            [UnitVector3::new_normalize(point.coords), UnitVector3::new_normalize(second)]
        });
        let essential = translation.cross_matrix() * rotation.to_rotation_matrix().matrix();
        (rays, essential / essential.norm())
    }

    #[test]
    fn the_true_matrix_is_among_the_solutions_also_for_points_on_a_plane() {
        for flat in [false, true] {
            let mut found = 0;
            for seed in 0..500 {
                let (rays, truth) = scene(seed, flat);
                let near = |e: &Matrix3<f64>| {
                    let e = e / e.norm();
                    (e - truth).norm().min((e + truth).norm()) < 1e-6
                };
                found += usize::from(essential_matrices(&rays).iter().any(near));
            }
            // The rest: two roots so close that rounding moves them off the real line or more than the tolerance.
            assert!(found >= 485, "flat {flat}: {found} of 500");
        }
    }

    #[test]
    fn every_solution_is_an_essential_matrix_through_all_five_pairs() {
        for seed in 0..100 {
            let (rays, _) = scene(seed, false);
            for essential in essential_matrices(&rays) {
                let e = essential / essential.norm();
                let constraint = e * e.transpose() * e - e * ((e * e.transpose()).trace() * 0.5);
                assert!(constraint.norm() < 1e-6, "seed {seed}: {constraint}");
                for [first, second] in &rays {
                    assert!(second.dot(&(e * first.into_inner())).abs() < 1e-12);
                }
            }
        }
    }

    #[test]
    fn equal_pairs_give_nothing_or_finite_matrices_and_do_not_panic() {
        let (rays, _) = scene(1, false);
        let same = [rays[0]; 5];
        assert!(essential_matrices(&same).iter().all(|e| e.iter().all(|entry| entry.is_finite())));
    }
}
