//! Pixel grids in memory.

/// A row-major grid of samples, `CHANNELS` per pixel.
#[derive(Clone, Debug, PartialEq)]
pub struct Raster<S, const CHANNELS: usize> {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// `height * width * CHANNELS` samples.
    pub data: Vec<S>,
}

/// Grey image, 0..=255 as floating point.
pub type Grey = Raster<f32, 1>;
/// 8-bit grey image.
pub type Luma = Raster<u8, 1>;
/// 8-bit RGB image.
pub type Rgb8 = Raster<u8, 3>;
/// Mask: 0 = ignore, 255 = use.
pub type Mask = Raster<u8, 1>;

impl<S: Copy + Default, const CHANNELS: usize> Raster<S, CHANNELS> {
    /// Returns a raster of default samples.
    pub fn new(width: usize, height: usize) -> Self {
        Self { width, height, data: vec![S::default(); width * height * CHANNELS] }
    }

    /// Returns the samples of pixel (column, row). Panics outside.
    pub fn at(&self, column: usize, row: usize) -> [S; CHANNELS] {
        let start = (row * self.width + column) * CHANNELS;
        std::array::from_fn(|channel| self.data[start + channel])
    }

    /// Sets the samples of pixel (column, row). Panics outside.
    pub fn set(&mut self, column: usize, row: usize, samples: [S; CHANNELS]) {
        let start = (row * self.width + column) * CHANNELS;
        self.data[start..start + CHANNELS].copy_from_slice(&samples);
    }
}
