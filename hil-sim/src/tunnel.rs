//! The real wall as range sensors and the vehicle's body meet it.

use nalgebra::{Point3, Unit, Vector3};

use crate::scene::{Surface, Wall};
use crate::sensors::range::{Echo, Surroundings};

impl Surroundings for Wall {
    fn echo(&self, origin: &Point3<f64>, direction: &Unit<Vector3<f64>>) -> Option<Echo> {
        let hit = self.ray_cast(*origin, direction.into_inner())?;
        Some(Echo {
            distance_m: hit.distance,
            incidence_cosine: -hit.normal.dot(direction),
            water: hit.surface == Surface::Water,
        })
    }
}

/// Signed distance of the vehicle's middle from the nominal lining, positive inside.
pub fn clearance_m(wall: &Wall, position_m: &Vector3<f64>) -> f64 {
    wall.profile().nearest(position_m.yz()).map_or(f64::NEG_INFINITY, |nearest| nearest.clearance_m)
}

#[cfg(test)]
mod tests {
    use adit_geometry::profile::ProfileSpec;

    use super::*;
    use crate::scene::WallConfig;

    #[test]
    fn the_beam_downwards_meets_the_water_before_the_floor() {
        let profile = ProfileSpec::Circle { radius_m: 1.5 }.build().expect("a profile");
        let config = WallConfig { water_z_m: Some(1.2), ..WallConfig::default() };
        let wall = Wall::new(profile, &config, 1).expect("a wall");
        let down = wall.echo(&Point3::origin(), &Vector3::z_axis()).expect("an echo");
        assert!(down.water && (down.distance_m - 1.2).abs() < 1e-9);
        let up = wall.echo(&Point3::origin(), &-Vector3::z_axis()).expect("an echo");
        assert!(!up.water && (up.distance_m - 1.5).abs() < 1e-9 && up.incidence_cosine > 0.999);
    }
}
