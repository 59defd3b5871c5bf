//! Template search by normalised cross-correlation, with a sub-pixel peak.

use super::patch::{MIN_VARIANCE, Patch};
use super::texels::{LANES, STEPS, Texels};
use crate::vectors::vectorised;

/// Window columns worked on together: enough independent sums to hide the latency of a fused multiply-add.
const GROUP: usize = 8;

/// Sums of products, of which each is that of two neighbouring lanes.
type Products = [i32; LANES / 2];

/// Least variance of a template, steps squared.
const MIN_VARIANCE_STEPS: f32 = MIN_VARIANCE * STEPS * STEPS;

/// Half-width of the search window, texels, from which it is searched at half the resolution first.
const WIDE_REACH: usize = 12;

/// Places at half the resolution that are looked at in full: repeated bricks look alike there.
const CANDIDATES: usize = 3;

/// Half-width, texels, of the search around such a place.
const REFINING_REACH: usize = 3;

/// Where a template was found.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Peak {
    /// Offset from the window's middle, texels, `[column, row]`.
    pub(super) offset: [f64; 2],
    /// Normalised cross-correlation, at most 1.
    pub(super) ncc: f32,
}

/// Working memory of a search, reused from point to point.
#[derive(Debug, Default)]
pub(super) struct Search {
    template: Vec<i16>,
    window: Vec<i16>,
    /// Sums of the window's columns over the rows of one offset: of the values, of their squares.
    column_sums: [Vec<i32>; 2],
    scores: Vec<f32>,
}

impl Search {
    /// Finds the template around `point` of `from` near `target` (column and row in the window of `to`).
    ///
    /// `None` if the best place lies on the border of the search, touches wall that `to` did not see, or correlates less
    /// than `min_ncc`. Cost: the search window times the template's area in multiply-adds; where the window is wide a
    /// sixteenth of that, since it is searched at half the resolution first.
    pub(super) fn find(
        &mut self,
        from: &Patch,
        point: [usize; 2],
        to: &Patch,
        target: [i64; 2],
        size: &SearchSize,
    ) -> Option<Peak> {
        let point = point.map(|middle| middle as i64);
        if size.reach.iter().all(|&reach| reach < WIDE_REACH) {
            return self.find_at_once(from, point, to, target, size);
        }
        let narrow = SearchSize { reach: [REFINING_REACH; 2], ..*size };
        let mut best: Option<Peak> = None;
        for offset in self.find_halved(from, point, to, target, size)? {
            let near = [0, 1].map(|axis| target[axis] + offset[axis]);
            if let Some(peak) = self.find_at_once(from, point, to, near, &narrow)
                && best.is_none_or(|best| peak.ncc > best.ncc)
            {
                best = Some(Peak { offset: [0, 1].map(|axis| peak.offset[axis] + offset[axis] as f64), ..peak });
            }
        }
        best.filter(|peak| (0..2).all(|axis| peak.offset[axis].abs() < size.reach[axis] as f64))
    }

    fn find_at_once(
        &mut self,
        from: &Patch,
        point: [i64; 2],
        to: &Patch,
        target: [i64; 2],
        size: &SearchSize,
    ) -> Option<Peak> {
        let template = self.take_template(&from.texels, point, size)?;
        self.take_window(&to.texels, target, size);
        self.correlate(size, template);
        self.hide_unusable(to, 1, target, size);
        self.peak(size)
    }

    /// The best places at half the resolution, as offsets from `target` in texels; the true one may be a texel off.
    fn find_halved(
        &mut self,
        from: &Patch,
        point: [i64; 2],
        to: &Patch,
        target: [i64; 2],
        size: &SearchSize,
    ) -> Option<impl Iterator<Item = [i64; 2]> + use<>> {
        let halved = SearchSize { half: size.half / 2, reach: size.reach.map(|reach| reach / 2 + 1), min_ncc: 0.0 };
        let [halved_point, halved_target] = [point, target].map(|place| place.map(|texel| texel.div_euclid(2)));
        let template = self.take_template(from.texels.halved(), halved_point, &halved)?;
        self.take_window(to.texels.halved(), halved_target, &halved);
        self.correlate(&halved, template);
        self.hide_unusable(to, 2, halved_target, &halved);
        let offset = move |[column, row]: [usize; 2]| {
            let place = [column, row].map(|index| index as i64);
            [0, 1].map(|axis| {
                let found = halved_target[axis] - halved.reach[axis] as i64 + place[axis];
                2 * (found - halved_point[axis]) + point[axis] - target[axis]
            })
        };
        Some(self.highest(&halved).into_iter().flatten().map(offset))
    }

    /// The highest of the scores that no neighbour exceeds, as column and row.
    fn highest(&self, size: &SearchSize) -> [Option<[usize; 2]>; CANDIDATES] {
        let (span, columns) = (size.span(), size.columns());
        let mut highest = [(0.0, None); CANDIDATES];
        for (row, scores) in self.scores.chunks_exact(columns).enumerate() {
            for (column, &score) in scores[..span[0]].iter().enumerate() {
                if score <= highest[CANDIDATES - 1].0 {
                    continue;
                }
                let rows = row.saturating_sub(1)..(row + 2).min(span[1]);
                let beside = column.saturating_sub(1)..(column + 2).min(span[0]);
                let exceeds =
                    |row: usize| self.scores[row * columns..][beside.clone()].iter().any(|&other| other > score);
                if !rows.into_iter().any(exceeds) {
                    let rank = highest.partition_point(|(other, _)| *other >= score);
                    highest[rank..].rotate_right(1);
                    highest[rank] = (score, Some([column, row]));
                }
            }
        }
        highest.map(|(_, place)| place)
    }

    /// Takes the template; `None` if there is too little contrast.
    fn take_template(&mut self, from: &Texels, middle: [i64; 2], size: &SearchSize) -> Option<Template> {
        let side = size.side();
        let corner = middle.map(|middle| middle - size.half as i64);
        let stride = size.template_stride();
        from.copy_rectangle(corner, [stride, side], &mut self.template);
        for row in self.template.chunks_exact_mut(stride) {
            row[side..].fill(0);
        }
        let values = &self.template;
        let (sum, squares) = vectorised(
            #[inline(always)]
            || {
                values.iter().fold((0, 0), |(sum, squares), &value| {
                    let value = i32::from(value);
                    (sum + value, squares + value * value)
                })
            },
        );
        let area = (side * side) as f32;
        let deviation = squares as f32 - sum as f32 * sum as f32 / area;
        let mean = sum as f32 / area;
        (deviation > MIN_VARIANCE_STEPS * area).then(|| Template { mean, contrast: deviation.sqrt().recip() })
    }

    fn take_window(&mut self, to: &Texels, target: [i64; 2], size: &SearchSize) {
        let corner = [0, 1].map(|axis| target[axis] - (size.half + size.reach[axis]) as i64);
        let height = 2 * (size.half + size.reach[1]) + 1;
        to.copy_rectangle(corner, [size.window_stride(), height], &mut self.window);
    }

    /// Fills the scores with the normalised cross-correlation at every offset; 0 where the window has too little contrast.
    fn correlate(&mut self, size: &SearchSize, template: Template) {
        self.scores.resize(size.span()[1] * size.columns(), 0.0);
        for sums in &mut self.column_sums {
            sums.clear();
            sums.resize(size.window_stride(), 0);
        }
        #[cfg(target_arch = "x86_64")]
        if let Some(v3) = pulp::x86::V3::try_new() {
            // No compiler finds this instruction by itself; it halves the time.
            return vectorised(
                #[inline(always)]
                || {
                    self.correlate_by(
                        size,
                        template,
                        #[inline(always)]
                        |sums, a, b| {
                            let products = v3.avx2._mm256_madd_epi16(pulp::cast(a), pulp::cast(b));
                            pulp::cast(v3.avx2._mm256_add_epi32(pulp::cast(sums), products))
                        },
                    );
                },
            );
        }
        vectorised(
            #[inline(always)]
            || self.correlate_by(size, template, add_products),
        );
    }

    #[expect(clippy::inline_always, reason = "inlined into the dispatch, else it is compiled without its vectors")]
    #[inline(always)]
    fn correlate_by(
        &mut self,
        size: &SearchSize,
        Template { mean, contrast }: Template,
        add_products: impl Fn(Products, [i16; LANES], [i16; LANES]) -> Products,
    ) {
        let Self { template, window, column_sums, scores } = self;
        let (side, template_stride, window_stride) = (size.side(), size.template_stride(), size.window_stride());
        for (offset_row, scores) in scores.chunks_exact_mut(size.columns()).enumerate() {
            let rows = &window[offset_row * window_stride..][..side * window_stride];
            add_row_sums(window, window_stride, side, offset_row, column_sums);
            for (group, scores) in scores.as_chunks_mut::<GROUP>().0.iter_mut().enumerate() {
                let start = group * GROUP;
                let mut products = [Products::default(); GROUP];
                let template_rows = template.chunks_exact(template_stride);
                for (template_row, window_row) in template_rows.zip(rows.chunks_exact(window_stride)) {
                    let window_row = &window_row[start..start + template_stride + GROUP];
                    for (index, &texels) in template_row.as_chunks::<LANES>().0.iter().enumerate() {
                        let around = &window_row[index * LANES..index * LANES + LANES + GROUP];
                        for (sums, met) in products.iter_mut().zip(around.array_windows::<LANES>()) {
                            *sums = add_products(*sums, texels, *met);
                        }
                    }
                }
                let met = sums_met(&column_sums.each_ref().map(|sums| &sums[start..start + side + GROUP - 1]));
                for ((score, products), [sum, squares]) in scores.iter_mut().zip(products).zip(met) {
                    let area = (side * side) as f32;
                    let deviation = squares - sum * sum / area;
                    let norm = if deviation > MIN_VARIANCE_STEPS * area { deviation.sqrt().recip() } else { 0.0 };
                    *score = (products.iter().sum::<i32>() as f32 - mean * sum) * contrast * norm;
                }
            }
        }
    }

    /// Clears the scores where no template can lie; a step of the window is one of `texels`.
    fn hide_unusable(&mut self, to: &Patch, texels: i64, target: [i64; 2], size: &SearchSize) {
        let corner = [0, 1].map(|axis| target[axis] - size.reach[axis] as i64);
        for (row, scores) in (corner[1]..).zip(self.scores.chunks_exact_mut(size.columns())) {
            for (column, score) in (corner[0]..).zip(scores) {
                if !to.is_usable([column * texels, row * texels]) {
                    *score = 0.0;
                }
            }
        }
    }

    fn peak(&self, size: &SearchSize) -> Option<Peak> {
        let (span, columns) = (size.span(), size.columns());
        let (mut best, mut at) = (size.min_ncc, None);
        for (row, scores) in self.scores.chunks_exact(columns).enumerate() {
            for (column, &score) in scores[..span[0]].iter().enumerate() {
                if score >= best {
                    (best, at) = (score, Some((column, row)));
                }
            }
        }
        let (column, row) = at?;
        if column == 0 || row == 0 || column + 1 == span[0] || row + 1 == span[1] {
            return None;
        }
        let around: [[f32; 3]; 3] =
            std::array::from_fn(|dy| std::array::from_fn(|dx| self.scores[(row + dy - 1) * columns + column + dx - 1]));
        if around.iter().flatten().any(|&score| score == 0.0) {
            return None;
        }
        let [dx, dy] = quadratic_peak(&around)?;
        let reach = span.map(|side| (side / 2) as f64);
        Some(Peak { offset: [column as f64 - reach[0] + dx, row as f64 - reach[1] + dy], ncc: best })
    }
}

/// Sizes of one search, texels.
#[derive(Clone, Copy, Debug)]
pub(super) struct SearchSize {
    /// Half the template's side.
    pub(super) half: usize,
    /// Half the search window's width and height.
    pub(super) reach: [usize; 2],
    pub(super) min_ncc: f32,
}

impl SearchSize {
    /// The template's side.
    fn side(&self) -> usize {
        2 * self.half + 1
    }

    /// Texels of a template's row with the zeros after it.
    fn template_stride(&self) -> usize {
        self.side().next_multiple_of(LANES)
    }

    /// Texels of a window's row; those that are not searched meet zeros, or give scores that are not looked at.
    fn window_stride(&self) -> usize {
        (self.columns() + self.template_stride()).next_multiple_of(LANES)
    }

    /// Columns of the scores: those of the search window and some that are not looked at.
    fn columns(&self) -> usize {
        self.span()[0].next_multiple_of(GROUP)
    }

    /// Columns and rows of the search window.
    fn span(&self) -> [usize; 2] {
        self.reach.map(|reach| 2 * reach + 1)
    }
}

/// What the correlation must know of a template, in steps.
#[derive(Clone, Copy)]
struct Template {
    mean: f32,
    /// One over the norm of the deviations from the mean.
    contrast: f32,
}

fn add_products(mut sums: Products, a: [i16; LANES], b: [i16; LANES]) -> Products {
    for (lane, sum) in sums.iter_mut().enumerate() {
        *sum += i32::from(a[2 * lane]) * i32::from(b[2 * lane]);
        *sum += i32::from(a[2 * lane + 1]) * i32::from(b[2 * lane + 1]);
    }
    sums
}

/// Moves the sums of the window's columns on to the rows of an offset, from those of the offset before.
#[expect(clippy::inline_always, reason = "inlined into the dispatch, else it is compiled without its vectors")]
#[inline(always)]
fn add_row_sums(window: &[i16], stride: usize, side: usize, offset_row: usize, [sums, squares]: &mut [Vec<i32>; 2]) {
    let row = |index: usize| &window[index * stride..(index + 1) * stride];
    let first_new = if offset_row == 0 { 0 } else { offset_row + side - 1 };
    for index in first_new..offset_row + side {
        for ((sum, square), &value) in sums.iter_mut().zip(squares.iter_mut()).zip(row(index)) {
            let value = i32::from(value);
            *sum += value;
            *square += value * value;
        }
    }
    if let Some(old) = offset_row.checked_sub(1) {
        for ((sum, square), &value) in sums.iter_mut().zip(squares.iter_mut()).zip(row(old)) {
            let value = i32::from(value);
            *sum -= value;
            *square -= value * value;
        }
    }
}

/// For `GROUP` successive offsets the sums of what the template meets: of the values, of their squares.
#[expect(clippy::inline_always, reason = "inlined into the dispatch, else it is compiled without its vectors")]
#[inline(always)]
fn sums_met([sums, squares]: &[&[i32]; 2]) -> [[f32; 2]; GROUP] {
    let mut met = [[0; 2]; GROUP];
    for (sums, squares) in sums.array_windows::<GROUP>().zip(squares.array_windows::<GROUP>()) {
        for offset in 0..GROUP {
            met[offset][0] += sums[offset];
            met[offset][1] += squares[offset];
        }
    }
    met.map(|sums| sums.map(|sum| sum as f32))
}

/// Highest point of the least-squares quadratic through nine scores, `[column, row]` from the middle one.
///
/// `None` if the quadratic has no maximum or has it more than a texel away.
fn quadratic_peak(scores: &[[f32; 3]; 3]) -> Option<[f64; 2]> {
    let s = scores.map(|row| row.map(f64::from));
    let column_sum = |c: usize| s[0][c] + s[1][c] + s[2][c];
    let row_sum = |r: usize| s[r][0] + s[r][1] + s[r][2];
    let gx = (column_sum(2) - column_sum(0)) / 6.0;
    let gy = (row_sum(2) - row_sum(0)) / 6.0;
    // Second derivatives of the fit.
    let hxx = (column_sum(0) - 2.0 * column_sum(1) + column_sum(2)) / 3.0;
    let hyy = (row_sum(0) - 2.0 * row_sum(1) + row_sum(2)) / 3.0;
    let hxy = (s[0][0] - s[0][2] - s[2][0] + s[2][2]) / 4.0;
    let determinant = hxx * hyy - hxy * hxy;
    if !(hxx < 0.0 && determinant > 0.0) {
        return None;
    }
    let peak = [(hxy * gy - hyy * gx) / determinant, (hxy * gx - hxx * gy) / determinant];
    peak.iter().all(|offset| offset.abs() <= 1.0).then_some(peak)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_quadratic_finds_its_own_peak() {
        let peak = [0.3, -0.4];
        let scores = std::array::from_fn(|row| {
            std::array::from_fn(|column| {
                let (x, y) = (column as f32 - 1.0 - peak[0], row as f32 - 1.0 - peak[1]);
                1.0 - 0.2 * x * x - 0.3 * y * y + 0.1 * x * y
            })
        });
        let found = quadratic_peak(&scores).expect("a maximum");
        assert!((found[0] - 0.3).abs() < 1e-6 && (found[1] + 0.4).abs() < 1e-6, "{found:?}");
    }

    #[test]
    fn a_saddle_has_no_peak() {
        assert_eq!(quadratic_peak(&[[0.0, 1.0, 0.0], [-1.0, 0.0, -1.0], [0.0, 1.0, 0.0]]), None);
    }
}
