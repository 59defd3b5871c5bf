//! A photo's band as it is held for matching: a byte a texel, a quarter of the memory and of its traffic.

use std::sync::OnceLock;

use super::filter::Plane;
use crate::vectors::vectorised;

/// Steps per standard deviation of the local contrast. Rounding adds 1 % of noise; what stands out by four standard deviations
/// saturates.
pub(super) const STEPS: f32 = 32.0;

/// Texels worked on at once.
pub(super) const LANES: usize = 16;

/// Added to a small number it leaves the nearest whole one in the lowest bits; unlike a cast, compilers turn this into vectors.
pub(super) const ROUNDING: f32 = 1.5 * (1 << 23) as f32;

/// A row-major grid of the normalised band.
#[derive(Debug)]
pub(super) struct Texels {
    pub(super) width: usize,
    pub(super) height: usize,
    data: Vec<i8>,
    halved: OnceLock<Box<Texels>>,
}

impl Texels {
    /// Rounds a band in standard deviations, into memory of [`Self::into_memory`].
    pub(super) fn new(band: &Plane, mut data: Vec<i8>) -> Self {
        data.resize(band.data.len(), 0);
        vectorised(
            #[inline(always)]
            || {
                for (texel, value) in data.iter_mut().zip(&band.data) {
                    let steps = (STEPS * value).clamp(f32::from(i8::MIN), f32::from(i8::MAX));
                    *texel = (steps + ROUNDING).to_bits() as i8;
                }
            },
        );
        Self { width: band.width, height: band.height, data, halved: OnceLock::new() }
    }

    /// Memory for the next one.
    pub(super) fn into_memory(self) -> Vec<i8> {
        self.data
    }

    /// Means of two by two texels; worked out when first asked for.
    pub(super) fn halved(&self) -> &Self {
        self.halved.get_or_init(|| {
            let mut data = Vec::with_capacity(self.data.len() / 4);
            for rows in self.data.chunks_exact(2 * self.width) {
                let (upper, lower) = rows.split_at(self.width);
                let pairs = upper.as_chunks::<2>().0.iter().zip(lower.as_chunks::<2>().0);
                data.extend(pairs.map(|(&[a, b], &[c, d])| {
                    let sum: i16 = [a, b, c, d].map(i16::from).iter().sum();
                    ((sum + 2) >> 2) as i8
                }));
            }
            Box::new(Self { width: self.width / 2, height: self.height / 2, data, halved: OnceLock::new() })
        })
    }

    /// Copies a rectangle in steps; zero beyond the grid. Quick if the width is a multiple of [`LANES`].
    pub(super) fn copy_rectangle(&self, corner: [i64; 2], [width, height]: [usize; 2], target: &mut Vec<i16>) {
        target.resize(height * width, 0);
        let skip = (-corner[0]).clamp(0, width as i64) as usize;
        let end = (self.width as i64 - corner[0]).clamp(0, width as i64) as usize;
        if skip >= end {
            target.fill(0);
            return;
        }
        let start = (corner[0] + skip as i64) as usize;
        vectorised(
            #[inline(always)]
            || {
                for (source_row, row) in (corner[1]..).zip(target.chunks_exact_mut(width)) {
                    if source_row < 0 || source_row >= self.height as i64 {
                        row.fill(0);
                        continue;
                    }
                    row[..skip].fill(0);
                    row[end..].fill(0);
                    let source = self.data[source_row as usize * self.width + start..][..end - skip].as_chunks();
                    let (rows, rest) = row[skip..end].as_chunks_mut();
                    for (values, texels) in rows.iter_mut().zip::<&[[i8; LANES]]>(source.0) {
                        *values = texels.map(i16::from);
                    }
                    for (value, &texel) in rest.iter_mut().zip(source.1) {
                        *value = i16::from(texel);
                    }
                }
            },
        );
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ramp() -> Texels {
        let data = (0..32).map(|index| 0.125 * (index % 8) as f32 + (index / 8) as f32).collect();
        Texels::new(&Plane { width: 8, height: 4, data }, Vec::new())
    }

    #[test]
    fn a_rectangle_across_the_border_is_copied_where_there_are_texels_and_zero_elsewhere() {
        let mut target = vec![9; 15];
        ramp().copy_rectangle([6, -1], [4, 3], &mut target);
        assert_eq!(target, [0, 0, 0, 0, 24, 28, 0, 0, 56, 60, 0, 0]);
        ramp().copy_rectangle([-9, 1], [18, 1], &mut target);
        assert_eq!(target, [0, 0, 0, 0, 0, 0, 0, 0, 0, 32, 36, 40, 44, 48, 52, 56, 60, 0]);
    }

    #[test]
    fn halving_takes_the_mean_of_four() {
        let mut target = Vec::new();
        ramp().halved().copy_rectangle([0, 0], [4, 2], &mut target);
        assert_eq!(target, [18, 26, 34, 42, 82, 90, 98, 106]);
    }

    #[test]
    fn what_stands_out_too_far_saturates() {
        let mut target = Vec::new();
        let texels = Texels::new(&Plane { width: 2, height: 1, data: vec![-50.0, 50.0] }, Vec::new());
        texels.copy_rectangle([0, 0], [2, 1], &mut target);
        assert_eq!(target, [-128, 127]);
    }
}
