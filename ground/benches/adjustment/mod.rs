//! A spiral with noise of a twentieth of a pixel; an adjustment that starts at its optimum takes exactly one iteration.

use adit_geometry::camera::{Camera, Distortion};
use adit_geometry::profile::{Profile, ProfileSpec};
use adit_geometry::rig::{ImageUp, Rig};
use adit_ground::adjust::{Loss, Observation, Problem, Shared, SharedSigmas, Tracks, Weights, adjust};
use adit_ground::prior::{PriorModel, TagPrior, prior_views};
use adit_protocol::mission::Sigma;
use nalgebra::{Isometry3, Point3, UnitQuaternion, Vector3};

pub(crate) const WEIGHTS: Weights = Weights { pixel_px: 0.1, loss: Loss::GemanMcClure(3.0), surface_m: 0.05 };
const SIGMA: Sigma =
    Sigma { shaft_rad: 0.017, range_m: 0.02, odometer_m_per_m: 0.02, attitude_rad: 0.026, mount_rad: 0.017 };
const STEP_M: f64 = 0.1;
const POINTS_PER_PHOTO: usize = 150;
/// A point is looked for in photos at most so far away along the axis: about seven photos see it.
const REACH_M: f64 = 1.1;

pub(crate) struct Scene {
    camera: Camera<f64>,
    profile: Profile<f64>,
    rig: Rig<f64>,
    tags: Vec<TagPrior>,
    poses: Vec<Isometry3<f64>>,
    tracks: Tracks,
    shared: Shared,
}

impl Scene {
    /// `off` tells how far the adjustment starts from the truth: 1 is 2 cm and half a degree.
    pub(crate) fn new(photos: usize, off: f64) -> Self {
        let camera = Camera {
            width_px: 1000,
            height_px: 750,
            focal_px: [466.0; 2],
            centre_px: [503.0, 373.0],
            distortion: Distortion::BrownConrady([-0.04, 0.006, 0.0, 0.0, 0.0]),
        };
        let profile = ProfileSpec::Circle { radius_m: 3.0 }.build().expect("a circle");
        let rig = Rig {
            images_per_turn: 10,
            image_up: ImageUp::Forward,
            lever_radial_m: 0.0,
            lever_forward_m: 0.0,
            mount_rotvec_rad: [0.0; 3],
        };
        let tags: Vec<TagPrior> = (0..photos)
            .map(|photo| TagPrior {
                shaft_rad: (36.0 * photo as f64).to_radians(),
                attitude_rad: None,
                beams: Vec::new(),
                range_head_m: None,
                odometer_m: Some(STEP_M * photo as f64),
                rotation_sigma_rad: [0.031, 0.026, 0.026],
            })
            .collect();
        let model =
            PriorModel { rig: &rig, profile: &profile, sigma: &SIGMA, odometer_factor: 1.0, unknown_step_m: 0.0 };
        let poses = prior_views(&tags, &model).into_iter().map(|view| view.tunnel_from_cam).collect();
        let shared = Shared::nominal(&camera, &rig);
        let mut scene = Self { camera, profile, rig, tags, poses, tracks: Tracks::default(), shared };
        scene.add_wall_points();
        for (photo, pose) in scene.poses.iter_mut().enumerate() {
            let [a, b, c] = [1.0, 1.7, 2.9].map(|turn| (turn * photo as f64).sin() * off);
            pose.rotation *= UnitQuaternion::from_scaled_axis(Vector3::new(b, c, a) * 0.009);
            pose.translation.vector += Vector3::new(a, b, c) * 0.02;
        }
        scene
    }

    /// Points spread evenly over the wall (golden ratio), with their sightings.
    fn add_wall_points(&mut self) {
        let length_m = STEP_M * self.tags.len() as f64;
        let count = POINTS_PER_PHOTO * self.tags.len();
        for index in 0..count {
            let x_m = length_m * index as f64 / count as f64;
            let s_m = self.profile.perimeter_m() * (index as f64 * 0.618_034).fract();
            let around = self.profile.at(s_m).expect("a finite arc length");
            let position = Point3::new(x_m, around.point.x, around.point.y);
            let seen: Vec<Observation> = self
                .poses
                .iter()
                .enumerate()
                .filter(|(_, pose)| (pose.translation.x - x_m).abs() < REACH_M)
                .filter_map(|(photo, pose)| {
                    let pixel = self.camera.project(&pose.inverse_transform_point(&position).coords)?;
                    let noise_px = [12.9898, 78.233].map(|turn| 0.07 * (turn * (index * 7 + photo) as f64).sin());
                    let pixel_px = [(pixel.x + noise_px[0]) as f32, (pixel.y + noise_px[1]) as f32];
                    self.camera.contains(&pixel, 5.0).then_some(Observation { photo: photo as u32, pixel: pixel_px })
                })
                .collect();
            if seen.len() >= 2 {
                self.tracks.push(position, seen);
            }
        }
    }

    /// The scene at its optimum.
    pub(crate) fn adjusted(mut self) -> Self {
        let adjusted = adjust(&self.problem(), &WEIGHTS).expect("the priors make the system definite");
        self.tracks.positions_mut().copy_from_slice(&adjusted.points);
        (self.poses, self.shared) = (adjusted.poses, adjusted.shared);
        self
    }

    pub(crate) fn problem(&self) -> Problem<'_> {
        Problem {
            camera: &self.camera,
            profile: &self.profile,
            rig: &self.rig,
            sigma: SIGMA,
            tags: &self.tags,
            poses: &self.poses,
            tracks: &self.tracks,
            shared: self.shared,
            shared_sigmas: SharedSigmas::of_tags(&SIGMA),
            readout_s: 0.0,
        }
    }
}
