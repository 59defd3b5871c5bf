//! The tunnel problem as the solver sees it.

use adit_geometry::rig::nominal_rotation;
use nalgebra::{Isometry3, Matrix3, Point3, SMatrix, SVector, UnitQuaternion, Vector2, Vector3};

use super::factors::{
    ANCHOR_M, ODOMETER_STEP_M, Turned, body_centre, inverse_left_jacobian, ranges, rotation_prior, surface,
    viewing_direction,
};
use super::loss::Loss;
use super::problem::Problem;
use super::shared::{
    Free, INTRINSICS, LEVER, MOUNT, ODOMETER, SHAFT_BIAS, SHAFT_COS, SHAFT_SIN, SHUTTER, SIZE, Shared,
};
use super::solver::{Layout, Model, PointPrior, PriorRow, Sight, Step};
use super::tracks::{Observation, Tracks};

/// Unknowns per camera.
pub(super) const CAMERA: usize = 6;
/// Shared unknowns that observations and points know of: size, shutter and nine of the camera.
pub(super) const WITH_POINTS: usize = 11;
/// Range readings are Geman-McClure at this many standard deviations: a beam may meet a pipe, a person, a spray of water.
const RANGE_LOSS: Loss = Loss::GemanMcClure(3.0);
/// Keeps a photo that nothing else holds near its prior pose; ten times looser than the worst prior. Along the axis it holds the
/// step from the photo before: start poses drift by metres over a long tunnel, and holding each to its own x would hold the
/// drift (2,300 photos that were 1.6 % off pulled the scale by 0.28 %).
const LOOSE_POSITION_M: f64 = 0.5;
/// As for the position: a photo without tag and matches must not make the equations singular.
const LOOSE_ROTATION_RAD: f64 = 1.0;

/// The problem, with `K` shared unknowns in sight of the points: all of [`WITH_POINTS`], or none if they are fixed.
pub(super) struct TunnelModel<'a, const K: usize> {
    problem: &'a Problem<'a>,
    surface_m: f64,
    free: Free,
    shutter: ShutterAxis,
}

/// The shaft's axis in the camera frame, the same for all photos.
struct ShutterAxis {
    axis: Vector3<f64>,
    /// A point on it.
    foot: Vector3<f64>,
}

/// Poses and shared unknowns.
#[derive(Clone)]
pub(super) struct Estimate {
    pub(super) poses: Vec<Isometry3<f64>>,
    pub(super) shared: Shared,
    eyes: Vec<Eye>,
}

/// A pose in the form that projections use.
#[derive(Clone, Copy)]
struct Eye {
    cam_from_tunnel: Matrix3<f64>,
    centre: Vector3<f64>,
}

impl Eye {
    fn in_cam(&self, point: &Point3<f64>) -> Vector3<f64> {
        self.cam_from_tunnel * (point.coords - self.centre)
    }
}

impl Estimate {
    pub(super) fn new(poses: Vec<Isometry3<f64>>, shared: Shared) -> Self {
        let eye = |pose: &Isometry3<f64>| Eye {
            cam_from_tunnel: pose.rotation.inverse().to_rotation_matrix().into_inner(),
            centre: pose.translation.vector,
        };
        let eyes = poses.iter().map(eye).collect();
        Self { poses, shared, eyes }
    }
}

/// Tells whether an unknown that observations or points know of is free.
pub(super) fn points_see_shared(problem: &Problem<'_>) -> bool {
    let free = Free::new(&problem.shared_sigmas, problem.camera);
    free.column[SIZE..].iter().any(Option::is_some)
}

impl<'a, const K: usize> TunnelModel<'a, K> {
    pub(super) fn new(problem: &'a Problem<'a>, surface_m: f64) -> Self {
        // The nominal mounting and lever do: what they are off by changes the axis by a few percent of a small rotation.
        let rig = problem.rig;
        let cam_from_body = (nominal_rotation(rig.image_up, 0.0)
            * UnitQuaternion::from_scaled_axis(Vector3::from(rig.mount_rotvec_rad)))
        .inverse();
        let view = UnitQuaternion::from_scaled_axis(-Vector3::from(rig.mount_rotvec_rad)) * Vector3::z();
        let shutter = ShutterAxis { axis: cam_from_body * Vector3::x(), foot: view * -rig.lever_radial_m };
        Self { problem, surface_m, free: Free::new(&problem.shared_sigmas, problem.camera), shutter }
    }

    /// How long after the middle row the row of an observation was exposed, seconds.
    fn delay_s(&self, seen: &Observation) -> f64 {
        self.problem.readout_s * (f64::from(seen.pixel[1]) / f64::from(self.problem.camera.height_px) - 0.5)
    }

    /// Rotation `row_from_middle` that takes a point from the camera of the middle row to that of an observation's row.
    fn shutter_rotation(&self, shared: &Shared, seen: &Observation) -> Option<Matrix3<f64>> {
        let angle_rad = shared.shutter_rad_per_s * self.delay_s(seen);
        (angle_rad != 0.0)
            .then(|| UnitQuaternion::from_scaled_axis(self.shutter.axis * -angle_rad).to_rotation_matrix().into_inner())
    }

    /// A point of the camera of the middle row in that of an observation's row.
    fn in_row(&self, row_from_middle: Option<&Matrix3<f64>>, middle: Vector3<f64>) -> Vector3<f64> {
        match row_from_middle {
            Some(row_from_middle) => row_from_middle * (middle - self.shutter.foot) + self.shutter.foot,
            None => middle,
        }
    }
}

fn pixel_of(seen: &Observation) -> Vector2<f64> {
    Vector2::from(seen.pixel.map(f64::from))
}

impl<const K: usize> Model<CAMERA, K> for TunnelModel<'_, K> {
    type Estimate = Estimate;

    fn cameras(&self) -> usize {
        self.problem.poses.len()
    }

    fn tracks(&self) -> &Tracks {
        self.problem.tracks
    }

    fn shared(&self) -> usize {
        self.free.count
    }

    fn point_shared(&self) -> [Option<usize>; K] {
        std::array::from_fn(|k| self.free.column[SIZE + k])
    }

    fn links(&self) -> Vec<[u32; 2]> {
        let tags = self.problem.tags.iter().enumerate();
        let with_odometer: Vec<u32> =
            tags.filter_map(|(photo, tag)| tag.odometer_m.is_some().then_some(photo as u32)).collect();
        let steps = with_odometer.windows(2).map(|pair| [pair[0], pair[1]]);
        let neighbours = (1..self.problem.poses.len() as u32).map(|photo| [photo - 1, photo]);
        steps.chain(neighbours).collect()
    }

    fn residual(&self, estimate: &Estimate, point: &Point3<f64>, seen: &Observation) -> Option<Vector2<f64>> {
        let row_from_middle = self.shutter_rotation(&estimate.shared, seen);
        let in_cam = self.in_row(row_from_middle.as_ref(), estimate.eyes[seen.photo as usize].in_cam(point));
        Some(estimate.shared.camera.project(&in_cam)? - pixel_of(seen))
    }

    fn sight(&self, estimate: &Estimate, point: &Point3<f64>, seen: &Observation) -> Option<Sight<CAMERA, K>> {
        let eye = &estimate.eyes[seen.photo as usize];
        let middle = eye.in_cam(point);
        let camera = &estimate.shared.camera;
        let row_from_middle = self.shutter_rotation(&estimate.shared, seen);
        let in_cam = self.in_row(row_from_middle.as_ref(), middle);
        let (pixel, by_in_cam) = camera.project_with_jacobian(&in_cam)?;
        let by_middle = match row_from_middle {
            Some(row_from_middle) => by_in_cam * row_from_middle,
            None => by_in_cam,
        };
        let by_point = by_middle * eye.cam_from_tunnel;
        let mut by_camera = SMatrix::<f64, 2, CAMERA>::zeros();
        by_camera.fixed_columns_mut::<3>(0).copy_from(&(by_middle * middle.cross_matrix()));
        by_camera.fixed_columns_mut::<3>(3).copy_from(&-by_point);
        let mut by_shared = SMatrix::<f64, 2, K>::zeros();
        if K > 0 {
            let turned = -self.shutter.axis.cross(&(in_cam - self.shutter.foot)) * self.delay_s(seen);
            by_shared.set_column(SHUTTER - SIZE, &(by_in_cam * turned));
            let intrinsics = camera.jacobian_by_intrinsics(&in_cam);
            by_shared.columns_mut(INTRINSICS - SIZE, 9).copy_from(&intrinsics);
            for k in 0..K {
                if self.free.column[SIZE + k].is_none() {
                    by_shared.column_mut(k).fill(0.0);
                }
            }
        }
        Some(Sight { residual: pixel - pixel_of(seen), by_camera, by_point, by_shared })
    }

    fn point_prior(&self, estimate: &Estimate, point: &Point3<f64>) -> Option<PointPrior<K>> {
        let size = estimate.shared.profile_size;
        let (residual, by_point, by_size) = surface(self.problem.profile, size, &point.coords, self.surface_m)?;
        let mut by_shared = SVector::<f64, K>::zeros();
        if K > 0 && self.free.column[SIZE].is_some() {
            by_shared[0] = by_size;
        }
        Some(PointPrior { residual, by_point, by_shared })
    }

    fn priors(&self, estimate: &Estimate, layout: &Layout, emit: &mut dyn FnMut(&PriorRow<'_>)) {
        let mut rows = Rows { free: &self.free, layout, slopes: Vec::new(), emit };
        let mut before: Option<Fix> = None;
        for (photo, (tag, pose)) in self.problem.tags.iter().zip(&estimate.poses).enumerate() {
            self.add_rotation(photo, estimate, &mut rows);
            self.add_ranges(photo, estimate, &mut rows);
            self.add_loose(photo, &estimate.poses, &mut rows);
            if let Some(reading_m) = tag.odometer_m {
                let view = viewing_direction(&pose.rotation, &estimate.shared);
                let body = body_centre(pose, &view, &estimate.shared);
                let fix = Fix { photo, reading_m, body, view_x: view.value.x };
                match &before {
                    Some(before) => rows.add_step(before, &fix, estimate.shared.odometer_scale),
                    None => rows.add_anchor(&fix),
                }
                before = Some(fix);
            }
        }
        let nominal = Shared::nominal(self.problem.camera, self.problem.rig).values();
        let sigmas = self.problem.shared_sigmas.values();
        for (parameter, value) in estimate.shared.values().into_iter().enumerate() {
            if self.free.column[parameter].is_some() {
                let sigma = sigmas[parameter];
                rows.shared(parameter, 1.0 / sigma);
                rows.emit((value - nominal[parameter]) / sigma, Loss::Squared);
            }
        }
    }

    fn stepped(&self, estimate: &Estimate, step: &Step<'_>) -> Estimate {
        let moved = estimate.poses.iter().enumerate().map(|(photo, pose)| {
            let by = step.camera::<CAMERA>(photo);
            let mut pose = *pose;
            pose.rotation *= UnitQuaternion::from_scaled_axis(by.fixed_rows::<3>(0).into_owned());
            pose.rotation.renormalize();
            pose.translation.vector += by.fixed_rows::<3>(3);
            pose
        });
        let mut values = estimate.shared.values();
        for (value, column) in values.iter_mut().zip(self.free.column) {
            *value += column.map_or(0.0, |column| step.shared(column));
        }
        Estimate::new(moved.collect(), estimate.shared.with_values(&values))
    }
}

impl<const K: usize> TunnelModel<'_, K> {
    fn add_rotation(&self, photo: usize, estimate: &Estimate, rows: &mut Rows<'_, '_>) {
        let tag = &self.problem.tags[photo];
        let prior = rotation_prior(tag, self.problem.rig, &estimate.poses[photo].rotation, &estimate.shared);
        let (sin, cos) = tag.shaft_rad.sin_cos();
        for axis in 0..3 {
            if !tag.rotation_sigma_rad[axis].is_finite() {
                continue;
            }
            for unknown in 0..3 {
                rows.camera(photo, unknown, prior.by_rotation[(axis, unknown)]);
                rows.shared(MOUNT + unknown, prior.by_mount[(axis, unknown)]);
            }
            let by_shaft = prior.by_shaft[axis];
            rows.shared(SHAFT_BIAS, by_shaft);
            rows.shared(SHAFT_SIN, by_shaft * sin);
            rows.shared(SHAFT_COS, by_shaft * cos);
            rows.emit(prior.residual[axis], Loss::Squared);
        }
    }

    fn add_ranges(&self, photo: usize, estimate: &Estimate, rows: &mut Rows<'_, '_>) {
        let Problem { tags, profile, sigma, .. } = self.problem;
        for range in ranges(&tags[photo], profile, sigma.range_m, &estimate.poses[photo], &estimate.shared) {
            for axis in 0..3 {
                rows.camera(photo, axis, range.by_rotation[axis]);
                rows.camera(photo, 3 + axis, range.by_centre[axis]);
                rows.shared(MOUNT + axis, range.by_mount[axis]);
            }
            rows.shared(LEVER, range.by_radial);
            rows.shared(SIZE, range.by_size);
            rows.emit(range.residual, RANGE_LOSS);
        }
    }

    /// Keeps a photo near where it started, loosely: along the axis against the photo before it.
    fn add_loose(&self, photo: usize, poses: &[Isometry3<f64>], rows: &mut Rows<'_, '_>) {
        let (start, pose) = (&self.problem.poses[photo], &poses[photo]);
        let turned = (start.rotation.inverse() * pose.rotation).scaled_axis();
        let by_rotation = inverse_left_jacobian(&turned).transpose() / LOOSE_ROTATION_RAD;
        let mut moved = pose.translation.vector - start.translation.vector;
        for axis in 0..3 {
            for unknown in 0..3 {
                rows.camera(photo, unknown, by_rotation[(axis, unknown)]);
            }
            rows.emit(turned[axis] / LOOSE_ROTATION_RAD, Loss::Squared);
            if axis == 0 && photo > 0 {
                moved.x -= poses[photo - 1].translation.x - self.problem.poses[photo - 1].translation.x;
                rows.camera(photo - 1, 3, -1.0 / LOOSE_POSITION_M);
            }
            rows.camera(photo, 3 + axis, 1.0 / LOOSE_POSITION_M);
            rows.emit(moved[axis] / LOOSE_POSITION_M, Loss::Squared);
        }
    }
}

/// A photo with an odometer reading.
struct Fix {
    photo: usize,
    reading_m: f64,
    body: Turned,
    /// Of the viewing direction.
    view_x: f64,
}

/// One residual at a time: slopes are gathered, then sent off.
struct Rows<'a, 'b> {
    free: &'a Free,
    layout: &'a Layout,
    slopes: Vec<(usize, f64)>,
    emit: &'a mut (dyn FnMut(&PriorRow<'_>) + 'b),
}

impl Rows<'_, '_> {
    fn camera(&mut self, photo: usize, unknown: usize, slope: f64) {
        self.slopes.push((self.layout.camera(photo) + unknown, slope));
    }

    fn shared(&mut self, parameter: usize, slope: f64) {
        if let Some(column) = self.free.column[parameter] {
            self.slopes.push((self.layout.shared(column), slope));
        }
    }

    fn emit(&mut self, residual: f64, loss: Loss) {
        (self.emit)(&PriorRow { residual, loss, slopes: &self.slopes });
        self.slopes.clear();
    }

    /// The step of the body along x against the odometer's.
    fn add_step(&mut self, before: &Fix, fix: &Fix, odometer_scale: f64) {
        let step_m = fix.reading_m - before.reading_m;
        let moved_m = fix.body.value.x - before.body.value.x;
        let per_m = 1.0 / ODOMETER_STEP_M;
        self.camera(before.photo, 3, -per_m);
        self.camera(fix.photo, 3, per_m);
        for axis in 0..3 {
            self.camera(before.photo, axis, -before.body.by_rotation[(0, axis)] * per_m);
            self.camera(fix.photo, axis, fix.body.by_rotation[(0, axis)] * per_m);
            self.shared(MOUNT + axis, (fix.body.by_mount[(0, axis)] - before.body.by_mount[(0, axis)]) * per_m);
        }
        self.shared(LEVER, (before.view_x - fix.view_x) * per_m);
        self.shared(ODOMETER, -step_m * per_m);
        self.emit((moved_m - (1.0 + odometer_scale) * step_m) * per_m, Loss::Squared);
    }

    /// The first reading pins x.
    fn add_anchor(&mut self, fix: &Fix) {
        let per_m = 1.0 / ANCHOR_M;
        self.camera(fix.photo, 3, per_m);
        for axis in 0..3 {
            self.camera(fix.photo, axis, fix.body.by_rotation[(0, axis)] * per_m);
            self.shared(MOUNT + axis, fix.body.by_mount[(0, axis)] * per_m);
        }
        self.shared(LEVER, -fix.view_x * per_m);
        self.shared(LEVER + 1, -per_m);
        self.emit((fix.body.value.x - fix.reading_m) * per_m, Loss::Squared);
    }
}

#[cfg(test)]
mod tests;
