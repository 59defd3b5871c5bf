//! Parts of the vehicle in the picture: rods with round ends, fixed in the body frame.

use nalgebra::{Isometry3, Point3, Vector3};

use super::config::VehiclePartConfig;

/// Linear albedo of the vehicle's black plastic.
const ALBEDO: f32 = 0.045;

/// A rod in the `cam` frame.
#[derive(Clone, Copy, Debug)]
pub(super) struct Rod {
    from: Vector3<f64>,
    axis: Vector3<f64>,
    radius_m: f64,
}

/// What a ray through the lens meets of a rod.
#[derive(Clone, Copy, Debug)]
pub(super) struct RodHit {
    /// Smallest distance of the ray from the rod's axis minus its radius: negative if it hits.
    pub(super) miss_m: f64,
    /// Distance from the lens of that place.
    pub(super) depth_m: f64,
    /// Intensity of the rod there under a light at the camera.
    pub(super) intensity: f32,
}

/// The rods of one photo in the `cam` frame; those that lie behind the camera altogether are left out.
pub(super) fn rods_in_cam(
    parts: &[VehiclePartConfig],
    tunnel_from_cam: &Isometry3<f64>,
    tunnel_from_body: &Isometry3<f64>,
) -> Vec<Rod> {
    let cam_from_body = tunnel_from_cam.inverse() * tunnel_from_body;
    parts
        .iter()
        .map(|part| {
            let from = (cam_from_body * Point3::from(part.from_m)).coords;
            let to = (cam_from_body * Point3::from(part.to_m)).coords;
            Rod { from, axis: to - from, radius_m: part.radius_mm * 1e-3 }
        })
        .filter(|rod| rod.from.z.max(rod.from.z + rod.axis.z) + rod.radius_m > 0.0)
        .collect()
}

impl Rod {
    /// Closest approach of the ray from the lens along `direction` (`cam` frame) and the rod's axis.
    ///
    /// Method: Ericson, Real-Time Collision Detection, 5.1.9, with one end of the ray open.
    pub(super) fn meet(&self, direction: &Vector3<f64>) -> RodHit {
        let direction = direction.normalize();
        let length_squared = self.axis.norm_squared();
        let across = direction.dot(&self.axis);
        let denominator = length_squared - across * across;
        let along = if denominator > 1e-12 {
            (across * direction.dot(&self.from) - self.axis.dot(&self.from)) / denominator
        } else {
            0.0
        };
        let on_axis = self.from + self.axis * along.clamp(0.0, 1.0);
        let depth_m = direction.dot(&on_axis).max(0.0);
        let gap = direction * depth_m - on_axis;
        let distance_m = gap.norm();
        let facing = (1.0 - (distance_m / self.radius_m).powi(2)).max(0.0).sqrt();
        RodHit { miss_m: distance_m - self.radius_m, depth_m, intensity: ALBEDO * (0.15 + 0.85 * facing as f32) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_rod_is_hit_where_it_is() {
        let identity = Isometry3::identity();
        let part = VehiclePartConfig { from_m: [-1.0, 0.2, 0.5], to_m: [1.0, 0.2, 0.5], radius_mm: 50.0 };
        let rods = rods_in_cam(&[part], &identity, &identity);
        let miss_m = |y: f64, z: f64| rods[0].meet(&Vector3::new(0.3, y, z)).miss_m;
        assert!(miss_m(0.2, 0.5) < -0.049);
        assert!(miss_m(-0.2, 0.5) > 0.1);
        let behind = VehiclePartConfig { from_m: [-1.0, 0.0, -0.5], to_m: [1.0, 0.0, -0.5], radius_mm: 50.0 };
        assert!(rods_in_cam(&[behind], &identity, &identity).is_empty());
    }
}
