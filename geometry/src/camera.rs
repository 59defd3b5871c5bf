//! Camera models: pinhole with Brown-Conrady or Kannala-Brandt distortion.
//!
//! Pixels: (0.5, 0.5) is the centre of the first pixel. `cam` frame: x right, y down, z forward.

use nalgebra::{Matrix2, Matrix2x3, SMatrix, Vector2, Vector3};

use crate::Real;

/// Lens distortion.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Distortion<T> {
    /// `k1 k2 p1 p2 k3` as in `OpenCV`: radial polynomial in r^2 and tangential terms on the plane z = 1.
    BrownConrady([T; 5]),
    /// `k1..k4` as in `OpenCV`'s fisheye model: `theta (1 + k1 theta^2 + ... + k4 theta^8)`.
    KannalaBrandt([T; 4]),
}

/// Size, intrinsics and distortion of a camera.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Camera<T> {
    /// Image width.
    pub width_px: u32,
    /// Image height.
    pub height_px: u32,
    /// Focal lengths `[fx, fy]`.
    pub focal_px: [T; 2],
    /// Principal point `[cx, cy]`.
    pub centre_px: [T; 2],
    /// Distortion.
    pub distortion: Distortion<T>,
}

impl<T: Real> Camera<T> {
    /// Projects a point in the `cam` frame.
    ///
    /// `None` behind the camera (Brown-Conrady: `z <= 0`), or beyond the radius where the distortion folds back.
    pub fn project(&self, point_in_cam: &Vector3<T>) -> Option<Vector2<T>> {
        let plane = match self.distortion {
            Distortion::BrownConrady(k) => {
                if point_in_cam.z <= T::of(1e-9) {
                    return None;
                }
                let normalised = point_in_cam.xy() / point_in_cam.z;
                if !brown_grows_up_to(&k, normalised.norm_squared()) {
                    return None;
                }
                brown(&k, normalised)
            }
            Distortion::KannalaBrandt(k) => {
                let radius = point_in_cam.xy().norm();
                let theta = radius.atan2(point_in_cam.z);
                if !kannala_grows_up_to(&k, theta) {
                    return None;
                }
                if radius <= T::of(1e-12) {
                    Vector2::zeros()
                } else {
                    point_in_cam.xy() * (kannala(&k, theta) / radius)
                }
            }
        };
        Some(self.to_pixel(plane))
    }

    /// Projects a point and gives the derivative of the pixel with respect to the point (2 x 3, px per metre).
    ///
    /// `None` where [`Self::project`] is.
    pub fn project_with_jacobian(&self, point_in_cam: &Vector3<T>) -> Option<(Vector2<T>, Matrix2x3<T>)> {
        let pixel = self.project(point_in_cam)?;
        let (x, y, z) = (point_in_cam.x, point_in_cam.y, point_in_cam.z);
        let [fx, fy] = self.focal_px;
        let focal = Matrix2::new(fx, T::zero(), T::zero(), fy);
        let jacobian = match self.distortion {
            Distortion::BrownConrady(k) => {
                let (u, v) = (x / z, y / z);
                let plane_from_point = Matrix2x3::new(z, T::zero(), -x, T::zero(), z, -y) / (z * z);
                focal * brown_jacobian(&k, u, v) * plane_from_point
            }
            Distortion::KannalaBrandt(k) => {
                let r2 = x * x + y * y;
                let r = r2.sqrt();
                let d2 = r2 + z * z;
                if r <= T::of(1e-9) {
                    let s = T::one() / z;
                    focal * Matrix2x3::new(s, T::zero(), T::zero(), T::zero(), s, T::zero())
                } else {
                    let theta = r.atan2(z);
                    let (f, df) = (kannala(&k, theta), kannala_slope(&k, theta));
                    // plane = xy * f(theta) / r; d theta = (z/(r d2)) xy . dxy - r/d2 dz
                    let g = f / r;
                    let a = (df * z / d2 - g) / r2;
                    let b = -df / d2;
                    focal * Matrix2x3::new(g + a * x * x, a * x * y, b * x, a * x * y, g + a * y * y, b * y)
                }
            }
        };
        Some((pixel, jacobian))
    }

    /// Returns the derivative of the pixel with respect to `fx fy cx cy` and the distortion coefficients in the model's order
    /// (2 x 9; the last column is zero for Kannala-Brandt, which has four).
    ///
    /// Meaningless where [`Self::project`] is `None`.
    pub fn jacobian_by_intrinsics(&self, point_in_cam: &Vector3<T>) -> SMatrix<T, 2, 9> {
        let [fx, fy] = self.focal_px;
        let (zero, one, two) = (T::zero(), T::one(), T::of(2.0));
        let (plane, by_distortion) = match self.distortion {
            Distortion::BrownConrady(k) => {
                let p = point_in_cam.xy() / point_in_cam.z;
                let (r2, xy) = (p.norm_squared(), two * p.x * p.y);
                let (tangential_x, tangential_y) = (r2 + two * p.x * p.x, r2 + two * p.y * p.y);
                let tangential = [Vector2::new(xy, tangential_y), Vector2::new(tangential_x, xy)];
                (brown(&k, p), [p * r2, p * (r2 * r2), tangential[0], tangential[1], p * (r2 * r2 * r2)])
            }
            Distortion::KannalaBrandt(k) => {
                let radius = point_in_cam.xy().norm();
                let theta = radius.atan2(point_in_cam.z);
                let direction = if radius <= T::of(1e-12) { Vector2::zeros() } else { point_in_cam.xy() / radius };
                let t2 = theta * theta;
                let [a, b] = [theta * t2, theta * t2 * t2];
                let columns = [direction * a, direction * b, direction * (b * t2), direction * (b * t2 * t2)];
                (direction * kannala(&k, theta), [columns[0], columns[1], columns[2], columns[3], Vector2::zeros()])
            }
        };
        let [a, b, c, d, e] = by_distortion.map(|column| Vector2::new(fx * column.x, fy * column.y));
        SMatrix::from_columns(&[
            Vector2::new(plane.x, zero),
            Vector2::new(zero, plane.y),
            Vector2::new(one, zero),
            Vector2::new(zero, one),
            a,
            b,
            c,
            d,
            e,
        ])
    }

    /// Returns the viewing direction of a pixel in the `cam` frame (not of unit length: for Brown-Conrady z = 1).
    ///
    /// Newton's iteration on the distortion; `None` where it does not converge to 1e-7 (f64: 1e-12) of the focal length.
    pub fn unproject(&self, pixel: &Vector2<T>) -> Option<Vector3<T>> {
        let plane = Vector2::new(
            (pixel.x - self.centre_px[0]) / self.focal_px[0],
            (pixel.y - self.centre_px[1]) / self.focal_px[1],
        );
        let tolerance = T::default_epsilon() * T::of(64.0);
        match self.distortion {
            Distortion::BrownConrady(k) => {
                let mut guess = plane;
                for _ in 0..20 {
                    let error = brown(&k, guess) - plane;
                    if error.norm() <= tolerance * (T::one() + plane.norm()) {
                        return brown_grows_up_to(&k, guess.norm_squared()).then(|| guess.push(T::one()));
                    }
                    guess -= brown_jacobian(&k, guess.x, guess.y).try_inverse()? * error;
                }
                None
            }
            Distortion::KannalaBrandt(k) => {
                let distorted = plane.norm();
                let mut theta = distorted.min(T::frac_pi_2());
                for _ in 0..20 {
                    let error = kannala(&k, theta) - distorted;
                    if error.abs() <= tolerance * (T::one() + distorted) {
                        if !kannala_grows_up_to(&k, theta) {
                            return None;
                        }
                        let (sin, cos) = theta.sin_cos();
                        let direction = if distorted > T::zero() { plane / distorted } else { Vector2::zeros() };
                        return Some((direction * sin).push(cos));
                    }
                    theta -= error / kannala_slope(&k, theta);
                }
                None
            }
        }
    }

    /// The same camera in another scalar.
    pub fn cast<U: Real>(&self) -> Camera<U> {
        let to = |value: T| U::of(value.to_f64());
        Camera {
            width_px: self.width_px,
            height_px: self.height_px,
            focal_px: self.focal_px.map(to),
            centre_px: self.centre_px.map(to),
            distortion: match self.distortion {
                Distortion::BrownConrady(k) => Distortion::BrownConrady(k.map(to)),
                Distortion::KannalaBrandt(k) => Distortion::KannalaBrandt(k.map(to)),
            },
        }
    }

    /// Tells whether a pixel position lies within the image, at least `margin_px` from its border.
    pub fn contains(&self, pixel: &Vector2<T>, margin_px: T) -> bool {
        pixel.x >= margin_px
            && pixel.y >= margin_px
            && pixel.x <= T::count(self.width_px) - margin_px
            && pixel.y <= T::count(self.height_px) - margin_px
    }

    fn to_pixel(self, plane: Vector2<T>) -> Vector2<T> {
        Vector2::new(self.focal_px[0] * plane.x + self.centre_px[0], self.focal_px[1] * plane.y + self.centre_px[1])
    }
}

fn brown<T: Real>(k: &[T; 5], p: Vector2<T>) -> Vector2<T> {
    let [k1, k2, p1, p2, k3] = *k;
    let two = T::of(2.0);
    let r2 = p.norm_squared();
    let radial = T::one() + r2 * (k1 + r2 * (k2 + r2 * k3));
    Vector2::new(
        p.x * radial + two * p1 * p.x * p.y + p2 * (r2 + two * p.x * p.x),
        p.y * radial + p1 * (r2 + two * p.y * p.y) + two * p2 * p.x * p.y,
    )
}

/// Derivative of the radial part `r (1 + k1 r^2 + ...)` with respect to r; not positive where the image folds back.
fn brown_slope<T: Real>(k: &[T; 5], r2: T) -> T {
    let [k1, k2, _, _, k3] = *k;
    T::one() + r2 * (T::of(3.0) * k1 + r2 * (T::of(5.0) * k2 + r2 * T::of(7.0) * k3))
}

/// Tells whether the image grows with the radius all the way to `r2`: the slope, a cubic in r^2, has no root before.
fn brown_grows_up_to<T: Real>(k: &[T; 5], r2: T) -> bool {
    let falling = |coefficient: T| coefficient.min(T::zero());
    // Cheap and almost always enough: what falls, taken at its worst, is less than one.
    if brown_slope(&[falling(k[0]), falling(k[1]), T::zero(), T::zero(), falling(k[4])], r2) > T::zero() {
        return true;
    }
    let slope = brown_slope(k, r2);
    if slope <= T::zero() || !slope.is_finite() {
        return false;
    }
    let [k1, k2, _, _, k3] = *k;
    // The slope's own minimum: derivative a + 2 b t + c t^2, at the root with positive curvature.
    let (a, b, c) = (T::of(3.0) * k1, T::of(5.0) * k2, T::of(21.0) * k3);
    let discriminant = b * b - a * c;
    if discriminant <= T::zero() {
        return true;
    }
    let root = discriminant.sqrt();
    // Two forms of the same root: the one whose denominator does not cancel.
    let lowest = if b >= T::zero() { -a / (b + root) } else { (root - b) / c };
    lowest <= T::zero() || lowest >= r2 || brown_slope(k, lowest) > T::zero()
}

fn brown_jacobian<T: Real>(k: &[T; 5], x: T, y: T) -> Matrix2<T> {
    let [k1, k2, p1, p2, k3] = *k;
    let (two, six) = (T::of(2.0), T::of(6.0));
    let r2 = x * x + y * y;
    let radial = T::one() + r2 * (k1 + r2 * (k2 + r2 * k3));
    // d radial / d (r^2)
    let slope = k1 + r2 * (two * k2 + r2 * T::of(3.0) * k3);
    let cross = two * x * y * slope + two * p1 * x + two * p2 * y;
    Matrix2::new(
        radial + two * x * x * slope + two * p1 * y + six * p2 * x,
        cross,
        cross,
        radial + two * y * y * slope + six * p1 * y + two * p2 * x,
    )
}

fn kannala<T: Real>(k: &[T; 4], theta: T) -> T {
    let t2 = theta * theta;
    theta * (T::one() + t2 * (k[0] + t2 * (k[1] + t2 * (k[2] + t2 * k[3]))))
}

fn kannala_slope<T: Real>(k: &[T; 4], theta: T) -> T {
    let t2 = theta * theta;
    let of = T::of;
    T::one() + t2 * (of(3.0) * k[0] + t2 * (of(5.0) * k[1] + t2 * (of(7.0) * k[2] + t2 * of(9.0) * k[3])))
}

/// Tells whether the image grows with the angle up to `theta`, looked at in eight places.
fn kannala_grows_up_to<T: Real>(k: &[T; 4], theta: T) -> bool {
    let step = theta / T::of(8.0);
    let mut at = theta;
    for _ in 0..8 {
        let slope = kannala_slope(k, at);
        if slope <= T::zero() || !slope.is_finite() {
            return false;
        }
        at -= step;
    }
    true
}
