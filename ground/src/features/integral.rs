//! Which parts of a photo may carry features.

use crate::raster::Mask;

/// Counts masked pixels of any box in constant time.
pub(super) struct Usable {
    width: usize,
    height: usize,
    /// Masked pixels left of and above each pixel corner, `(width + 1) * (height + 1)`; empty without a mask.
    sums: Vec<u32>,
}

impl Usable {
    /// Prepares a photo of `width` x `height` pixels.
    pub(super) fn new(width: usize, height: usize, mask: Option<&Mask>) -> Self {
        let Some(mask) = mask else { return Self { width, height, sums: Vec::new() } };
        let stride = width + 1;
        let mut sums = vec![0; stride * (height + 1)];
        for (row, line) in mask.data.chunks_exact(width).enumerate() {
            let mut before = 0;
            for (column, &value) in line.iter().enumerate() {
                before += u32::from(value == 0);
                sums[(row + 1) * stride + column + 1] = sums[row * stride + column + 1] + before;
            }
        }
        Self { width, height, sums }
    }

    /// Tells whether the square of half-side `half_px` around `pixel` lies in the photo and touches no masked pixel.
    pub(super) fn is_clear(&self, pixel: [f64; 2], half_px: f64) -> bool {
        let low = pixel.map(|at| (at - half_px).floor());
        let high = pixel.map(|at| (at + half_px).ceil());
        let inside = low[0] >= 0.0 && low[1] >= 0.0 && high[0] <= self.width as f64 && high[1] <= self.height as f64;
        if !inside || self.sums.is_empty() {
            return inside;
        }
        let [left, top] = low.map(|at| at as usize);
        let [right, bottom] = high.map(|at| at as usize);
        let sum = |column: usize, row: usize| self.sums[row * (self.width + 1) + column];
        sum(right, bottom) + sum(left, top) == sum(left, bottom) + sum(right, top)
    }
}
