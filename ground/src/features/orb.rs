//! The ORB-class detector: corners on a pyramid with binary descriptors.

use rayon::prelude::*;

use super::brief::{BLUR_PX, Pattern, RADIUS, centroid_angle_rad};
use super::fast::corners;
use super::integral::Usable;
use super::scale_space::blurred;
use super::spread::spread;
use super::{BriefDescriptor, Features, Keypoint, Orientation};
use crate::raster::{Grey, Mask, Raster};

/// What to look for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OrbOptions {
    /// Whether descriptors turn with the picture.
    pub orientation: Orientation,
    /// Least contrast of a corner, grey levels.
    pub contrast: u8,
    /// Levels of the pyramid.
    pub levels: usize,
    /// Ratio of the sizes of successive levels.
    pub level_ratio: f64,
    /// Most features; the best of each part of the photo are kept.
    pub most: usize,
}

impl Default for OrbOptions {
    /// The literature's pyramid; faint corners allowed, for concrete; upright.
    fn default() -> Self {
        Self { orientation: Orientation::Upright, contrast: 4, levels: 8, level_ratio: 1.2, most: 6000 }
    }
}

/// A level of the pyramid.
struct Level {
    image: Grey,
    blurred: Grey,
    /// Pixels of the photo per pixel of the level.
    step_px: f64,
}

/// Finds and describes the features of a photo (grey values 0 to 255).
///
/// None whose descriptor would touch a masked pixel or leave the photo. The result does not depend on the number of
/// threads.
pub fn orb(photo: &Grey, mask: Option<&Mask>, options: &OrbOptions) -> Features<BriefDescriptor> {
    let usable = Usable::new(photo.width, photo.height, mask);
    let levels = pyramid(photo, options);
    let mut keypoints = Vec::new();
    for level in &levels {
        let bytes = level.image.data.iter().map(|value| value.round() as u8).collect();
        let image = Raster { width: level.image.width, height: level.image.height, data: bytes };
        // The blur's own reach belongs to the support.
        let support_px = (RADIUS as f64 + f64::from(4.0 * BLUR_PX) + 1.0) * level.step_px;
        let keypoint = |column: usize, row: usize, score: u8| Keypoint {
            pixel: [column, row].map(|at| (at as f64 + 0.5) * level.step_px),
            scale_px: level.step_px as f32,
            angle_rad: 0.0,
            response: f32::from(score),
        };
        let found = corners(&image, options.contrast);
        let clear = found.iter().map(|corner| keypoint(corner.column, corner.row, corner.score));
        keypoints.extend(clear.filter(|keypoint| usable.is_clear(keypoint.pixel, support_px)));
    }
    let keypoints = spread(keypoints, options.most, photo.width, photo.height);
    let pattern = Pattern::new(options.orientation);
    let described = keypoints.into_par_iter().map(|keypoint| {
        let level = levels.iter().find(|level| level.step_px as f32 == keypoint.scale_px).unwrap_or(&levels[0]);
        let [column, row] = keypoint.pixel.map(|at| (at / level.step_px - 0.5).round() as usize);
        let angle_rad = match options.orientation {
            Orientation::Upright => 0.0,
            Orientation::Free => centroid_angle_rad(&level.image, column, row),
        };
        (Keypoint { angle_rad, ..keypoint }, pattern.describe(&level.blurred, column, row, angle_rad))
    });
    let (keypoints, descriptors) = described.unzip();
    Features { keypoints, descriptors }
}

fn pyramid(photo: &Grey, options: &OrbOptions) -> Vec<Level> {
    let mut levels: Vec<Level> = Vec::new();
    for number in 0..options.levels.max(1) {
        let step_px = options.level_ratio.powi(number as i32);
        let size = [photo.width, photo.height].map(|size| (size as f64 / step_px) as usize);
        if size.iter().any(|&size| size < 4 * RADIUS as usize) {
            break;
        }
        let image =
            levels.last().map_or_else(|| photo.clone(), |finer| shrunk(&finer.image, size, step_px / finer.step_px));
        levels.push(Level { blurred: blurred(&image, BLUR_PX), image, step_px });
    }
    levels
}

/// Bilinear samples every `ratio` pixels, at least 1 and less than 2.
fn shrunk(image: &Grey, [width, height]: [usize; 2], ratio: f64) -> Grey {
    let source = |at: usize, size: usize| {
        let place = ((at as f64 + 0.5) * ratio - 0.5).clamp(0.0, size as f64 - 1.0);
        let first = (place as usize).min(size - 2);
        (first, (place - first as f64) as f32)
    };
    let columns: Vec<(usize, f32)> = (0..width).map(|column| source(column, image.width)).collect();
    let mut out = Grey::new(width, height);
    out.data.par_chunks_exact_mut(width).enumerate().for_each(|(row, line)| {
        let (first, down) = source(row, image.height);
        let above = &image.data[first * image.width..][..image.width];
        let below = &image.data[(first + 1) * image.width..][..image.width];
        for (value, &(column, across)) in line.iter_mut().zip(&columns) {
            let mix = |line: &[f32]| line[column] + across * (line[column + 1] - line[column]);
            *value = mix(above) + down * (mix(below) - mix(above));
        }
    });
    out
}
