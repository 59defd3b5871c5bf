//! Cast concrete: a nearly even grey with formwork joints, tie holes, pores, hairline cracks and stains.

use super::lattice::{Octave, Octaves, around, cell, even_count, hash, share_in_joint, signed, smooth_step, unit};
use super::{Paint, Patch, Rgb, blend, linear_of_srgb, mean, scale};

/// Length of a formwork panel along the tunnel.
const PANEL_X_M: f64 = 2.4;
/// Height of a formwork panel around the section.
const PANEL_S_M: f64 = 1.2;
/// Width of the mark that a formwork joint leaves.
const JOINT_M: f32 = 0.004;
/// Cells that may hold one pore each.
const PORE_CELL_M: f64 = 0.05;
/// Width of the widest crack.
const CRACK_M: f32 = 0.002;
/// Lattice of the crack lines.
const CRACK_CELL_M: f64 = 1.1;

pub(super) struct Concrete {
    seed: u32,
    panels: i32,
    panel_s_m: f64,
    pore_columns: i32,
    pore_s_m: f64,
    cloud: Octaves<6>,
    streak: Octave,
    crack: [Octave; 2],
    crack_where: Octave,
    grey: Rgb,
    rust: Rgb,
}

impl Concrete {
    pub(super) fn new(perimeter_m: f64, seed: u64) -> Self {
        let (panels, panel_s_m) = even_count(perimeter_m, PANEL_S_M);
        let (pore_columns, pore_s_m) = even_count(perimeter_m, PORE_CELL_M);
        let octave = |stream, cell_m| Octave::new(seed, stream, perimeter_m, cell_m);
        Self {
            seed: seed as u32,
            panels,
            panel_s_m,
            pore_columns,
            pore_s_m,
            cloud: Octaves([
                (octave(1, 0.006), 0.030),
                (octave(2, 0.02), 0.030),
                (octave(3, 0.07), 0.030),
                (octave(4, 0.25), 0.035),
                (octave(5, 0.9), 0.045),
                (octave(6, 3.1), 0.050),
            ]),
            streak: Octave::stretched(seed, 7, perimeter_m, 1.6, 0.22),
            crack: [octave(8, CRACK_CELL_M), octave(9, 0.13)],
            crack_where: octave(10, 1.7),
            grey: linear_of_srgb([150, 150, 145]),
            rust: linear_of_srgb([128, 100, 78]),
        }
    }

    /// Share of the patch that lies in a crack: the zero line of a noise field, widened to its true width.
    fn crack_share(&self, patch: &Patch) -> f32 {
        let presence = smooth_step(0.0, 0.3, self.crack_where.full(patch.s_m, patch.x_m));
        if presence <= 0.0 {
            return 0.0;
        }
        let field = |s_m: f64, x_m: f64| self.crack[0].full(s_m, x_m) + 0.10 * self.crack[1].full(s_m, x_m);
        let here = field(patch.s_m, patch.x_m);
        if here.abs() > 0.12 {
            return 0.0;
        }
        let reach_m = 0.004;
        let slope_s = (field(patch.s_m + reach_m, patch.x_m) - here) / reach_m as f32;
        let slope_x = (field(patch.s_m, patch.x_m + reach_m) - here) / reach_m as f32;
        let distance_m = here.abs() / length(slope_s, slope_x).max(0.2);
        let size_m = patch.size_m();
        super::lattice::share_within(distance_m, size_m, -0.5 * CRACK_M * presence, 0.5 * CRACK_M * presence)
    }

    /// Share of the patch that lies in a pore.
    fn pore_share(&self, patch: &Patch) -> f32 {
        let (column, from_s_m) = cell(patch.s_m, self.pore_s_m);
        let (row, from_x_m) = cell(patch.x_m, PORE_CELL_M);
        let bits = hash(self.seed ^ 0x9072, around(column, self.pore_columns), row);
        if unit(bits) > 0.35 {
            return 0.0;
        }
        let radius_m = 0.0012 + 0.0045 * unit(bits.wrapping_mul(0x9e37_79b1)).powi(3);
        let place = |turn: u32| 0.018 * signed(bits.wrapping_mul(0x85eb_ca77).rotate_left(turn));
        let distance_m = length(from_s_m - place(7), from_x_m - place(19));
        let size_m = patch.size_m();
        let cover = (2.0 * radius_m / size_m).min(1.0);
        cover * ((radius_m - distance_m) / size_m + 0.5).clamp(0.0, 1.0)
    }

    fn tie_hole_share(from_s_m: f32, from_x_m: f32, patch: &Patch) -> f32 {
        let (ds, dx) = (from_s_m.abs() - 0.35, from_x_m.abs() - 0.7);
        let size_m = patch.size_m();
        ((0.012 - length(ds, dx)) / size_m + 0.5).clamp(0.0, 1.0)
    }
}

impl Paint for Concrete {
    fn mean_albedo(&self, whole: &Patch, samples: &[Patch]) -> Rgb {
        let coarse_cloud = self.cloud.coarse(whole);
        let streak = 0.22 * smooth_step(0.35, 0.8, self.streak.at(whole));
        let crack = 1.0 - 0.80 * self.crack_share(whole);
        mean(samples, |sample| {
            let cloud = coarse_cloud + self.cloud.fine(whole, sample);
            let (column, from_s_m) = cell(sample.s_m, self.panel_s_m);
            let (row, from_x_m) = cell(sample.x_m, PANEL_X_M);
            let panel = signed(hash(self.seed, around(column, self.panels), row));
            let joint_s = share_in_joint(from_s_m, sample.size_s_m, self.panel_s_m as f32, JOINT_M);
            let joint_x = share_in_joint(from_x_m, sample.size_x_m, PANEL_X_M as f32, JOINT_M);
            let joint = 1.0 - (1.0 - joint_s) * (1.0 - joint_x);
            let hole = self.pore_share(sample).max(Self::tie_hole_share(from_s_m, from_x_m, sample));
            let base = scale(self.grey, 1.0 + 1.4 * cloud + 0.035 * panel);
            let stained = blend(base, self.rust, streak);
            scale(stained, (1.0 - 0.55 * joint) * crack * (1.0 - 0.65 * hole))
        })
    }
}

/// Euclidean length; `hypot` guards against overflows that cannot occur here, at ten times the cost.
fn length(a: f32, b: f32) -> f32 {
    (a * a + b * b).sqrt()
}
