//! Where the camera truly was: the recipe's plan, and how far from it.

use adit_geometry::angles::shaft_step_rad;
use adit_geometry::rig::{Rig, attitude};
use nalgebra::{Isometry3, Translation3, Vector3};

use super::kind::{Recipe, Scatter};
use crate::render::Shot;
use crate::seed::{Random, Stream, Wander};

/// True roll, pitch and yaw, one standard deviation each; the tags know nothing of them.
const ATTITUDE_DEG: f64 = 1.5;
/// An attitude lasts over so many photos.
const ATTITUDE_PHOTOS: f64 = 5.0;
/// The first photo looks down, as in the samples.
const FIRST_SHAFT_DEG: f64 = 180.0;

/// One capture as it truly was.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Capture {
    /// Section angle of the shaft.
    pub(super) shaft_rad: f64,
    pub(super) tunnel_from_body: Isometry3<f64>,
    pub(super) tunnel_from_cam: Isometry3<f64>,
}

impl Capture {
    /// The exposure, with the shaft turning at `shaft_rad_per_s` (clockwise looking forward) about the body's x axis.
    pub(super) fn shot(&self, index: u32, shaft_rad_per_s: f64) -> Shot {
        let still = Shot::still(index, self.tunnel_from_cam, self.tunnel_from_body);
        let angular_velocity_rad_per_s = self.tunnel_from_body.rotation * (Vector3::x() * shaft_rad_per_s);
        let arm_m = self.tunnel_from_cam.translation.vector - self.tunnel_from_body.translation.vector;
        Shot { velocity_mps: angular_velocity_rad_per_s.cross(&arm_m), angular_velocity_rad_per_s, ..still }
    }
}

/// The true captures of a set with the camera mounted as `rig` says.
pub(super) fn captures(recipe: &Recipe, rig: &Rig<f64>, photos: u32, seed: u64) -> Vec<Capture> {
    let mut body = Body::new(&recipe.scatter, seed);
    let mut shaft = Random::new(seed, Stream::Servo);
    let mut tunnel_from_body = Isometry3::identity();
    let step_rad: f64 = shaft_step_rad(recipe.images_per_turn);
    (0..photos)
        .map(|index| {
            let turn = index / u32::from(recipe.images_per_turn);
            if !recipe.stands {
                tunnel_from_body = body.next(f64::from(index) * recipe.advance_m);
            } else if index % u32::from(recipe.images_per_turn) == 0 {
                tunnel_from_body = body.next(f64::from(turn) * recipe.advance_m);
            }
            let stray_rad = shaft.gauss(recipe.scatter.shaft_deg.to_radians());
            let shaft_rad = FIRST_SHAFT_DEG.to_radians() + f64::from(index) * step_rad + stray_rad;
            Capture { shaft_rad, tunnel_from_body, tunnel_from_cam: tunnel_from_body * rig.body_from_cam(shaft_rad) }
        })
        .collect()
}

/// The vehicle's body from place to place.
struct Body {
    along: Random,
    along_m: f64,
    across: [Wander; 2],
    wind: Random,
    angles: [Wander; 3],
    wobble: Random,
}

impl Body {
    fn new(scatter: &Scatter, seed: u64) -> Self {
        let mut wind = Random::new(seed, Stream::Wind);
        let mut wobble = Random::new(seed, Stream::Attitude);
        let across = [(); 2].map(|()| Wander::settled(scatter.across_m, scatter.memory_photos, &mut wind));
        let angles = [(); 3].map(|()| Wander::settled(ATTITUDE_DEG.to_radians(), ATTITUDE_PHOTOS, &mut wobble));
        Self { along: Random::new(seed, Stream::Autopilot), along_m: scatter.along_m, across, wind, angles, wobble }
    }

    /// `tunnel_from_body` at the next place, planned at `x_m` on the axis.
    fn next(&mut self, x_m: f64) -> Isometry3<f64> {
        let x_m = x_m + self.along.gauss(self.along_m);
        let [y_m, z_m] = self.across.each_mut().map(|wander| wander.step(1.0, &mut self.wind));
        let [roll, pitch, yaw] = self.angles.each_mut().map(|wander| wander.step(1.0, &mut self.wobble));
        Isometry3::from_parts(Translation3::from(Vector3::new(x_m, y_m, z_m)), attitude(roll, pitch, yaw))
    }
}
