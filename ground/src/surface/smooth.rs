//! Heights made whole: what the photos say, smooth where they say little.

use super::sweep::{FINE_SAMPLES, Found};

/// Real walls slope about so much: the scale of the differences between neighbouring cells, over their distance.
const SLOPE: f32 = 0.12;
/// Steeper steps are believed to be edges: the scale of the Cauchy loss between neighbours, over their distance.
const EDGE_SLOPE: f32 = 0.24;
/// Measured heights farther from the surface are believed to be wrong: the scale of the Cauchy loss on them, in samples
/// of the sweep, for its errors are as large as its samples.
const WRONG_SAMPLES: f32 = 1.3;
/// Heights farther than this from the surface in the end are called unknown.
const REFUSED_SAMPLES: f32 = 1.9;
/// Added to every measured height's sigma: poses and lens.
const FLOOR_M: f32 = 0.001;
/// Where nothing was measured heights fade to the ring's over about this distance.
const FADE_M: f32 = 0.25;
/// The relaxation starts from the median of what was found within this distance, around and along.
const START_M: f32 = 0.05;
/// Rounds of relaxation.
const ROUNDS: usize = 60;
/// Over-relaxation.
const HASTE: f32 = 1.5;

/// Heights of a strip, columns once around.
pub(super) struct Smoothed {
    /// Height of every cell over the profile.
    pub(super) height_m: Vec<f32>,
    /// 0 where the height is only carried on from elsewhere.
    pub(super) confidence: Vec<f32>,
}

/// Finds the heights with the least `sum w C(h - found) + sum C'(h - neighbour) + fade (h - ring)^2`.
///
/// # Method
/// C: Cauchy losses, so that wrong heights and true edges are let go; successive over-relaxation with the losses' weights
/// renewed on the way. It starts from the median of what was found around each cell. Blake and Zisserman, "Visual
/// Reconstruction", 1987 (weak membrane). `step_m` is the distance of cells: all scales are slopes, lengths or samples, so
/// that coarse photos, whose cells are large, keep a bulge as fine ones do.
pub(super) fn smooth(found: &[Found], ring_m: &[f32], columns: usize, step_m: f32) -> Smoothed {
    let rows = found.len() / columns;
    let sample_m = step_m / FINE_SAMPLES as f32;
    let [edge_m, wrong_m, refused_m] = [EDGE_SLOPE * step_m, WRONG_SAMPLES * sample_m, REFUSED_SAMPLES * sample_m];
    let mut height_m: Vec<f32> = start(found, ring_m, columns, (START_M / step_m).round().max(1.0) as usize);
    let smoothness = (SLOPE * step_m).powi(-2);
    let fade = smoothness * (step_m / FADE_M).powi(2);
    let data: Vec<f32> =
        found.iter().map(|found| found.confidence / (found.sigma_m.powi(2) + FLOOR_M * FLOOR_M)).collect();
    for _ in 0..ROUNDS {
        for row in 0..rows {
            for column in 0..columns {
                let at = row * columns + column;
                let here = height_m[at];
                let left = if column == 0 { at + columns - 1 } else { at - 1 };
                let right = if column + 1 == columns { at + 1 - columns } else { at + 1 };
                let upper = if row == 0 { at } else { at - columns };
                let lower = if row + 1 == rows { at } else { at + columns };
                // Differences are those of the relief: the ring may slope as it likes.
                let above_ring = here - ring_m[at];
                let (mut sum, mut weights) = (fade * ring_m[at], fade);
                for neighbour in [left, right, upper, lower] {
                    let level = height_m[neighbour] - ring_m[neighbour];
                    let weight = smoothness * cauchy(level - above_ring, edge_m);
                    sum += weight * (level + ring_m[at]);
                    weights += weight;
                }
                let measured = data[at] * cauchy(found[at].height_m - here, wrong_m);
                sum += measured * found[at].height_m;
                weights += measured;
                height_m[at] = here + HASTE * (sum / weights - here);
            }
        }
    }
    let believed = |(found, height_m): (&Found, &f32)| {
        if (found.height_m - height_m).abs() > refused_m { 0.0 } else { found.confidence }
    };
    let confidence = found.iter().zip(&height_m).map(believed).collect();
    Smoothed { height_m, confidence }
}

fn cauchy(difference_m: f32, scale_m: f32) -> f32 {
    1.0 / (1.0 + (difference_m / scale_m).powi(2))
}

/// Medians of the found heights up to `reach` cells away; the ring's where there are none.
fn start(found: &[Found], ring_m: &[f32], columns: usize, reach: usize) -> Vec<f32> {
    let rows = found.len() / columns;
    let mut near = Vec::new();
    let mut heights = Vec::with_capacity(found.len());
    for row in 0..rows {
        for column in 0..columns {
            near.clear();
            for line in row.saturating_sub(reach)..(row + reach + 1).min(rows) {
                for step in 0..=2 * reach {
                    let at = line * columns + (column + columns + step - reach) % columns;
                    if found[at].confidence > 0.0 {
                        near.push(found[at].height_m - ring_m[at]);
                    }
                }
            }
            let middle = near.len() / 2;
            let median = if near.is_empty() { 0.0 } else { *near.select_nth_unstable_by(middle, f32::total_cmp).1 };
            heights.push(ring_m[row * columns + column] + median);
        }
    }
    heights
}

#[cfg(test)]
mod tests {
    use super::*;

    const COLUMNS: usize = 40;
    const STEP_M: f32 = 0.025;

    fn cell(height_m: f32) -> Found {
        Found { height_m, sigma_m: 0.001, confidence: 1.0 }
    }

    #[test]
    fn wrong_heights_are_refused_and_holes_filled_from_around() {
        let mut found = vec![cell(0.02); COLUMNS * 30];
        found[15 * COLUMNS + 7] = cell(0.07);
        for row in 10..14 {
            found[row * COLUMNS + 20..row * COLUMNS + 24].fill(Found::default());
        }
        let smoothed = smooth(&found, &vec![0.0; found.len()], COLUMNS, STEP_M);
        assert_eq!(smoothed.confidence[15 * COLUMNS + 7], 0.0);
        // 50 mm off, believed with a fortieth of its weight.
        assert!((smoothed.height_m[15 * COLUMNS + 7] - 0.02).abs() < 0.002);
        let hole = 12 * COLUMNS + 22;
        assert!((smoothed.height_m[hole] - 0.02).abs() < 0.002 && smoothed.confidence[hole] == 0.0);
    }

    #[test]
    fn an_edge_stays_an_edge() {
        let found: Vec<Found> = (0..COLUMNS * 20).map(|at| cell(if at % COLUMNS < 20 { 0.0 } else { 0.05 })).collect();
        let smoothed = smooth(&found, &vec![0.0; found.len()], COLUMNS, STEP_M);
        let line = &smoothed.height_m[10 * COLUMNS..][..COLUMNS];
        assert!(line[18].abs() < 0.002 && (line[21] - 0.05).abs() < 0.002, "{line:?}");
    }

    #[test]
    fn a_measured_bulge_keeps_its_height_in_small_cells_and_in_large_ones() {
        for step_m in [0.02, 0.025, 0.063] {
            let shape = |at: usize| {
                let (s_m, x_m) = ((at % COLUMNS) as f32 * step_m - 0.5, (at / COLUMNS) as f32 * step_m - 0.4);
                0.03 * (-(s_m * s_m + x_m * x_m) / (2.0 * 0.15 * 0.15)).exp()
            };
            let sigma_m = 0.04 * step_m;
            let cell = |at: usize| Found { height_m: shape(at), sigma_m, confidence: 1.0 };
            let found: Vec<Found> = (0..COLUMNS * 40).map(cell).collect();
            let smoothed = smooth(&found, &vec![0.0; found.len()], COLUMNS, step_m);
            let worst = (0..found.len()).map(|at| (smoothed.height_m[at] - shape(at)).abs()).fold(0.0, f32::max);
            assert!(worst < 0.0015, "{worst} m at cells of {step_m} m");
            assert!(smoothed.confidence.iter().all(|confidence| *confidence > 0.0));
        }
    }
}
