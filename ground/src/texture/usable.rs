//! Which part of a photo may be used: inside the border and away from what its mask blackens.

use std::f32::consts::SQRT_2;

use crate::raster::Mask;

/// Photo pixels along the side of a cell of the distance map.
const CELL_PX: usize = 4;
/// Clearance of what is not masked itself but within a cell of what is: least preferred, for JPEG blocks smear what is masked
/// over its edge, but used where no other photo shows the place.
const BESIDE_MASK_PX: f32 = 0.5;
/// The farthest distance that is told apart.
const FARTHEST_PX: f32 = 250.0;

/// The usable part of a photo.
pub(crate) struct Usable {
    width_px: f32,
    height_px: f32,
    masked: Option<Masked>,
}

/// Which pixels are masked, and how far it is to them.
pub(super) struct Masked {
    /// Pixels in a row.
    width: usize,
    /// A bit per pixel, row by row; 1 = masked.
    bits: Vec<u64>,
    distance: MaskDistance,
}

/// Distance to the nearest masked pixel, in pixels, per cell of [`CELL_PX`] pixels.
struct MaskDistance {
    columns: usize,
    rows: usize,
    distance_px: Vec<u8>,
}

impl Usable {
    /// Prepares the lookup. `mask`: 0 = do not use.
    pub(crate) fn new(width_px: u32, height_px: u32, mask: Option<&Mask>) -> Self {
        let masked = mask.filter(|mask| mask.data.contains(&0)).map(Masked::new);
        Self { width_px: width_px as f32, height_px: height_px as f32, masked }
    }

    /// Distance from a pixel position to the nearest place that must not be used; not positive if it lies there.
    pub(crate) fn clearance_px(&self, u_px: f32, v_px: f32) -> f32 {
        let border = u_px.min(v_px).min(self.width_px - u_px).min(self.height_px - v_px).min(FARTHEST_PX);
        match &self.masked {
            Some(masked) if border > 0.0 => border.min(masked.clearance_px(u_px, v_px)),
            _ => border,
        }
    }

    /// What is masked; `None` if nothing is.
    pub(super) fn masked(&self) -> Option<&Masked> {
        self.masked.as_ref()
    }
}

impl Masked {
    fn new(mask: &Mask) -> Self {
        let mut bits = vec![0; mask.data.len().div_ceil(64)];
        for (at, _) in mask.data.iter().enumerate().filter(|(_, sample)| **sample == 0) {
            bits[at / 64] |= 1 << (at % 64);
        }
        Self { width: mask.width, bits, distance: MaskDistance::new(mask) }
    }

    /// Tells for every pixel, row by row, whether it may be used.
    pub(super) fn usable_pixels(&self, pixels: usize) -> Vec<bool> {
        (0..pixels).map(|at| !self.holds(at)).collect()
    }

    fn holds(&self, at: usize) -> bool {
        self.bits[at / 64] >> (at % 64) & 1 == 1
    }

    fn clearance_px(&self, u_px: f32, v_px: f32) -> f32 {
        let distance_px = self.distance.at(u_px, v_px);
        if distance_px > 0.0 {
            distance_px
        } else if self.holds(v_px as usize * self.width + u_px as usize) {
            0.0
        } else {
            BESIDE_MASK_PX
        }
    }
}

impl MaskDistance {
    /// Two-pass chamfer distance (weights 1 and sqrt 2), accurate to about 8 %.
    fn new(mask: &Mask) -> Self {
        let (columns, rows) = (mask.width.div_ceil(CELL_PX), mask.height.div_ceil(CELL_PX));
        let mut distance = vec![f32::INFINITY; columns * rows];
        for (row, line) in mask.data.chunks_exact(mask.width).enumerate() {
            for (column, &sample) in line.iter().enumerate() {
                if sample == 0 {
                    distance[row / CELL_PX * columns + column / CELL_PX] = 0.0;
                }
            }
        }
        for row in 0..rows {
            for column in 0..columns {
                relax(&mut distance, columns, column, row, -1);
            }
        }
        for row in (0..rows).rev() {
            for column in (0..columns).rev() {
                relax(&mut distance, columns, column, row, 1);
            }
        }
        let distance_px = distance.into_iter().map(|cells| (cells * CELL_PX as f32).min(FARTHEST_PX) as u8).collect();
        Self { columns, rows, distance_px }
    }

    fn at(&self, u_px: f32, v_px: f32) -> f32 {
        let column = ((u_px / CELL_PX as f32) as usize).min(self.columns - 1);
        let row = ((v_px / CELL_PX as f32) as usize).min(self.rows - 1);
        f32::from(self.distance_px[row * self.columns + column])
    }
}

/// Lowers a cell's distance by its four neighbours on the side of `direction` (-1: before it in reading order).
fn relax(distance: &mut [f32], columns: usize, column: usize, row: usize, direction: i64) {
    let rows = distance.len() / columns;
    let mut best = distance[row * columns + column];
    let steps = [(direction, 0, 1.0), (-1, direction, SQRT_2), (0, direction, 1.0), (1, direction, SQRT_2)];
    for (across, down, cost) in steps {
        let (c, r) = (column as i64 + across, row as i64 + down);
        if c >= 0 && r >= 0 && c < columns as i64 && r < rows as i64 {
            best = best.min(distance[r as usize * columns + c as usize] + cost);
        }
    }
    distance[row * columns + column] = best;
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::raster::Raster;

    #[test]
    fn clearance_counts_from_the_border_without_a_mask() {
        let usable = Usable::new(100, 80, None);
        assert!((usable.clearance_px(10.0, 40.0) - 10.0).abs() < 1e-6);
        assert!(usable.clearance_px(-1.0, 40.0) < 0.0);
        assert!(usable.clearance_px(50.0, 80.1) < 0.0);
    }

    #[test]
    fn clearance_counts_from_masked_pixels() {
        let mut mask: Mask = Raster { width: 200, height: 100, data: vec![255; 200 * 100] };
        for row in 0..100 {
            for column in 121..200 {
                mask.set(column, row, [0]);
            }
        }
        let usable = Usable::new(200, 100, Some(&mask));
        assert!(usable.clearance_px(140.0, 50.0) <= 0.0);
        assert!(usable.clearance_px(121.0, 50.0) <= 0.0);
        let beside_px = usable.clearance_px(120.9, 50.0);
        assert!(beside_px > 0.0 && beside_px < 1.0, "{beside_px}");
        assert!(usable.clearance_px(119.0, 50.0) <= 4.0);
        assert!((usable.clearance_px(80.0, 50.0) - 40.0).abs() < 5.0);
    }
}
