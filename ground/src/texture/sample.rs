//! Sampling a photo: bicubic between pixels, a pyramid of halved photos where texels are coarser than pixels.

use super::usable::Masked;
use crate::raster::Rgb8;

/// No level smaller than this on its short side.
const SMALLEST_LEVEL_PX: usize = 16;

/// Anti-aliasing starts this much later (in octaves) than the sampling theorem asks: crisper, and bicubic hides it.
const SHARPNESS_OCTAVES: f32 = 0.25;

/// A photo and its halved copies.
pub(super) struct Mips {
    levels: Vec<Level>,
}

/// RGB, three bytes per pixel and one more at the end, so that four bytes can be read at any pixel.
struct Level {
    /// First column and row that are held, in pixels of this level.
    origin: [usize; 2],
    width: usize,
    height: usize,
    data: Vec<u8>,
}

impl Mips {
    /// Builds the pyramid; what is masked takes the colours around it, so that none of it gets into a sample beside it.
    ///
    /// # Method
    /// Masked pixels have no part in the halved copies; from the coarsest down they take their colours from there. Gortler et
    /// al., "The Lumigraph", SIGGRAPH 1996 (pull-push).
    pub(super) fn masked(photo: Rgb8, masked: &Masked) -> Self {
        let mut known = vec![masked.usable_pixels(photo.width * photo.height)];
        let mut mips = Self::new(photo);
        for octave in 1..mips.levels.len() {
            let (finer, coarser) = mips.levels.split_at_mut(octave);
            known.push(coarser[0].average_known(&finer[octave - 1], &known[octave - 1]));
        }
        if let (Some(coarsest), Some(known)) = (mips.levels.last_mut(), known.last()) {
            coarsest.fill_with_mean(known);
        }
        for octave in (1..mips.levels.len()).rev() {
            let (finer, coarser) = mips.levels.split_at_mut(octave);
            finer[octave - 1].fill_unknown(&known[octave - 1], &coarser[0]);
        }
        mips
    }

    /// Builds the pyramid.
    pub(super) fn new(photo: Rgb8) -> Self {
        let mut data = photo.data;
        data.push(0);
        let mut levels = vec![Level { origin: [0, 0], width: photo.width, height: photo.height, data }];
        while let Some(last) = levels.last()
            && last.width.min(last.height) >= SMALLEST_LEVEL_PX * 2
        {
            levels.push(last.halved());
        }
        Self { levels }
    }

    /// Returns what is needed to sample between `from` and `to` (column and row, in pixels of the full photo).
    pub(super) fn cropped(&self, from_px: [f32; 2], to_px: [f32; 2]) -> Self {
        let levels = self.levels.iter().enumerate();
        Self { levels: levels.map(|(octave, level)| level.cropped(octave, from_px, to_px)).collect() }
    }

    /// Bytes in memory.
    pub(super) fn bytes(&self) -> usize {
        self.levels.iter().map(|level| level.data.len()).sum()
    }

    /// Returns the colour (0..=255; the fourth number means nothing) at a pixel position of the full photo.
    ///
    /// `octaves`: base-2 logarithm of the texel's size in photo pixels; above zero the photo is averaged.
    pub(super) fn sample(&self, u_px: f32, v_px: f32, octaves: f32) -> [f32; 4] {
        let last = self.levels.len() - 1;
        let octaves = (octaves - SHARPNESS_OCTAVES).clamp(0.0, last as f32);
        let lower = octaves as usize;
        let share = octaves - lower as f32;
        let fine = self.level_sample(lower, u_px, v_px);
        if share < 0.02 || lower == last {
            return fine;
        }
        let coarse = self.level_sample(lower + 1, u_px, v_px);
        std::array::from_fn(|i| fine[i] + share * (coarse[i] - fine[i]))
    }

    fn level_sample(&self, level: usize, u_px: f32, v_px: f32) -> [f32; 4] {
        let scale = 1.0 / (1_u32 << level) as f32;
        let level = &self.levels[level];
        let [column, row] = level.origin.map(|first| first as f32 + 0.5);
        level.bicubic(u_px * scale - column, v_px * scale - row)
    }
}

impl Level {
    fn halved(&self) -> Self {
        let (width, height) = (self.width / 2, self.height / 2);
        let stride = self.width * 3;
        let mut data = Vec::with_capacity(width * height * 3 + 1);
        for row in 0..height {
            let upper = &self.data[2 * row * stride..][..stride];
            let lower = &self.data[(2 * row + 1) * stride..][..stride];
            for (a, b) in upper.chunks_exact(6).zip(lower.chunks_exact(6)) {
                for channel in 0..3 {
                    let sum = u16::from(a[channel])
                        + u16::from(a[channel + 3])
                        + u16::from(b[channel])
                        + u16::from(b[channel + 3]);
                    data.push(((sum + 2) / 4) as u8);
                }
            }
        }
        data.push(0);
        Self { origin: [0, 0], width, height, data }
    }

    /// Averages again where the finer level is known in part, of the known pixels alone; tells what is known then.
    fn average_known(&mut self, finer: &Self, known: &[bool]) -> Vec<bool> {
        let mut known_here = Vec::with_capacity(self.width * self.height);
        for (row, column) in (0..self.height).flat_map(|row| (0..self.width).map(move |column| (row, column))) {
            let first = 2 * row * finer.width + 2 * column;
            let four = [first, first + 1, first + finer.width, first + finer.width + 1];
            let count = four.iter().filter(|&&at| known[at]).count();
            known_here.push(count > 0);
            if (1..4).contains(&count) {
                for channel in 0..3 {
                    let sum = four.iter().filter(|&&at| known[at]).map(|&at| usize::from(finer.data[at * 3 + channel]));
                    let mean = (sum.sum::<usize>() + count / 2) / count;
                    self.data[(row * self.width + column) * 3 + channel] = mean as u8;
                }
            }
        }
        known_here
    }

    /// Gives unknown pixels the mean colour of the known ones.
    fn fill_with_mean(&mut self, known: &[bool]) {
        let count = known.iter().filter(|known| **known).count().max(1);
        for channel in 0..3 {
            let values = known.iter().enumerate().filter(|(_, known)| **known);
            let sum: usize = values.map(|(at, _)| usize::from(self.data[at * 3 + channel])).sum();
            let mean = ((sum + count / 2) / count) as u8;
            for at in (0..known.len()).filter(|&at| !known[at]) {
                self.data[at * 3 + channel] = mean;
            }
        }
    }

    /// Gives unknown pixels the colours of a coarser level.
    fn fill_unknown(&mut self, known: &[bool], coarser: &Self) {
        for at in (0..known.len()).filter(|&at| !known[at]) {
            let (row, column) = (at / self.width / 2, at % self.width / 2);
            let from = (row.min(coarser.height - 1) * coarser.width + column.min(coarser.width - 1)) * 3;
            self.data[at * 3..at * 3 + 3].copy_from_slice(&coarser.data[from..from + 3]);
        }
    }

    fn cropped(&self, octave: usize, from_px: [f32; 2], to_px: [f32; 2]) -> Self {
        let scale = 1.0 / (1_u32 << octave) as f32;
        // Two pixels on each side for the interpolation and one against rounding.
        let first = |at_px: f32, length: usize| ((at_px * scale - 3.0).max(0.0) as usize).min(length - 1);
        let end = |at_px: f32, length: usize| ((at_px * scale + 4.0).max(0.0) as usize).min(length);
        let columns = first(from_px[0], self.width)..end(to_px[0], self.width).max(1);
        let rows = first(from_px[1], self.height)..end(to_px[1], self.height).max(1);
        let mut data = Vec::with_capacity(columns.len() * rows.len() * 3 + 1);
        for row in rows.clone() {
            let start = (row * self.width + columns.start) * 3;
            data.extend_from_slice(&self.data[start..start + columns.len() * 3]);
        }
        data.push(0);
        Self { origin: [columns.start, rows.start], width: columns.len(), height: rows.len(), data }
    }

    /// Catmull-Rom interpolation at index position (0 = centre of the first pixel); the border is repeated outside.
    fn bicubic(&self, x: f32, y: f32) -> [f32; 4] {
        let (x_floor, y_floor) = (x.floor(), y.floor());
        let (weights_x, weights_y) = (catmull_rom(x - x_floor), catmull_rom(y - y_floor));
        let (column, row) = (x_floor as i32 - 1, y_floor as i32 - 1);
        let mut sum = [0.0; 4];
        let inside = column >= 0 && row >= 0 && column + 4 <= self.width as i32 && row + 4 <= self.height as i32;
        if inside {
            let start = (row as usize * self.width + column as usize) * 3;
            for (line, weight_y) in weights_y.into_iter().enumerate() {
                let pixels = &self.data[start + line * self.width * 3..][..13];
                let mut across = [0.0; 4];
                for (tap, weight_x) in weights_x.into_iter().enumerate() {
                    for channel in 0..4 {
                        across[channel] += weight_x * f32::from(pixels[tap * 3 + channel]);
                    }
                }
                for channel in 0..4 {
                    sum[channel] += weight_y * across[channel];
                }
            }
        } else {
            for (line, weight_y) in (row..).zip(weights_y) {
                let line = line.clamp(0, self.height as i32 - 1) as usize;
                for (tap, weight_x) in (column..).zip(weights_x) {
                    let tap = tap.clamp(0, self.width as i32 - 1) as usize;
                    let pixel = &self.data[(line * self.width + tap) * 3..][..3];
                    for channel in 0..3 {
                        sum[channel] += weight_x * weight_y * f32::from(pixel[channel]);
                    }
                }
            }
        }
        sum
    }
}

/// Weights of the four neighbours at `t` between the second and the third (Catmull and Rom 1974).
fn catmull_rom(t: f32) -> [f32; 4] {
    let (t2, t3) = (t * t, t * t * t);
    [-0.5 * t3 + t2 - 0.5 * t, 1.5 * t3 - 2.5 * t2 + 1.0, -1.5 * t3 + 2.0 * t2 + 0.5 * t, 0.5 * t3 - 0.5 * t2]
}

#[cfg(test)]
mod tests {
    use super::super::usable::Usable;
    use super::*;
    use crate::raster::Raster;

    fn ramp(width: usize, height: usize) -> Rgb8 {
        let mut photo = Raster::new(width, height);
        for row in 0..height {
            for column in 0..width {
                photo.set(column, row, [column as u8 * 2, row as u8 * 3, 7]);
            }
        }
        photo
    }

    #[test]
    fn pixel_centres_return_the_pixels_themselves() {
        let mips = Mips::new(ramp(60, 40));
        for (column, row) in [(0, 0), (5, 7), (59, 39), (1, 38)] {
            let [r, g, b, _] = mips.sample(column as f32 + 0.5, row as f32 + 0.5, 0.0);
            assert!((r - column as f32 * 2.0).abs() < 1e-3 && (g - row as f32 * 3.0).abs() < 1e-3, "{column} {row}");
            assert!((b - 7.0).abs() < 1e-3);
        }
    }

    #[test]
    fn a_crop_gives_what_the_whole_photo_gives() {
        let mips = Mips::new(ramp(120, 80));
        let crop = mips.cropped([40.0, 20.0], [90.0, 60.0]);
        assert!(crop.bytes() < mips.bytes() / 2);
        for pixel in [[40.0, 20.0], [63.7, 41.2], [90.0, 60.0]] {
            for octaves in [0.0, 0.9, 1.6] {
                assert_eq!(
                    crop.sample(pixel[0], pixel[1], octaves),
                    mips.sample(pixel[0], pixel[1], octaves),
                    "{pixel:?}"
                );
            }
        }
    }

    #[test]
    fn nothing_of_what_is_masked_gets_into_a_sample_beside_it() {
        let mut photo = Raster::new(96, 64);
        let mut mask = Raster { width: 96, height: 64, data: vec![255; 96 * 64] };
        for (row, column) in (0..64).flat_map(|row| (0..96).map(move |column| (row, column))) {
            let hidden = column > 41 && row < 51;
            photo.set(column, row, if hidden { [255, 0, 0] } else { [100, 100, 100] });
            mask.set(column, row, [if hidden { 0 } else { 255 }]);
        }
        let usable = Usable::new(96, 64, Some(&mask));
        let mips = Mips::masked(photo, usable.masked().unwrap());
        for [u, v] in [[41.9, 20.0], [20.0, 50.0], [70.0, 51.1], [41.9, 51.1]] {
            assert!(usable.clearance_px(u, v) > 0.0);
            for octaves in [0.0, 1.0, 2.6] {
                let [red, green, blue, _] = mips.sample(u, v, octaves);
                assert!(
                    [red, green, blue].iter().all(|value| (value - 100.0).abs() < 0.01),
                    "{u} {v} {octaves}: {red}"
                );
            }
        }
    }

    #[test]
    fn a_linear_ramp_is_kept_on_every_level() {
        let mips = Mips::new(ramp(120, 80));
        for octaves in [0.0, 0.6, 1.0, 1.7] {
            let [r, g, ..] = mips.sample(61.3, 40.9, octaves);
            assert!((r - 60.8 * 2.0).abs() < 1.0 && (g - 40.4 * 3.0).abs() < 1.0, "at {octaves}: {r} {g}");
        }
    }
}
