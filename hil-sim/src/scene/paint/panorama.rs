//! A picture as of a panorama photo: sky, foliage and ground in patches, house fronts with windows, all scales.

use super::lattice::{Octave, Octaves, around, cell, even_count, hash, share_in_joint, signed, smooth_step, unit};
use super::{Paint, Patch, Rgb, blend, linear_of_srgb, mean, scale};

/// Width of a house front.
const HOUSE_X_M: f64 = 1.7;
/// Height of a house front.
const HOUSE_S_M: f64 = 2.1;
/// Share of the lots that are built on.
const BUILT_SHARE: f32 = 0.62;

pub(super) struct Panorama {
    seed: u32,
    houses: i32,
    house_s_m: f64,
    octaves: Octaves<10>,
    hue: [Octave; 2],
    kind: Octave,
    scenery: [Rgb; 4],
    fronts: [Rgb; 6],
    glass: [Rgb; 3],
    frame: Rgb,
}

impl Panorama {
    pub(super) fn new(perimeter_m: f64, seed: u64) -> Self {
        let (houses, house_s_m) = even_count(perimeter_m, HOUSE_S_M);
        let cells_m = [0.004, 0.009, 0.02, 0.045, 0.1, 0.22, 0.48, 1.05, 2.2, 4.6];
        let mut stream = 0;
        let octaves = cells_m.map(|cell_m| {
            stream += 1;
            // Amplitudes grow slowly with size, as in photographs.
            (Octave::new(seed, stream, perimeter_m, cell_m), 0.14 + 0.02 * stream as f32)
        });
        Self {
            seed: seed as u32,
            houses,
            house_s_m,
            octaves: Octaves(octaves),
            hue: [Octave::new(seed, 21, perimeter_m, 0.6), Octave::new(seed, 22, perimeter_m, 1.9)],
            kind: Octave::new(seed, 23, perimeter_m, 2.7),
            scenery: [[122, 156, 196], [72, 98, 52], [142, 122, 94], [208, 206, 200]].map(linear_of_srgb),
            fronts: [[188, 166, 132], [150, 92, 74], [126, 130, 136], [196, 186, 170], [104, 116, 96], [172, 128, 88]]
                .map(linear_of_srgb),
            glass: [[38, 46, 58], [92, 112, 132], [202, 178, 112]].map(linear_of_srgb),
            frame: linear_of_srgb([222, 218, 210]),
        }
    }

    fn scenery(&self, hue: [f32; 2], rough: f32) -> Rgb {
        let first = smooth_step(-0.5, 0.5, 1.4 * hue[0] + 0.4 * rough);
        let second = smooth_step(-0.4, 0.4, 1.4 * hue[1] + 0.3 * rough);
        let near = blend(self.scenery[1], self.scenery[2], first);
        let far = blend(self.scenery[0], self.scenery[3], first);
        scale(blend(near, far, second), 1.0 + 0.8 * rough)
    }

    /// A front with windows in a grid of its own and a cornice.
    fn front(&self, patch: &Patch, house: (i32, f32), plot: (i32, f32), rough: f32) -> Rgb {
        let bits = hash(self.seed ^ 0x00f1, house.0, plot.0);
        let wall = scale(self.fronts[(bits % 6) as usize], 1.0 + 0.35 * rough);
        let pitch_s = 0.30 + 0.12 * unit(bits.rotate_left(5));
        let pitch_x = 0.20 + 0.14 * unit(bits.rotate_left(13));
        let (floor, from_floor_m) = cell(f64::from(house.1) + 10.0, f64::from(pitch_s));
        let (axis, from_axis_m) = cell(f64::from(plot.1) + 10.0, f64::from(pitch_x));
        let window = |margin: f32| {
            let across = share_in_joint(from_floor_m, patch.size_s_m, pitch_s, pitch_s * (0.40 + margin));
            let along = share_in_joint(from_axis_m, patch.size_x_m, pitch_x, pitch_x * (0.46 + margin));
            (1.0 - across) * (1.0 - along)
        };
        let pane_bits = hash(bits, floor, axis);
        let lit = [0, 0, 0, 1, 1, 2][(pane_bits % 6) as usize];
        let pane = scale(self.glass[lit], 1.0 + 0.4 * signed(pane_bits.rotate_left(7)) + 0.5 * rough);
        let framed = blend(wall, self.frame, 0.8 * window(0.0));
        blend(framed, pane, window(0.12))
    }

    fn colour(&self, patch: &Patch, hue: [f32; 2], kind: f32, rough: f32) -> Rgb {
        let scenery = self.scenery(hue, rough);
        let (house, from_house_m) = cell(patch.s_m, self.house_s_m);
        let house = around(house, self.houses);
        let shift_m = f64::from(unit(hash(self.seed, house, -1))) * HOUSE_X_M;
        let (plot, from_plot_m) = cell(patch.x_m + shift_m, HOUSE_X_M);
        let bits = hash(self.seed ^ 0x0b17, house, plot);
        if unit(bits) > BUILT_SHARE {
            return scenery;
        }
        // Fronts differ in height and width; foliage may overgrow them.
        let (lot_s_m, lot_x_m) = (self.house_s_m as f32, HOUSE_X_M as f32);
        let height_m = lot_s_m * (0.55 + 0.35 * unit(bits.rotate_left(9)));
        let width_m = lot_x_m * (0.6 + 0.35 * unit(bits.rotate_left(17)));
        let across = share_in_joint(from_house_m, patch.size_s_m, lot_s_m, lot_s_m - height_m);
        let along = share_in_joint(from_plot_m, patch.size_x_m, lot_x_m, lot_x_m - width_m);
        let free = 1.0 - smooth_step(0.25, 0.45, kind + 0.35 * rough);
        let built = (1.0 - across) * (1.0 - along) * free;
        if built <= 0.0 {
            return scenery;
        }
        blend(scenery, self.front(patch, (house, from_house_m), (plot, from_plot_m), rough), built)
    }
}

impl Paint for Panorama {
    fn mean_albedo(&self, whole: &Patch, samples: &[Patch]) -> Rgb {
        let coarse = self.octaves.coarse(whole);
        let hue = [self.hue[0].at(whole), self.hue[1].at(whole)];
        let kind = self.kind.at(whole);
        mean(samples, |sample| self.colour(sample, hue, kind, coarse + self.octaves.fine(whole, sample)))
            .map(|value| value.max(0.01))
    }
}
