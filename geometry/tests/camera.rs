//! Invariants of the camera models and sign tests of the rig.

use std::f64::consts::{FRAC_PI_2, TAU};

use adit_geometry::Real;
use adit_geometry::camera::{Camera, Distortion};
use adit_geometry::rig::{ImageUp, Rig, attitude, clockwise, nominal_rotation, outward};
use nalgebra::{Vector2, Vector3};
use proptest::prelude::*;

fn camera<T: Real>(distortion: Distortion<T>) -> Camera<T> {
    Camera {
        width_px: 1000,
        height_px: 750,
        focal_px: [T::of(466.0), T::of(471.0)],
        centre_px: [T::of(503.5), T::of(373.0)],
        distortion,
    }
}

fn brown<T: Real>() -> Camera<T> {
    camera(Distortion::BrownConrady([-0.04, 0.006, 0.0012, -0.0007, 0.0003].map(T::of)))
}

fn kannala<T: Real>() -> Camera<T> {
    camera(Distortion::KannalaBrandt([-0.03, 0.004, -0.0008, 0.0001].map(T::of)))
}

/// The calibrated lens of the chessboard sample, which folds back within the frame's corners.
fn gopro() -> Camera<f64> {
    Camera {
        width_px: 1280,
        height_px: 960,
        focal_px: [561.3, 562.3],
        centre_px: [651.3, 499.2],
        distortion: Distortion::BrownConrady([-0.241, 0.0714, 0.0, 0.0, -0.0105]),
    }
}

fn check_inverse<T: Real>(camera: &Camera<T>, pixel: Vector2<f64>, tolerance_px: f64) {
    let pixel: Vector2<T> = pixel.map(T::of);
    let direction = camera.unproject(&pixel).expect("every pixel of this lens has a direction");
    for depth in [0.1, 1.0, 7.0] {
        let again = camera.project(&(direction * T::of(depth))).expect("in front");
        assert!((again - pixel).norm().to_f64() < tolerance_px, "{pixel:?} came back as {again:?}");
    }
}

fn check_jacobian(camera: &Camera<f64>, point: Vector3<f64>) {
    let Some((pixel, jacobian)) = camera.project_with_jacobian(&point) else { return };
    assert_eq!(Some(pixel), camera.project(&point));
    let step = 1e-6;
    for axis in 0..3 {
        let mut moved = [point, point];
        moved[0][axis] -= step;
        moved[1][axis] += step;
        let [Some(low), Some(high)] = moved.map(|p| camera.project(&p)) else { return };
        let difference = (high - low) / (2.0 * step);
        let error = (difference - jacobian.column(axis)).norm();
        assert!(error < 1e-4 * (1.0 + difference.norm()), "axis {axis}: {difference:?} {:?}", jacobian.column(axis));
    }
}

fn check_jacobian_by_intrinsics(camera: &Camera<f64>, point: Vector3<f64>) {
    if camera.project(&point).is_none() {
        return;
    }
    let jacobian = camera.jacobian_by_intrinsics(&point);
    for unknown in 0..9 {
        let at = |step: f64| {
            let mut moved = *camera;
            match (unknown, &mut moved.distortion) {
                (0 | 1, _) => moved.focal_px[unknown] += step,
                (2 | 3, _) => moved.centre_px[unknown - 2] += step,
                (_, Distortion::BrownConrady(k)) => k[unknown - 4] += step,
                (8, Distortion::KannalaBrandt(_)) => {}
                (_, Distortion::KannalaBrandt(k)) => k[unknown - 4] += step,
            }
            moved.project(&point)
        };
        let step = if unknown < 4 { 1e-4 } else { 1e-7 };
        let (Some(low), Some(high)) = (at(-step), at(step)) else { return };
        let difference = (high - low) / (2.0 * step);
        let error = (difference - jacobian.column(unknown)).norm();
        assert!(
            error < 1e-5 * (1.0 + difference.norm()),
            "unknown {unknown}: {difference:?} {:?}",
            jacobian.column(unknown)
        );
    }
}

proptest! {
    #[test]
    fn jacobians_by_intrinsics_agree_with_differences(x in -2.0f64..2.0, y in -2.0f64..2.0, z in 0.3f64..5.0) {
        let point = Vector3::new(x, y, z);
        check_jacobian_by_intrinsics(&brown(), point);
        check_jacobian_by_intrinsics(&kannala(), point);
        check_jacobian_by_intrinsics(&gopro(), point);
    }

    #[test]
    fn unproject_is_the_inverse_of_project(u in 0.0f64..1000.0, v in 0.0f64..750.0) {
        let pixel = Vector2::new(u, v);
        check_inverse::<f64>(&brown(), pixel, 1e-9);
        check_inverse::<f64>(&kannala(), pixel, 1e-9);
        check_inverse::<f32>(&brown(), pixel, 0.01);
        check_inverse::<f32>(&kannala(), pixel, 0.01);
    }

    #[test]
    fn jacobians_agree_with_differences(x in -2.0f64..2.0, y in -2.0f64..2.0, z in 0.3f64..5.0) {
        let point = Vector3::new(x, y, z);
        check_jacobian(&brown(), point);
        check_jacobian(&kannala(), point);
        check_jacobian(&gopro(), point);
    }

    #[test]
    fn kannala_sees_sideways_and_behind_while_brown_does_not(angle in 0.0..TAU) {
        let sideways = Vector3::new(angle.cos(), angle.sin(), -0.05);
        prop_assert!(brown::<f64>().project(&sideways).is_none());
        prop_assert!(kannala::<f64>().project(&sideways).is_some());
        check_jacobian(&kannala(), sideways);
    }

    #[test]
    fn what_a_folding_lens_projects_comes_back(x in -4.0f64..4.0, y in -4.0f64..4.0) {
        let camera = gopro();
        let direction = Vector3::new(x, y, 1.0);
        // A point beyond the fold has no pixel, instead of the pixel of another point.
        if let Some(pixel) = camera.project(&direction) {
            let back = camera.unproject(&pixel);
            if let Some(back) = back {
                prop_assert!((back - direction).norm() < 1e-6, "{direction:?} came back as {back:?}");
            }
        }
    }

    #[test]
    fn no_pixel_panics(u in proptest::num::f32::ANY, v in proptest::num::f32::ANY, w in proptest::num::f32::ANY) {
        for camera in [brown::<f32>(), kannala::<f32>()] {
            let _ = camera.unproject(&Vector2::new(u, v));
            let _ = camera.project_with_jacobian(&Vector3::new(u, v, w));
        }
    }
}

#[test]
fn points_beyond_a_second_fold_have_no_pixel() {
    // The slope 1 - 3 r^2 + 1.5 r^4 is negative between r^2 = 0.42 and 1.58 and positive again beyond.
    let camera: Camera<f64> = camera(Distortion::BrownConrady([-1.0, 0.3, 0.0, 0.0, 0.0]));
    assert!(camera.project(&Vector3::new(0.6, 0.0, 1.0)).is_some());
    assert!(camera.project(&Vector3::new(1.0, 0.0, 1.0)).is_none());
    assert!(camera.project(&Vector3::new(1.5, 0.0, 1.0)).is_none());
}

#[test]
fn the_image_axes_are_right_and_down() {
    for camera in [brown::<f64>(), kannala::<f64>()] {
        let centre = camera.project(&Vector3::z()).unwrap();
        assert!((centre - Vector2::new(503.5, 373.0)).norm() < 1e-12);
        assert!(camera.project(&Vector3::new(0.1, 0.0, 1.0)).unwrap().x > centre.x);
        assert!(camera.project(&Vector3::new(0.0, 0.1, 1.0)).unwrap().y > centre.y);
    }
}

#[test]
fn contains_counts_from_the_image_border() {
    let camera = brown::<f64>();
    assert!(camera.contains(&Vector2::new(0.0, 750.0), 0.0));
    assert!(!camera.contains(&Vector2::new(1000.1, 10.0), 0.0));
    assert!(!camera.contains(&Vector2::new(4.0, 10.0), 5.0));
}

/// Which way is up in the body frame, by section angle.
type Up = fn(f64) -> Vector3<f64>;

const UPS: [(ImageUp, Up); 4] = [
    (ImageUp::Forward, |_| Vector3::x()),
    (ImageUp::Backward, |_| -Vector3::x()),
    (ImageUp::Clockwise, clockwise),
    (ImageUp::Counterclockwise, |phi| -clockwise(phi)),
];

#[test]
fn the_section_angle_is_up_right_down_left() {
    for (phi, expected) in [
        (0.0, -Vector3::z()),
        (FRAC_PI_2, Vector3::y()),
        (2.0 * FRAC_PI_2, Vector3::z()),
        (3.0 * FRAC_PI_2, -Vector3::y()),
    ] {
        assert!((outward::<f64>(phi) - expected).norm() < 1e-12, "phi = {phi}");
    }
    // Clockwise is the direction in which the angle grows.
    for phi in [0.0, 1.0, 2.5, 4.0] {
        let difference = (outward::<f64>(phi + 1e-6) - outward(phi - 1e-6)) / 2e-6;
        assert!((clockwise::<f64>(phi) - difference).norm() < 1e-8);
    }
}

#[test]
fn the_camera_looks_outwards_with_its_top_where_image_up_says() {
    for (image_up, up) in UPS {
        for i in 0..24 {
            let phi = f64::from(i) * TAU / 24.0;
            let body_from_cam = nominal_rotation(image_up, phi);
            assert!((body_from_cam * Vector3::z() - outward(phi)).norm() < 1e-12, "{image_up:?} looks out");
            assert!((body_from_cam * -Vector3::y() - up(phi)).norm() < 1e-12, "{image_up:?} has its top there");
            let right = (body_from_cam * Vector3::y()).cross(&outward(phi));
            assert!((body_from_cam * Vector3::x() - right).norm() < 1e-12, "{image_up:?} is right-handed");
        }
    }
}

#[test]
fn looking_up_with_the_top_forward_the_photos_right_is_the_vehicles_left() {
    let body_from_cam = nominal_rotation::<f64>(ImageUp::Forward, 0.0);
    assert!((body_from_cam * Vector3::x() + Vector3::y()).norm() < 1e-12);
}

#[test]
fn lever_and_mounting_act_in_their_own_frames() {
    let rig = Rig {
        images_per_turn: 10,
        image_up: ImageUp::Forward,
        lever_radial_m: 0.06,
        lever_forward_m: 0.2,
        mount_rotvec_rad: [0.0, 0.0, 0.1],
    };
    let body_from_cam = rig.body_from_cam(FRAC_PI_2);
    assert!((body_from_cam.translation.vector - Vector3::new(0.2, 0.06, 0.0)).norm() < 1e-12);
    // A turn about the camera's own viewing direction leaves that direction alone and turns its x towards its y.
    assert!((body_from_cam.rotation * Vector3::z() - Vector3::y()).norm() < 1e-12);
    let nominal = nominal_rotation(ImageUp::Forward, FRAC_PI_2);
    let turned = nominal * Vector3::new(0.1f64.cos(), 0.1f64.sin(), 0.0);
    assert!((body_from_cam.rotation * Vector3::x() - turned).norm() < 1e-12);
}

#[test]
fn attitude_signs_are_those_of_an_aircraft() {
    let turned = |roll: f64, pitch: f64, yaw: f64, v: Vector3<f64>| attitude(roll, pitch, yaw) * v;
    assert!(turned(0.1, 0.0, 0.0, Vector3::y()).z > 0.0, "roll right lowers the right side");
    assert!(turned(0.0, 0.1, 0.0, Vector3::x()).z < 0.0, "pitch up raises the nose");
    assert!(turned(0.0, 0.0, 0.1, Vector3::x()).y > 0.0, "yaw right turns the nose right");
    // Rolling right turns the section angle clockwise: up becomes up-right.
    assert!(turned(0.1, 0.0, 0.0, outward(0.0)).y > 0.0);
}
