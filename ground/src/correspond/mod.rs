//! Correspondences between two photos of which no pose is known, by three strategies over the same features.
//!
//! - [`Ratio`]: nearest neighbours that are clearly nearer than the second (Lowe, IJCV 2004), then RANSAC. The baseline.
//! - [`Gms`]: nearest neighbours, right or not, that move together with their surroundings (Bian et al., CVPR 2017), then
//!   RANSAC. A fast filter for many cheap features.
//! - [`RepMatch`]: RANSAC's inliers train curves of likelihood and motion, by which every near neighbour is judged again
//!   (Lin et al., "RepMatch: Robust Feature Matching and Pose for Reconstructing Modern Cities", ECCV 2016).
//!
//! All of them are [`Strategy`], for any [`Descriptor`]. Where tags give rough poses, [`crate::matching`] finds more and
//! better ones than any of them: see [`crate::comparison`].

mod bilateral;
mod gms;
mod motion;
mod ratio;
mod repmatch;
mod verify;

use adit_geometry::camera::Camera;
use nalgebra::{UnitVector3, Vector2};

pub use gms::Gms;
pub use ratio::Ratio;
pub use repmatch::RepMatch;
pub use verify::Verify;

use crate::features::{Descriptor, Features};
use crate::two_view::TwoView;

/// A photo's features with their viewing directions.
#[derive(Clone, Debug)]
pub struct View<D> {
    /// The camera.
    pub camera: Camera<f64>,
    /// The features, all of them with a ray.
    pub features: Features<D>,
    /// Viewing direction of each feature in the `cam` frame.
    pub rays: Vec<UnitVector3<f64>>,
}

impl<D> View<D> {
    /// Adds the rays; features beyond where the lens model can be inverted are left out.
    pub fn new(features: Features<D>, camera: &Camera<f64>) -> Self {
        let mut view = Self {
            camera: *camera,
            features: Features { keypoints: Vec::new(), descriptors: Vec::new() },
            rays: Vec::new(),
        };
        for (keypoint, descriptor) in features.keypoints.into_iter().zip(features.descriptors) {
            if let Some(ray) = camera.unproject(&Vector2::from(keypoint.pixel)) {
                view.features.keypoints.push(keypoint);
                view.features.descriptors.push(descriptor);
                view.rays.push(UnitVector3::new_normalize(ray));
            }
        }
        view
    }

    fn pixel(&self, feature: u32) -> Vector2<f64> {
        Vector2::from(self.features.keypoints[feature as usize].pixel)
    }

    fn ray(&self, feature: u32) -> UnitVector3<f64> {
        self.rays[feature as usize]
    }
}

/// Features of a first and a second photo that show the same thing, by index.
pub type Match = [u32; 2];

/// What a strategy found out about two photos.
#[derive(Clone, Debug, Default)]
pub struct Correspondences {
    /// Matches that agree with one motion of the camera; no feature is in two of them.
    pub matches: Vec<Match>,
    /// How many there were before the geometry decided.
    pub tentative: usize,
    /// The motion; `None` if no motion explains enough of them.
    pub two_view: Option<TwoView>,
}

/// A way to find correspondences.
pub trait Strategy<D: Descriptor>: Sync {
    /// Finds what `first` and `second` both see.
    fn correspond(&self, first: &View<D>, second: &View<D>) -> Correspondences;
}
