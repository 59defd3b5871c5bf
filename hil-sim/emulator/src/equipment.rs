//! Turns the world's inputs into what the board's equipment senses: raw readings, encoder steps, levels of lines.

use std::f64::consts::TAU;

use adit_firmware::io::{Inputs, RangeReading, RangeSample};
use adit_geometry::rig::attitude;
use adit_hil_sim::plant::vehicle::VehicleState;
use adit_protocol::beams::{Beam, Beams};
use adit_protocol::parameters::RangeFamily;
use nalgebra::Vector3;

use crate::machine::{Motion, Sensed};

/// A sensor without a new sample for this long is unplugged: two samples at 10 Hz, the slowest rate in use.
const DEAD_AFTER_US: u64 = 250_000;
/// The camera's confirm line: high, then low, for this long per photo (the firmware samples it every 5 ms).
const PULSE_US: u64 = 30_000;
/// Steps per turn of the AS5600.
const ENCODER_STEPS: f64 = 4096.0;
/// Standard gravity along z, which points down, m/s^2.
const GRAVITY_MPS2: f64 = 9.80665;

/// The equipment.
#[derive(Clone, Debug)]
pub(crate) struct Equipment {
    family: RangeFamily,
    ranges: Beams<Plug>,
    head: Plug,
    confirm: ConfirmLine,
    motion: Motion,
    last: Option<(u64, Vector3<f64>)>,
}

impl Equipment {
    pub(crate) fn new(family: RangeFamily) -> Self {
        Self {
            family,
            ranges: Beams::default(),
            head: Plug::default(),
            confirm: ConfirmLine::default(),
            motion: Motion::default(),
            last: None,
        }
    }

    /// Takes note of how the vehicle moves.
    pub(crate) fn feel(&mut self, now_us: u64, vehicle: &VehicleState) {
        let [roll, pitch, yaw] = vehicle.attitude_rad;
        let acceleration_mps2 = match self.last {
            Some((last_us, last_mps)) if now_us > last_us => {
                (vehicle.velocity_mps - last_mps) / ((now_us - last_us) as f64 * 1e-6)
            }
            _ => Vector3::zeros(),
        };
        self.last = Some((now_us, vehicle.velocity_mps));
        let force_in_tunnel = acceleration_mps2 - Vector3::z() * GRAVITY_MPS2;
        self.motion = Motion {
            turning_rad_per_s: vehicle.angular_velocity_in_body(),
            force_mps2: attitude(roll, pitch, yaw).inverse() * force_in_tunnel,
        };
    }

    /// What is sensed from `now_us` on.
    pub(crate) fn sense(&mut self, now_us: u64, inputs: &Inputs, safety_switch: bool) -> Sensed {
        let mut ranges_mm = Beams::default();
        for beam in Beam::ALL {
            let plug = self.ranges.get_mut(beam);
            *ranges_mm.get_mut(beam) = plug.raw_mm(self.family, now_us, *inputs.ranges.get(beam));
        }
        Sensed {
            ranges_mm,
            head_mm: self.head.raw_mm(self.family, now_us, inputs.head),
            encoder_steps: inputs.shaft_encoder_rad.map(encoder_steps),
            motion: self.motion,
            camera_busy: inputs.camera.busy,
            camera_confirm: self.confirm.level(now_us, inputs.camera.photos_stored),
            safety_switch,
        }
    }
}

/// The encoder's step at this angle.
fn encoder_steps(angle_rad: f32) -> u16 {
    let steps = (f64::from(angle_rad) / TAU * ENCODER_STEPS).round();
    steps.rem_euclid(ENCODER_STEPS) as u16
}

/// Where a range sensor is plugged in: the world stops counting samples of one that is dead, the bus must see it gone.
#[derive(Clone, Copy, Debug, Default)]
struct Plug {
    count: u32,
    counted_us: u64,
}

impl Plug {
    fn raw_mm(&mut self, family: RangeFamily, now_us: u64, sample: RangeSample) -> Option<u16> {
        if sample.count != self.count {
            *self = Self { count: sample.count, counted_us: now_us };
        }
        let plugged = sample.reading != RangeReading::Disconnected && now_us < self.counted_us + DEAD_AFTER_US;
        plugged.then(|| sample.reading.to_raw(family))
    }
}

/// The camera's confirm line: one pulse per stored photo, one after another.
#[derive(Clone, Copy, Debug, Default)]
struct ConfirmLine {
    pulsed: u32,
    began_us: Option<u64>,
}

impl ConfirmLine {
    fn level(&mut self, now_us: u64, photos_stored: u32) -> bool {
        let free = self.began_us.is_none_or(|began_us| now_us >= began_us + 2 * PULSE_US);
        if free && self.pulsed != photos_stored {
            self.pulsed = self.pulsed.wrapping_add(1);
            self.began_us = Some(now_us);
        }
        self.began_us.is_some_and(|began_us| now_us < began_us + PULSE_US)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn two_photos_stored_at_once_become_two_pulses() {
        let mut line = ConfirmLine::default();
        let levels: Vec<bool> = (0..40).map(|step| line.level(step * 5_000, if step < 2 { 0 } else { 2 })).collect();
        let rises = levels.windows(2).filter(|pair| pair == &[false, true]).count();
        let highs = levels.iter().filter(|level| **level).count();
        assert_eq!((rises, highs), (2, 12), "two pulses of six steps: {levels:?}");
    }

    #[test]
    fn the_encoder_counts_within_a_turn() {
        let quarter = std::f32::consts::FRAC_PI_2;
        assert_eq!([0.0, quarter, 5.0 * quarter, -quarter].map(encoder_steps), [0, 1024, 1024, 3072]);
    }

    #[test]
    fn a_sensor_that_stops_counting_is_gone_after_a_quarter_second() {
        let mut plug = Plug::default();
        let sample = RangeSample { reading: RangeReading::Measured(1.5), count: 1 };
        let mut raw_mm = |now_us| plug.raw_mm(RangeFamily::Evo, now_us, sample);
        assert_eq!([0, 249_999, 250_000].map(&mut raw_mm), [Some(1500), Some(1500), None]);
    }

    #[test]
    fn at_rest_the_inertial_units_feel_the_ground() {
        let mut equipment = Equipment::new(RangeFamily::Evo);
        let level = VehicleState {
            position_m: Vector3::zeros(),
            velocity_mps: Vector3::zeros(),
            attitude_rad: [0.0, 0.0, 0.5],
            attitude_rate_rad_per_s: [0.0; 3],
        };
        equipment.feel(0, &level);
        equipment.feel(5_000, &level);
        assert!((equipment.motion.force_mps2 - Motion::default().force_mps2).norm() < 1e-12);
        let rolled = VehicleState { attitude_rad: [std::f64::consts::FRAC_PI_2, 0.0, 0.0], ..level };
        equipment.feel(10_000, &rolled);
        let force_mps2 = equipment.motion.force_mps2;
        assert!(
            (force_mps2.y + GRAVITY_MPS2).abs() < 1e-9,
            "on its right side the ground pushes to the left: {force_mps2}"
        );
    }
}
