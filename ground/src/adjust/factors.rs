//! The adjustment's residuals and their derivatives. Every residual is divided by its standard deviation.
//!
//! A camera's six unknowns are a rotation `w` applied on the right (`R exp(w)`, camera axes) and a shift of the optical
//! centre in the tunnel frame, in this order.

use adit_geometry::camera::Camera;
use adit_geometry::profile::Profile;
use adit_geometry::rig::{Rig, nominal_rotation};
use adit_protocol::mission::Sigma;
use nalgebra::{Isometry3, Matrix2x3, Matrix3, Point3, RowVector3, SMatrix, UnitQuaternion, Vector2, Vector3};

use super::problem::Shared;
use crate::prior::TagPrior;

/// Random part of one odometer step, one standard deviation. Visual and inertial odometers in tunnels reach a few percent
/// of a step of 10 cm; the rest is margin, for matches decide the steps.
pub(super) const ODOMETER_STEP_M: f64 = 0.015;
/// The first odometer reading defines the origin of x.
const ANCHOR_M: f64 = 0.001;

/// Reprojection error in pixels and its derivatives with respect to camera (2 x 6) and point (2 x 3).
///
/// `None` if the point is behind the camera.
pub(super) fn reprojection(
    camera: &Camera<f64>,
    tunnel_from_cam: &Isometry3<f64>,
    point: &Point3<f64>,
    pixel: &Vector2<f64>,
) -> Option<(Vector2<f64>, SMatrix<f64, 2, 6>, Matrix2x3<f64>)> {
    let in_cam = tunnel_from_cam.inverse_transform_point(point).coords;
    let (projected, by_point_in_cam) = camera.project_with_jacobian(&in_cam)?;
    let cam_from_tunnel = tunnel_from_cam.rotation.inverse().to_rotation_matrix();
    let by_point = by_point_in_cam * cam_from_tunnel.matrix();
    let mut by_camera = SMatrix::<f64, 2, 6>::zeros();
    by_camera.fixed_columns_mut::<3>(0).copy_from(&(by_point_in_cam * in_cam.cross_matrix()));
    by_camera.fixed_columns_mut::<3>(3).copy_from(&-by_point);
    Some((projected - pixel, by_camera, by_point))
}

/// Distance of a point to the profile over `surface_m`, and its derivative.
pub(super) fn surface(profile: &Profile<f64>, point: &Point3<f64>, surface_m: f64) -> Option<(f64, RowVector3<f64>)> {
    let nearest = profile.nearest(point.yz().coords)?;
    let normal = nearest.surface.normal / surface_m;
    Some((nearest.clearance_m / surface_m, RowVector3::new(0.0, normal.x, normal.y)))
}

/// The difference between a camera's rotation and what shaft angle, attitude and mounting predict.
pub(super) struct RotationPrior {
    pub(super) residual: Vector3<f64>,
    pub(super) by_rotation: Matrix3<f64>,
    pub(super) by_mount: Matrix3<f64>,
}

/// Rotation error `log(R R_predicted^T)` in tunnel axes over (roll, pitch, yaw) standard deviations.
///
/// Derivatives to first order in the error, which is a few degrees at most.
pub(super) fn rotation_prior(
    tag: &TagPrior,
    rig: &Rig<f64>,
    sigma: &Sigma,
    rotation: &UnitQuaternion<f64>,
    shared: &Shared,
) -> RotationPrior {
    let nominal = tag.tunnel_from_body_rotation() * nominal_rotation(rig.image_up, tag.shaft_rad);
    let predicted = nominal * UnitQuaternion::from_scaled_axis(shared.mount_rotvec);
    let error = (rotation * predicted.inverse()).scaled_axis();
    let inverse_left = Matrix3::identity() - error.cross_matrix() * 0.5;
    let inverse_right = Matrix3::identity() + error.cross_matrix() * 0.5;
    let roll_rad = sigma.shaft_rad.hypot(sigma.attitude_rad);
    let whiten =
        Matrix3::from_diagonal(&Vector3::new(1.0 / roll_rad, 1.0 / sigma.attitude_rad, 1.0 / sigma.attitude_rad));
    RotationPrior {
        residual: whiten * error,
        by_rotation: whiten * inverse_left * rotation.to_rotation_matrix().matrix(),
        by_mount: -(whiten
            * inverse_right
            * predicted.to_rotation_matrix().matrix()
            * right_jacobian(&shared.mount_rotvec)),
    }
}

/// `exp(m + d) = exp(m) exp(J d)`, to second order in `m`.
fn right_jacobian(m: &Vector3<f64>) -> Matrix3<f64> {
    let cross = m.cross_matrix();
    Matrix3::identity() - cross * 0.5 + cross * cross / 6.0
}

/// A scalar residual on the optical centre.
pub(super) struct RangeResidual {
    pub(super) residual: f64,
    pub(super) by_centre: RowVector3<f64>,
}

/// Range readings against the profile: one residual per beam that was measured.
///
/// The lever arm between optical centre and body is taken from the present pose; its own derivative (a few centimetres times
/// the rotation step) is left out.
pub(super) fn ranges<'a>(
    tag: &'a TagPrior,
    rig: &Rig<f64>,
    profile: &'a Profile<f64>,
    range_m: f64,
    tunnel_from_cam: &Isometry3<f64>,
    shared: &Shared,
) -> impl Iterator<Item = RangeResidual> + use<'a> {
    let body = body_centre(rig, tunnel_from_cam, shared);
    let head = tunnel_from_cam.translation.vector;
    let optical_axis = viewing_direction(tunnel_from_cam, shared);
    let body_beams = tag.beams.iter().map(move |beam| (body, beam.direction, beam.measured_m));
    let head_beam = tag.range_head_m.map(move |measured_m| (head, optical_axis, measured_m));
    body_beams.chain(head_beam).filter_map(move |(origin, direction, measured_m)| {
        let hit = profile.ray_cast(origin.yz(), direction.yz())?;
        let closing = hit.surface.normal.dot(&direction.yz());
        let slope = -hit.surface.normal / closing;
        Some(RangeResidual {
            residual: (hit.distance - measured_m) / range_m,
            by_centre: RowVector3::new(0.0, slope.x, slope.y) / range_m,
        })
    })
}

/// The body's origin in the tunnel frame, from a camera pose.
pub(super) fn body_centre(rig: &Rig<f64>, tunnel_from_cam: &Isometry3<f64>, shared: &Shared) -> Vector3<f64> {
    tunnel_from_cam.translation.vector
        - viewing_direction(tunnel_from_cam, shared) * rig.lever_radial_m
        - Vector3::x() * rig.lever_forward_m
}

/// Where a perfectly mounted camera would look.
fn viewing_direction(tunnel_from_cam: &Isometry3<f64>, shared: &Shared) -> Vector3<f64> {
    tunnel_from_cam.rotation * (UnitQuaternion::from_scaled_axis(-shared.mount_rotvec) * Vector3::z())
}

/// One odometer step between two photos: residual, and its derivatives by either x and by the odometer's scale.
pub(super) struct OdometerResidual {
    pub(super) residual: f64,
    /// Derivative by the later photo's x; the earlier's is the negative.
    pub(super) by_x: f64,
    pub(super) by_scale: f64,
}

/// The step from `before` to `after` (odometer metres) against the step of the body along x.
pub(super) fn odometer_step(before_m: f64, after_m: f64, moved_m: f64, shared: &Shared) -> OdometerResidual {
    let step_m = after_m - before_m;
    OdometerResidual {
        residual: (moved_m - (1.0 + shared.odometer_scale) * step_m) / ODOMETER_STEP_M,
        by_x: 1.0 / ODOMETER_STEP_M,
        by_scale: -step_m / ODOMETER_STEP_M,
    }
}

/// The first reading pins x.
pub(super) fn odometer_anchor(reading_m: f64, x_m: f64) -> (f64, f64) {
    ((x_m - reading_m) / ANCHOR_M, 1.0 / ANCHOR_M)
}

/// Geman-McClure loss of a squared residual in standard deviations: `(cost, weight)` with scale `k`.
///
/// `cost = 0.5 k^2 r^2 / (k^2 + r^2)`; weight is its derivative by `0.5 r^2`.
pub(super) fn geman_mcclure(squared: f64, k: f64) -> (f64, f64) {
    let k2 = k * k;
    let ratio = k2 / (k2 + squared);
    (0.5 * squared * ratio, ratio * ratio)
}

#[cfg(test)]
mod tests {
    use adit_geometry::camera::Distortion;
    use adit_geometry::profile::ProfileSpec;
    use adit_geometry::rig::ImageUp;

    use super::*;
    use crate::prior::Beam;

    const STEP: f64 = 1e-6;

    fn rig() -> Rig<f64> {
        Rig {
            images_per_turn: 10,
            image_up: ImageUp::Forward,
            lever_radial_m: 0.06,
            lever_forward_m: 0.0,
            mount_rotvec_rad: [0.0; 3],
        }
    }

    fn pose() -> Isometry3<f64> {
        let mut pose = rig().body_from_cam(0.8);
        pose.rotation *= UnitQuaternion::from_euler_angles(0.02, -0.03, 0.01);
        pose.translation.vector += Vector3::new(1.0, 0.1, -0.05);
        pose
    }

    fn moved(pose: &Isometry3<f64>, unknown: usize, step: f64) -> Isometry3<f64> {
        let mut moved = *pose;
        if unknown < 3 {
            let mut rotvec = Vector3::zeros();
            rotvec[unknown] = step;
            moved.rotation *= UnitQuaternion::from_scaled_axis(rotvec);
        } else {
            moved.translation.vector[unknown - 3] += step;
        }
        moved
    }

    fn camera() -> Camera<f64> {
        Camera {
            width_px: 1000,
            height_px: 750,
            focal_px: [466.0, 460.0],
            centre_px: [503.0, 373.0],
            distortion: Distortion::BrownConrady([-0.04, 0.006, 0.001, -0.0005, 0.0]),
        }
    }

    #[test]
    fn reprojection_derivatives_agree_with_differences() {
        let (pose, camera) = (pose(), camera());
        let point = pose * Point3::new(0.7, -0.4, 2.8);
        let pixel = Vector2::new(600.0, 300.0);
        let (_, by_camera, by_point) = reprojection(&camera, &pose, &point, &pixel).unwrap();
        for unknown in 0..6 {
            let ahead = reprojection(&camera, &moved(&pose, unknown, STEP), &point, &pixel).unwrap().0;
            let behind = reprojection(&camera, &moved(&pose, unknown, -STEP), &point, &pixel).unwrap().0;
            let difference = (ahead - behind) / (2.0 * STEP);
            assert!(
                (difference - by_camera.column(unknown)).norm() < 1e-5 * (1.0 + difference.norm()),
                "unknown {unknown}"
            );
        }
        for axis in 0..3 {
            let mut shift = Vector3::zeros();
            shift[axis] = STEP;
            let ahead = reprojection(&camera, &pose, &(point + shift), &pixel).unwrap().0;
            let behind = reprojection(&camera, &pose, &(point - shift), &pixel).unwrap().0;
            let difference = (ahead - behind) / (2.0 * STEP);
            assert!((difference - by_point.column(axis)).norm() < 1e-5 * (1.0 + difference.norm()), "axis {axis}");
        }
    }

    fn tag() -> TagPrior {
        let beam = |y: f64, z: f64| Beam { direction: Vector3::new(0.0, y, z), measured_m: 2.9 };
        TagPrior {
            shaft_rad: 0.81,
            rotation_sigma_rad: [0.024, 0.017, 0.017],
            attitude_rad: Some([0.01, 0.005, -0.02]),
            beams: vec![beam(0.0, -1.0), beam(1.0, 0.0), beam(-1.0, 0.0)],
            range_head_m: Some(2.95),
            odometer_m: Some(1.0),
        }
    }

    fn sigma() -> Sigma {
        Sigma { shaft_rad: 0.017, range_m: 0.02, odometer_m_per_m: 0.02, attitude_rad: 0.026, mount_rad: 0.017 }
    }

    #[test]
    fn rotation_prior_derivatives_agree_with_differences() {
        let shared = Shared { mount_rotvec: Vector3::new(0.01, -0.015, 0.02), odometer_scale: 0.0 };
        let (tag, rig, sigma, pose) = (tag(), rig(), sigma(), pose());
        let at = |pose: &Isometry3<f64>, shared: &Shared| rotation_prior(&tag, &rig, &sigma, &pose.rotation, shared);
        let analytic = at(&pose, &shared);
        for axis in 0..3 {
            let ahead = at(&moved(&pose, axis, STEP), &shared).residual;
            let behind = at(&moved(&pose, axis, -STEP), &shared).residual;
            let difference = (ahead - behind) / (2.0 * STEP);
            assert!(
                (difference - analytic.by_rotation.column(axis)).norm() < 2e-3 * difference.norm(),
                "rotation {axis}"
            );
            let mut turned = shared;
            turned.mount_rotvec[axis] += STEP;
            let ahead = at(&pose, &turned).residual;
            turned.mount_rotvec[axis] -= 2.0 * STEP;
            let behind = at(&pose, &turned).residual;
            let difference = (ahead - behind) / (2.0 * STEP);
            assert!((difference - analytic.by_mount.column(axis)).norm() < 2e-3 * difference.norm(), "mount {axis}");
        }
    }

    #[test]
    fn range_and_surface_derivatives_agree_with_differences() {
        let profile =
            ProfileSpec::Underpass { width_m: 4.0, wall_m: 2.5, rise_m: 1.0, axis_height_m: 1.4 }.build().unwrap();
        let shared = Shared { mount_rotvec: Vector3::new(0.01, 0.0, 0.0), odometer_scale: 0.0 };
        let (tag, rig, pose) = (tag(), rig(), pose());
        let at = |pose: &Isometry3<f64>| -> Vec<RangeResidual> {
            ranges(&tag, &rig, &profile, 0.02, pose, &shared).collect()
        };
        let analytic = at(&pose);
        assert_eq!(analytic.len(), 4);
        for axis in 0..3 {
            let (ahead, behind) = (at(&moved(&pose, axis + 3, STEP)), at(&moved(&pose, axis + 3, -STEP)));
            for (beam, analytic) in analytic.iter().enumerate() {
                let difference = (ahead[beam].residual - behind[beam].residual) / (2.0 * STEP);
                assert!((difference - analytic.by_centre[axis]).abs() < 1e-4, "beam {beam} axis {axis}");
            }
        }
        let point = Point3::new(1.0, 0.8, -1.7);
        let (_, slope) = surface(&profile, &point, 0.05).unwrap();
        for axis in 0..3 {
            let mut shift = Vector3::zeros();
            shift[axis] = STEP;
            let ahead = surface(&profile, &(point + shift), 0.05).unwrap().0;
            let behind = surface(&profile, &(point - shift), 0.05).unwrap().0;
            assert!(((ahead - behind) / (2.0 * STEP) - slope[axis]).abs() < 1e-4, "axis {axis}");
        }
    }

    #[test]
    fn a_robust_weight_is_the_slope_of_its_cost() {
        for squared in [0.0, 0.5, 4.0, 100.0] {
            let slope = (geman_mcclure(squared + 1e-6, 3.0).0 - geman_mcclure(squared, 3.0).0) / 0.5e-6;
            assert!((slope - geman_mcclure(squared, 3.0).1).abs() < 1e-5);
        }
    }
}
