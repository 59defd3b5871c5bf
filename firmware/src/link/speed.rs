//! How fast the vehicle is, from whom, and whether that can be believed.
//!
//! The estimate of place and velocity comes first; the head-up display's speed has no direction and stands in for it. A
//! velocity that jumps as no vehicle can, an estimate that says it began anew or has failed, and one whose speed differs from
//! the display's are doubted: for a second there is no speed along the axis but the display's, and of two that differ the
//! larger counts, for the limit guards the wall.

use nalgebra::ComplexField;

use super::{Timed, fresh};
use crate::time::{has_passed, seconds};

/// Velocity comes 5 to 50 times a second.
const STALE_S: f32 = 1.0;
/// No vehicle in a tunnel flies faster.
const MOST_MPS: f32 = 20.0;
/// A multicopter at full thrust.
const MOST_MPS2: f32 = 20.0;
/// Noise of two samples.
const NOISE_MPS: f32 = 0.3;
/// An estimate that jumped is doubted for this long.
const DOUBT_S: f32 = 1.0;
/// Two speeds of one vehicle may differ by this share and by the noise: they are not of the same moment.
const DIFFER_SHARE: f32 = 0.3;

/// The speedometer.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Speedometer {
    /// North and east.
    velocity: Timed<[f32; 2]>,
    head_up: Timed<f32>,
    doubted_us: Option<u64>,
}

impl Speedometer {
    /// A velocity to north and east.
    pub(super) fn hear_velocity(&mut self, now_us: u64, velocity_mps: [f32; 2]) {
        if !(norm(velocity_mps) <= MOST_MPS) {
            return;
        }
        if let Some((before_mps, at_us)) = self.velocity {
            let [north, east] = velocity_mps;
            let change = norm([north - before_mps[0], east - before_mps[1]]);
            if change > NOISE_MPS + MOST_MPS2 * seconds(at_us, now_us) {
                self.doubt(now_us);
            }
        }
        self.velocity = Some((velocity_mps, now_us));
    }

    /// A speed over ground.
    pub(super) fn hear_head_up(&mut self, now_us: u64, speed_mps: f32) {
        if (0.0..=MOST_MPS).contains(&speed_mps) {
            self.head_up = Some((speed_mps, now_us));
        }
    }

    /// The estimate has begun anew.
    pub(super) fn doubt(&mut self, now_us: u64) {
        self.doubted_us = Some(now_us);
    }

    /// Speed along an axis at this yaw.
    pub(super) fn along_mps(&self, now_us: u64, axis_yaw_rad: f32) -> Option<f32> {
        let head_up = fresh(self.head_up, now_us, STALE_S);
        let doubted = self.doubted_us.is_some_and(|at_us| !has_passed(at_us, now_us, DOUBT_S));
        let Some(velocity_mps) = fresh(self.velocity, now_us, STALE_S).filter(|_| !doubted) else {
            return head_up;
        };
        let along_mps = super::vehicle::along(velocity_mps, axis_yaw_rad);
        let speed_mps = norm(velocity_mps);
        let excess = head_up.filter(|other| *other > speed_mps * (1.0 + DIFFER_SHARE) + NOISE_MPS);
        Some(excess.map_or(along_mps, |other| if along_mps < 0.0 { -other } else { other }))
    }
}

fn norm([north, east]: [f32; 2]) -> f32 {
    ComplexField::sqrt(north * north + east * east)
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: u64 = 1000;

    #[test]
    fn the_estimate_comes_first_and_the_display_stands_in() {
        let mut speed = Speedometer::default();
        speed.hear_head_up(0, 0.4);
        assert_eq!(speed.along_mps(0, 0.0), Some(0.4));
        speed.hear_velocity(0, [-0.4, 0.0]);
        assert_eq!(speed.along_mps(0, 0.0), Some(-0.4));
        assert_eq!(speed.along_mps(2000 * MS, 0.0), None);
    }

    #[test]
    fn a_jump_is_doubted_for_a_second() {
        let mut speed = Speedometer::default();
        speed.hear_velocity(0, [0.2, 0.0]);
        speed.hear_velocity(50 * MS, [3.0, 0.0]);
        assert_eq!(speed.along_mps(50 * MS, 0.0), None);
        speed.hear_velocity(1060 * MS, [0.2, 0.0]);
        assert_eq!(speed.along_mps(1060 * MS, 0.0), Some(0.2));
    }

    #[test]
    fn of_two_speeds_that_differ_the_larger_counts() {
        let mut speed = Speedometer::default();
        speed.hear_velocity(0, [0.0, 0.0]);
        speed.hear_head_up(0, 1.0);
        assert_eq!(speed.along_mps(0, 0.0), Some(1.0));
        speed.hear_head_up(0, 0.2);
        assert_eq!(speed.along_mps(0, 0.0), Some(0.0));
    }

    #[test]
    fn what_is_no_speed_is_not_heard() {
        let mut speed = Speedometer::default();
        for wrong in [f32::NAN, f32::INFINITY, 1e6] {
            speed.hear_velocity(0, [wrong, 0.0]);
            speed.hear_head_up(0, wrong);
        }
        assert_eq!(speed.along_mps(0, 0.0), None);
    }
}
