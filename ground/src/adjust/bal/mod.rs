//! "Bundle Adjustment in the Large" problems: every camera has nine free parameters, points are free, no loss.
//!
//! Camera model (Snavely's Bundler): `P = R X + t`, `p = -P / P.z`, pixel `= f (1 + k1 |p|^2 + k2 |p|^4) p`, pixels from the
//! image's centre, y up. Agarwal, Snavely, Seitz & Szeliski, "Bundle Adjustment in the Large", 2010.

mod file;

use nalgebra::{Matrix2x3, Point3, SMatrix, UnitQuaternion, Vector2, Vector3};
use serde::Serialize;

pub use file::{BalError, read_bal, write_bal};

use super::Outcome;
use super::loss::Loss;
use super::solver::{
    Layout, Limits, Model, NotPositiveDefinite, PointPrior, PriorRow, Sight, Solver, State, Step, Weighting,
};
use super::tracks::{Observation, Tracks};

/// Unknowns per camera: rotation (on the left, world axes), translation, focal length and two radial coefficients.
const CAMERA: usize = 9;
/// Relative decrease of the cost at which the iteration stops.
const DECREASE: f64 = 1e-8;
/// See [`Limits::kink`].
const KINK: f64 = 3e-7;
/// The first damping.
const DAMPING: f64 = 1e-4;

/// A camera of a BAL problem.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BalCamera {
    /// `cam_from_world`, z backwards.
    pub rotation: UnitQuaternion<f64>,
    /// `cam_from_world`.
    pub translation: Vector3<f64>,
    /// Focal length, pixels.
    pub focal_px: f64,
    /// Radial distortion `k1`, `k2`.
    pub radial: [f64; 2],
}

/// A BAL problem.
#[derive(Clone, Debug, PartialEq)]
pub struct BalProblem {
    /// The cameras.
    pub cameras: Vec<BalCamera>,
    /// Points with their images; `photo` is the camera's index.
    pub tracks: Tracks,
}

/// What an adjustment of a BAL problem did. Costs are half the sum of squared residuals in pixels.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct BalReport {
    /// Before.
    pub initial_cost: f64,
    /// After.
    pub final_cost: f64,
    /// Linear systems solved.
    pub iterations: usize,
    /// How it ended.
    pub outcome: Outcome,
}

impl BalProblem {
    /// Adjusts cameras and points in place, with at most `iterations` linear systems.
    ///
    /// # Errors
    /// [`NotPositiveDefinite`] if a camera is not determined even with damping, as when nothing is seen from it.
    pub fn adjust(&mut self, iterations: usize) -> Result<BalReport, NotPositiveDefinite> {
        let mut state =
            State { estimate: self.cameras.iter().map(Lens::new).collect(), points: self.tracks.positions().to_vec() };
        let model = BalModel { tracks: &self.tracks, cameras: self.cameras.len() };
        let weighting = Weighting { pixel_px: 1.0, loss: Loss::Squared, information: None, curved: false };
        let mut solver = Solver::new(&model);
        let initial_cost = solver.cost(&weighting, &state);
        let limits = Limits { iterations, decrease: DECREASE, kink: KINK, damping: DAMPING };
        let minimised = solver.minimise(&weighting, &mut state, limits)?;
        self.cameras = state.estimate.iter().map(|lens: &Lens| lens.camera).collect();
        self.tracks.positions_mut().copy_from_slice(&state.points);
        Ok(BalReport {
            initial_cost,
            final_cost: minimised.cost,
            iterations: minimised.iterations,
            outcome: minimised.outcome,
        })
    }
}

struct BalModel<'a> {
    tracks: &'a Tracks,
    cameras: usize,
}

/// A camera with its rotation as a matrix.
#[derive(Clone)]
struct Lens {
    camera: BalCamera,
    cam_from_world: nalgebra::Matrix3<f64>,
}

impl Lens {
    fn new(camera: &BalCamera) -> Self {
        Self { camera: *camera, cam_from_world: camera.rotation.to_rotation_matrix().into_inner() }
    }
}

impl Model<CAMERA, 0> for BalModel<'_> {
    type Estimate = Vec<Lens>;

    fn cameras(&self) -> usize {
        self.cameras
    }

    fn tracks(&self) -> &Tracks {
        self.tracks
    }

    fn shared(&self) -> usize {
        0
    }

    fn point_shared(&self) -> [Option<usize>; 0] {
        []
    }

    fn links(&self) -> Vec<[u32; 2]> {
        Vec::new()
    }

    fn residual(&self, estimate: &Vec<Lens>, point: &Point3<f64>, seen: &Observation) -> Option<Vector2<f64>> {
        let Lens { camera, cam_from_world } = &estimate[seen.photo as usize];
        let in_cam = cam_from_world * point.coords + camera.translation;
        let plane = -in_cam.xy() / in_cam.z;
        let r2 = plane.norm_squared();
        let [k1, k2] = camera.radial;
        Some(plane * (camera.focal_px * (1.0 + r2 * (k1 + r2 * k2))) - Vector2::from(seen.pixel.map(f64::from)))
    }

    fn sight(&self, estimate: &Vec<Lens>, point: &Point3<f64>, seen: &Observation) -> Option<Sight<CAMERA, 0>> {
        let Lens { camera, cam_from_world } = &estimate[seen.photo as usize];
        let rotated = cam_from_world * point.coords;
        let in_cam = rotated + camera.translation;
        let plane = -in_cam.xy() / in_cam.z;
        let r2 = plane.norm_squared();
        let [k1, k2] = camera.radial;
        let radial = 1.0 + r2 * (k1 + r2 * k2);
        let by_plane = nalgebra::Matrix2::identity() * (camera.focal_px * radial)
            + plane * plane.transpose() * (2.0 * camera.focal_px * (k1 + 2.0 * r2 * k2));
        let plane_by_cam = Matrix2x3::new(-1.0, 0.0, -plane.x, 0.0, -1.0, -plane.y) / in_cam.z;
        let by_cam = by_plane * plane_by_cam;
        let mut by_camera = SMatrix::<f64, 2, CAMERA>::zeros();
        by_camera.fixed_columns_mut::<3>(0).copy_from(&(-by_cam * rotated.cross_matrix()));
        by_camera.fixed_columns_mut::<3>(3).copy_from(&by_cam);
        by_camera.set_column(6, &(plane * radial));
        by_camera.set_column(7, &(plane * (camera.focal_px * r2)));
        by_camera.set_column(8, &(plane * (camera.focal_px * r2 * r2)));
        Some(Sight {
            residual: plane * (camera.focal_px * radial) - Vector2::from(seen.pixel.map(f64::from)),
            by_camera,
            by_point: by_cam * cam_from_world,
            by_shared: SMatrix::zeros(),
        })
    }

    fn point_prior(&self, _: &Vec<Lens>, _: &Point3<f64>) -> Option<PointPrior<0>> {
        None
    }

    fn priors(&self, _: &Vec<Lens>, _: &Layout, _: &mut dyn FnMut(&PriorRow<'_>)) {}

    fn stepped(&self, estimate: &Vec<Lens>, step: &Step<'_>) -> Vec<Lens> {
        let moved = estimate.iter().enumerate().map(|(index, Lens { camera, .. })| {
            let by = step.camera::<CAMERA>(index);
            let turned = UnitQuaternion::from_scaled_axis(by.fixed_rows::<3>(0).into_owned()) * camera.rotation;
            Lens::new(&BalCamera {
                rotation: UnitQuaternion::new_normalize(turned.into_inner()),
                translation: camera.translation + by.fixed_rows::<3>(3),
                focal_px: camera.focal_px + by[6],
                radial: [camera.radial[0] + by[7], camera.radial[1] + by[8]],
            })
        });
        moved.collect()
    }
}

#[cfg(test)]
mod tests;
