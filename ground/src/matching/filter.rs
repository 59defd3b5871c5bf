//! Filters over masked grids: Gaussian and box sums, band-pass, local contrast. All linear in the number of texels.
//!
//! What varies slowly is worked out on averages of [`DECIMATION`] x [`DECIMATION`] texels, sixteen times cheaper: the wide
//! Gaussians, and every sum over a template's or a corner's box. Windows start at whole blocks of the wall grid, so every
//! photo averages alike. What must be done to every texel goes row by row, in vectors, through memory as seldom as possible.

use crate::vectors::vectorised;

/// Texels averaged before a wide Gaussian or a box sum, per axis.
pub(super) const DECIMATION: usize = 4;

/// Columns of a Gaussian that are summed in registers.
const STRIP: usize = 32;

/// A row-major grid of values.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Plane {
    pub(super) width: usize,
    pub(super) height: usize,
    pub(super) data: Vec<f32>,
}

impl Plane {
    /// Takes on a size in the memory that there is; the values are whatever they were.
    pub(super) fn reshape(&mut self, [width, height]: [usize; 2]) {
        (self.width, self.height) = (width, height);
        self.data.resize(width * height, 0.0);
    }

    /// Takes on a size, every value `value`, in the memory that there is.
    pub(super) fn reset(&mut self, size: [usize; 2], value: f32) {
        self.data.clear();
        self.data.resize(size[0] * size[1], value);
        self.reshape(size);
    }

    pub(super) fn row(&self, row: usize) -> &[f32] {
        &self.data[row * self.width..(row + 1) * self.width]
    }

    pub(super) fn row_mut(&mut self, row: usize) -> &mut [f32] {
        &mut self.data[row * self.width..(row + 1) * self.width]
    }
}

/// Planes that are worked in again and again: memory fresh from the system costs more than most of the work.
#[derive(Debug, Default)]
pub(super) struct Planes(Vec<Plane>);

impl Planes {
    /// A plane of a size, with any values.
    pub(super) fn take(&mut self, size: [usize; 2]) -> Plane {
        let mut plane = self.0.pop().unwrap_or_default();
        plane.reshape(size);
        plane
    }

    /// Takes planes back that are not needed any more.
    pub(super) fn give_back<const N: usize>(&mut self, planes: [Plane; N]) {
        self.0.extend(planes);
    }
}

/// What matching sees of a photo on the wall grid; its memory serves one photo after the other.
#[derive(Debug, Default)]
pub(super) struct Band {
    /// The rectified photo, NaN where unseen; then its normalised band, 0 where unseen.
    pub(super) texels: Plane,
    /// Share that was seen of every block of [`DECIMATION`] squared texels.
    pub(super) seen: Plane,
}

impl Band {
    /// Band-pass and local contrast normalisation, in place, of texels of which NaN marks the unseen ones.
    ///
    /// `G(small) * (I - G(large) * I)`, divided by its own standard deviation under `G(large)` plus the floor; every Gaussian over the seen
    /// texels only. Width and height are multiples of [`DECIMATION`].
    pub(super) fn normalise(&mut self, [small_px, large_px]: [f32; 2], contrast_floor: f32, planes: &mut Planes) {
        let large_px = large_px / DECIMATION as f32;
        let Self { texels, seen } = self;
        decimate(texels, |value| if value.is_nan() { 0.0 } else { 1.0 }, seen, planes);
        let mut weight = planes.take([seen.width, seen.height]);
        weight.data.copy_from_slice(&seen.data);
        gaussian(&mut weight, large_px, planes);
        let mut mean = decimated(texels, |value| if value.is_nan() { 0.0 } else { value }, planes);
        gaussian(&mut mean, large_px, planes);
        divide(&mut mean, &weight);
        let mut mean = Upsampled::new(mean);
        let centre = |row: usize, values: &[f32], centred: &mut [f32]| {
            for ((out, value), mean) in centred.iter_mut().zip(values).zip(mean.row(row)) {
                *out = if value.is_nan() { 0.0 } else { value - mean };
            }
        };
        let hide_unseen = |before: &[f32], blurred: &mut [f32]| {
            for (out, before) in blurred.iter_mut().zip(before) {
                *out = if before.is_nan() { 0.0 } else { *out };
            }
        };
        blur(texels, small_px, centre, hide_unseen, planes);
        let mut gain = decimated(texels, |value| value * value, planes);
        gaussian(&mut gain, large_px, planes);
        divide(&mut gain, &weight);
        for value in &mut gain.data {
            *value = 1.0 / (value.max(0.0).sqrt() + contrast_floor);
        }
        let mut gain = Upsampled::new(gain);
        vectorised(
            #[inline(always)]
            || {
                for row in 0..texels.height {
                    for (value, gain) in texels.row_mut(row).iter_mut().zip(gain.row(row)) {
                        *value *= gain;
                    }
                }
            },
        );
        planes.give_back([weight, mean.small, gain.small]);
    }
}

/// Divides by the weight; 0 where there is none.
fn divide(plane: &mut Plane, weight: &Plane) {
    for (value, weight) in plane.data.iter_mut().zip(&weight.data) {
        *value = if *weight > 1e-3 { *value / weight } else { 0.0 };
    }
}

/// Means of `f(value)` over blocks of [`DECIMATION`] squared texels.
pub(super) fn decimated(plane: &Plane, f: impl Fn(f32) -> f32, planes: &mut Planes) -> Plane {
    let mut small = planes.take([0; 2]);
    decimate(plane, f, &mut small, planes);
    small
}

/// [`decimated`] into `small`.
fn decimate(plane: &Plane, f: impl Fn(f32) -> f32, small: &mut Plane, planes: &mut Planes) {
    let add = |row: usize, sums: &mut [f32]| {
        for (sum, &value) in sums.iter_mut().zip(plane.row(row)) {
            *sum += f(value);
        }
    };
    decimate_rows([plane.width, plane.height], add, small, planes);
}

/// Means over blocks of [`DECIMATION`] squared texels of what `add` adds to the sums of each row, into `small`.
pub(super) fn decimate_rows(
    [width, height]: [usize; 2],
    add: impl Fn(usize, &mut [f32]),
    small: &mut Plane,
    planes: &mut Planes,
) {
    small.reshape([width / DECIMATION, height / DECIMATION]);
    let mut sums = planes.take([width, 1]);
    let share = 1.0 / (DECIMATION * DECIMATION) as f32;
    vectorised(
        #[inline(always)]
        || {
            for block_row in 0..small.height {
                sums.data.fill(0.0);
                for row in block_row * DECIMATION..(block_row + 1) * DECIMATION {
                    add(row, &mut sums.data);
                }
                for (mean, block) in small.row_mut(block_row).iter_mut().zip(sums.data.as_chunks::<DECIMATION>().0) {
                    *mean = share * block.iter().sum::<f32>();
                }
            }
        },
    );
    planes.give_back([sums]);
}

/// A decimated plane, interpolated row by row to the size it came from.
struct Upsampled {
    small: Plane,
    /// A row between two of the small plane's, its ends repeated.
    blended: Vec<f32>,
    wide: Vec<f32>,
}

impl Upsampled {
    fn new(small: Plane) -> Self {
        let (blended, wide) = (vec![0.0; small.width + 2], vec![0.0; small.width * DECIMATION]);
        Self { small, blended, wide }
    }

    #[expect(clippy::inline_always, reason = "inlined into the dispatch, else it is compiled without its vectors")]
    #[inline(always)]
    fn row(&mut self, row: usize) -> &[f32] {
        let (first, second, t) = neighbours(row, self.small.height);
        let rows = self.small.row(first).iter().zip(self.small.row(second));
        for (out, (a, b)) in self.blended[1..].iter_mut().zip(rows) {
            *out = a + t * (b - a);
        }
        let last = self.small.width;
        self.blended[0] = self.blended[1];
        self.blended[last + 1] = self.blended[last];
        for (texels, around) in self.wide.as_chunks_mut::<DECIMATION>().0.iter_mut().zip(self.blended.windows(3)) {
            for (phase, texel) in texels.iter_mut().enumerate() {
                let offset = phase_offset(phase);
                let beside = if offset < 0.0 { around[0] } else { around[2] };
                *texel = around[1] + offset.abs() * (beside - around[1]);
            }
        }
        &self.wide
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

/// Gaussian blur in place, cut at three standard deviations, zero beyond the border.
pub(super) fn gaussian(plane: &mut Plane, sigma_px: f32, planes: &mut Planes) {
    blur(plane, sigma_px, |_, values, target| target.copy_from_slice(values), |_, _| (), planes);
}

/// Gaussian blur in place as of [`gaussian`] of the rows that `fill` makes of the plane's, each once, in order; `finish` sees
/// every row as it was, and its blur.
fn blur(
    plane: &mut Plane,
    sigma_px: f32,
    mut fill: impl FnMut(usize, &[f32], &mut [f32]),
    mut finish: impl FnMut(&[f32], &mut [f32]),
    planes: &mut Planes,
) {
    let taps = gaussian_taps(sigma_px);
    let radius = taps.len() / 2;
    let (width, height) = (plane.width, plane.height);
    let strips = width.next_multiple_of(STRIP);
    // The rows around the current one, in turn; what no row has filled yet is zero.
    let [mut ring, mut column, mut before] = [taps.len() * strips, strips + 2 * radius, width].map(|length| {
        let mut row = planes.take([0; 2]);
        row.reset([length, 1], 0.0);
        row
    });
    vectorised(
        #[inline(always)]
        || {
            for next in 0..height + radius {
                let slot = &mut ring.data[(next % taps.len()) * strips..][..width];
                if next < height {
                    fill(next, plane.row(next), slot);
                } else {
                    slot.fill(0.0);
                }
                let Some(row) = next.checked_sub(radius) else { continue };
                for start in (0..strips).step_by(STRIP) {
                    // The oldest row lies after the newest.
                    let sources = (0..taps.len()).map(|tap| ((next + 1 + tap) % taps.len()) * strips + start);
                    let sums = weighted_sums(&taps, &ring.data, sources);
                    column.data[radius + start..][..STRIP].copy_from_slice(&sums);
                }
                before.data.copy_from_slice(plane.row(row));
                let (targets, rest) = plane.row_mut(row).as_chunks_mut::<STRIP>();
                let sums = |strip: usize| weighted_sums(&taps, &column.data, strip * STRIP..strip * STRIP + taps.len());
                for (strip, target) in targets.iter_mut().enumerate() {
                    *target = sums(strip);
                }
                if !rest.is_empty() {
                    rest.copy_from_slice(&sums(targets.len())[..rest.len()]);
                }
                finish(&before.data, plane.row_mut(row));
            }
        },
    );
    planes.give_back([ring, column, before]);
}

/// Sums of strips of `data` that begin at `sources`, weighted by `taps`.
#[expect(clippy::inline_always, reason = "inlined into the dispatch, else it is compiled without its vectors")]
#[inline(always)]
fn weighted_sums(taps: &[f32], data: &[f32], sources: impl Iterator<Item = usize>) -> [f32; STRIP] {
    let mut sums = [0.0; STRIP];
    for (tap, start) in taps.iter().zip(sources) {
        for (sum, value) in sums.iter_mut().zip(&data[start..start + STRIP]) {
            *sum += tap * value;
        }
    }
    sums
}

fn gaussian_taps(sigma_px: f32) -> Vec<f32> {
    let radius = (3.0 * sigma_px).ceil().max(1.0) as usize;
    let tap = |index: usize| {
        let z = (index as f32 - radius as f32) / sigma_px.max(1e-3);
        (-0.5 * z * z).exp()
    };
    let taps: Vec<f32> = (0..=2 * radius).map(tap).collect();
    let sum: f32 = taps.iter().sum();
    taps.iter().map(|tap| tap / sum).collect()
}

/// Sums over boxes of `2 radius + 1` squared texels around each texel, zero beyond the border.
pub(super) fn box_sums(plane: &Plane, radius: usize, planes: &mut Planes) -> Plane {
    let (width, height) = (plane.width, plane.height);
    let mut out = planes.take([width, height]);
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
        let mut plane = Plane::default();
        plane.reset([width, height], 0.0);
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
        let sums = box_sums(&plane, 3, &mut Planes::default());
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
        let mut plane = Plane::default();
        plane.reset([31, 31], 0.0);
        plane.row_mut(15)[15] = 1.0;
        gaussian(&mut plane, 2.0, &mut Planes::default());
        let blurred = plane;
        assert!((blurred.data.iter().sum::<f32>() - 1.0).abs() < 1e-5);
        assert_eq!(blurred.row(15)[12], blurred.row(15)[18]);
        assert!((blurred.row(12)[15] - blurred.row(15)[12]).abs() < 1e-7);
    }

    #[test]
    fn brightness_and_contrast_do_not_change_the_normalised_band() {
        let plane = wavy(64, 64);
        let mut other = plane.clone();
        for value in &mut other.data {
            *value = 3.0 * *value + 20.0;
        }
        let [band, other] = [plane, other].map(|plane| {
            let mut band = Band { texels: plane, seen: Plane::default() };
            band.normalise([1.0, 8.0], 0.01, &mut Planes::default());
            band
        });
        assert!(band.seen.data.iter().all(|&share| share == 1.0));
        let worst = band.texels.data.iter().zip(&other.texels.data).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        assert!(worst < 0.05, "differs by {worst}");
    }

    #[test]
    fn unseen_texels_become_zero_and_leave_their_neighbours_finite() {
        let mut plane = wavy(64, 32);
        for row in 8..20 {
            plane.row_mut(row)[10..40].fill(f32::NAN);
        }
        let mut band = Band { texels: plane.clone(), seen: Plane::default() };
        band.normalise([1.0, 8.0], 0.01, &mut Planes::default());
        assert!(band.texels.data.iter().all(|value| value.is_finite()));
        assert!(plane.data.iter().zip(&band.texels.data).all(|(given, value)| given.is_nan() == (*value == 0.0)));
        assert_eq!(band.seen.row(3)[2..10], [0.5, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
    }
}
