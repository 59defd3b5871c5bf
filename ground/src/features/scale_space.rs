//! The Gaussian scale space: a photo blurred more and more, halved with each octave.

use rayon::prelude::*;

use crate::raster::Grey;
use crate::vectors::vectorised;

/// Scales per octave at which extrema are looked for ("Anatomy of the SIFT method", table 1: `n_spo`).
pub(super) const SCALES: usize = 3;

/// Blur of an octave's first image, in its own samples (`sigma_min / delta_min`).
pub(super) const FIRST_BLUR: f32 = 1.6;

/// Blur that a photo is supposed to have, pixels (`sigma_in`).
const PHOTO_BLUR_PX: f32 = 0.5;

/// Octaves end where an image would be smaller than this.
const LEAST_SIDE: usize = 24;

/// Rows that one task blurs.
const BAND: usize = 32;

/// The images of one octave. Sample `(i, j)` lies at pixel `(i, j) * step_px + 0.5`.
pub(super) struct Octave {
    /// Pixels of the photo per sample (`delta`).
    pub(super) step_px: f32,
    /// `SCALES + 3` images; number s has the blur `FIRST_BLUR * 2^(s / SCALES)` samples.
    pub(super) images: Vec<Grey>,
}

impl Octave {
    /// Differences of successive images, `SCALES + 2` of them.
    pub(super) fn differences(&self) -> Vec<Grey> {
        let difference = |pair: &[Grey]| {
            let data = pair[0].data.par_iter().with_min_len(1 << 14).zip(&pair[1].data).map(|(a, b)| b - a).collect();
            Grey { width: pair[0].width, height: pair[0].height, data }
        };
        self.images.windows(2).map(difference).collect()
    }
}

/// Returns the octaves of a photo, the first with twice its resolution if `doubled`.
pub(super) fn octaves(photo: &Grey, doubled: bool) -> Vec<Octave> {
    let (mut first, mut step_px, blur) =
        if doubled { (double(photo), 0.5, 2.0 * PHOTO_BLUR_PX) } else { (photo.clone(), 1.0, PHOTO_BLUR_PX) };
    first = blurred(&first, (FIRST_BLUR * FIRST_BLUR - blur * blur).sqrt());
    let mut octaves = Vec::new();
    while first.width.min(first.height) >= LEAST_SIDE {
        let mut images = vec![first];
        for scale in 1..SCALES + 3 {
            // From blur a to blur b: another Gaussian of sqrt(b^2 - a^2).
            let growth = |scale: usize| (2.0 * scale as f32 / SCALES as f32).exp2();
            let more = FIRST_BLUR * (growth(scale) - growth(scale - 1)).sqrt();
            images.push(blurred(&images[scale - 1], more));
        }
        first = halve(&images[SCALES]);
        octaves.push(Octave { step_px, images });
        step_px *= 2.0;
    }
    octaves
}

/// Twice as many samples per axis, bilinear; sample 2i stays sample i.
fn double(photo: &Grey) -> Grey {
    let (width, height) = (photo.width, photo.height);
    let mut out = Grey::new(2 * width, 2 * height);
    out.data.par_chunks_exact_mut(2 * width).enumerate().for_each(|(row, line)| {
        let above = &photo.data[row / 2 * width..][..width];
        let below = &photo.data[row.div_ceil(2).min(height - 1) * width..][..width];
        for column in 0..width {
            let here = 0.5 * (above[column] + below[column]);
            let next = (column + 1).min(width - 1);
            line[2 * column] = here;
            line[2 * column + 1] = 0.5 * here + 0.25 * (above[next] + below[next]);
        }
    });
    out
}

/// Every second sample of every second row.
fn halve(image: &Grey) -> Grey {
    let (width, height) = (image.width / 2, image.height / 2);
    let mut out = Grey::new(width, height);
    for (row, line) in out.data.chunks_exact_mut(width).enumerate() {
        for (column, value) in line.iter_mut().enumerate() {
            *value = image.data[2 * row * image.width + 2 * column];
        }
    }
    out
}

/// Gaussian blur, cut at four standard deviations, mirrored at the border.
pub(super) fn blurred(image: &Grey, sigma: f32) -> Grey {
    let radius = (4.0 * sigma).ceil().max(1.0) as usize;
    let mut taps: Vec<f32> = (0..=radius).map(|i| (-0.5 * (i as f32 / sigma).powi(2)).exp()).collect();
    let sum = 2.0 * taps[1..].iter().sum::<f32>() + taps[0];
    for tap in &mut taps {
        *tap /= sum;
    }
    let mut out = Grey::new(image.width, image.height);
    out.data.par_chunks_mut(BAND * image.width).enumerate().for_each(|(band, lines)| {
        vectorised(
            #[inline(always)]
            || blur_band(image, &taps, band * BAND, lines),
        );
    });
    out
}

#[expect(clippy::inline_always, reason = "inlined into the dispatch, else it is compiled without its vectors")]
#[inline(always)]
fn blur_band(image: &Grey, taps: &[f32], first_row: usize, lines: &mut [f32]) {
    let (width, radius) = (image.width, taps.len() - 1);
    let row_of = |row: i64| &image.data[mirrored(row, image.height) * width..][..width];
    let mut padded = vec![0.0_f32; width + 2 * radius];
    for (offset, line) in lines.chunks_exact_mut(width).enumerate() {
        let row = (first_row + offset) as i64;
        weigh(&mut padded[radius..radius + width], row_of(row), taps[0]);
        for (distance, &tap) in taps.iter().enumerate().skip(1) {
            let distance = distance as i64;
            add_pair(&mut padded[radius..radius + width], row_of(row - distance), row_of(row + distance), tap);
        }
        for beyond in 1..=radius {
            padded[radius - beyond] = padded[radius + mirrored(-(beyond as i64), width)];
            padded[radius + width - 1 + beyond] = padded[radius + mirrored((width - 1 + beyond) as i64, width)];
        }
        weigh(line, &padded[radius..radius + width], taps[0]);
        for (distance, &tap) in taps.iter().enumerate().skip(1) {
            add_pair(line, &padded[radius - distance..][..width], &padded[radius + distance..][..width], tap);
        }
    }
}

/// Index within `0..size` of a place beyond the border, the border sample itself not repeated.
fn mirrored(index: i64, size: usize) -> usize {
    let last = size as i64 - 1;
    let period = (2 * last).max(1);
    let folded = index.rem_euclid(period);
    folded.min(period - folded).clamp(0, last) as usize
}

#[expect(clippy::inline_always, reason = "inlined into the dispatch, else it is compiled without its vectors")]
#[inline(always)]
fn weigh(target: &mut [f32], source: &[f32], tap: f32) {
    for (out, value) in target.iter_mut().zip(source) {
        *out = tap * value;
    }
}

#[expect(clippy::inline_always, reason = "inlined into the dispatch, else it is compiled without its vectors")]
#[inline(always)]
fn add_pair(target: &mut [f32], before: &[f32], after: &[f32], tap: f32) {
    for ((out, a), b) in target.iter_mut().zip(before).zip(after) {
        *out += tap * (a + b);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_constant_picture_stays_as_it_is() {
        let image = Grey { width: 40, height: 30, data: vec![7.0; 1200] };
        assert!(blurred(&image, 2.5).data.iter().all(|value| (value - 7.0).abs() < 1e-4));
        assert!(double(&image).data.iter().all(|value| (value - 7.0).abs() < 1e-6));
    }

    #[test]
    fn a_spot_spreads_with_the_variance_that_was_asked_for() {
        let mut image = Grey::new(81, 81);
        image.set(40, 40, [1.0]);
        let out = blurred(&image, 3.0);
        let (mut sum, mut second) = (0.0, 0.0);
        for row in 0..81 {
            for column in 0..81 {
                let [value] = out.at(column, row);
                sum += value;
                second += value * (column as f32 - 40.0).powi(2);
            }
        }
        assert!((sum - 1.0).abs() < 1e-4 && (second / sum - 9.0).abs() < 0.1, "{sum} {second}");
    }

    #[test]
    fn places_beyond_the_border_are_mirrored_without_repeating_it() {
        assert_eq!([-2, -1, 0, 3, 4, 5].map(|index| mirrored(index, 5)), [2, 1, 0, 3, 4, 3]);
    }
}
