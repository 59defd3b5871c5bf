//! Pipes: galvanised steel with brackets, couplings and rust.

use super::lattice::{Octave, Octaves, cell, share_within, smooth_step};
use super::{Patch, Rgb, blend, linear_of_srgb, mean, scale};

/// Distance of brackets.
const BRACKET_PITCH_M: f64 = 1.5;
/// Width of a bracket.
const BRACKET_M: f32 = 0.04;

/// The surface of pipes.
pub(crate) struct Fittings {
    grain: Octaves<4>,
    rust_where: Octave,
    zinc: Rgb,
    rust: Rgb,
    bracket: Rgb,
}

impl Fittings {
    pub(crate) fn new(perimeter_m: f64, seed: u64) -> Self {
        let octave = |stream, cell_m| Octave::new(seed, stream, perimeter_m, cell_m);
        Self {
            grain: Octaves([
                (octave(1, 0.006), 0.07),
                (octave(2, 0.02), 0.07),
                (octave(3, 0.07), 0.06),
                (octave(4, 0.3), 0.06),
            ]),
            rust_where: octave(5, 0.25),
            zinc: linear_of_srgb([128, 132, 134]),
            rust: linear_of_srgb([116, 72, 48]),
            bracket: linear_of_srgb([58, 58, 60]),
        }
    }

    /// Mean albedo of `whole`, judged by samples in it; `s_m` is that of the lining behind the pipe.
    pub(crate) fn mean_albedo(&self, whole: &Patch, samples: &[Patch]) -> Rgb {
        let coarse_grain = self.grain.coarse(whole);
        let rust_here = self.rust_where.at(whole);
        mean(samples, |sample| {
            let grain = coarse_grain + self.grain.fine(whole, sample);
            let rust = smooth_step(0.2, 0.6, rust_here + 2.0 * grain);
            let (_, from_bracket_m) = cell(sample.x_m, BRACKET_PITCH_M);
            let bracket = share_within(from_bracket_m, sample.size_x_m, -0.5 * BRACKET_M, 0.5 * BRACKET_M);
            let metal = scale(blend(self.zinc, self.rust, 0.8 * rust), 1.0 + 1.5 * grain);
            blend(metal, self.bracket, bracket)
        })
    }
}
