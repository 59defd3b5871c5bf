//! Viewing directions of the pixel corners, unprojected once per camera.

use adit_geometry::camera::Camera;
use nalgebra::{Vector2, Vector3};
use rayon::prelude::*;

/// Unit viewing directions in the `cam` frame at the integer pixel positions (column, row), `0..=width`, `0..=height`.
///
/// Pixel (i, j) lies between the corners (i, j) and (i + 1, j + 1); its centre is at (i + 0.5, j + 0.5).
/// Single precision: 1e-7 rad, 0.3 micrometres on a wall at 3 m.
pub(super) struct CornerRays {
    columns: usize,
    directions: Vec<[f32; 3]>,
}

impl CornerRays {
    pub(super) fn new(camera: &Camera<f64>) -> Self {
        let columns = camera.width_px as usize + 1;
        let rows = camera.height_px as usize + 1;
        let directions = (0..rows * columns)
            .into_par_iter()
            .map(|index| {
                let pixel = Vector2::new((index % columns) as f64, (index / columns) as f64);
                match camera.unproject(&pixel) {
                    Some(direction) => direction.normalize().map(|part| part as f32).into(),
                    None => [f32::NAN; 3],
                }
            })
            .collect();
        Self { columns, directions }
    }

    /// Direction at a corner; `None` where the lens model has none. Panics outside the image.
    pub(super) fn at(&self, column: usize, row: usize) -> Option<Vector3<f64>> {
        let direction = self.directions[row * self.columns + column];
        direction[0].is_finite().then(|| Vector3::from(direction.map(f64::from)))
    }

    /// Direction within pixel (column, row) at the share (u, v) of its width and height.
    ///
    /// Bilinear: lens models are smooth, so the error is below 1e-4 px.
    pub(super) fn within(&self, column: usize, row: usize, u: f64, v: f64) -> Option<Vector3<f64>> {
        let (a, b) = (self.at(column, row)?, self.at(column + 1, row)?);
        let (c, d) = (self.at(column, row + 1)?, self.at(column + 1, row + 1)?);
        Some(a.lerp(&b, u).lerp(&c.lerp(&d, u), v))
    }
}
