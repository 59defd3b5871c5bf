//! A piece of the image whose rays meet one smooth face, so that the wall can be interpolated between its corners.

use nalgebra::Vector3;

use crate::scene::Surface;

/// Corners whose normals differ by more than this cosine are not interpolated between.
const SAME_FACE_COSINE: f32 = 0.97;
/// Corners further apart than this on the wall are not interpolated between.
const SAME_FACE_M: f64 = 0.3;

/// What the ray through a corner meets.
#[derive(Clone, Copy, Debug)]
pub(super) struct Corner {
    pub(super) s_m: f64,
    pub(super) x_m: f64,
    pub(super) irradiance: f32,
    pub(super) normal: Vector3<f32>,
    pub(super) surface: Surface,
}

/// A part of a cell, in shares of its width and height.
#[derive(Clone, Copy, Debug)]
pub(super) struct Window {
    pub(super) u: f64,
    pub(super) v: f64,
    pub(super) width: f64,
    pub(super) height: f64,
}

impl Window {
    /// The whole cell.
    pub(super) const WHOLE: Self = Self { u: 0.0, v: 0.0, width: 1.0, height: 1.0 };
}

/// Wall and light between four corners, bilinear.
#[derive(Clone, Copy, Debug)]
pub(super) struct Cell {
    /// `[s, x]` at the top left, then the changes along u, along v, and along both.
    origin: [f64; 2],
    du: [f64; 2],
    dv: [f64; 2],
    twist: [f64; 2],
    irradiance: [f32; 4],
    surface: Surface,
}

impl Cell {
    /// The cell between the corners top left, top right, bottom left, bottom right.
    ///
    /// `None` where they do not lie on one smooth face, and on water, whose mirror image needs rays.
    pub(super) fn new(corners: [Option<Corner>; 4], perimeter_m: f64) -> Option<Self> {
        let [a, b, c, d] = [corners[0]?, corners[1]?, corners[2]?, corners[3]?];
        if a.surface == Surface::Water {
            return None;
        }
        let step = |to: &Corner| [shortest_way(to.s_m - a.s_m, perimeter_m), to.x_m - a.x_m];
        let steps = [step(&b), step(&c), step(&d)];
        let smooth = [b, c, d].iter().zip(&steps).all(|(corner, step)| {
            corner.surface == a.surface
                && corner.normal.dot(&a.normal) > SAME_FACE_COSINE
                && step[0].abs() < SAME_FACE_M
                && step[1].abs() < SAME_FACE_M
        });
        let [du, dv, both] = steps;
        smooth.then(|| Self {
            origin: [a.s_m, a.x_m],
            du,
            dv,
            twist: [both[0] - du[0] - dv[0], both[1] - du[1] - dv[1]],
            irradiance: [a.irradiance, b.irradiance, c.irradiance, d.irradiance],
            surface: a.surface,
        })
    }

    pub(super) fn surface(&self) -> Surface {
        self.surface
    }

    /// `[s, x]` at the shares (u, v).
    pub(super) fn at(&self, u: f64, v: f64) -> [f64; 2] {
        [0, 1].map(|axis| self.origin[axis] + u * self.du[axis] + v * self.dv[axis] + u * v * self.twist[axis])
    }

    /// Irradiance at the shares (u, v).
    pub(super) fn irradiance(&self, u: f64, v: f64) -> f32 {
        let (u, v) = (u as f32, v as f32);
        let [a, b, c, d] = self.irradiance;
        let (top, bottom) = (a + (b - a) * u, c + (d - c) * u);
        top + (bottom - top) * v
    }

    /// Size on the wall of a window, `[along s, along x]`.
    pub(super) fn size_m(&self, window: &Window) -> [f32; 2] {
        [0, 1].map(|axis| {
            let (du, dv) = (self.du[axis] * window.width, self.dv[axis] * window.height);
            (du * du + dv * dv).sqrt() as f32
        })
    }

    /// Distance on the wall between a corner and the interpolation at the shares (u, v).
    pub(super) fn error_m(&self, u: f64, v: f64, truth: &Corner, perimeter_m: f64) -> f64 {
        let [s_m, x_m] = self.at(u, v);
        shortest_way(truth.s_m - s_m, perimeter_m).hypot(truth.x_m - x_m)
    }

    /// The same cell with its arc length in the turn of `other`'s.
    pub(super) fn nearest_turn(mut self, other: &Self, perimeter_m: f64) -> Self {
        self.origin[0] = other.origin[0] + shortest_way(self.origin[0] - other.origin[0], perimeter_m);
        self
    }
}

/// Brings a difference of arc lengths into half a perimeter either way.
pub(super) fn shortest_way(difference_m: f64, perimeter_m: f64) -> f64 {
    if difference_m.abs() <= 0.5 * perimeter_m {
        difference_m
    } else {
        difference_m - (difference_m / perimeter_m).round() * perimeter_m
    }
}
