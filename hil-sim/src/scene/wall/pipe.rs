//! A round pipe along the tunnel with flat ends.

use nalgebra::{Point3, Vector2, Vector3};

/// Section circle and stations.
#[derive(Clone, Copy, Debug)]
pub(super) struct Pipe {
    pub(super) centre: Vector2<f64>,
    pub(super) radius_m: f64,
    pub(super) from_x_m: f64,
    pub(super) to_x_m: f64,
}

impl Pipe {
    /// Tells whether a cone of half-width `reach` (per unit of distance) around the ray may touch the pipe.
    ///
    /// The ray's closest approach in the section, where a pipe is a disc; its ends are taken as endless.
    pub(super) fn is_near(&self, origin: Point3<f64>, direction: Vector3<f64>, reach: f64) -> bool {
        let to_centre = self.centre - origin.coords.yz();
        let along = direction.yz();
        let speed_squared = along.norm_squared();
        let t = to_centre.dot(&along) / speed_squared;
        if !(t > 0.0) {
            return to_centre.norm() <= self.radius_m;
        }
        (to_centre - along * t).norm() <= self.radius_m + reach * t * direction.norm()
    }

    /// Distance and outward normal of the first hit.
    pub(super) fn ray_cast(&self, origin: Point3<f64>, direction: Vector3<f64>) -> Option<(f64, Vector3<f64>)> {
        let offset = origin.coords.yz() - self.centre;
        let along = direction.yz();
        let (a, half_b) = (along.norm_squared(), offset.dot(&along));
        let c = offset.norm_squared() - self.radius_m * self.radius_m;
        let discriminant = half_b * half_b - a * c;
        if discriminant > 0.0 && a > 0.0 {
            let distance = (-half_b - discriminant.sqrt()) / a;
            let x_m = origin.x + distance * direction.x;
            if distance > 0.0 && x_m >= self.from_x_m && x_m <= self.to_x_m {
                let outward = (offset + along * distance) / self.radius_m;
                return Some((distance, Vector3::new(0.0, outward.x, outward.y)));
            }
        }
        let end_x_m = if direction.x > 0.0 { self.from_x_m } else { self.to_x_m };
        let distance = (end_x_m - origin.x) / direction.x;
        let on_disc = (offset + along * distance).norm_squared() < self.radius_m * self.radius_m;
        (distance > 0.0 && on_disc).then(|| (distance, Vector3::x() * -direction.x.signum()))
    }
}
