//! A noise-free spiral, so that the adjustment starts at its optimum and takes exactly one iteration.

use adit_geometry::camera::{Camera, Distortion};
use adit_geometry::profile::{Profile, ProfileSpec};
use adit_geometry::rig::{ImageUp, Rig};
use adit_ground::adjust::{Observation, Point, Problem, Shared, Weights};
use adit_ground::prior::{TagPrior, prior_poses};
use adit_protocol::mission::Sigma;
use nalgebra::{Point3, Vector3};

pub(crate) const WEIGHTS: Weights = Weights { pixel_px: 0.1, robust: 3.0, surface_m: 0.05 };
const STEP_M: f64 = 0.1;
const POINTS_PER_PHOTO: usize = 150;
/// A point is looked for in photos at most so far away along the axis: about seven photos see it.
const REACH_M: f64 = 1.1;

pub(crate) struct Scene {
    camera: Camera<f64>,
    profile: Profile<f64>,
    rig: Rig<f64>,
    tags: Vec<TagPrior>,
    points: Vec<Point>,
}

impl Scene {
    pub(crate) fn new(photos: usize) -> Self {
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
                rotation_sigma_rad: [0.024, 0.017, 0.017],
                attitude_rad: None,
                beams: Vec::new(),
                range_head_m: None,
                odometer_m: Some(STEP_M * photo as f64),
            })
            .collect();
        let mut scene = Self { camera, profile, rig, tags, points: Vec::new() };
        scene.points = scene.wall_points();
        scene
    }

    /// Points spread evenly over the wall (golden ratio), with their exact sightings.
    fn wall_points(&self) -> Vec<Point> {
        let poses = prior_poses(&self.tags, &self.rig, &self.profile, 0.02);
        let length_m = STEP_M * self.tags.len() as f64;
        let count = POINTS_PER_PHOTO * self.tags.len();
        let place = |index: usize| -> Option<Point> {
            let x_m = length_m * index as f64 / count as f64;
            let around = self.profile.at(self.profile.perimeter_m() * (index as f64 * 0.618_034).fract())?;
            let position = Point3::new(x_m, around.point.x, around.point.y);
            let observations: Vec<Observation> = poses
                .iter()
                .enumerate()
                .filter(|(_, pose)| (pose.translation.x - x_m).abs() < REACH_M)
                .filter_map(|(photo, pose)| {
                    let pixel = self.camera.project(&pose.inverse_transform_point(&position).coords)?;
                    self.camera.contains(&pixel, 5.0).then_some(Observation { photo, pixel })
                })
                .collect();
            (observations.len() >= 2).then_some(Point { position, observations })
        };
        (0..count).filter_map(place).collect()
    }

    pub(crate) fn problem(&self) -> Problem<'_> {
        Problem {
            camera: &self.camera,
            profile: &self.profile,
            rig: &self.rig,
            sigma: Sigma {
                shaft_rad: 0.017,
                range_m: 0.02,
                odometer_m_per_m: 0.02,
                attitude_rad: 0.026,
                mount_rad: 0.017,
            },
            tags: &self.tags,
            poses: prior_poses(&self.tags, &self.rig, &self.profile, 0.02),
            points: self.points.clone(),
            shared: Shared { mount_rotvec: Vector3::zeros(), odometer_scale: 0.0 },
        }
    }
}
