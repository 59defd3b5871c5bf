//! The height field by which a real wall differs from its profile: ovality, ring steps, bulges, undulation.
//!
//! Heights are along the profile's normal, positive inwards (towards the axis), in metres, over arc length `s` and
//! station `x`. Near the profile's corners the field fades to zero, so that the displaced faces still meet.

use serde::{Deserialize, Serialize};

use super::noise;

/// A Gaussian bulge of the wall.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BulgeConfig {
    /// Arc length of its centre from the crown, clockwise looking forward.
    pub s_m: f64,
    /// Station of its centre.
    pub x_m: f64,
    /// Height at the centre, positive inwards; negative for a hollow.
    pub height_mm: f64,
    /// Standard deviation of the Gaussian, in both directions.
    pub sigma_m: f64,
}

/// Height and slopes of the relief at one place.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Height {
    /// Height over the profile, positive inwards.
    pub height_m: f64,
    /// Derivative with respect to arc length.
    pub d_s: f64,
    /// Derivative with respect to the station; at a ring joint that of the ring itself.
    pub d_x: f64,
}

/// The relief of a wall, ready for evaluation.
#[derive(Clone, Debug, PartialEq)]
pub struct Relief {
    pub(super) perimeter_m: f64,
    pub(super) ovality_m: f64,
    pub(super) ring: Option<Rings>,
    pub(super) undulation: Option<Undulation>,
    pub(super) bulges: Vec<Bulge>,
    /// Arc lengths of the profile's corners.
    pub(super) corners_s_m: Vec<f64>,
    pub(super) corner_fade_m: f64,
}

/// Rings of a lining, each set in or out by its own amount.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Rings {
    pub(super) length_m: f64,
    pub(super) step_m: f64,
    pub(super) seed: u64,
}

/// Smooth irregularity.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Undulation {
    pub(super) amplitude_m: f64,
    /// Lattice cells around the section.
    pub(super) cells: i64,
    pub(super) cell_s_m: f64,
    pub(super) cell_x_m: f64,
    pub(super) seed: u64,
}

#[derive(Clone, Copy, Debug, PartialEq)]
#[expect(clippy::struct_field_names, reason = "units stand last in names")]
pub(super) struct Bulge {
    pub(super) s_m: f64,
    pub(super) x_m: f64,
    pub(super) height_m: f64,
    pub(super) sigma_m: f64,
}

/// Beyond this many standard deviations a bulge counts as flat: `exp(-18)` of 100 mm is 2 nanometres.
const BULGE_REACH_SIGMAS: f64 = 6.0;

/// Within this many standard deviations of its middle a bulge counts with its whole height.
const BULGE_CORE_SIGMAS: f64 = 3.0;

impl Relief {
    /// Tells whether the wall is its profile exactly.
    pub fn is_flat(&self) -> bool {
        self.ovality_m == 0.0 && self.ring.is_none() && self.undulation.is_none() && self.bulges.is_empty()
    }

    /// Returns a height that the relief exceeds nowhere, in either sense.
    ///
    /// Bulges count together where they are near enough to each other to add up.
    pub fn bound_m(&self) -> f64 {
        self.ovality_m.abs()
            + self.ring.map_or(0.0, |ring| ring.step_m.abs())
            + self.undulation.map_or(0.0, |undulation| undulation.amplitude_m.abs())
            + self.bulges_bound_m()
    }

    /// At a point within [`BULGE_CORE_SIGMAS`] of some bulge only bulges whose cores overlap that one's can be near too;
    /// all others have fallen to `exp(-4.5)` of their height.
    fn bulges_bound_m(&self) -> f64 {
        let far_share = (-0.5 * BULGE_CORE_SIGMAS * BULGE_CORE_SIGMAS).exp();
        let together_m = |one: &Bulge| -> f64 {
            let share = |other: &&Bulge| {
                let away_m = self.shortest_way(one.s_m - other.s_m).hypot(one.x_m - other.x_m);
                away_m <= BULGE_CORE_SIGMAS * (one.sigma_m + other.sigma_m)
            };
            self.bulges.iter().filter(share).map(|bulge| bulge.height_m.abs()).sum()
        };
        let all_m: f64 = self.bulges.iter().map(|bulge| bulge.height_m.abs()).sum();
        self.bulges.iter().map(together_m).fold(0.0, f64::max) + far_share * all_m
    }

    /// Returns the number of the ring at a station; 0 everywhere if rings do not differ.
    pub fn ring_of(&self, x_m: f64) -> i64 {
        self.ring.map_or(0, |ring| (x_m / ring.length_m).floor() as i64)
    }

    /// Returns the station of the ring joint that a ray at `x_m` meets next when it moves in the sense of `direction_x`.
    pub fn next_joint_x_m(&self, x_m: f64, direction_x: f64) -> Option<f64> {
        let ring = self.ring?;
        if direction_x == 0.0 {
            return None;
        }
        let place = x_m / ring.length_m;
        Some(if direction_x > 0.0 { place.floor() + 1.0 } else { place.ceil() - 1.0 } * ring.length_m)
    }

    /// Returns height and slopes at arc length `s_m` and station `x_m`.
    pub fn at(&self, s_m: f64, x_m: f64) -> Height {
        let mut sum = Height::default();
        if self.ovality_m != 0.0 {
            let waves = 2.0 * std::f64::consts::TAU / self.perimeter_m;
            let (sin, cos) = (waves * s_m).sin_cos();
            sum.height_m += self.ovality_m * cos;
            sum.d_s -= self.ovality_m * waves * sin;
        }
        if let Some(ring) = self.ring {
            let bits = noise::lattice_bits(ring.seed, self.ring_of(x_m), 0);
            sum.height_m += ring.step_m * f64::from(noise::signed_unit(bits));
        }
        if let Some(u) = self.undulation {
            let sample = noise::value_noise(u.seed, s_m / u.cell_s_m, x_m / u.cell_x_m, u.cells);
            sum.height_m += u.amplitude_m * sample.value;
            sum.d_s += u.amplitude_m * sample.d_column / u.cell_s_m;
            sum.d_x += u.amplitude_m * sample.d_row / u.cell_x_m;
        }
        for bulge in &self.bulges {
            let (ds, dx) = (self.shortest_way(s_m - bulge.s_m), x_m - bulge.x_m);
            let variance = bulge.sigma_m * bulge.sigma_m;
            let reach = (ds * ds + dx * dx) / variance;
            if reach < BULGE_REACH_SIGMAS * BULGE_REACH_SIGMAS {
                let height_m = bulge.height_m * (-0.5 * reach).exp();
                sum.height_m += height_m;
                sum.d_s -= height_m * ds / variance;
                sum.d_x -= height_m * dx / variance;
            }
        }
        self.fade_at_corners(s_m, sum)
    }

    fn fade_at_corners(&self, s_m: f64, full: Height) -> Height {
        let mut nearest_m = f64::INFINITY;
        for corner in &self.corners_s_m {
            let away_m = self.shortest_way(s_m - corner);
            if away_m.abs() < nearest_m.abs() {
                nearest_m = away_m;
            }
        }
        let t = nearest_m.abs() / self.corner_fade_m;
        if t >= 1.0 {
            return full;
        }
        let weight = t * t * (3.0 - 2.0 * t);
        let d_weight = 6.0 * t * (1.0 - t) / self.corner_fade_m * nearest_m.signum();
        Height {
            height_m: full.height_m * weight,
            d_s: full.d_s * weight + full.height_m * d_weight,
            d_x: full.d_x * weight,
        }
    }

    /// Brings a difference of arc lengths into half a perimeter either way.
    fn shortest_way(&self, difference_m: f64) -> f64 {
        difference_m - (difference_m / self.perimeter_m).round() * self.perimeter_m
    }
}
