//! What has become of a tunnel between two surveys: a bulge and a stain, so that a comparison has something to find.

use serde::Serialize;

use crate::scene::BulgeConfig;
use crate::scene::paint::{LiningPaint, Paint, Patch, Rgb};

/// Where the changes lie, as shares of the perimeter (clockwise from the crown) and of the way flown.
const BULGE_AT: [f64; 2] = [0.62, 0.5];
const STAIN_AT: [f64; 2] = [0.15, 0.6];

/// A round damp patch.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Stain {
    /// Arc length of its centre from the crown, clockwise looking forward.
    pub s_m: f64,
    /// Station of its centre.
    pub x_m: f64,
    /// Its radius.
    pub radius_m: f64,
    /// Factor on the albedo.
    pub albedo: f32,
}

/// What has changed since the tunnel was surveyed first.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Changes {
    /// The wall came in.
    pub bulge: BulgeConfig,
    /// The wall became dark.
    pub stain: Stain,
}

impl Changes {
    pub(super) fn new(perimeter_m: f64, length_m: f64) -> Self {
        Self {
            bulge: BulgeConfig {
                s_m: BULGE_AT[0] * perimeter_m,
                x_m: BULGE_AT[1] * length_m,
                height_mm: 30.0,
                sigma_m: 0.15,
            },
            stain: Stain { s_m: STAIN_AT[0] * perimeter_m, x_m: STAIN_AT[1] * length_m, radius_m: 0.12, albedo: 0.45 },
        }
    }
}

/// A lining with a stain on it.
pub(super) struct Stained {
    pub(super) lining: LiningPaint,
    pub(super) stain: Stain,
    pub(super) perimeter_m: f64,
}

impl Paint for Stained {
    fn mean_albedo(&self, whole: &Patch, samples: &[Patch]) -> Rgb {
        let around_m = whole.s_m - self.stain.s_m;
        let around_m = around_m - (around_m / self.perimeter_m).round() * self.perimeter_m;
        let inside_m = self.stain.radius_m - around_m.hypot(whole.x_m - self.stain.x_m);
        // Damp spreads: a soft edge of two centimetres.
        let share = (inside_m / 0.02 + 0.5).clamp(0.0, 1.0) as f32;
        let factor = 1.0 + share * (self.stain.albedo - 1.0);
        self.lining.mean_albedo(whole, samples).map(|value| value * factor)
    }
}
