//! A photo as the sweep uses it: where wall points lie in it, and its grey values at two resolutions.

use adit_geometry::profile::Profile;
use nalgebra::{Vector2, Vector3};

use crate::poses::{PoseStatus, Reconstruction};
use crate::raster::Raster;
use crate::survey::{Loss, Photo, Size, Survey, decode_luma, load_mask};
use crate::texture::{Footprint, Usable, View, WallPoint};

/// Flattest view that is compared: cosine of the angle of incidence (66 degrees).
const LEAST_INCIDENCE_COS: f64 = 0.4;

/// A photo whose pose the adjustment holds.
pub(super) struct Shot<'a> {
    pub(super) photo: &'a Photo,
    pub(super) view: View,
    pub(super) footprint: Footprint,
}

/// Grey values at the work resolution and at half of it.
pub(super) struct Pixels {
    levels: [Plane; 2],
    pub(super) usable: Usable,
}

/// One resolution of a photo.
pub(super) struct Plane {
    width: usize,
    height: usize,
    /// Photo pixels per pixel of this plane.
    scale: f32,
    data: Vec<u8>,
}

/// How a photo sees a place of the wall.
#[derive(Clone, Copy, Debug)]
pub(super) struct Outlook {
    /// Cosine of the angle of incidence over the distance: resolution in the worse direction but for the focal length.
    pub(super) quality: f64,
    /// Tangent of the angle of incidence, around and along: by so much the picture on the wall moves per height.
    pub(super) slant: Vector2<f64>,
}

/// Photos with an adjusted pose that looks at the wall; others cannot measure it.
pub(super) fn shots<'a>(survey: &'a Survey, reconstruction: &Reconstruction, profile: &Profile<f64>) -> Vec<Shot<'a>> {
    let adjusted = reconstruction.poses.iter().filter(|pose| pose.status == PoseStatus::Adjusted);
    adjusted
        .filter_map(|pose| {
            let photo = survey.photos.iter().find(|photo| photo.name == pose.photo)?;
            let view = View::new(reconstruction.camera, &pose.tunnel_from_cam, 1.0);
            let footprint = view.footprint(profile)?;
            Some(Shot { photo, view, footprint })
        })
        .collect()
}

impl Shot<'_> {
    /// Decodes the photo, halved `halvings` times, and its mask.
    pub(super) fn pixels(&self, halvings: u32) -> Result<Pixels, Loss> {
        let camera = &self.view.camera;
        let size = Size { width_px: camera.width_px, height_px: camera.height_px };
        let lost = |why: String| Loss::new(&self.photo.name, format!("not used for the surface: {why}"));
        let grey = decode_luma(&self.photo.path, size).map_err(|error| lost(error.to_string()))?;
        let mask = self.photo.mask.as_ref().map(|path| load_mask(path, size)).transpose();
        let mask = mask.map_err(|error| lost(format!("mask: {error}")))?;
        Ok(Pixels::new(grey, halvings, Usable::new(size.width_px, size.height_px, mask.as_ref())))
    }

    /// How the photo sees a wall point at a height over the profile; `None` if it does not, or too flatly.
    pub(super) fn outlook(&self, wall: &WallPoint, x_m: f64, height_m: f64, profile: &Profile<f64>) -> Option<Outlook> {
        let centre = self.view.centre_in_tunnel();
        let point = wall.point + wall.normal * height_m;
        let to_cam = Vector3::new(centre.x - x_m, centre.y - point.x, centre.z - point.y);
        let section = Vector2::new(to_cam.y, to_cam.z);
        let facing_m = section.dot(&wall.normal);
        let distance_m = to_cam.norm();
        if facing_m < LEAST_INCIDENCE_COS * distance_m {
            return None;
        }
        // Something of a section that is not convex may stand between.
        let origin = Vector2::new(centre.y, centre.z);
        let free = profile.ray_cast(origin, -section).is_none_or(|hit| hit.distance > 0.95);
        free.then(|| Outlook {
            quality: facing_m / (distance_m * distance_m),
            slant: Vector2::new(section.dot(&wall.tangent), to_cam.x) / facing_m,
        })
    }

    /// Pixel of a wall point and how it moves per metre of height.
    pub(super) fn look(&self, wall: &WallPoint, x_m: f64, height_m: f64) -> Option<[f32; 4]> {
        let view = &self.view;
        let in_cam = view.section_in_cam(wall.point + wall.normal * height_m) + view.forward_in_cam() * x_m;
        let inwards = view.turned_into_cam(&Vector3::new(0.0, wall.normal.x, wall.normal.y));
        let (pixel, pixel_from_cam) = view.camera.project_with_jacobian(&in_cam)?;
        let moved = pixel_from_cam * inwards;
        Some([pixel.x as f32, pixel.y as f32, moved.x as f32, moved.y as f32])
    }
}

impl Pixels {
    pub(super) fn new(grey: Raster<u8, 1>, halvings: u32, usable: Usable) -> Self {
        let mut fine = Plane { width: grey.width, height: grey.height, scale: 1.0, data: grey.data };
        for _ in 0..halvings {
            fine = fine.halved();
        }
        let coarse = fine.halved();
        Self { levels: [fine, coarse], usable }
    }

    pub(super) fn level(&self, level: usize) -> &Plane {
        &self.levels[level]
    }

    pub(super) fn bytes(&self) -> usize {
        self.levels.iter().map(|plane| plane.data.len()).sum()
    }
}

impl Plane {
    fn halved(&self) -> Self {
        let (width, height) = (self.width / 2, self.height / 2);
        let mut data = Vec::with_capacity(width * height);
        for row in 0..height {
            let line = |row: usize| self.data[row * self.width..][..2 * width].as_chunks::<2>().0;
            let sum = |pair: &[u8; 2]| u16::from(pair[0]) + u16::from(pair[1]);
            let lines = line(2 * row).iter().zip(line(2 * row + 1));
            data.extend(lines.map(|(upper, lower)| ((sum(upper) + sum(lower) + 2) / 4) as u8));
        }
        Self { width, height, scale: self.scale * 2.0, data }
    }

    /// Bilinear grey value less 128 at a pixel position of the full photo; the border is repeated outside.
    #[inline]
    pub(super) fn sample(&self, u_px: f32, v_px: f32) -> f32 {
        let x = (u_px / self.scale - 0.5).clamp(0.0, self.width as f32 - 1.001);
        let y = (v_px / self.scale - 0.5).clamp(0.0, self.height as f32 - 1.001);
        let (column, row) = (x as usize, y as usize);
        let (right, down) = (x - column as f32, y - row as f32);
        let at = row * self.width + column;
        let upper = &self.data[at..at + 2];
        let lower = &self.data[at + self.width..at + self.width + 2];
        let mix = |pair: &[u8]| f32::from(pair[0]) + right * (f32::from(pair[1]) - f32::from(pair[0]));
        let top = mix(upper);
        top + down * (mix(lower) - top) - 128.0
    }
}
