//! Texels that the photo chosen for their cell does not quite reach, though another does: slivers where the borders of photos and masks
//! cross. They take the colour of any photo that shows them.

use rayon::prelude::*;

use super::blend::Band;
use super::fine::TexelRows;
use super::grid::MID_PER_COARSE;
use super::layer::Rgbx;
use super::sample::Mips;
use super::seams::NO_PHOTO;
use super::tone::ToneCurve;
use super::usable::Usable;
use super::view::{Sight, View};

/// A texel of a strip without a colour.
pub(super) struct Gap {
    /// Row and column in the strip.
    line: usize,
    texel: usize,
    s_m: f64,
    x_m: f64,
    height_m: f64,
}

/// Finds the texels without detail near cells that some photo shows; beyond these only projecting would tell that nothing is seen.
pub(super) fn gaps(texels: &TexelRows, band: &Band, taken: &[u32], detail: &[Rgbx]) -> Vec<Gap> {
    let near = near(band, taken);
    let width = texels.grid.width_px;
    let mut gaps = Vec::new();
    for (line, row) in detail.chunks_exact(width).enumerate() {
        let (x_m, mid_row) = texels.row(line);
        let coarse_row = ((mid_row + 0.5) / MID_PER_COARSE as f64) as usize;
        let row_near = &near[(coarse_row.clamp(band.row0, band.row0 + band.rows - 1) - band.row0) * band.columns..];
        let mut heights_m = None;
        for texel in (0..width).filter(|&texel| row[texel][3] == 0.0) {
            let coarse_column = ((texels.column(texel as i64) + 0.5) / MID_PER_COARSE as f64) as usize;
            if row_near[coarse_column.min(band.columns - 1)] {
                let height_m = heights_m.get_or_insert_with(|| texels.heights_m(x_m))[texel];
                gaps.push(Gap { line, texel, s_m: texels.grid.s_m(texel as f64 + 0.5), x_m, height_m });
            }
        }
    }
    gaps
}

/// Coarse cells that hold a mid cell which some photo shows, and those beside them.
fn near(band: &Band, taken: &[u32]) -> Vec<bool> {
    let mut near = vec![false; band.columns * band.rows];
    for (at, _) in taken.iter().enumerate().filter(|(_, photo)| **photo != NO_PHOTO) {
        let (row, column) =
            (at / band.mid_columns() / MID_PER_COARSE, at % band.mid_columns() / MID_PER_COARSE + band.columns);
        for line in row.saturating_sub(1)..(row + 2).min(band.rows) {
            for across in column - 1..column + 2 {
                near[line * band.columns + across % band.columns] = true;
            }
        }
    }
    near
}

/// Fills the gaps that a photo shows; the others are left. A negative fourth number says that it is the colour itself. `decode` is
/// asked for the photo only if it shows any.
pub(super) fn fill<E>(
    gaps: &mut Vec<Gap>,
    (view, usable, curve): (&View, &Usable, &ToneCurve),
    texels: &TexelRows,
    detail: &mut [Rgbx],
    decode: impl FnOnce() -> Result<Mips, E>,
) -> Result<(), E> {
    let profile = texels.surface.profile();
    let sights: Vec<Sight> = gaps
        .par_iter()
        .map(|gap| view.sight_at(profile, [gap.s_m, gap.x_m], gap.height_m, texels.mid.step_s_m, usable))
        .collect();
    if sights.iter().all(|sight| sight.score <= 0.0) {
        return Ok(());
    }
    let mips = decode()?;
    let texel_m = texels.grid.texel_m() as f32;
    let mut sights = sights.into_iter();
    gaps.retain(|gap| {
        let Some(sight) = sights.next().filter(|sight| sight.score > 0.0) else { return true };
        let octaves = (texel_m * sight.mean_density_per_m).max(1e-3).log2();
        let [u, v] = sight.pixel;
        let [red, green, blue, _] = curve.evened(mips.sample(u, v, octaves), sight.pixel);
        detail[gap.line * texels.grid.width_px + gap.texel] = [red, green, blue, -1.0];
        false
    });
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cells_beside_what_is_shown_are_near_around_the_seam_too() {
        let band = Band { columns: 5, row0: 3, rows: 4 };
        let mut taken = vec![NO_PHOTO; band.mid_columns() * band.mid_rows()];
        taken[5 * band.mid_columns()] = 7;
        let near = near(&band, &taken);
        let marked: Vec<usize> = (0..near.len()).filter(|&at| near[at]).collect();
        assert_eq!(marked, [0, 1, 4, 5, 6, 9, 10, 11, 14]);
    }
}
