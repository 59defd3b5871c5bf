//! The residual of the fit: two rays that show the same thing meet on the wall.

use adit_geometry::profile::Profile;
use nalgebra::{Isometry3, Matrix3, SMatrix, UnitVector3, Vector2, Vector3};

/// Unknowns per photo: a rotation on the right (camera axes), then a shift of the optical centre (tunnel axes).
pub(super) const UNKNOWNS: usize = 6;

/// By how much two rays miss each other on the wall, and its derivatives by the two poses.
pub(super) struct Miss {
    /// In the plane tangent to the second ray, radians.
    pub(super) error: Vector2<f64>,
    pub(super) by_pose: [SMatrix<f64, 2, UNKNOWNS>; 2],
}

/// The first ray's point on the wall as the second photo sees it, against the second ray.
pub(super) fn miss(
    profile: &Profile<f64>,
    [first, second]: [&Isometry3<f64>; 2],
    [ray, other]: &[UnitVector3<f64>; 2],
) -> Option<Miss> {
    let direction = first.rotation * ray.into_inner();
    let hit = profile.ray_cast(first.translation.vector.yz(), direction.yz())?;
    let normal = Vector3::new(0.0, hit.surface.normal.x, hit.surface.normal.y);
    let slope = normal.dot(&direction);
    let point = first.translation.vector + direction * hit.distance;
    let seen = second.rotation.inverse() * (point - second.translation.vector);
    let distance = seen.norm();
    let seen = seen / distance;
    if seen.dot(other) < 0.2 || slope > -0.05 {
        return None;
    }
    let tangents = tangents(other);
    // The point slides on the wall's tangent plane.
    let on_wall = Matrix3::identity() - direction * normal.transpose() / slope;
    let turned = first.rotation.to_rotation_matrix().matrix() * ray.cross_matrix() * -hit.distance;
    let across = tangents
        * (Matrix3::identity() - seen * seen.transpose())
        * second.rotation.inverse().to_rotation_matrix().matrix()
        / distance;
    let mut by_first = SMatrix::<f64, 2, UNKNOWNS>::zeros();
    by_first.fixed_columns_mut::<3>(0).copy_from(&(across * on_wall * turned));
    by_first.fixed_columns_mut::<3>(3).copy_from(&(across * on_wall));
    let mut by_second = SMatrix::<f64, 2, UNKNOWNS>::zeros();
    by_second.fixed_columns_mut::<3>(0).copy_from(&(tangents * seen.cross_matrix()));
    by_second.fixed_columns_mut::<3>(3).copy_from(&-across);
    Some(Miss { error: tangents * seen, by_pose: [by_first, by_second] })
}

/// Two unit vectors, as rows, that span the plane orthogonal to a ray.
fn tangents(ray: &UnitVector3<f64>) -> SMatrix<f64, 2, 3> {
    let first = ray.cross(&Vector3::ith(ray.iamin(), 1.0)).normalize();
    SMatrix::from_rows(&[first.transpose(), ray.cross(&first).transpose()])
}

#[cfg(test)]
mod tests {
    use adit_geometry::profile::ProfileSpec;
    use adit_geometry::rig::{ImageUp, Rig};
    use nalgebra::{SVector, UnitQuaternion};

    use super::*;

    #[test]
    fn derivatives_of_a_miss_agree_with_differences() {
        let profile =
            ProfileSpec::Underpass { width_m: 4.0, wall_m: 2.5, rise_m: 1.0, axis_height_m: 1.4 }.build().unwrap();
        let rig = Rig {
            images_per_turn: 10,
            image_up: ImageUp::Forward,
            lever_radial_m: 0.06,
            lever_forward_m: 0.0,
            mount_rotvec_rad: [0.0; 3],
        };
        let mut poses = [rig.body_from_cam(0.3), rig.body_from_cam(0.9)];
        poses[1].translation.vector += Vector3::new(0.1, 0.05, -0.03);
        let unit = |x: f64, y: f64| UnitVector3::new_normalize(Vector3::new(x, y, 1.0));
        let pair = [unit(0.4, 0.1), unit(-0.25, 0.12)];
        let moved = |photo: usize, by: SVector<f64, 6>| {
            let mut poses = poses;
            poses[photo].rotation *= UnitQuaternion::from_scaled_axis(by.fixed_rows::<3>(0).into_owned());
            poses[photo].translation.vector += by.fixed_rows::<3>(3);
            miss(&profile, [&poses[0], &poses[1]], &pair).unwrap()
        };
        let analytic = moved(0, SVector::zeros()).by_pose;
        for (photo, by_pose) in analytic.iter().enumerate() {
            for unknown in 0..UNKNOWNS {
                let at = |size: f64| moved(photo, SVector::ith(unknown, size)).error;
                let difference = (at(1e-6) - at(-1e-6)) / 2e-6;
                let column = by_pose.column(unknown);
                assert!((difference - column).norm() < 1e-6, "photo {photo} unknown {unknown}: {difference} {column}");
            }
        }
    }
}
