//! A first camera and first poses from nothing but the corners.
//!
//! Boards before a wide lens are too bent for a pinhole's closed form alone. So each of several focal lengths (Zhang's among
//! them, where his equations have an answer) starts as an equidistant fisheye, boards are posed by homographies of the rays,
//! and the fisheye model is fitted: it is well behaved for any lens, for its distortion is a small correction. The best one
//! wins; a Brown-Conrady camera starts as the curve nearest to it.

use adit_geometry::camera::{Camera, Distortion};
use nalgebra::{Isometry3, Matrix4, Vector2, Vector4};

use super::homography::{focal_px, homography, pose};
use super::solver::{Estimate, FINE, ROUGH, Sighting, minimise, parameters};
use crate::survey::Size;

/// Focal lengths tried, as a share of the photo's longer side: from a fisheye of 180 degrees to a telephoto lens.
const FOCALS: [f64; 5] = [0.3, 0.45, 0.7, 1.1, 2.0];
/// Rays farther from the optical axis (tangent: 80 degrees) take no part in a homography.
const WIDEST_TANGENT: f64 = 5.7;

/// The best fisheye camera for the sightings; `None` if no start leads anywhere.
pub(super) fn fisheye(sightings: &[Sighting], size: Size) -> Option<Estimate> {
    let centre = Vector2::new(f64::from(size.width_px), f64::from(size.height_px)) / 2.0;
    let planes: Vec<Vec<Vector2<f64>>> = sightings.iter().map(plane).collect();
    let direct: Vec<_> =
        planes.iter().zip(sightings).filter_map(|(plane, sighting)| homography(plane, &sighting.pixels)).collect();
    let longer = f64::from(size.width_px.max(size.height_px));
    let focals = focal_px(&direct, centre).into_iter().chain(FOCALS.map(|share| share * longer));
    let fits = focals.filter_map(|focal_px| {
        let camera = Camera {
            width_px: size.width_px,
            height_px: size.height_px,
            focal_px: [focal_px; 2],
            centre_px: centre.into(),
            distortion: Distortion::KannalaBrandt([0.0; 4]),
        };
        let cam_from_board: Option<Vec<_>> =
            planes.iter().zip(sightings).map(|(plane, sighting)| first_pose(&camera, plane, sighting)).collect();
        let mut estimate = Estimate { camera, cam_from_board: cam_from_board? };
        // Poses, then the focal lengths and the principal point, then the distortion.
        let mut cost = f64::INFINITY;
        for free in [0, 2, 4, parameters(&camera)] {
            cost = minimise(&mut estimate, sightings, free, ROUGH)?;
        }
        Some((cost, estimate))
    });
    let (_, mut best) = fits.min_by(|(a, _), (b, _)| a.total_cmp(b))?;
    let free = parameters(&best.camera);
    minimise(&mut best, sightings, free, FINE)?;
    Some(best)
}

fn plane(sighting: &Sighting) -> Vec<Vector2<f64>> {
    sighting.board.iter().map(nalgebra::Vector3::xy).collect()
}

fn first_pose(camera: &Camera<f64>, plane: &[Vector2<f64>], sighting: &Sighting) -> Option<Isometry3<f64>> {
    let mut board = Vec::with_capacity(plane.len());
    let mut rays = Vec::with_capacity(plane.len());
    for (place, pixel) in plane.iter().zip(&sighting.pixels) {
        let Some(ray) = camera.unproject(pixel) else { continue };
        let ray = if ray.z > 0.0 { ray.xy() / ray.z } else { continue };
        if ray.norm() < WIDEST_TANGENT {
            board.push(*place);
            rays.push(ray);
        }
    }
    pose(&homography(&board, &rays)?)
}

/// The Brown-Conrady camera nearest to a fisheye over the rays that the corners were seen by; poses stay.
///
/// Least squares for `f`, `f k1`, `f k2`, `f k3` of the radius in the image over the tangent: a linear problem.
pub(super) fn as_brown_conrady(fisheye: &Estimate, sightings: &[Sighting]) -> Option<Estimate> {
    let camera = &fisheye.camera;
    let mut normal = Matrix4::zeros();
    let mut right = Vector4::zeros();
    for (sighting, pose) in sightings.iter().zip(&fisheye.cam_from_board) {
        for place in &sighting.board {
            let point = pose.rotation * place + pose.translation.vector;
            if point.z <= 0.0 {
                return None;
            }
            let tangent = point.xy().norm() / point.z;
            let seen = camera.project(&point)?;
            let plane = Vector2::new(
                (seen.x - camera.centre_px[0]) / camera.focal_px[0],
                (seen.y - camera.centre_px[1]) / camera.focal_px[1],
            );
            let square = tangent * tangent;
            let powers = Vector4::new(1.0, square, square * square, square * square * square) * tangent;
            normal += powers * powers.transpose();
            right += powers * plane.norm();
        }
    }
    let [scale, a, b, c] = normal.cholesky()?.solve(&right).into();
    let camera = Camera {
        focal_px: camera.focal_px.map(|focal| focal * scale),
        distortion: Distortion::BrownConrady([a / scale, b / scale, 0.0, 0.0, c / scale]),
        ..*camera
    };
    Some(Estimate { camera, cam_from_board: fisheye.cam_from_board.clone() })
}
