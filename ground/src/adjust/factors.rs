//! What tags say about poses: residuals in standard deviations and their derivatives.
//!
//! A camera's six unknowns are a rotation `w` applied on the right (`R exp(w)`, camera axes) and a shift of the optical
//! centre in the tunnel frame, in this order.

use adit_geometry::profile::Profile;
use adit_geometry::rig::{Rig, nominal_rotation};
use nalgebra::{Isometry3, Matrix3, RowVector3, UnitQuaternion, Vector3};

use super::shared::Shared;
use crate::prior::TagPrior;

/// Random part of one odometer step, one standard deviation. Visual and inertial odometers in tunnels reach a few percent
/// of a step of 10 cm; the rest is margin, for matches decide the steps.
pub(super) const ODOMETER_STEP_M: f64 = 0.015;
/// The first odometer reading defines the origin of x.
pub(super) const ANCHOR_M: f64 = 0.001;

/// The difference between a camera's rotation and what shaft angle, attitude and mounting predict.
pub(super) struct RotationPrior {
    pub(super) residual: Vector3<f64>,
    pub(super) by_rotation: Matrix3<f64>,
    pub(super) by_mount: Matrix3<f64>,
    /// By an error of the shaft angle.
    pub(super) by_shaft: Vector3<f64>,
}

/// Rotation error `log(R R_predicted^T)` in tunnel axes over the tag's standard deviations (roll, pitch, yaw).
pub(super) fn rotation_prior(
    tag: &TagPrior,
    rig: &Rig<f64>,
    rotation: &UnitQuaternion<f64>,
    shared: &Shared,
) -> RotationPrior {
    let (sin, cos) = tag.shaft_rad.sin_cos();
    let [by_sin, by_cos] = shared.shaft_periodic_rad;
    let shaft_rad = tag.shaft_rad + shared.shaft_bias_rad + by_sin * sin + by_cos * cos;
    let tunnel_from_body = tag.tunnel_from_body_rotation();
    let nominal = tunnel_from_body * nominal_rotation(rig.image_up, shaft_rad);
    let predicted = nominal * UnitQuaternion::from_scaled_axis(shared.mount_rotvec);
    let error = (rotation * predicted.inverse()).scaled_axis();
    let whiten = Matrix3::from_diagonal(&Vector3::from(tag.rotation_sigma_rad.map(|sigma_rad| 1.0 / sigma_rad)));
    // exp(e + d) = exp(J_left d) exp(e) = exp(e) exp(J_right d).
    let inverse_left = inverse_left_jacobian(&error);
    let inverse_right = inverse_left.transpose();
    let mount = predicted.to_rotation_matrix().matrix() * right_jacobian(&shared.mount_rotvec);
    RotationPrior {
        residual: whiten * error,
        by_rotation: whiten * inverse_left * rotation.to_rotation_matrix().matrix(),
        by_mount: -(whiten * inverse_right * mount),
        by_shaft: -(whiten * inverse_right * (tunnel_from_body * Vector3::x())),
    }
}

/// `exp(m + d) = exp(m) exp(J d)`. Chirikjian, "Stochastic Models, Information Theory, and Lie Groups", 2011, equation 10.86.
fn right_jacobian(m: &Vector3<f64>) -> Matrix3<f64> {
    let (angle, cross) = (m.norm(), m.cross_matrix());
    let (first, second) = if angle < 1e-3 {
        (0.5, 1.0 / 6.0)
    } else {
        ((1.0 - angle.cos()) / angle.powi(2), (angle - angle.sin()) / angle.powi(3))
    };
    Matrix3::identity() - cross * first + cross * cross * second
}

/// `log(exp(d) exp(e)) = e + J d`, the inverse of the left Jacobian.
pub(super) fn inverse_left_jacobian(e: &Vector3<f64>) -> Matrix3<f64> {
    let (angle, cross) = (e.norm(), e.cross_matrix());
    let second =
        if angle < 1e-3 { 1.0 / 12.0 } else { angle.powi(-2) - (1.0 + angle.cos()) / (2.0 * angle * angle.sin()) };
    Matrix3::identity() - cross * 0.5 + cross * cross * second
}

/// A position of the vehicle or a direction of the camera, with derivatives by the camera's rotation and by the mounting.
#[derive(Clone, Copy)]
pub(super) struct Turned {
    pub(super) value: Vector3<f64>,
    pub(super) by_rotation: Matrix3<f64>,
    pub(super) by_mount: Matrix3<f64>,
}

/// Where a perfectly mounted camera would look: `R exp(-m) z`, tunnel frame.
pub(super) fn viewing_direction(rotation: &UnitQuaternion<f64>, shared: &Shared) -> Turned {
    let in_cam = UnitQuaternion::from_scaled_axis(-shared.mount_rotvec) * Vector3::z();
    let rotation = rotation.to_rotation_matrix();
    let by_turn = rotation.matrix() * in_cam.cross_matrix();
    Turned { value: rotation * in_cam, by_rotation: -by_turn, by_mount: by_turn * right_jacobian(&shared.mount_rotvec) }
}

/// The body's origin in the tunnel frame, from a camera pose and its viewing direction. By the optical centre it changes one to
/// one, by the lever's radial part along the negative view, by its forward part along negative x.
pub(super) fn body_centre(pose: &Isometry3<f64>, view: &Turned, shared: &Shared) -> Turned {
    let [radial_m, forward_m] = shared.lever_m;
    Turned {
        value: pose.translation.vector - view.value * radial_m - Vector3::x() * forward_m,
        by_rotation: view.by_rotation * -radial_m,
        by_mount: view.by_mount * -radial_m,
    }
}

/// A range reading against the profile.
pub(super) struct RangeResidual {
    pub(super) residual: f64,
    pub(super) by_rotation: RowVector3<f64>,
    pub(super) by_centre: RowVector3<f64>,
    pub(super) by_mount: RowVector3<f64>,
    pub(super) by_radial: f64,
    pub(super) by_size: f64,
}

/// Range readings against the profile: one residual per beam that was measured and meets the wall.
pub(super) fn ranges<'a>(
    tag: &'a TagPrior,
    profile: &'a Profile<f64>,
    range_m: f64,
    pose: &Isometry3<f64>,
    shared: &Shared,
) -> impl Iterator<Item = RangeResidual> + use<'a> {
    let view = viewing_direction(&pose.rotation, shared);
    let body = body_centre(pose, &view, shared);
    let head = Turned { value: pose.translation.vector, by_rotation: Matrix3::zeros(), by_mount: Matrix3::zeros() };
    let fixed = |direction| Turned { value: direction, by_rotation: Matrix3::zeros(), by_mount: Matrix3::zeros() };
    let body_beams = tag.beams.iter().map(move |beam| (body, fixed(beam.direction), beam.measured_m, true));
    let head_beam = tag.range_head_m.map(move |measured_m| (head, view, measured_m, false));
    let size = shared.profile_size;
    body_beams.chain(head_beam).filter_map(move |(origin, direction, measured_m, on_body)| {
        let scaled = origin.value.yz() / size;
        let hit = profile.ray_cast(scaled, direction.value.yz())?;
        let normal = hit.surface.normal;
        // The wall's tangent plane: n . (o + t d) stays constant.
        let slope = -normal / normal.dot(&direction.value.yz());
        let by_centre = RowVector3::new(0.0, slope.x, slope.y) / range_m;
        let by_direction = by_centre * (hit.distance * size);
        Some(RangeResidual {
            residual: (hit.distance * size - measured_m) / range_m,
            by_rotation: by_centre * origin.by_rotation + by_direction * direction.by_rotation,
            by_centre,
            by_mount: by_centre * origin.by_mount + by_direction * direction.by_mount,
            by_radial: if on_body { -(by_centre * view.value).x } else { 0.0 },
            by_size: (hit.distance - slope.dot(&scaled)) / range_m,
        })
    })
}

/// Distance of a point to the profile over `surface_m`, with derivatives by the point and by the profile's size.
pub(super) fn surface(
    profile: &Profile<f64>,
    size: f64,
    point: &Vector3<f64>,
    surface_m: f64,
) -> Option<(f64, RowVector3<f64>, f64)> {
    let scaled = point.yz() / size;
    let nearest = profile.nearest(scaled)?;
    let normal = nearest.surface.normal / surface_m;
    let clearance = nearest.clearance_m / surface_m;
    Some((clearance * size, RowVector3::new(0.0, normal.x, normal.y), clearance - normal.dot(&scaled)))
}
