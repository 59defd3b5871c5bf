//! An unrolled wall at a chosen resolution, read band by band from its deep-zoom tiles.

use std::path::Path;

use adit_geometry::profile::Profile;

use super::error::ChangeError;
use crate::surface::SurfaceStore;
use crate::texture::{Panorama, PixelBox, TileReader};

/// Weights of red, green and blue in a grey value (ITU-R BT.601).
const LUMA: [f32; 3] = [0.299, 0.587, 0.114];

/// One survey's wall.
pub(super) struct Wall {
    pub(super) profile: Profile<f64>,
    pub(super) perimeter_m: f64,
    /// Along the axis, metres.
    pub(super) extent_m: [f64; 2],
    /// Its heights; absent where photos were not matched.
    pub(super) surface: Option<SurfaceStore>,
    reader: TileReader,
    s0_m: f64,
    texel_m: f64,
}

/// Rows of a wall in memory, once around.
#[derive(Clone, Debug)]
pub(super) struct Band {
    columns: usize,
    rows: usize,
    step_m: f64,
    s0_m: f64,
    /// Upper edge of the first row.
    x0_m: f64,
    perimeter_m: f64,
    /// NaN where no photo saw the wall.
    grey: Vec<f32>,
}

impl Wall {
    pub(super) fn open(out: &Path) -> Result<Self, ChangeError> {
        let Panorama { grid, profile, .. } = Panorama::open(out)?;
        let reader = TileReader::new(&out.join("panorama/tiles"), grid.width_px, grid.height_px);
        let extent_m = [grid.x0_m, grid.x_m(grid.height_px as f64)];
        let perimeter_m = profile.perimeter_m();
        let measured = out.join("surface/surface.json").is_file();
        let surface = measured.then(|| SurfaceStore::open(out)).transpose()?;
        Ok(Self { profile, perimeter_m, extent_m, surface, reader, s0_m: grid.s0_m, texel_m: grid.texel_m() })
    }

    /// Texel of the finest level that is not finer than `step_m`, or of the full resolution where that is coarser.
    pub(super) fn step_m(&self, step_m: f64) -> f64 {
        self.texel_m * f64::from(self.halvings(step_m)).exp2()
    }

    fn halvings(&self, step_m: f64) -> u32 {
        let halvings = (step_m / self.texel_m).log2().floor().max(0.0) as u32;
        halvings.min(self.reader.last_level())
    }

    /// The rows that hold `[x0_m, x1_m]` and one more on either side, as far as there are any, at about `step_m`.
    pub(super) fn band(&self, x_m: [f64; 2], step_m: f64) -> Result<Band, ChangeError> {
        let level = self.reader.last_level() - self.halvings(step_m);
        let step_m = self.step_m(step_m);
        let (width, height) = self.reader.size(level);
        let row = |x_m: f64| ((x_m - self.extent_m[0]) / step_m).clamp(0.0, height as f64);
        let first = (row(x_m[0]).floor() as usize).saturating_sub(1);
        let last = (row(x_m[1]).ceil() as usize + 1).min(height).max(first);
        let area = PixelBox { column: 0, row: first, width, height: last - first };
        let picture = self.reader.read(level, area)?;
        let grey = picture.data.chunks_exact(4).map(|pixel| match pixel {
            [r, g, b, 255] => [r, g, b].iter().zip(LUMA).map(|(value, weight)| f32::from(**value) * weight).sum(),
            _ => f32::NAN,
        });
        Ok(Band {
            columns: width,
            rows: last - first,
            step_m,
            s0_m: self.s0_m,
            x0_m: self.extent_m[0] + first as f64 * step_m,
            perimeter_m: self.perimeter_m,
            grey: grey.collect(),
        })
    }
}

impl Band {
    /// Bilinear grey value at a place of the wall, around the seam; NaN where one of the four texels is not seen.
    pub(super) fn sample(&self, s_m: f64, x_m: f64) -> f32 {
        let column = (s_m - self.s0_m).rem_euclid(self.perimeter_m) / self.step_m - 0.5;
        let row = (x_m - self.x0_m) / self.step_m - 0.5;
        if row < 0.0 || row >= self.rows as f64 - 1.0 {
            return f32::NAN;
        }
        let (column0, row0) = (column.floor(), row.floor());
        let (right, below) = ((column - column0) as f32, (row - row0) as f32);
        let wrap = |column: f64| (column.rem_euclid(self.columns as f64) as usize).min(self.columns - 1);
        let (left_column, right_column, row0) = (wrap(column0), wrap(column0 + 1.0), row0 as usize);
        let line = |row: usize| {
            let row = &self.grey[row * self.columns..(row + 1) * self.columns];
            row[left_column] * (1.0 - right) + row[right_column] * right
        };
        line(row0) * (1.0 - below) + line(row0 + 1) * below
    }
}
