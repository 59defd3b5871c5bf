//! The wall as dense points, row by row along the tunnel: the one source of PLY, LAZ and E57.

use super::error::ModelError;
use super::wall::TexturedWall;
use crate::surface::WallPlace;
use crate::texture::{PixelBox, TILE_PX};

/// A point of the wall.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DensePoint {
    /// Tunnel frame (x forward, y right, z down), metres.
    pub position_m: [f64; 3],
    /// Unit vector inwards, tunnel frame.
    pub normal: [f32; 3],
    /// Red, green, blue.
    pub colour: [u8; 3],
    /// How well the wall's height is known there, 0 (not measured) to 1.
    pub confidence: f32,
}

/// The points of one level of the panorama: one per pixel that a photo saw.
#[derive(Debug)]
pub struct PointSource<'a> {
    wall: &'a TexturedWall,
    level: u32,
    /// Arc length of every column.
    columns_s_m: Vec<f64>,
}

impl<'a> PointSource<'a> {
    /// Takes the level whose pixels are nearest to `step_m`.
    pub fn new(wall: &'a TexturedWall, step_m: f64) -> Self {
        // sqrt(2) above: from there on, twice the pixel is nearer (as a ratio).
        let level = wall.level(step_m * 1000.0 * std::f64::consts::SQRT_2);
        let (width, _) = wall.reader.size(level);
        let scale = wall.scale(level);
        let s_m = |column: usize| wall.grid.s_m(((column as f64 + 0.5) * scale).min(wall.grid.width_px as f64 - 0.5));
        Self { wall, level, columns_s_m: (0..width).map(s_m).collect() }
    }

    /// Distance between neighbours.
    pub fn step_m(&self) -> f64 {
        self.wall.mm_per_px(self.level) / 1000.0
    }

    /// Corners of a box around the section along the panorama, tunnel frame, metres.
    pub fn bounds_m(&self) -> ([f64; 3], [f64; 3]) {
        let (low, high) = self.wall.surface.profile().bounds();
        let grid = &self.wall.grid;
        ([grid.x_m(0.0), low.x, low.y], [grid.x_m(grid.height_px as f64), high.x, high.y])
    }

    /// Bands of rows that [`Self::stream`] reads, one tick each.
    pub fn bands(&self) -> usize {
        self.wall.reader.size(self.level).1.div_ceil(TILE_PX)
    }

    /// Hands the points to `sink`, a row at a time; returns how many there are. Memory holds one band of tiles.
    ///
    /// # Errors
    /// If a tile cannot be read, or what `sink` says.
    pub fn stream<E: From<ModelError>>(
        &self,
        tick: &dyn Fn(),
        mut sink: impl FnMut(&[DensePoint]) -> Result<(), E>,
    ) -> Result<u64, E> {
        let TexturedWall { surface, grid, reader } = self.wall;
        let (width, height) = reader.size(self.level);
        let scale = self.wall.scale(self.level);
        let x_m = |row: usize| grid.x_m(((row as f64 + 0.5) * scale).min(grid.height_px as f64 - 0.5));
        let mut count = 0;
        let mut points = Vec::with_capacity(width);
        for first in (0..height).step_by(TILE_PX) {
            let rows = TILE_PX.min(height - first);
            let band = reader
                .read(self.level, PixelBox { column: 0, row: first, width, height: rows })
                .map_err(ModelError::from)?;
            let window = surface.window([x_m(first), x_m(first + rows - 1)]).map_err(ModelError::from)?;
            for (row, pixels) in band.data.chunks_exact(width * 4).enumerate() {
                let x_m = x_m(first + row);
                points.clear();
                for (&s_m, pixel) in self.columns_s_m.iter().zip(pixels.chunks_exact(4)) {
                    if let &[red, green, blue, opacity] = pixel
                        && opacity >= 128
                    {
                        let WallPlace { position, normal } = window.point(s_m, x_m);
                        points.push(DensePoint {
                            position_m: position.into(),
                            normal: normal.map(|component| component as f32).into(),
                            colour: [red, green, blue],
                            confidence: window.confidence(s_m, x_m) as f32,
                        });
                    }
                }
                count += points.len() as u64;
                sink(&points)?;
            }
            tick();
        }
        Ok(count)
    }
}
