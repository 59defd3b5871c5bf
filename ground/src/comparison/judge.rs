//! What is correct: by the truth, or without one, by the adjusted poses.

use std::collections::HashMap;

use adit_geometry::camera::Camera;
use adit_geometry::profile::Profile;
use anyhow::{Context, Result};
use nalgebra::{Isometry3, Point3, Vector2};
use serde::Serialize;

use super::CORRECT_PX;
use crate::poses::{PhotoPose, read_poses};
use crate::survey::Survey;
use crate::two_view::{Motion, TwoView};

/// What correctness is judged by.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Reference {
    /// truth/poses.csv: both pixels see the same point of the true section.
    Truth,
    /// Adjusted poses, there being no truth: the pixels lie on each other's epipolar lines, which wrong ones may too.
    Adjusted,
}

/// Errors of a relative pose.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct RelativeErrors {
    /// Angle between estimated and true rotation.
    pub rotation_deg: f64,
    /// Angle between estimated and true direction of the baseline; `None` if the estimate says that the camera only turned.
    pub direction_deg: Option<f64>,
}

/// Knows the poses, and so what is correct.
#[derive(Debug)]
pub struct Judge<'a> {
    reference: Reference,
    camera: &'a Camera<f64>,
    profile: Profile<f64>,
    /// `tunnel_from_cam`, one per photo of the survey.
    poses: Vec<Isometry3<f64>>,
}

impl<'a> Judge<'a> {
    /// Reads the truth; asks for `adjusted` poses if there is none.
    ///
    /// # Errors
    /// If the truth cannot be read or lacks a photo, or if `adjusted` fails.
    pub fn new(survey: &'a Survey, adjusted: impl FnOnce() -> Result<Vec<PhotoPose>>) -> Result<Self> {
        let path = survey.folder.join("truth/poses.csv");
        let (reference, known) = if path.is_file() {
            (Reference::Truth, read_poses(&path)?)
        } else {
            (Reference::Adjusted, adjusted().context("adjusted poses, for want of a truth")?)
        };
        let file_name = |photo: &str| photo.rsplit('/').next().unwrap_or(photo).to_owned();
        let by_name: HashMap<String, Isometry3<f64>> =
            known.into_iter().map(|pose| (file_name(&pose.photo), pose.tunnel_from_cam)).collect();
        let pose = |name: &str| {
            by_name.get(&file_name(name)).copied().with_context(|| format!("{}: no pose of {name}", path.display()))
        };
        let poses = survey.photos.iter().map(|photo| pose(&photo.name)).collect::<Result<_>>()?;
        let profile = survey.config.profile.build().context("survey.toml: [tunnel]")?;
        Ok(Self { reference, camera: &survey.config.camera.camera, profile, poses })
    }

    /// What correctness is judged by.
    pub fn reference(&self) -> Reference {
        self.reference
    }

    /// Tells whether two pixels show the same thing, to [`CORRECT_PX`] in either photo.
    pub fn is_correct(&self, photos: [usize; 2], pixels: [[f64; 2]; 2]) -> bool {
        let poses = photos.map(|photo| &self.poses[photo]);
        let pixels = pixels.map(Vector2::from);
        let error_px = match self.reference {
            Reference::Truth => {
                let forth = self.transfer_error_px(poses, pixels);
                let back = self.transfer_error_px([poses[1], poses[0]], [pixels[1], pixels[0]]);
                forth.zip(back).map(|(forth, back)| forth.max(back))
            }
            Reference::Adjusted => self.epipolar_error_px(poses, pixels),
        };
        error_px.is_some_and(|error_px| error_px <= CORRECT_PX)
    }

    /// Distance, in the second photo, from where the wall point that the first pixel sees should be.
    fn transfer_error_px(&self, poses: [&Isometry3<f64>; 2], pixels: [Vector2<f64>; 2]) -> Option<f64> {
        let ray = poses[0].rotation * self.camera.unproject(&pixels[0])?;
        let centre = poses[0].translation.vector;
        let hit = self.profile.ray_cast(centre.yz(), ray.yz())?;
        let point = Point3::from(centre + ray * hit.distance);
        let expected = self.camera.project(&poses[1].inverse_transform_point(&point).coords)?;
        Some((expected - pixels[1]).norm())
    }

    /// Angle between the second ray and the plane of baseline and first ray, as pixels at the photo's centre.
    fn epipolar_error_px(&self, poses: [&Isometry3<f64>; 2], pixels: [Vector2<f64>; 2]) -> Option<f64> {
        let first = poses[0].rotation * self.camera.unproject(&pixels[0])?;
        let second = (poses[1].rotation * self.camera.unproject(&pixels[1])?).normalize();
        let baseline = poses[1].translation.vector - poses[0].translation.vector;
        let normal = baseline.cross(&first).try_normalize(1e-12)?;
        Some(normal.dot(&second).abs().asin() * self.camera.focal_px[0])
    }

    /// Compares a relative pose with the known one.
    pub fn errors(&self, photos: [usize; 2], two_view: &TwoView) -> RelativeErrors {
        let [first, second] = photos.map(|photo| &self.poses[photo]);
        let known = second.inv_mul(first);
        let estimated = &two_view.second_from_first;
        let direction = |pose: &Isometry3<f64>| pose.translation.vector;
        RelativeErrors {
            rotation_deg: known.rotation.angle_to(&estimated.rotation).to_degrees(),
            direction_deg: (two_view.motion == Motion::General)
                .then(|| direction(&known).angle(&direction(estimated)).to_degrees()),
        }
    }
}
