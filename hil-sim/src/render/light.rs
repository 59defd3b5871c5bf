//! The lamp: irradiance of a wall point.

use nalgebra::{Point3, Vector3};

use super::config::{LightConfig, LightMount};
use super::photo::Shot;

/// The lamp of one photo, in the tunnel frame.
#[derive(Clone, Copy, Debug)]
pub(super) struct Lamp {
    position: Point3<f64>,
    axis: Vector3<f64>,
    /// Exponent of the cosine law of the beam.
    exponent: f64,
    /// Distance at which a wall in the beam's axis gets unit irradiance.
    reference_m: f64,
    level: f64,
    ambient: f64,
}

impl Lamp {
    pub(super) fn new(config: &LightConfig, shot: &Shot, reference_m: f64) -> Self {
        let tunnel_from_mount = match config.mount {
            LightMount::Camera => shot.tunnel_from_cam,
            LightMount::Body => shot.tunnel_from_body,
        };
        Self {
            position: tunnel_from_mount * Point3::from(config.position_m),
            axis: (tunnel_from_mount * Vector3::from(config.direction)).normalize(),
            exponent: 0.5_f64.ln() / config.half_intensity_deg.to_radians().cos().ln(),
            reference_m,
            level: shot.light_level,
            ambient: config.ambient,
        }
    }

    /// Irradiance relative to that of a wall at the reference distance in the beam's axis.
    ///
    /// Lambert's cosine law at the wall, inverse square of the distance, cosine power law over the beam, plus ambient.
    pub(super) fn irradiance(&self, point: &Point3<f64>, normal: &Vector3<f64>) -> f64 {
        let to_wall = point - self.position;
        let distance_squared = to_wall.norm_squared().max(0.0025);
        let direction = to_wall / distance_squared.sqrt();
        let incidence = -direction.dot(normal);
        let along_axis = direction.dot(&self.axis);
        if incidence <= 0.0 || along_axis <= 0.0 {
            return self.ambient;
        }
        let beam = along_axis.powf(self.exponent);
        self.ambient + self.level * beam * incidence * self.reference_m * self.reference_m / distance_squared
    }

    /// Brightness of the lamp's own mirror image in a smooth surface, seen along the mirrored ray.
    pub(super) fn glint(&self, point: &Point3<f64>, mirrored: &Vector3<f64>) -> f64 {
        let cosine = (self.position - point).normalize().dot(&mirrored.normalize());
        // An LED panel of about 3 degrees across, with a soft rim.
        40.0 * self.level * ((cosine - 0.9990) / 0.0006).clamp(0.0, 1.0)
    }
}
