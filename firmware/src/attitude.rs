//! An attitude of the board's own, from its inertial unit alone.
//!
//! Model: a complementary filter after Mahony, Hamel and Pflimlin (Nonlinear Complementary Filters on the Special
//! Orthogonal Group, 2008). Rates less their bias are integrated; the accelerometer, which on average feels gravity
//! alone, pulls roll and pitch towards its idea of up with a time constant of 5 s. The bias of the gyroscope is the
//! mean rate while the vehicle rests.
//!
//! Limits: roll and pitch are against the horizontal, not against a tunnel that slopes. Yaw is relative to where it was
//! zeroed and nothing holds it: it drifts by what is left of the bias, 0.01 degrees per second and more as the chip
//! warms up. A steady turn about the vertical slower than half a degree per second (before the first attitude: six)
//! looks like rest and becomes bias. The first attitude needs two seconds of rest, so after a restart in flight there
//! is none.

use nalgebra::{ComplexField, RealField, UnitQuaternion, Vector3};

use crate::drivers::imu::{GRAVITY_MPS2, ImuSample};

/// How strongly the accelerometer pulls, 1/s: slow against gusts and manoeuvres, quick against what is left of the bias
/// (0.02 degrees per second then tilt the attitude by 0.1 degrees).
const PULL_PER_S: f32 = 0.2;
/// The accelerometer pulls while it feels gravity to within this.
const PULL_MAX_EXCESS_MPS2: f32 = 1.0;
/// Rest: no sample differs from the mean since rest began by more than this. Ten sigmas of either chip's noise (0.05
/// degrees per second and 0.016 m/s^2 in 41 Hz: DS 3.1 and 3.2, PS 3.1 and 3.2); turning rotors shake it more.
const REST_RATE_RADPS: f32 = 0.5 * DEGREE;
const REST_ACCELERATION_MPS2: f32 = 0.2;
/// Rest that is long enough to correct the bias, and to take the first attitude.
const REST_S: f32 = 1.0;
const SETTLING_S: f32 = 2.0;
/// The mean over rest forgets with this time constant once rest has lasted so long.
const MEAN_S: f32 = 10.0;
/// The largest bias that a healthy chip has (PS 3.1: 5 degrees per second).
const BIAS_MAX_RADPS: f32 = 6.0 * DEGREE;
/// The most that a bias moves between two rests; a mean farther off is a turn.
const BIAS_STEP_RADPS: f32 = 0.5 * DEGREE;
/// Longest time that may be bridged without a good sample; after that, what happened in between is unknown.
const GAP_MAX_S: f32 = 0.2;
/// More than a chip set to +-500 degrees per second and +-4 g can say: a garbled sample.
const RATE_MAX_RADPS: f32 = 10.0;
const ACCELERATION_MAX_MPS2: f32 = 45.0;
const DEGREE: f32 = core::f32::consts::PI / 180.0;

/// The attitude filter.
#[derive(Clone, Debug, Default)]
pub struct AttitudeFilter {
    /// Rotation from body to a level frame (x where yaw was zeroed, z down), once settled.
    level_from_body: Option<UnitQuaternion<f32>>,
    bias_radps: Vector3<f32>,
    rest: Rest,
    /// Time since the last good sample.
    gap_s: f32,
}

impl AttitudeFilter {
    /// Takes the sample that came `dt_s` after the last one; returns roll, pitch and yaw in radians (aerospace order
    /// yaw, pitch, roll), or `None` until the filter has settled.
    ///
    /// Samples that are not finite, or more than the chip can say, are passed over. After 0.2 s without a good one, or
    /// a `dt_s` that is no time, the filter has to settle anew.
    pub fn update(&mut self, dt_s: f32, sample: &ImuSample) -> Option<[f32; 3]> {
        self.gap_s += dt_s;
        if !(dt_s >= 0.0 && self.gap_s <= GAP_MAX_S) {
            *self = Self { bias_radps: self.bias_radps, ..Self::default() };
        }
        let rate = Vector3::from(sample.rate_radps);
        let acceleration = Vector3::from(sample.acceleration_mps2);
        let credible = |vector: &Vector3<f32>, limit: f32| vector.iter().all(|value| value.abs() <= limit);
        if credible(&rate, RATE_MAX_RADPS) && credible(&acceleration, ACCELERATION_MAX_MPS2) {
            let step_s = core::mem::take(&mut self.gap_s);
            self.rest.update(step_s, rate, acceleration);
            self.learn_bias();
            self.level_from_body = match self.level_from_body {
                Some(level_from_body) => Some(self.integrate(level_from_body, step_s, rate, acceleration)),
                None => self.first_attitude(),
            };
        }
        self.attitude_rad()
    }

    /// Roll, pitch and yaw, if the filter has settled.
    pub fn attitude_rad(&self) -> Option<[f32; 3]> {
        self.level_from_body.map(|level_from_body| level_from_body.euler_angles().into())
    }

    /// The bias of the gyroscope as known so far.
    pub fn bias_radps(&self) -> [f32; 3] {
        self.bias_radps.into()
    }

    /// Makes the present heading the one where yaw is zero.
    pub fn zero_yaw(&mut self) {
        if let Some(level_from_body) = &mut self.level_from_body {
            let (_, _, yaw_rad) = level_from_body.euler_angles();
            *level_from_body = UnitQuaternion::from_euler_angles(0.0, 0.0, -yaw_rad) * *level_from_body;
        }
    }

    fn learn_bias(&mut self) {
        let mean = self.rest.rate_radps;
        let known = self.level_from_body.is_some();
        let believable = if known {
            self.rest.lasts_s >= REST_S && (mean - self.bias_radps).amax() <= BIAS_STEP_RADPS
        } else {
            self.rest.lasts_s >= SETTLING_S && mean.amax() <= BIAS_MAX_RADPS
        };
        if believable {
            self.bias_radps = mean;
        }
    }

    /// Roll and pitch from the mean specific force over a rest, yaw zero.
    fn first_attitude(&self) -> Option<UnitQuaternion<f32>> {
        let force = self.rest.acceleration_mps2;
        let settled = self.rest.lasts_s >= SETTLING_S
            && self.rest.rate_radps.amax() <= BIAS_MAX_RADPS
            && (force.norm() - GRAVITY_MPS2).abs() <= PULL_MAX_EXCESS_MPS2;
        let roll_rad = RealField::atan2(-force.y, -force.z);
        let pitch_rad = RealField::atan2(force.x, ComplexField::sqrt(force.y * force.y + force.z * force.z));
        settled.then(|| UnitQuaternion::from_euler_angles(roll_rad, pitch_rad, 0.0))
    }

    /// One step of the filter. `up` in the body frame as felt, crossed with `up` as believed, is the rotation (body
    /// frame, small angles) that takes the belief to the feeling.
    fn integrate(
        &self,
        level_from_body: UnitQuaternion<f32>,
        step_s: f32,
        rate: Vector3<f32>,
        acceleration: Vector3<f32>,
    ) -> UnitQuaternion<f32> {
        let mut corrected = rate - self.bias_radps;
        let force_mps2 = acceleration.norm();
        if (force_mps2 - GRAVITY_MPS2).abs() <= PULL_MAX_EXCESS_MPS2 {
            let up = level_from_body.inverse_transform_vector(&-Vector3::z());
            corrected += (acceleration / force_mps2).cross(&up) * PULL_PER_S;
        }
        let turned = level_from_body * UnitQuaternion::from_scaled_axis(corrected * step_s);
        UnitQuaternion::new_normalize(turned.into_inner())
    }
}

/// How long the vehicle has been at rest, and what the chip has felt on average since.
#[derive(Clone, Debug, Default)]
struct Rest {
    started: bool,
    lasts_s: f32,
    rate_radps: Vector3<f32>,
    acceleration_mps2: Vector3<f32>,
}

impl Rest {
    fn update(&mut self, step_s: f32, rate: Vector3<f32>, acceleration: Vector3<f32>) {
        let rate_change = rate - self.rate_radps;
        let acceleration_change = acceleration - self.acceleration_mps2;
        let still = rate_change.amax() <= REST_RATE_RADPS && acceleration_change.amax() <= REST_ACCELERATION_MPS2;
        if !(self.started && still) {
            *self = Self { started: true, lasts_s: 0.0, rate_radps: rate, acceleration_mps2: acceleration };
        } else if step_s > 0.0 {
            self.lasts_s += step_s;
            let weight = step_s / self.lasts_s.min(MEAN_S);
            self.rate_radps += rate_change * weight;
            self.acceleration_mps2 += acceleration_change * weight;
        }
    }
}

#[cfg(test)]
mod tests;
