//! Candidates: places where two dark and two bright sectors meet.
//!
//! The determinant of the Hessian finds them (Beaudet, "Rotationally invariant image operators", 1978: negative at a saddle),
//! a ring around each tells a corner of a chessboard from everything else: exactly four changes between dark and bright,
//! opposite ones half a turn apart (the idea of Bennett and Lasenby, "`ChESS`", CVIU 2014). No threshold depends on a photo's
//! contrast but the least one: a corner in the glare of a lamp counts as much as one in full light.

use std::f64::consts::{FRAC_PI_2, PI, TAU};

use nalgebra::{Matrix2, Vector2};

use super::super::Pattern;
use crate::features::blurred;
use crate::raster::Grey;

/// Blur before derivatives are taken, samples.
const BLUR: f32 = 1.2;
/// A candidate is the strongest within so many samples.
const APART: usize = 3;
/// Samples of a ring.
const RING: usize = 32;
/// Radii tried, the wider first: it is the less noisy one, the narrower fits small squares, the third the white between markers.
const RADII: [f64; 2] = [5.0, 3.5];
const RADII_BETWEEN_MARKERS: [f64; 3] = [5.0, 3.5, 2.5];
/// Least difference between the bright and the dark sectors, grey levels.
pub(super) const LEAST_CONTRAST: f64 = 12.0;
/// Opposite changes are half a turn apart within this; the ring's centre is a sample or less off the corner.
const STRAIGHT_RAD: f64 = 0.6;
/// The narrowest sector: a board seen at 75 degrees.
const SECTOR_RAD: f64 = 0.3;
/// Steps of Newton's iteration to the saddle point, and how far it may go, samples.
const STEPS: usize = 4;
const FARTHEST: f64 = 2.0;

/// A corner between four squares, in samples of its image: (0, 0) is the first sample.
#[derive(Clone, Copy, Debug)]
pub(super) struct Saddle {
    pub(super) at: Vector2<f64>,
    /// Directions of the two lines that cross here, modulo half a turn.
    pub(super) lines_rad: [f64; 2],
    /// Bright minus dark, grey levels.
    pub(super) contrast: f64,
}

/// An image made ready to look for saddles.
pub(super) struct Field {
    image: Grey,
    radii: &'static [f64],
}

impl Field {
    pub(super) fn new(image: &Grey, pattern: Pattern) -> Self {
        let radii: &[f64] = match pattern {
            Pattern::Chessboard => &RADII,
            Pattern::Charuco(_) => &RADII_BETWEEN_MARKERS,
        };
        Self { image: blurred(image, BLUR), radii }
    }

    /// Every saddle with the look of a chessboard's corner.
    pub(super) fn saddles(&self) -> Vec<Saddle> {
        let (width, height) = (self.image.width, self.image.height);
        let border = APART + self.radii.iter().fold(f64::MAX, |least, radius| least.min(*radius)).ceil() as usize;
        if width.min(height) <= 2 * border {
            return Vec::new();
        }
        let mut strength = Grey::new(width, height);
        for row in 1..height - 1 {
            for column in 1..width - 1 {
                let hessian = self.hessian(column, row);
                strength.set(column, row, [-(hessian.determinant() as f32)]);
            }
        }
        let mut found = Vec::new();
        for row in border..height - border {
            for column in border..width - border {
                if is_strongest(&strength, column, row)
                    && let Some(saddle) = self.saddle_near(Vector2::new(column as f64, row as f64), LEAST_CONTRAST)
                {
                    found.push(saddle);
                }
            }
        }
        found
    }

    /// The saddle nearest to a place, if one with at least this contrast is within two samples.
    pub(super) fn saddle_near(&self, start: Vector2<f64>, least_contrast: f64) -> Option<Saddle> {
        let mut at = start;
        for _ in 0..STEPS {
            if !self.is_inside(at, 2.0) {
                return None;
            }
            let (column, row) = (at.x.round() as usize, at.y.round() as usize);
            let hessian = self.hessian(column, row);
            let from_sample = at - Vector2::new(column as f64, row as f64);
            let slope = self.gradient(column, row) + hessian * from_sample;
            let step = hessian.try_inverse()? * slope;
            at -= step * (1.0_f64).min(1.0 / step.norm().max(1e-12));
            if (at - start).norm() > FARTHEST {
                return None;
            }
        }
        self.radii.iter().find_map(|&radius| self.judged(at, radius)).filter(|saddle| saddle.contrast >= least_contrast)
    }

    /// The value between samples; `None` beyond them.
    pub(super) fn value(&self, at: Vector2<f64>) -> Option<f64> {
        if !self.is_inside(at, 0.0) {
            return None;
        }
        Some(bilinear(&self.image, at))
    }

    fn is_inside(&self, at: Vector2<f64>, margin: f64) -> bool {
        let last = Vector2::new((self.image.width - 1) as f64, (self.image.height - 1) as f64);
        at.x >= margin && at.y >= margin && at.x <= last.x - margin && at.y <= last.y - margin
    }

    /// What a ring of this radius says.
    fn judged(&self, at: Vector2<f64>, radius: f64) -> Option<Saddle> {
        if !self.is_inside(at, radius) {
            return None;
        }
        let angle = |step: usize| TAU * step as f64 / RING as f64;
        let values: [f64; RING] = std::array::from_fn(|step| {
            let (sin, cos) = angle(step).sin_cos();
            bilinear(&self.image, at + Vector2::new(cos, sin) * radius)
        });
        let (low, high) = values.iter().fold((f64::MAX, f64::MIN), |(low, high), v| (low.min(*v), high.max(*v)));
        let middle = f64::midpoint(low, high);
        let mut changes = [0.0; 4];
        let mut count = 0;
        for step in 0..RING {
            let (here, next) = (values[step] - middle, values[(step + 1) % RING] - middle);
            if (here > 0.0) != (next > 0.0) {
                *changes.get_mut(count)? = angle(step) + TAU / RING as f64 * here / (here - next);
                count += 1;
            }
        }
        let sectors = [changes[1] - changes[0], changes[2] - changes[1], changes[3] - changes[2]];
        let last = TAU - (changes[3] - changes[0]);
        let straight = |from: f64, to: f64| (to - from - PI).abs() < STRAIGHT_RAD;
        if count != 4
            || sectors.into_iter().chain([last]).any(|sector| sector < SECTOR_RAD)
            || !straight(changes[0], changes[2])
            || !straight(changes[1], changes[3])
        {
            return None;
        }
        let line = |from: f64, to: f64| (f64::midpoint(from, to) + FRAC_PI_2).rem_euclid(PI);
        let lines_rad = [line(changes[0], changes[2]), line(changes[1], changes[3])];
        Some(Saddle { at, lines_rad, contrast: high - low })
    }

    fn gradient(&self, column: usize, row: usize) -> Vector2<f64> {
        let v = |c: usize, r: usize| f64::from(self.image.at(c, r)[0]);
        Vector2::new(v(column + 1, row) - v(column - 1, row), v(column, row + 1) - v(column, row - 1)) * 0.5
    }

    fn hessian(&self, column: usize, row: usize) -> Matrix2<f64> {
        let v = |c: usize, r: usize| f64::from(self.image.at(c, r)[0]);
        let here = 2.0 * v(column, row);
        let xx = v(column + 1, row) + v(column - 1, row) - here;
        let yy = v(column, row + 1) + v(column, row - 1) - here;
        let falling = v(column + 1, row + 1) + v(column - 1, row - 1);
        let rising = v(column + 1, row - 1) + v(column - 1, row + 1);
        let xy = 0.25 * (falling - rising);
        Matrix2::new(xx, xy, xy, yy)
    }
}

/// Strongest of its surroundings, and a saddle at all.
fn is_strongest(strength: &Grey, column: usize, row: usize) -> bool {
    let [here] = strength.at(column, row);
    // Flatter than a corner of the least contrast can be, by far.
    if here < 0.05 {
        return false;
    }
    let around = |r: usize| {
        let line = &strength.data[r * strength.width..][column - APART..=column + APART];
        line.iter().enumerate().all(|(c, value)| *value < here || (r == row && c == APART))
    };
    (row - APART..=row + APART).all(around)
}

/// The value between four samples. Must be within the image.
pub(super) fn bilinear(image: &Grey, at: Vector2<f64>) -> f64 {
    let column = (at.x.max(0.0) as usize).min(image.width.saturating_sub(2));
    let row = (at.y.max(0.0) as usize).min(image.height.saturating_sub(2));
    let (u, v) = (at.x - column as f64, at.y - row as f64);
    let sample = |c: usize, r: usize| f64::from(image.at(c, r)[0]);
    let above = sample(column, row) * (1.0 - u) + sample(column + 1, row) * u;
    let below = sample(column, row + 1) * (1.0 - u) + sample(column + 1, row + 1) * u;
    above * (1.0 - v) + below * v
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two lines through `(20.3, 19.6)` in these directions, dark and bright by turns, drawn with 16 x 16 samples per pixel.
    fn crossing(lines_rad: [f64; 2], contrast: f64) -> Grey {
        let mut image = Grey::new(41, 41);
        let normals = lines_rad.map(|angle| Vector2::new(-angle.sin(), angle.cos()));
        for row in 0..41 {
            for column in 0..41 {
                let bright = (0..256).filter(|sub| {
                    let offset = |step: i32| (f64::from(step) + 0.5) / 16.0 - 0.5;
                    let at = Vector2::new(column as f64 + offset(sub % 16), row as f64 + offset(sub / 16));
                    let from_corner = at - Vector2::new(20.3, 19.6);
                    (normals[0].dot(&from_corner) > 0.0) != (normals[1].dot(&from_corner) > 0.0)
                });
                image.set(column, row, [100.0 + (contrast * bright.count() as f64 / 256.0) as f32]);
            }
        }
        image
    }

    #[test]
    fn a_crossing_is_found_once_with_its_lines_whatever_its_contrast() {
        for contrast in [25.0, 150.0] {
            let wanted = [0.2, 1.3];
            let found = Field::new(&crossing(wanted, contrast), Pattern::Chessboard).saddles();
            assert_eq!(found.len(), 1, "{found:?}");
            assert!((found[0].at - Vector2::new(20.3, 19.6)).norm() < 0.3, "{found:?}");
            for line in wanted {
                let off = |found: f64| (found - line + FRAC_PI_2).rem_euclid(PI) - FRAC_PI_2;
                assert!(found[0].lines_rad.iter().any(|found| off(*found).abs() < 0.1), "{found:?}");
            }
        }
    }

    #[test]
    fn edges_corners_spots_and_faint_crossings_are_none() {
        let mut edge = Grey::new(41, 41);
        let mut square = Grey::new(41, 41);
        let mut spot = Grey::new(41, 41);
        for row in 0..41 {
            for column in 0..41 {
                edge.set(column, row, [if column + row / 3 > 25 { 200.0 } else { 20.0 }]);
                square.set(column, row, [if column > 20 && row > 20 { 200.0 } else { 20.0 }]);
                let r2 = (column as f32 - 20.0).powi(2) + (row as f32 - 20.0).powi(2);
                spot.set(column, row, [200.0 * (-r2 / 18.0).exp()]);
            }
        }
        for image in [edge, square, spot, crossing([0.2, 1.3], 6.0)] {
            assert!(Field::new(&image, Pattern::Chessboard).saddles().is_empty());
        }
    }
}
