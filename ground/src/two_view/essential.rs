//! Epipolar error, decomposition and refinement of a relative pose.

use nalgebra::{Isometry3, Matrix3, Rotation3, SMatrix, SVector, Translation3, UnitQuaternion, UnitVector3, Vector3};

/// Refinement stops when a step turns rotation and direction by less than this, radians.
const CONVERGED_RAD: f64 = 1e-10;
/// Parallax below this says nothing about depth, radians.
const LEAST_PARALLAX_RAD: f64 = 1e-3;

/// Essential matrix of `second_from_first`: `second^T E first = 0`.
pub(super) fn essential_of(second_from_first: &Isometry3<f64>) -> Matrix3<f64> {
    second_from_first.translation.vector.cross_matrix() * second_from_first.rotation.to_rotation_matrix().matrix()
}

/// Signed Sampson error on the sphere, radians: to first order the smallest total shift of both rays that makes them meet.
///
/// `n / sqrt(|E f|^2 + |E^T s|^2 - 2 n^2)` with `n = s^T E f`: as Sampson's error in the image, but with gradients in the
/// rays' tangent planes, so that it holds for any field of view.
pub(super) fn sampson_rad(essential: &Matrix3<f64>, [first, second]: &[UnitVector3<f64>; 2]) -> f64 {
    let (line_in_second, line_in_first) = (essential * first.into_inner(), essential.tr_mul(second));
    let n = second.dot(&line_in_second);
    let squared = line_in_second.norm_squared() + line_in_first.norm_squared() - 2.0 * n * n;
    n / squared.max(f64::MIN_POSITIVE).sqrt()
}

/// Returns the pose (unit translation) of an essential matrix that puts most points before both cameras.
///
/// Hartley & Zisserman, "Multiple View Geometry", 2nd edition, result 9.19.
pub(super) fn decompose<'a>(
    essential: &Matrix3<f64>,
    rays: &(impl Iterator<Item = &'a [UnitVector3<f64>; 2]> + Clone),
) -> Option<Isometry3<f64>> {
    let svd = essential.try_svd(true, true, f64::EPSILON, 100)?;
    let (mut u, mut v_t) = (svd.u?, svd.v_t?);
    // nalgebra sorts singular values; the last column of u is the direction of the translation.
    u *= u.determinant().signum();
    v_t *= v_t.determinant().signum();
    let w = Matrix3::new(0.0, -1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0);
    let direction = u.column(2).into_owned();
    let candidates = [(w, 1.0), (w, -1.0), (w.transpose(), 1.0), (w.transpose(), -1.0)].map(|(w, sign)| {
        let rotation = Rotation3::from_matrix_unchecked(u * w * v_t);
        let rotation = UnitQuaternion::from_rotation_matrix(&rotation);
        Isometry3::from_parts(Translation3::from(direction * sign), rotation)
    });
    candidates.into_iter().max_by_key(|pose| rays.clone().filter(|pair| in_front(pose, pair)).count())
}

/// Tells whether the rays meet before both cameras, with a parallax that decides it.
fn in_front(second_from_first: &Isometry3<f64>, [first, second]: &[UnitVector3<f64>; 2]) -> bool {
    let turned = second_from_first.rotation * first.into_inner();
    let direction = second_from_first.translation.vector;
    // a turned + direction = b second, in the sense of least squares.
    let cosine = turned.dot(second);
    let sine_squared = 1.0 - cosine * cosine;
    let (along_first, along_second) = (turned.dot(&direction), second.dot(&direction));
    let depth_in_first = cosine * along_second - along_first;
    let depth_in_second = along_second - cosine * along_first;
    sine_squared > LEAST_PARALLAX_RAD * LEAST_PARALLAX_RAD && depth_in_first > 0.0 && depth_in_second > 0.0
}

/// Two unit vectors that span the plane orthogonal to `direction`.
fn tangents(direction: &Vector3<f64>) -> [Vector3<f64>; 2] {
    let first = direction.cross(&Vector3::ith(direction.iamin(), 1.0)).normalize();
    [first, direction.cross(&first)]
}

/// Moves the pose by a rotation on the right (first camera's axes) and a step of the direction in its tangent plane.
fn step(pose: &Isometry3<f64>, by: &SVector<f64, 5>) -> Isometry3<f64> {
    let direction = pose.translation.vector;
    let [a, b] = tangents(&direction);
    let turned = (direction + a * by[3] + b * by[4]).normalize();
    let rotation = pose.rotation * UnitQuaternion::from_scaled_axis(by.fixed_rows::<3>(0).into_owned());
    Isometry3::from_parts(Translation3::from(turned), rotation)
}

/// Derivatives of the essential matrix by the five unknowns of [`step`].
fn essential_derivatives(pose: &Isometry3<f64>) -> [Matrix3<f64>; 5] {
    let essential = essential_of(pose);
    let rotation = *pose.rotation.to_rotation_matrix().matrix();
    let [a, b] = tangents(&pose.translation.vector);
    let by_rotation = |axis: usize| essential * Vector3::ith(axis, 1.0).cross_matrix();
    [by_rotation(0), by_rotation(1), by_rotation(2), a.cross_matrix() * rotation, b.cross_matrix() * rotation]
}

/// [`sampson_rad`] and its derivatives.
fn sampson_with_jacobian(
    essential: &Matrix3<f64>,
    derivatives: &[Matrix3<f64>; 5],
    [first, second]: &[UnitVector3<f64>; 2],
) -> (f64, SVector<f64, 5>) {
    let (in_second, in_first) = (essential * first.into_inner(), essential.tr_mul(second));
    let n = second.dot(&in_second);
    let squared = (in_second.norm_squared() + in_first.norm_squared() - 2.0 * n * n).max(f64::MIN_POSITIVE);
    let scale = squared.sqrt();
    let jacobian = SVector::from_fn(|k, _| {
        let (by_second, by_first) = (derivatives[k] * first.into_inner(), derivatives[k].tr_mul(second));
        let dn = second.dot(&by_second);
        let half_squared = in_second.dot(&by_second) + in_first.dot(&by_first) - 2.0 * n * dn;
        dn / scale - n * half_squared / (squared * scale)
    });
    (n / scale, jacobian)
}

/// Truncated sum of squared errors of a pose.
pub(super) fn truncated_cost(essential: &Matrix3<f64>, rays: &[[UnitVector3<f64>; 2]], threshold_rad: f64) -> f64 {
    let limit = threshold_rad * threshold_rad;
    rays.iter().map(|pair| sampson_rad(essential, pair).powi(2).min(limit)).sum()
}

/// Minimises the truncated sum of squared Sampson errors from a start, by Levenberg-Marquardt.
pub(super) fn refine(
    start: &Isometry3<f64>,
    rays: &[[UnitVector3<f64>; 2]],
    threshold_rad: f64,
    iterations: usize,
) -> Isometry3<f64> {
    let mut pose = *start;
    let mut cost = truncated_cost(&essential_of(&pose), rays, threshold_rad);
    let mut damping = 1e-4;
    for _ in 0..iterations {
        let (essential, derivatives) = (essential_of(&pose), essential_derivatives(&pose));
        let mut normal = SMatrix::<f64, 5, 5>::zeros();
        let mut gradient = SVector::<f64, 5>::zeros();
        for pair in rays {
            let (error, jacobian) = sampson_with_jacobian(&essential, &derivatives, pair);
            if error.abs() < threshold_rad {
                normal += jacobian * jacobian.transpose();
                gradient += jacobian * error;
            }
        }
        let damped = normal + SMatrix::from_diagonal(&normal.diagonal()) * damping;
        let Some(factor) = damped.cholesky() else { break };
        let by = -factor.solve(&gradient);
        let next = step(&pose, &by);
        let next_cost = truncated_cost(&essential_of(&next), rays, threshold_rad);
        if next_cost < cost {
            (pose, cost) = (next, next_cost);
            damping *= 0.1;
        } else {
            damping *= 10.0;
        }
        if by.norm() < CONVERGED_RAD {
            break;
        }
    }
    pose
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pose() -> Isometry3<f64> {
        let translation = Vector3::new(0.3, -0.5, 0.2).normalize();
        Isometry3::from_parts(Translation3::from(translation), UnitQuaternion::from_euler_angles(0.2, -0.4, 0.1))
    }

    #[test]
    fn derivatives_of_the_sampson_error_agree_with_differences() {
        let pose = pose();
        let unit = |x: f64, y: f64, z: f64| UnitVector3::new_normalize(Vector3::new(x, y, z));
        let (essential, derivatives) = (essential_of(&pose), essential_derivatives(&pose));
        for pair in [[unit(0.1, 0.2, 1.0), unit(0.4, -0.3, 1.0)], [unit(-0.9, 0.5, 1.0), unit(0.2, 0.9, -0.1)]] {
            let (_, jacobian) = sampson_with_jacobian(&essential, &derivatives, &pair);
            for k in 0..5 {
                let at = |size: f64| {
                    let mut by = SVector::zeros();
                    by[k] = size;
                    sampson_rad(&essential_of(&step(&pose, &by)), &pair)
                };
                let difference = (at(1e-6) - at(-1e-6)) / 2e-6;
                assert!((difference - jacobian[k]).abs() < 1e-7, "unknown {k}: {difference} and {}", jacobian[k]);
            }
        }
    }

    #[test]
    fn the_error_is_the_shift_that_was_made() {
        let pose = pose();
        let point = Vector3::new(0.4, -0.2, 3.0);
        let first = UnitVector3::new_normalize(point);
        let seen = pose.rotation * point + pose.translation.vector;
        let off_line = pose.translation.vector.cross(&seen).normalize();
        let shifted = UnitVector3::new_normalize(seen.normalize() + off_line * 1e-4);
        // Both rays share the shift, so the total is smaller by about the square root of two.
        let error = sampson_rad(&essential_of(&pose), &[first, shifted]).abs();
        assert!((0.65e-4..0.8e-4).contains(&error), "{error}");
    }
}
