//! The vehicle: a point mass that accelerates by tilting, as a multicopter does.
//!
//! Model: the autopilot asks for an acceleration; roll and pitch follow it as second-order systems, and the tilt they
//! have really reached accelerates the vehicle. Thrust follows at once along z. Gusts add to it. Limits: no drag, no
//! motor dynamics, no ground effect; good for centring errors and exposure poses, not for tuning an autopilot.

use adit_geometry::rig::attitude;
use nalgebra::{Isometry3, Translation3, Vector3};

use crate::config::AttitudeConfig;
use crate::seed::{Random, Stream, Wander};

/// Standard gravity, m/s^2.
const GRAVITY_MPS2: f64 = 9.80665;
/// Natural frequency of the roll and pitch loops, rad/s: a small multicopter's.
const TILT_RAD_PER_S: f64 = 12.0;
/// Damping ratio of these loops.
const TILT_DAMPING: f64 = 0.8;
/// Time constant of the wobble that motors and vibration add to the attitude.
const WOBBLE_TIME_S: f64 = 0.3;
/// Time constant of the heading's wandering.
const YAW_TIME_S: f64 = 4.0;

/// Where the vehicle is and how it moves.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct VehicleState {
    /// Position of the body origin in the tunnel frame.
    pub position_m: Vector3<f64>,
    /// Velocity in the tunnel frame.
    pub velocity_mps: Vector3<f64>,
    /// Roll, pitch, yaw (aerospace order) of the body in the tunnel frame.
    pub attitude_rad: [f64; 3],
    /// Their rates.
    pub attitude_rate_rad_per_s: [f64; 3],
}

impl VehicleState {
    /// The pose of the body.
    pub fn tunnel_from_body(&self) -> Isometry3<f64> {
        let [roll, pitch, yaw] = self.attitude_rad;
        Isometry3::from_parts(Translation3::from(self.position_m), attitude(roll, pitch, yaw))
    }

    /// Angular velocity in the body frame, from the rates of roll, pitch and yaw.
    pub fn angular_velocity_in_body(&self) -> Vector3<f64> {
        let [roll, pitch, _] = self.attitude_rad;
        let [roll_rate, pitch_rate, yaw_rate] = self.attitude_rate_rad_per_s;
        let (sin_roll, cos_roll) = roll.sin_cos();
        let (sin_pitch, cos_pitch) = pitch.sin_cos();
        Vector3::new(
            roll_rate - yaw_rate * sin_pitch,
            pitch_rate * cos_roll + yaw_rate * sin_roll * cos_pitch,
            -pitch_rate * sin_roll + yaw_rate * cos_roll * cos_pitch,
        )
    }
}

/// The vehicle.
#[derive(Clone, Debug)]
pub struct Vehicle {
    /// Where it is now.
    pub state: VehicleState,
    tilt: [Follower; 2],
    wobble: [Wander; 3],
    random: Random,
}

/// A second-order follower.
#[derive(Clone, Copy, Debug, Default)]
struct Follower {
    value: f64,
    rate: f64,
}

impl Follower {
    fn step(&mut self, target: f64, dt_s: f64) {
        let pull = TILT_RAD_PER_S * TILT_RAD_PER_S * (target - self.value);
        self.rate += (pull - 2.0 * TILT_DAMPING * TILT_RAD_PER_S * self.rate) * dt_s;
        self.value += self.rate * dt_s;
    }
}

impl Vehicle {
    /// A vehicle that hovers level at `position_m`.
    pub fn new(position_m: Vector3<f64>, config: &AttitudeConfig, seed: u64) -> Self {
        let mut random = Random::new(seed, Stream::Attitude);
        let state = VehicleState {
            position_m,
            velocity_mps: Vector3::zeros(),
            attitude_rad: [0.0; 3],
            attitude_rate_rad_per_s: [0.0; 3],
        };
        let wobble = [
            Wander::new(config.wobble_sigma_rad, WOBBLE_TIME_S),
            Wander::new(config.wobble_sigma_rad, WOBBLE_TIME_S),
            Wander::settled(config.yaw_sigma_rad, YAW_TIME_S, &mut random),
        ];
        Self { state, tilt: [Follower::default(); 2], wobble, random }
    }

    /// Goes on by `dt_s` under the acceleration the autopilot asks for and the one that gusts give (tunnel frame).
    pub fn step(&mut self, wanted_mps2: Vector3<f64>, gust_mps2: Vector3<f64>, dt_s: f64) {
        let [roll, pitch] = &mut self.tilt;
        roll.step((wanted_mps2.y / GRAVITY_MPS2).atan(), dt_s);
        pitch.step(-(wanted_mps2.x / GRAVITY_MPS2).atan(), dt_s);
        let thrust = Vector3::new(-GRAVITY_MPS2 * pitch.value.tan(), GRAVITY_MPS2 * roll.value.tan(), wanted_mps2.z);
        let centre = [roll.value, pitch.value, 0.0];

        self.state.velocity_mps += (thrust + gust_mps2) * dt_s;
        self.state.position_m += self.state.velocity_mps * dt_s;
        // Wobble is filtered by the vehicle's inertia: its step is taken up over `WOBBLE_FILTER_S`.
        let before = self.state.attitude_rad;
        for ((value, centre), wobble) in self.state.attitude_rad.iter_mut().zip(centre).zip(&mut self.wobble) {
            let target = centre + wobble.step(dt_s, &mut self.random);
            *value += (target - *value) * (dt_s / WOBBLE_FILTER_S).min(1.0);
        }
        for ((rate, after), before) in
            self.state.attitude_rate_rad_per_s.iter_mut().zip(self.state.attitude_rad).zip(before)
        {
            *rate = (after - before) / dt_s;
        }
    }
}

/// Time constant with which inertia smooths the wobble.
const WOBBLE_FILTER_S: f64 = 0.1;

#[cfg(test)]
mod tests {
    use super::*;

    fn still() -> Vehicle {
        let config = AttitudeConfig { wobble_sigma_rad: 0.0, yaw_sigma_rad: 0.0 };
        Vehicle::new(Vector3::zeros(), &config, 1)
    }

    #[test]
    fn a_wish_to_go_right_rolls_right_and_moves_right() {
        let mut vehicle = still();
        for _ in 0..200 {
            vehicle.step(Vector3::new(0.0, 1.0, 0.0), Vector3::zeros(), 0.005);
        }
        assert!(vehicle.state.attitude_rad[0] > 0.05);
        assert!(vehicle.state.position_m.y > 0.2);
        // The right side of the body points down, that is towards positive z.
        assert!((vehicle.state.tunnel_from_body() * Vector3::y()).z > 0.05);
    }

    #[test]
    fn a_wish_to_go_forward_lowers_the_nose_and_moves_forward() {
        let mut vehicle = still();
        for _ in 0..200 {
            vehicle.step(Vector3::new(1.0, 0.0, 0.0), Vector3::zeros(), 0.005);
        }
        assert!((vehicle.state.tunnel_from_body() * Vector3::x()).z > 0.05);
        assert!(vehicle.state.position_m.x > 0.2);
    }

    #[test]
    fn the_angular_velocity_turns_the_pose_as_it_really_turned() {
        let mut vehicle = Vehicle::new(Vector3::zeros(), &AttitudeConfig::default(), 5);
        let dt_s = 0.0005;
        for _ in 0..400 {
            vehicle.step(Vector3::new(0.5, -0.7, 0.0), Vector3::zeros(), dt_s);
        }
        let before = vehicle.state.tunnel_from_body().rotation;
        vehicle.step(Vector3::new(0.5, -0.7, 0.0), Vector3::zeros(), dt_s);
        let after = vehicle.state.tunnel_from_body().rotation;
        let turned = (before.inverse() * after).scaled_axis() / dt_s;
        assert!((turned - vehicle.state.angular_velocity_in_body()).norm() < 1e-3);
    }
}
