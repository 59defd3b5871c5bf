//! Every slope that the solver is given, against differences of the residuals.

use adit_geometry::camera::{Camera, Distortion};
use adit_geometry::profile::{Profile, ProfileSpec};
use adit_geometry::rig::{ImageUp, Rig};
use adit_protocol::mission::Sigma;

use super::super::shared::SharedSigmas;
use super::*;
use crate::prior::{Beam, TagPrior};

const STEP: f64 = 1e-6;
const PHOTOS: usize = 3;
const SURFACE_M: f64 = 0.05;
/// Everything is free but the forward lever, so that a fixed parameter is among them.
const FREE: SharedSigmas = SharedSigmas {
    mount_rad: [0.02; 3],
    odometer_scale: 0.02,
    shaft_bias_rad: 0.1,
    shaft_periodic_rad: [0.1; 2],
    lever_m: [0.05, 0.0],
    profile_size: 0.05,
    shutter_rad_per_s: 1.0,
    focal_px: [5.0; 2],
    centre_px: [5.0; 2],
    distortion: [0.1; 5],
};

struct Scene {
    camera: Camera<f64>,
    profile: Profile<f64>,
    rig: Rig<f64>,
    tags: Vec<TagPrior>,
    poses: Vec<Isometry3<f64>>,
    tracks: Tracks,
}

impl Scene {
    fn new(distortion: Distortion<f64>) -> Self {
        let camera =
            Camera { width_px: 1000, height_px: 750, focal_px: [466.0, 460.0], centre_px: [503.0, 373.0], distortion };
        let rig = Rig {
            images_per_turn: 10,
            image_up: ImageUp::Clockwise,
            lever_radial_m: 0.06,
            lever_forward_m: 0.02,
            mount_rotvec_rad: [0.01, -0.02, 0.03],
        };
        let profile = ProfileSpec::Underpass { width_m: 4.0, wall_m: 2.5, rise_m: 1.0, axis_height_m: 1.4 };
        let beam = |y: f64, z: f64| Beam { direction: Vector3::new(0.02, y, z), measured_m: 1.5 };
        let tag = |photo: usize| TagPrior {
            shaft_rad: 0.8 + 0.1 * photo as f64,
            attitude_rad: Some([0.01, 0.005, -0.02]),
            beams: vec![beam(0.0, -1.0), beam(1.0, 0.1), beam(-1.0, 0.0)],
            range_head_m: Some(2.0),
            odometer_m: (photo != 1).then_some(0.1 * photo as f64),
            rotation_sigma_rad: [0.03, 0.02, if photo == 1 { f64::INFINITY } else { 0.025 }],
        };
        let pose = |photo: usize| {
            let mut pose = rig.body_from_cam(0.83 + 0.1 * photo as f64);
            pose.rotation *= UnitQuaternion::from_euler_angles(0.05, -0.03, 0.08);
            pose.translation.vector += Vector3::new(0.1 * photo as f64, 0.1, -0.05);
            pose
        };
        let poses: Vec<Isometry3<f64>> = (0..PHOTOS).map(pose).collect();
        let mut tracks = Tracks::default();
        for [x, y, z] in [[0.7, -0.4, 1.8], [-0.5, 0.6, 2.1]] {
            let images =
                (0..PHOTOS as u32).map(|photo| Observation { photo, pixel: [610.0, 140.0 + 200.0 * photo as f32] });
            tracks.push(poses[0] * Point3::new(x, y, z), images);
        }
        Self { camera, profile: profile.build().unwrap(), rig, tags: (0..PHOTOS).map(tag).collect(), poses, tracks }
    }

    fn check(&self) {
        let mut shared = Shared::nominal(&self.camera, &self.rig);
        shared.mount_rotvec += Vector3::new(0.01, 0.015, -0.02);
        shared.shaft_periodic_rad = [0.01, -0.02];
        (shared.shaft_bias_rad, shared.odometer_scale, shared.profile_size) = (0.03, 0.01, 1.02);
        shared.shutter_rad_per_s = 0.7;
        let sigma =
            Sigma { shaft_rad: 0.017, range_m: 0.02, odometer_m_per_m: 0.02, attitude_rad: 0.026, mount_rad: 0.017 };
        let problem = Problem {
            camera: &self.camera,
            profile: &self.profile,
            rig: &self.rig,
            sigma,
            tags: &self.tags,
            poses: &self.poses,
            tracks: &self.tracks,
            shared,
            shared_sigmas: FREE,
            readout_s: 0.03,
        };
        let model = TunnelModel::<WITH_POINTS>::new(&problem, SURFACE_M);
        let layout = Layout::new(&self.tracks, CAMERA, PHOTOS, model.shared(), &model.links());
        // Away from the start, so that no residual is zero by construction.
        let moved: Vec<Isometry3<f64>> = self
            .poses
            .iter()
            .map(|pose| {
                Isometry3::from_parts(
                    pose.translation,
                    pose.rotation * UnitQuaternion::new(Vector3::new(0.03, 0.02, -0.04)),
                )
            })
            .collect();
        let estimate = Estimate::new(moved, shared);
        check_priors(&model, &layout, &estimate);
        check_points(&model, &layout, &estimate);
    }
}

/// Estimates one step ahead and behind along one unknown.
fn neighbours(
    model: &TunnelModel<'_, WITH_POINTS>,
    layout: &Layout,
    estimate: &Estimate,
    unknown: usize,
    step: f64,
) -> [Estimate; 2] {
    [step, -step].map(|step| {
        let mut values = vec![0.0; layout.shared(model.shared())];
        values[unknown] = step;
        model.stepped(estimate, &Step { layout, values: &values })
    })
}

fn rows(model: &TunnelModel<'_, WITH_POINTS>, layout: &Layout, estimate: &Estimate) -> Vec<(f64, Vec<(usize, f64)>)> {
    let mut rows = Vec::new();
    model.priors(estimate, layout, &mut |row| rows.push((row.residual, row.slopes.to_vec())));
    rows
}

fn check_priors(model: &TunnelModel<'_, WITH_POINTS>, layout: &Layout, estimate: &Estimate) {
    let at = rows(model, layout, estimate);
    // Rotation (3, one of them unknown once), four ranges and six loose ones each; anchor, step, shared unknowns.
    assert_eq!(at.len(), 3 * PHOTOS - 1 + 10 * PHOTOS + 2 + model.shared());
    for unknown in 0..layout.shared(model.shared()) {
        let [ahead, behind] =
            neighbours(model, layout, estimate, unknown, STEP).map(|moved| rows(model, layout, &moved));
        for (index, (_, slopes)) in at.iter().enumerate() {
            let slope: f64 = slopes.iter().filter(|(row, _)| *row == unknown).map(|(_, slope)| slope).sum();
            let difference = (ahead[index].0 - behind[index].0) / (2.0 * STEP);
            assert!(
                (difference - slope).abs() < 1e-5 * (1.0 + difference.abs()),
                "row {index} by {unknown}: {slope} {difference}"
            );
        }
    }
}

fn check_points(model: &TunnelModel<'_, WITH_POINTS>, layout: &Layout, estimate: &Estimate) {
    let indices = model.point_shared();
    for (position, seen) in model.tracks().iter() {
        for seen in seen {
            let sight = model.sight(estimate, position, seen).unwrap();
            let check = |slope: Vector2<f64>, [ahead, behind]: [Vector2<f64>; 2], step: f64, what: &str| {
                let difference = (ahead - behind) / (2.0 * step);
                assert!((difference - slope).norm() < 1e-5 * (1.0 + difference.norm()), "{what}: {slope} {difference}");
            };
            for unknown in 0..CAMERA {
                let row = layout.camera(seen.photo as usize) + unknown;
                let moved = neighbours(model, layout, estimate, row, STEP);
                let residuals = moved.map(|moved| model.residual(&moved, position, seen).unwrap());
                check(sight.by_camera.column(unknown).into_owned(), residuals, STEP, &format!("pose {unknown}"));
            }
            for (k, index) in indices.iter().enumerate() {
                let Some(index) = index else { continue };
                let moved = neighbours(model, layout, estimate, layout.shared(*index), STEP);
                let residuals = moved.map(|moved| model.residual(&moved, position, seen).unwrap());
                check(sight.by_shared.column(k).into_owned(), residuals, STEP, &format!("shared {k}"));
            }
            for axis in 0..3 {
                let mut shift = Vector3::zeros();
                shift[axis] = STEP;
                let residuals =
                    [position + shift, position - shift].map(|at| model.residual(estimate, &at, seen).unwrap());
                check(sight.by_point.column(axis).into_owned(), residuals, STEP, &format!("point {axis}"));
            }
        }
        let prior = model.point_prior(estimate, position).unwrap();
        let size = indices[0].map(|index| neighbours(model, layout, estimate, layout.shared(index), STEP)).unwrap();
        let [ahead, behind] = size.map(|moved| model.point_prior(&moved, position).unwrap().residual);
        assert!(((ahead - behind) / (2.0 * STEP) - prior.by_shared[0]).abs() < 1e-4, "size");
        for axis in 0..3 {
            let mut shift = Vector3::zeros();
            shift[axis] = STEP;
            let [ahead, behind] =
                [position + shift, position - shift].map(|at| model.point_prior(estimate, &at).unwrap().residual);
            assert!(((ahead - behind) / (2.0 * STEP) - prior.by_point[axis]).abs() < 1e-4, "surface by {axis}");
        }
    }
}

#[test]
fn slopes_agree_with_differences_for_a_lens_on_the_plane() {
    Scene::new(Distortion::BrownConrady([-0.04, 0.006, 0.001, -0.0005, 0.001])).check();
}

#[test]
fn slopes_agree_with_differences_for_a_fisheye() {
    Scene::new(Distortion::KannalaBrandt([0.02, -0.005, 0.001, -0.0003])).check();
}
