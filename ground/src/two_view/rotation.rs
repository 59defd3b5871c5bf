//! Rotation between two photos from one place.

use nalgebra::{Matrix3, Rotation3, UnitQuaternion, UnitVector3};

/// Returns the rotation `second_from_first` that best turns the first rays onto the second ones, in the sense of least squares.
///
/// At least two rays that are not parallel; `None` if the decomposition fails (NaN).
///
/// # Method
/// Wahba's problem by singular value decomposition (Markley, "Attitude Determination Using Vector Observations and the
/// Singular Value Decomposition", 1988).
pub(super) fn best_rotation<'a>(rays: impl Iterator<Item = &'a [UnitVector3<f64>; 2]>) -> Option<UnitQuaternion<f64>> {
    let sum: Matrix3<f64> = rays.map(|[first, second]| second.into_inner() * first.transpose()).sum();
    let svd = sum.try_svd(true, true, f64::EPSILON, 100)?;
    let (u, v_t) = (svd.u?, svd.v_t?);
    let mut sign = Matrix3::identity();
    sign[(2, 2)] = (u * v_t).determinant().signum();
    let rotation = u * sign * v_t;
    rotation
        .iter()
        .all(|entry| entry.is_finite())
        .then(|| UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(rotation)))
}

/// Squared distance of a pair from the rotation, radians^2: the smallest total shift of both rays that makes them agree.
pub(super) fn squared_error(rotation: &UnitQuaternion<f64>, [first, second]: &[UnitVector3<f64>; 2]) -> f64 {
    (second.into_inner() - rotation * first.into_inner()).norm_squared() * 0.5
}
