//! The finest band: every texel of a strip is looked up in the photo that shows it best.

use rayon::prelude::*;

use super::blend::{Composite, Shares};
use super::grid::{Lattice, PanoramaGrid, wall_at};
use super::layer::{Layer, Rgbx};
use super::sample::Mips;
use super::tone::ToneCurve;
use super::usable::Usable;
use super::view::View;
use crate::surface::SurfaceWindow;
use nalgebra::Vector3;

/// Weights below are nothing: they would only cost time.
const LEAST_WEIGHT: f32 = 1e-3;

/// Where the texels of a strip lie on the mid lattice.
pub(super) struct TexelRows<'a> {
    pub(super) grid: &'a PanoramaGrid,
    pub(super) mid: Lattice,
    /// The wall of these rows.
    pub(super) surface: &'a SurfaceWindow<'a>,
    /// First texel row.
    pub(super) v0: usize,
}

impl TexelRows<'_> {
    /// Position along the axis and on the mid lattice's rows (index position) of a texel row of the strip.
    pub(super) fn row(&self, line: usize) -> (f64, f64) {
        let x_m = self.grid.x_m((self.v0 + line) as f64 + 0.5);
        (x_m, (x_m - self.mid.x0_m) / self.mid.step_x_m - 0.5)
    }

    /// Heights of the wall at a texel row, per texel.
    pub(super) fn heights_m(&self, x_m: f64) -> Vec<f64> {
        let line = self.surface.line(x_m);
        (0..self.grid.width_px).map(|texel| line.at(self.grid.s_m(texel as f64 + 0.5))).collect()
    }

    /// Position of a texel column on the mid lattice's columns (index position).
    pub(super) fn column(&self, texel: i64) -> f64 {
        self.grid.s_m(texel as f64 + 0.5) / self.mid.step_s_m - 0.5
    }
}

/// A photo made ready for the texels of one strip.
pub(super) struct FineSource<'a> {
    pub(super) view: &'a View,
    pub(super) layer: &'a Layer,
    pub(super) shares: &'a Shares,
    pub(super) mips: &'a Mips,
    pub(super) curve: &'a ToneCurve,
    pub(super) usable: &'a Usable,
    taps: Vec<Tap>,
}

/// A texel column as one photo sees it.
struct Tap {
    /// Column of the panorama.
    texel: usize,
    /// Left one of the two mid cells (column within the layer) between which the texel lies.
    mid: usize,
    /// Share of the right one.
    share: f32,
    /// The wall at x = 0 in the camera frame.
    in_cam: Vector3<f64>,
    /// The wall's normal in the camera frame.
    inwards: Vector3<f64>,
}

impl<'a> FineSource<'a> {
    pub(super) fn new(
        view: &'a View,
        layer: &'a Layer,
        shares: &'a Shares,
        photo: (&'a Mips, &'a ToneCurve, &'a Usable),
        texels: &TexelRows,
    ) -> Self {
        let (mips, curve, usable) = photo;
        let region = layer.region.finer();
        let texels_per_mid = texels.mid.step_s_m / texels.grid.texel_m();
        let first = ((region.column0 as f64) * texels_per_mid).floor() as i64 - 1;
        let last = ((region.column0 + region.columns as i64) as f64 * texels_per_mid).ceil() as i64 + 1;
        let taps = (first..last.min(first + texels.grid.width_px as i64))
            .filter_map(|texel| {
                let position = texels.column(texel) - region.column0 as f64;
                let mid = position.floor();
                let inside = mid >= 0.0 && (mid as usize) + 1 < region.columns;
                inside.then(|| {
                    let wall = wall_at(texels.surface.profile(), texels.grid.s_m(texel as f64 + 0.5));
                    Tap {
                        texel: texel.rem_euclid(texels.grid.width_px as i64) as usize,
                        mid: mid as usize,
                        share: (position - mid) as f32,
                        in_cam: view.section_in_cam(wall.point),
                        inwards: view.turned_into_cam(&Vector3::new(0.0, wall.normal.x, wall.normal.y)),
                    }
                })
            })
            .collect();
        Self { view, layer, shares, mips, curve, usable, taps }
    }

    /// Adds the photo's detail to one row of texels; the fourth number gathers the weight.
    fn add_row(&self, x_m: f64, heights_m: &[f64], mid_position: f64, texels: &mut [Rgbx]) {
        let shares = self.shares;
        let floor = mid_position.floor();
        let (row, down) = (floor as i64, (mid_position - floor) as f32);
        let last_row = shares.row0 as i64 + shares.rows as i64 - 1;
        let lines = [row, row + 1].map(|row| row.clamp(shares.row0 as i64, last_row) as usize);
        if row < shares.row0 as i64 - 1 || row > last_row {
            return;
        }
        let columns = shares.columns;
        let share_line = |line: usize| &shares.fine[(line - shares.row0) * columns..][..columns];
        let weights: Vec<f32> =
            share_line(lines[0]).iter().zip(share_line(lines[1])).map(|(a, b)| a + down * (b - a)).collect();
        let Some(first) = weights.iter().position(|&weight| weight > LEAST_WEIGHT) else { return };
        let last = weights.iter().rposition(|&weight| weight > LEAST_WEIGHT).unwrap_or(first);
        let region = self.layer.region.finer();
        let start = |line: usize| (line - region.row0) * region.columns;
        let bases: Vec<Rgbx> = self.layer.colour[start(lines[0])..][..columns]
            .iter()
            .zip(&self.layer.colour[start(lines[1])..][..columns])
            .map(|(a, b)| std::array::from_fn(|i| a[i] + down * (b[i] - a[i])))
            .collect();
        let octaves = &self.layer.octaves[start(lines[0])..][..columns];
        let offset = self.view.forward_in_cam() * x_m;
        let from = self.taps.partition_point(|tap| tap.mid + 1 < first);
        for tap in self.taps[from..].iter().take_while(|tap| tap.mid <= last) {
            let weight = weights[tap.mid] + tap.share * (weights[tap.mid + 1] - weights[tap.mid]);
            if weight <= LEAST_WEIGHT {
                continue;
            }
            let in_cam = tap.in_cam + offset + tap.inwards * heights_m[tap.texel];
            let Some(pixel) = self.view.camera.project(&in_cam) else { continue };
            let (u, v) = (pixel.x as f32, pixel.y as f32);
            if self.usable.clearance_px(u, v) <= 0.0 {
                continue;
            }
            let colour = self.curve.evened(self.mips.sample(u, v, octaves[tap.mid]), [u, v]);
            let (left, right) = (bases[tap.mid], bases[tap.mid + 1]);
            let texel = &mut texels[tap.texel];
            for channel in 0..3 {
                let base = left[channel] + tap.share * (right[channel] - left[channel]);
                texel[channel] += weight * (colour[channel] - base);
            }
            texel[3] += weight;
        }
    }
}

/// Adds the photos' detail to the strip's texels (row by row, the whole width).
pub(super) fn add_detail(sources: &[FineSource], texels: &TexelRows, detail: &mut [Rgbx]) {
    detail.par_chunks_mut(texels.grid.width_px).enumerate().for_each(|(line, row)| {
        let (x_m, position) = texels.row(line);
        let heights_m = texels.heights_m(x_m);
        for source in sources {
            source.add_row(x_m, &heights_m, position, row);
        }
    });
}

/// Puts the lower bands under the detail: 8-bit red, green, blue, opacity, row by row. Where the weight is negative the detail is the
/// whole colour.
pub(super) fn finish(detail: &[Rgbx], composite: &Composite, texels: &TexelRows) -> Vec<u8> {
    let width = texels.grid.width_px;
    let columns = composite.band.mid_columns();
    let rows = composite.band.mid_rows();
    let taps: Vec<(usize, usize, f32)> = (0..width as i64)
        .map(|texel| {
            let position = texels.column(texel);
            let left = position.floor() as i64;
            let wrap = |column: i64| column.rem_euclid(columns as i64) as usize;
            (wrap(left), wrap(left + 1), (position - position.floor()) as f32)
        })
        .collect();
    let mut out = vec![0; detail.len() * 4];
    let lines = out.par_chunks_mut(width * 4).zip(detail.par_chunks(width)).enumerate();
    lines.for_each(|(line, (out, detail))| {
        let position = texels.row(line).1 - composite.band.mid_row0() as f64;
        let row = position.floor() as i64;
        let down = (position - position.floor()) as f32;
        let source = |row: i64| &composite.colour[row.clamp(0, rows as i64 - 1) as usize * columns..][..columns];
        let base: Vec<Rgbx> = source(row).iter().zip(source(row + 1)).map(|(a, b)| mix_known(a, b, down)).collect();
        for ((out, detail), &(left, right, across)) in out.chunks_exact_mut(4).zip(detail).zip(&taps) {
            if detail[3] != 0.0 {
                let base = if detail[3] > 0.0 { mix_known(&base[left], &base[right], across) } else { [0.0; 4] };
                for channel in 0..3 {
                    let value = base[channel] + detail[channel] / detail[3].abs();
                    out[channel] = value.round().clamp(0.0, 255.0) as u8;
                }
                out[3] = 255;
            }
        }
    });
    out
}

/// Interpolates colours of which either may be unknown (fourth number 0).
fn mix_known(a: &Rgbx, b: &Rgbx, share: f32) -> Rgbx {
    match (a[3] > 0.0, b[3] > 0.0) {
        (true, false) => *a,
        (false, true) => *b,
        _ => std::array::from_fn(|i| a[i] + share * (b[i] - a[i])),
    }
}
