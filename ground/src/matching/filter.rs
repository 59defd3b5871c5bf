//! Filters over masked grids: Gaussian and box sums, band-pass, local contrast. All linear in the number of texels.
//!
//! The wide Gaussians work on averages of [`DECIMATION`] x [`DECIMATION`] texels: they are smooth at that scale, and it
//! makes them sixteen times cheaper. Windows start at whole blocks of the wall grid, so every photo averages alike.

use pulp::Arch;

/// Texels averaged before a wide Gaussian, per axis.
pub(super) const DECIMATION: usize = 4;

/// A row-major grid of values.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Plane {
    pub(super) width: usize,
    pub(super) height: usize,
    pub(super) data: Vec<f32>,
}

impl Plane {
    pub(super) fn new(width: usize, height: usize) -> Self {
        Self { width, height, data: vec![0.0; width * height] }
    }

    pub(super) fn row(&self, row: usize) -> &[f32] {
        &self.data[row * self.width..(row + 1) * self.width]
    }

    pub(super) fn row_mut(&mut self, row: usize) -> &mut [f32] {
        &mut self.data[row * self.width..(row + 1) * self.width]
    }
}

/// Band-pass and local contrast normalisation in place; NaN marks unseen texels, which become 0.
///
/// `G(small) * (I - G(large) * I)`, divided by its own standard deviation under `G(large)` plus the floor; every Gaussian over the seen
/// texels only. Returns which texels were seen (1 or 0). Width and height are multiples of [`DECIMATION`].
pub(super) fn normalise_band(plane: &mut Plane, small_px: f32, large_px: f32, contrast_floor: f32) -> Plane {
    let mut seen = Plane::new(plane.width, plane.height);
    for (value, flag) in plane.data.iter_mut().zip(&mut seen.data) {
        let is_seen = !value.is_nan();
        *flag = f32::from(u8::from(is_seen));
        if !is_seen {
            *value = 0.0;
        }
    }
    let weight = decimated(&seen, |flag| flag);
    let blurred_weight = gaussian(&weight, large_px / DECIMATION as f32);
    let mean = ratio(&gaussian(&decimated(plane, |value| value), large_px / DECIMATION as f32), &blurred_weight);
    with_upsampled(plane, &mean, |value, mean| value - mean);
    mask(plane, &seen);
    *plane = gaussian(plane, small_px);
    mask(plane, &seen);
    let mut deviation =
        ratio(&gaussian(&decimated(plane, |value| value * value), large_px / DECIMATION as f32), &blurred_weight);
    for value in &mut deviation.data {
        *value = 1.0 / (value.max(0.0).sqrt() + contrast_floor);
    }
    with_upsampled(plane, &deviation, |value, gain| value * gain);
    seen
}

fn mask(plane: &mut Plane, seen: &Plane) {
    for (value, flag) in plane.data.iter_mut().zip(&seen.data) {
        *value *= flag;
    }
}

fn ratio(numerator: &Plane, denominator: &Plane) -> Plane {
    let divide = |(n, d): (&f32, &f32)| if *d > 1e-3 { n / d } else { 0.0 };
    let data = numerator.data.iter().zip(&denominator.data).map(divide).collect();
    Plane { data, ..*numerator }
}

/// Sums of `f(value)` over blocks of `DECIMATION` squared texels, over their number.
fn decimated(plane: &Plane, f: impl Fn(f32) -> f32 + Copy) -> Plane {
    let mut small = Plane::new(plane.width / DECIMATION, plane.height / DECIMATION);
    let share = 1.0 / (DECIMATION * DECIMATION) as f32;
    for row in 0..small.height {
        let target = row * small.width..(row + 1) * small.width;
        for source_row in row * DECIMATION..(row + 1) * DECIMATION {
            let blocks = plane.row(source_row).as_chunks::<DECIMATION>().0;
            for (sum, block) in small.data[target.clone()].iter_mut().zip(blocks) {
                *sum += share * block.iter().map(|&value| f(value)).sum::<f32>();
            }
        }
    }
    small
}

/// `target = f(target, small interpolated to the target's size)`.
fn with_upsampled(target: &mut Plane, small: &Plane, f: impl Fn(f32, f32) -> f32 + Copy) {
    let mut blended = vec![0.0; small.width];
    let mut wide = vec![0.0; small.width * DECIMATION];
    for row in 0..target.height {
        let (first, second, t) = neighbours(row, small.height);
        for ((out, a), b) in blended.iter_mut().zip(small.row(first)).zip(small.row(second)) {
            *out = a + t * (b - a);
        }
        for (phase, offset) in (0..DECIMATION).map(|phase| (phase, phase_offset(phase))) {
            for index in 0..small.width {
                let value = blended[index];
                let beside = if offset < 0.0 { index.saturating_sub(1) } else { (index + 1).min(small.width - 1) };
                wide[index * DECIMATION + phase] = value + offset.abs() * (blended[beside] - value);
            }
        }
        for (value, low) in target.row_mut(row).iter_mut().zip(&wide) {
            *value = f(*value, *low);
        }
    }
}

/// Offset of a texel's centre from its block's centre, in blocks.
fn phase_offset(phase: usize) -> f32 {
    (phase as f32 + 0.5) / DECIMATION as f32 - 0.5
}

/// The two blocks between whose centres a texel lies, and how far along.
fn neighbours(index: usize, blocks: usize) -> (usize, usize, f32) {
    let block = index / DECIMATION;
    let offset = phase_offset(index % DECIMATION);
    if offset < 0.0 { (block, block.saturating_sub(1), -offset) } else { (block, (block + 1).min(blocks - 1), offset) }
}

/// Gaussian blur, cut at three standard deviations, zero beyond the border.
pub(super) fn gaussian(plane: &Plane, sigma_px: f32) -> Plane {
    let radius = (3.0 * sigma_px).ceil().max(1.0) as usize;
    let mut taps: Vec<f32> = (0..=2 * radius)
        .map(|index| {
            let z = (index as f32 - radius as f32) / sigma_px.max(1e-3);
            (-0.5 * z * z).exp()
        })
        .collect();
    let sum: f32 = taps.iter().sum();
    for tap in &mut taps {
        *tap /= sum;
    }
    let mut out = Plane::new(plane.width, plane.height);
    let mut padded = vec![0.0; plane.width + 2 * radius];
    Arch::new().dispatch(
        #[inline(always)]
        || {
            for row in 0..plane.height {
                let column = &mut padded[radius..radius + plane.width];
                column.fill(0.0);
                for (index, &tap) in taps.iter().enumerate() {
                    let source = row + index;
                    if source >= radius && source - radius < plane.height {
                        add_scaled(column, plane.row(source - radius), tap);
                    }
                }
                let target = out.row_mut(row);
                for (index, &tap) in taps.iter().enumerate() {
                    add_scaled(target, &padded[index..index + plane.width], tap);
                }
            }
        },
    );
    out
}

#[expect(clippy::inline_always, reason = "inlined into the dispatch, else it is compiled without its vectors")]
#[inline(always)]
fn add_scaled(target: &mut [f32], source: &[f32], factor: f32) {
    for (out, value) in target.iter_mut().zip(source) {
        *out += factor * value;
    }
}

/// Sums over boxes of `2 radius + 1` squared texels around each texel, zero beyond the border.
pub(super) fn box_sums(plane: &Plane, radius: usize) -> Plane {
    let (width, height) = (plane.width, plane.height);
    let mut out = Plane::new(width, height);
    let mut column_sums = vec![0.0_f32; width];
    let mut prefix = vec![0.0_f32; width + 2 * radius + 1];
    for row in 0..height + radius {
        if row < height {
            for (sum, value) in column_sums.iter_mut().zip(plane.row(row)) {
                *sum += value;
            }
        }
        if row > 2 * radius {
            for (sum, value) in column_sums.iter_mut().zip(plane.row(row - 2 * radius - 1)) {
                *sum -= value;
            }
        }
        if row < radius {
            continue;
        }
        let mut total = 0.0;
        for (slot, value) in prefix[radius + 1..].iter_mut().zip(&column_sums) {
            total += value;
            *slot = total;
        }
        prefix[radius + 1 + width..].fill(total);
        for (index, sum) in out.row_mut(row - radius).iter_mut().enumerate() {
            *sum = prefix[index + 2 * radius + 1] - prefix[index];
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    fn wavy(width: usize, height: usize) -> Plane {
        let mut plane = Plane::new(width, height);
        for row in 0..height {
            for (column, value) in plane.row_mut(row).iter_mut().enumerate() {
                *value = ((column * 7 + row * 13) % 11) as f32 - 5.0 + 0.01 * (row * column) as f32;
            }
        }
        plane
    }

    #[test]
    fn box_sums_equal_the_sums_written_out() {
        let plane = wavy(23, 17);
        let sums = box_sums(&plane, 3);
        for row in 0..17_usize {
            for column in 0..23_usize {
                let mut expected = 0.0;
                for r in row.saturating_sub(3)..(row + 4).min(17) {
                    for c in column.saturating_sub(3)..(column + 4).min(23) {
                        expected += plane.row(r)[c];
                    }
                }
                assert!((sums.row(row)[column] - expected).abs() < 1e-3, "at {column}, {row}");
            }
        }
    }

    #[test]
    fn a_gaussian_keeps_a_constant_inside_and_spreads_an_impulse_evenly() {
        let mut plane = Plane::new(31, 31);
        plane.row_mut(15)[15] = 1.0;
        let blurred = gaussian(&plane, 2.0);
        assert!((blurred.data.iter().sum::<f32>() - 1.0).abs() < 1e-5);
        assert_eq!(blurred.row(15)[12], blurred.row(15)[18]);
        assert!((blurred.row(12)[15] - blurred.row(15)[12]).abs() < 1e-7);
    }

    #[test]
    fn brightness_and_contrast_do_not_change_the_normalised_band() {
        let mut plane = wavy(64, 64);
        let mut other = plane.clone();
        for value in &mut other.data {
            *value = 3.0 * *value + 20.0;
        }
        let seen = normalise_band(&mut plane, 1.0, 8.0, 0.01);
        normalise_band(&mut other, 1.0, 8.0, 0.01);
        assert!(seen.data.iter().all(|&flag| flag == 1.0));
        let worst = plane.data.iter().zip(&other.data).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        assert!(worst < 0.05, "differs by {worst}");
    }

    #[test]
    fn unseen_texels_become_zero_and_leave_their_neighbours_finite() {
        let mut plane = wavy(64, 32);
        for row in 8..20 {
            plane.row_mut(row)[10..40].fill(f32::NAN);
        }
        let seen = normalise_band(&mut plane, 1.0, 8.0, 0.01);
        assert!(plane.data.iter().all(|value| value.is_finite()));
        assert!(plane.data.iter().zip(&seen.data).all(|(value, &flag)| flag == 1.0 || *value == 0.0));
    }
}
