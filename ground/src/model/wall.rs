//! What every model is made from: the panorama's tiles and the measured wall that they lie on.

use std::path::Path;

use crate::surface::SurfaceStore;
use crate::texture::{PanoramaGrid, TileReader};

/// The unrolled wall with its colours.
#[derive(Debug)]
pub struct TexturedWall {
    /// The wall.
    pub surface: SurfaceStore,
    /// Where the panorama's pixels lie.
    pub grid: PanoramaGrid,
    /// The panorama's pixels.
    pub reader: TileReader,
}

impl TexturedWall {
    /// Hangs the panorama below `out` on the wall. Tiles are looked for when they are read.
    pub fn new(surface: SurfaceStore, grid: &PanoramaGrid, out: &Path) -> Self {
        let reader = TileReader::new(&out.join("panorama/tiles"), grid.width_px, grid.height_px);
        Self { surface, grid: *grid, reader }
    }

    /// The coarsest level of the pyramid whose pixels are not larger than `mm_per_px`; the finest if none is that fine.
    pub fn level(&self, mm_per_px: f64) -> u32 {
        // A pixel larger by rounding only is not larger.
        let halvings = (mm_per_px / self.grid.mm_per_px * (1.0 + 1e-6)).log2().floor();
        self.reader.last_level() - halvings.clamp(0.0, f64::from(self.reader.last_level())) as u32
    }

    /// Size of a level's pixels on the wall.
    pub fn mm_per_px(&self, level: u32) -> f64 {
        self.grid.mm_per_px * self.scale(level)
    }

    /// Pixels of the panorama along the side of a level's pixel.
    pub(super) fn scale(&self, level: u32) -> f64 {
        f64::from(self.reader.last_level() - level).exp2()
    }
}

#[cfg(test)]
mod tests {
    use adit_geometry::profile::ProfileSpec;

    use super::*;

    #[test]
    fn the_level_is_the_coarsest_that_is_fine_enough() {
        let spec = ProfileSpec::Circle { radius_m: 0.5 };
        let grid = PanoramaGrid::new(std::f64::consts::PI, 2.0, 0.0, 1.0);
        let wall = TexturedWall::new(SurfaceStore::flat(&spec).unwrap(), &grid, Path::new("nowhere"));
        let mm_per_px = |asked| wall.mm_per_px(wall.level(asked)) / grid.mm_per_px;
        let found = [0.5, 2.0, 3.9, 4.0, 5.0, 8.1, 1e9].map(mm_per_px);
        assert_eq!(found[..6], [1.0, 1.0, 1.0, 2.0, 2.0, 4.0]);
        assert_eq!(wall.level(1e9), 0);
    }
}
