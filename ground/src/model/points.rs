//! The wall as dense points, row by row along the tunnel: the one source of PLY, LAZ and E57.

use adit_geometry::SectionVector;

use super::error::ModelError;
use super::wall::TexturedWall;
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
}

/// The points of one level of the panorama: one per pixel that a photo saw.
#[derive(Debug)]
pub struct PointSource<'a> {
    wall: &'a TexturedWall,
    level: u32,
    columns: Vec<Column>,
}

/// One place around the wall, `[y, z]`.
#[derive(Debug)]
struct Column {
    point: SectionVector<f64>,
    normal: SectionVector<f64>,
}

impl<'a> PointSource<'a> {
    /// Takes the level whose pixels are nearest to `step_m`.
    pub fn new(wall: &'a TexturedWall, step_m: f64) -> Self {
        // sqrt(2) above: from there on, twice the pixel is nearer (as a ratio).
        let level = wall.level(step_m * 1000.0 * std::f64::consts::SQRT_2);
        let (width, _) = wall.reader.size(level);
        let scale = wall.scale(level);
        let at = |column: usize| {
            let s_m = wall.grid.s_m(((column as f64 + 0.5) * scale).min(wall.grid.width_px as f64 - 0.5));
            wall.profile.at(s_m).map(|surface| Column { point: surface.point, normal: surface.normal })
        };
        let columns = (0..width).filter_map(at).collect();
        Self { wall, level, columns }
    }

    /// Distance between neighbours.
    pub fn step_m(&self) -> f64 {
        self.wall.mm_per_px(self.level) / 1000.0
    }

    /// Corners of a box around all points, tunnel frame, metres.
    pub fn bounds_m(&self) -> ([f64; 3], [f64; 3]) {
        let (low, high) = self.wall.profile.bounds();
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
        let TexturedWall { grid, reader, .. } = self.wall;
        let (width, height) = reader.size(self.level);
        let scale = self.wall.scale(self.level);
        let mut count = 0;
        let mut points = Vec::with_capacity(width);
        for first in (0..height).step_by(TILE_PX) {
            let rows = TILE_PX.min(height - first);
            let band = reader
                .read(self.level, PixelBox { column: 0, row: first, width, height: rows })
                .map_err(ModelError::from)?;
            for (row, pixels) in band.data.chunks_exact(width * 4).enumerate() {
                let v = ((first + row) as f64 + 0.5) * scale;
                let x_m = grid.x_m(v.min(grid.height_px as f64 - 0.5));
                points.clear();
                for (column, pixel) in self.columns.iter().zip(pixels.chunks_exact(4)) {
                    if let &[red, green, blue, opacity] = pixel
                        && opacity >= 128
                    {
                        points.push(DensePoint {
                            position_m: [x_m, column.point.x, column.point.y],
                            normal: [0.0, column.normal.x as f32, column.normal.y as f32],
                            colour: [red, green, blue],
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
