//! Corners to a few hundredths of a pixel: the point that every gradient around it is perpendicular to the way to (Förstner
//! and Gülch, "A fast operator for detection and precise location of distinct points", 1987).
//!
//! A crossing of two lines looks the same after half a turn about its point, through any blur and any tone curve, and so does
//! the weighted sum: the estimate has no bias but from the bending of the lines within the window. A wide lens bends them
//! outwards everywhere, and 0.01 px that all corners have in common is ten times what their scatter would leave of the
//! distortion's error: so the bending, known from the neighbours, is taken out of the pixels' places first.

use nalgebra::{Matrix2, Vector2};

use crate::raster::Grey;

/// Half the window in squares, and the least and the most in pixels: below, noise decides; above, nothing is gained.
const HALF_PX: [f64; 2] = [2.0, 10.0];
/// The window's weight falls to exp(-2) at its half; the sum ends where this square of that distance is reached.
const END: f64 = 2.0;
/// Farther from its start than this share of a square a corner is not the one that was meant.
const FARTHEST: f64 = 0.25;
const ITERATIONS: usize = 30;
const ENOUGH_PX: f64 = 1e-4;

/// The image of the board around a corner, to second order in squares from it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Surroundings {
    /// Columns: the ways to the next corner of the row, and of the column.
    pub(super) steps: Matrix2<f64>,
    /// By how much the ways change from one square to the next, along rows and along columns.
    pub(super) bends: [Vector2<f64>; 2],
}

/// Moves a corner (in samples: (0, 0) is the first one) to where its edges cross; `None` if it runs away or the window leaves
/// the image. The half window is `share` squares wide.
pub(super) fn refined(image: &Grey, start: Vector2<f64>, around: &Surroundings, share: f64) -> Option<Vector2<f64>> {
    let squares_from_px = around.steps.try_inverse()?;
    let lengths = [0, 1].map(|axis| around.steps.column(axis).norm());
    let halves = lengths.map(|length| (share * length).clamp(HALF_PX[0], HALF_PX[1]) / length);
    let window = Window { around, squares_from_px, halves };
    let reach = Vector2::from_fn(|axis, _| {
        let half = |way: usize| around.steps[(axis, way)] * halves[way];
        (END.sqrt() * half(0).hypot(half(1))).ceil()
    });
    let farthest_px = FARTHEST * lengths[0].min(lengths[1]).max(2.0 * HALF_PX[0]);
    let last = Vector2::new(image.width as f64, image.height as f64) - Vector2::repeat(2.0);
    let mut at = start;
    for _ in 0..ITERATIONS {
        let (low, high) = (at - reach, at + reach);
        if !(low.min() >= 1.0 && high.x <= last.x && high.y <= last.y) {
            return None;
        }
        let step = window.step(image, at, reach)?;
        at += step;
        if (at - start).norm() > farthest_px {
            return None;
        }
        if step.norm() < ENOUGH_PX {
            return Some(at);
        }
    }
    None
}

struct Window<'a> {
    around: &'a Surroundings,
    squares_from_px: Matrix2<f64>,
    /// Half the window along each way, squares.
    halves: [f64; 2],
}

impl Window<'_> {
    /// Solves `sum w g g' (q - p) = 0` for the corner `q` over the window's pixels `p`, relative to `middle`.
    fn step(&self, image: &Grey, middle: Vector2<f64>, reach: Vector2<f64>) -> Option<Vector2<f64>> {
        let mut normal = Matrix2::zeros();
        let mut right = Vector2::zeros();
        let range = |axis: usize| {
            let (from, to) = (middle[axis] - reach[axis], middle[axis] + reach[axis]);
            from.ceil() as usize..=to.floor() as usize
        };
        for row in range(1) {
            for column in range(0) {
                let offset = Vector2::new(column as f64, row as f64) - middle;
                let squares = self.squares_from_px * offset;
                let distance = (0..2).map(|way| (squares[way] / self.halves[way]).powi(2)).sum::<f64>();
                if distance > END {
                    continue;
                }
                let (straight, turned) = self.straightened(offset, &squares)?;
                let value = |c: usize, r: usize| f64::from(image.at(c, r)[0]);
                let gradient = Vector2::new(
                    value(column + 1, row) - value(column - 1, row),
                    value(column, row + 1) - value(column, row - 1),
                );
                let gradient = turned * gradient;
                let product = gradient * gradient.transpose() * (-2.0 * distance).exp();
                normal += product;
                right += product * straight;
            }
        }
        Some(normal.try_inverse()? * right)
    }

    /// Where a pixel would lie if lines were straight, and what turns a gradient there (the inverse transpose of the
    /// derivative): the parabola of the row's line and of the column's taken off.
    fn straightened(&self, offset: Vector2<f64>, squares: &Vector2<f64>) -> Option<(Vector2<f64>, Matrix2<f64>)> {
        let mut straight = offset;
        let mut derivative = Matrix2::identity();
        for way in 0..2 {
            let bend = self.around.bends[way];
            straight -= bend * (0.5 * squares[way] * squares[way]);
            derivative -= bend * self.squares_from_px.row(way) * squares[way];
        }
        Some((straight, derivative.try_inverse()?.transpose()))
    }
}
