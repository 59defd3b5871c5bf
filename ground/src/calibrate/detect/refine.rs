//! Corners to a fraction of a pixel: the point that every gradient around it is perpendicular to the way to (Förstner and
//! Gülch, "A fast operator for detection and precise location of distinct points", 1987).
//!
//! A crossing of two lines looks the same after half a turn about its point, through any blur and any tone curve, and so does
//! the weighted sum: the estimate has no bias but from the bending of the lines within the window, which is therefore small.

use nalgebra::{Matrix2, Vector2};

use super::saddle::bilinear;
use crate::raster::Grey;

/// Half the window as a share of the distance to the nearest corner of the board.
const SHARE: f64 = 0.3;
/// Smallest and largest half window, pixels: below, noise decides; above, the lens bends the lines.
const HALF_PX: [f64; 2] = [3.0, 10.0];
/// Half windows tried where squares are so slanted that their other sides come into the window, as shares of the first.
const NARROWER: [f64; 3] = [1.0, 0.7, 0.5];
const ITERATIONS: usize = 30;
const ENOUGH_PX: f64 = 1e-4;

/// Moves a corner (in samples: (0, 0) is the first one) to where its edges cross; `None` if it runs away or the window leaves
/// the image.
pub(super) fn refined(image: &Grey, start: Vector2<f64>, nearest_px: f64) -> Option<Vector2<f64>> {
    let half_px = (SHARE * nearest_px).clamp(HALF_PX[0], HALF_PX[1]);
    NARROWER.iter().find_map(|share| within(image, start, share * half_px))
}

fn within(image: &Grey, start: Vector2<f64>, half_px: f64) -> Option<Vector2<f64>> {
    let reach = half_px.ceil() as i32;
    let last = Vector2::new(image.width as f64 - 1.0, image.height as f64 - 1.0);
    let mut at = start;
    for _ in 0..ITERATIONS {
        let margin = f64::from(reach) + 1.0;
        if !(at.x >= margin && at.y >= margin && at.x <= last.x - margin && at.y <= last.y - margin) {
            return None;
        }
        let step = step(image, at, reach, half_px)?;
        at += step;
        if (at - start).norm() > half_px {
            return None;
        }
        if step.norm() < ENOUGH_PX {
            break;
        }
    }
    Some(at)
}

/// Solves `sum w g g' (q - p) = 0` for the corner `q` over the window's places `p`, relative to the window's middle.
fn step(image: &Grey, middle: Vector2<f64>, reach: i32, half_px: f64) -> Option<Vector2<f64>> {
    let mut normal = Matrix2::zeros();
    let mut right = Vector2::zeros();
    let falloff = -2.0 / (half_px * half_px);
    for dy in -reach..=reach {
        for dx in -reach..=reach {
            let offset = Vector2::new(f64::from(dx), f64::from(dy));
            let at = middle + offset;
            let value = |x: f64, y: f64| bilinear(image, at + Vector2::new(x, y));
            let gradient = Vector2::new(value(1.0, 0.0) - value(-1.0, 0.0), value(0.0, 1.0) - value(0.0, -1.0));
            let product = gradient * gradient.transpose() * (falloff * offset.norm_squared()).exp();
            normal += product;
            right += product * offset;
        }
    }
    Some(normal.try_inverse()? * right)
}
