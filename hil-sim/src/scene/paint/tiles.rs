//! Glazed tiles in a straight grid: a pattern that repeats, with few tiles that differ.

use super::lattice::{Octave, Octaves, around, cell, even_count, hash, share_in_joint, signed, unit};
use super::{Paint, Patch, Rgb, blend, linear_of_srgb, mean, scale};

/// Edge of a tile with its joint.
const PITCH_M: f64 = 0.15;
/// Grout.
const JOINT_M: f32 = 0.003;

pub(super) struct Tiles {
    seed: u32,
    columns: i32,
    pitch_s_m: f64,
    grain: Octaves<3>,
    dirt: Octaves<3>,
    glaze: [Rgb; 3],
    grout: Rgb,
}

impl Tiles {
    pub(super) fn new(perimeter_m: f64, seed: u64) -> Self {
        let (columns, pitch_s_m) = even_count(perimeter_m, PITCH_M);
        let octave = |stream, cell_m| Octave::new(seed, stream, perimeter_m, cell_m);
        Self {
            seed: seed as u32,
            columns,
            pitch_s_m,
            grain: Octaves([(octave(1, 0.005), 0.02), (octave(2, 0.018), 0.02), (octave(3, 0.06), 0.02)]),
            dirt: Octaves([(octave(4, 0.05), 0.05), (octave(5, 0.3), 0.08), (octave(6, 1.4), 0.10)]),
            glaze: [[206, 203, 192], [70, 104, 112], [176, 150, 96]].map(linear_of_srgb),
            grout: linear_of_srgb([118, 114, 108]),
        }
    }
}

impl Paint for Tiles {
    fn mean_albedo(&self, whole: &Patch, samples: &[Patch]) -> Rgb {
        let coarse_grain = self.grain.coarse(whole);
        let dirt = self.dirt.coarse(whole) + self.dirt.fine(whole, whole);
        mean(samples, |sample| {
            let (column, from_s_m) = cell(sample.s_m, self.pitch_s_m);
            let (row, from_x_m) = cell(sample.x_m, PITCH_M);
            let column = around(column, self.columns);
            let joint_s = share_in_joint(from_s_m, sample.size_s_m, self.pitch_s_m as f32, JOINT_M);
            let joint_x = share_in_joint(from_x_m, sample.size_x_m, PITCH_M as f32, JOINT_M);
            let joint = 1.0 - (1.0 - joint_s) * (1.0 - joint_x);
            let bits = hash(self.seed, column, row);
            // A frieze of coloured tiles every ten, and one tile in forty replaced by another.
            let kind = if unit(bits) < 0.025 { 2 } else { usize::from(column % 10 == 0) };
            let grain = coarse_grain + self.grain.fine(whole, sample);
            let tile = scale(self.glaze[kind], 1.0 + 0.06 * signed(bits.rotate_left(9)) + grain);
            scale(blend(tile, self.grout, joint), 1.0 + dirt)
        })
    }
}
