//! How finely the wall was photographed: millimetres of wall per pixel of the best photo, in the worse direction.

use serde::{Deserialize, Serialize};

use super::grid::Lattice;
use super::tiles::Rgba8;

/// Limits of the classes, as shares of the median.
const LIMITS: [f64; 4] = [0.9, 1.2, 1.6, 2.5];
/// Colours of the classes, from fine to coarse: readable in grey as well.
pub(crate) const RESOLUTION_COLOURS: [[u8; 3]; 5] =
    [[8, 64, 129], [43, 140, 190], [123, 204, 196], [204, 235, 197], [254, 196, 79]];

/// Shares of the surveyed stretch by resolution.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Resolution {
    /// Between the classes, millimetres per pixel.
    pub limits_mm: [f64; 4],
    /// Share of the seen wall in each class, from fine to coarse.
    pub shares: [f64; 5],
    /// 95 % of the seen wall is shown at least as finely as this.
    pub p95_mm: f64,
}

fn class(limits_mm: &[f64; 4], density_per_m: f32) -> usize {
    let mm = 1000.0 / f64::from(density_per_m);
    limits_mm.iter().filter(|limit| mm > **limit).count()
}

/// Sorts the cells of the lattice within `stretch` (along the axis) by pixels per metre; 0 = not seen.
pub(super) fn measure(density_per_m: &[f32], lattice: &Lattice, stretch: [f64; 2], median_mm: f64) -> Resolution {
    let limits_mm = LIMITS.map(|share| share * median_mm);
    let judged = |row: usize| (stretch[0]..=stretch[1]).contains(&lattice.x_m(row as i64));
    let rows = density_per_m.chunks_exact(lattice.columns).enumerate().filter(|(row, _)| judged(*row));
    let mut seen: Vec<f32> = rows.flat_map(|(_, row)| row.iter().copied()).filter(|density| *density > 0.0).collect();
    let mut counts = [0_usize; 5];
    for &density in &seen {
        counts[class(&limits_mm, density)] += 1;
    }
    let cells = seen.len().max(1) as f64;
    let coarse = seen.len() / 20;
    let p95_mm =
        if seen.is_empty() { 0.0 } else { 1000.0 / f64::from(*seen.select_nth_unstable_by(coarse, f32::total_cmp).1) };
    Resolution { limits_mm, shares: counts.map(|count| count as f64 / cells), p95_mm }
}

/// Paints the classes, one pixel per cell; transparent where nothing was seen.
pub(super) fn picture(density_per_m: &[f32], lattice: &Lattice, resolution: &Resolution) -> Rgba8 {
    let mut picture = Rgba8::new(lattice.columns, lattice.rows);
    for (at, &density) in density_per_m.iter().enumerate().filter(|(_, density)| **density > 0.0) {
        let [r, g, b] = RESOLUTION_COLOURS[class(&resolution.limits_mm, density)];
        picture.set(at % lattice.columns, at / lattice.columns, [r, g, b, 255]);
    }
    picture
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cells_are_sorted_by_their_millimetres_within_the_stretch_only() {
        let lattice = Lattice { step_s_m: 0.1, step_x_m: 0.1, columns: 4, rows: 3, x0_m: 0.0 };
        // 2 mm everywhere, but 10 mm, 1 mm and a hole in the middle row; the last row lies beyond the stretch.
        let mut density = vec![500.0; 12];
        density[4..8].copy_from_slice(&[100.0, 1000.0, 0.0, 500.0]);
        density[8..].fill(10.0);
        let found = measure(&density, &lattice, [0.0, 0.2], 2.0);
        let share = 1.0 / 7.0;
        for (found, expected) in found.shares.iter().zip([share, 5.0 * share, 0.0, 0.0, share]) {
            assert!((found - expected).abs() < 1e-12, "{found:?}");
        }
        assert!((found.p95_mm - 10.0).abs() < 1e-6);
        let picture = picture(&density, &lattice, &found);
        assert_eq!(picture.at(2, 1)[3], 0);
        assert_eq!(picture.at(0, 1)[..3], RESOLUTION_COLOURS[4]);
        assert_eq!(picture.at(1, 1)[..3], RESOLUTION_COLOURS[0]);
    }
}
