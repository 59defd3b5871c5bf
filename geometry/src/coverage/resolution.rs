//! How finely an image shows a point of the wall.

use nalgebra::{Isometry3, Matrix3x2, Point3, Vector3};

use crate::Real;
use crate::camera::Camera;

/// Size of a pixel on the wall.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Resolution<T> {
    /// Along the direction in which the wall is shown finest.
    pub finest_m_per_px: T,
    /// Along the direction in which it is shown coarsest: what decides whether a crack is seen.
    pub coarsest_m_per_px: T,
}

/// Returns the size of a pixel on the wall at a point with the given unit normal (towards the inside).
///
/// `None` if the image does not show the point, or shows the wall from behind.
///
/// # Frame and units
/// Point and normal in `tunnel`, metres; metres per pixel.
/// # Method
/// The projection's derivative restricted to the wall's tangent plane is a 2 x 2 matrix in pixels per metre; the answer
/// is the inverse of its singular values.
pub fn resolution<T: Real>(
    camera: &Camera<T>,
    tunnel_from_cam: &Isometry3<T>,
    point_in_tunnel: &Point3<T>,
    normal_in_tunnel: &Vector3<T>,
) -> Option<Resolution<T>> {
    let point_in_cam = tunnel_from_cam.inverse_transform_point(point_in_tunnel);
    let normal_in_cam = tunnel_from_cam.inverse_transform_vector(normal_in_tunnel);
    if point_in_cam.coords.dot(&normal_in_cam) >= T::zero() {
        return None;
    }
    let (pixel, jacobian) = camera.project_with_jacobian(&point_in_cam.coords)?;
    if !camera.contains(&pixel, T::zero()) {
        return None;
    }
    // Any two unit vectors in the wall will do: the singular values do not depend on the choice.
    let beside = if normal_in_cam.x.abs() < T::of(0.7) { Vector3::x() } else { Vector3::y() };
    let one = normal_in_cam.cross(&beside).try_normalize(T::of(1e-6))?;
    let other = normal_in_cam.cross(&one);
    let px_per_m = jacobian * Matrix3x2::from_columns(&[one, other]);
    // Singular values of [a b; c d]: sqrt(sum of squares / 2 +- sqrt((sum / 2)^2 - det^2)).
    let half_sum = px_per_m.norm_squared() * T::of(0.5);
    let determinant = px_per_m.determinant().abs();
    let root = (half_sum * half_sum - determinant * determinant).max(T::zero()).sqrt();
    let largest = (half_sum + root).sqrt();
    if largest <= T::zero() || determinant <= T::zero() {
        return None;
    }
    // The smaller one from the product, which does not cancel.
    Some(Resolution { finest_m_per_px: T::one() / largest, coarsest_m_per_px: largest / determinant })
}
