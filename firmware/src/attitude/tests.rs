//! A vehicle in double precision, felt through a chip with noise and bias, against the filter.

use nalgebra::{UnitQuaternion, Vector3};
use proptest::prelude::*;

use super::AttitudeFilter;
use crate::drivers::imu::ImuSample;

const GRAVITY_MPS2: f64 = 9.80665;
const DT_S: f64 = 0.005;
/// Simulated steps in a sample.
const SUBSTEPS: u32 = 20;

/// Where the vehicle truly is and what is wrong with its chip.
struct Vehicle {
    level_from_body: UnitQuaternion<f64>,
    bias_dps: [f64; 3],
    /// One standard deviation, roughly.
    rate_noise_dps: f64,
    acceleration_noise_mps2: f64,
    random: u64,
    filter: AttitudeFilter,
    time_s: f64,
}

impl Vehicle {
    fn new(roll_deg: f64, pitch_deg: f64, bias_dps: [f64; 3]) -> Self {
        Self {
            level_from_body: UnitQuaternion::from_euler_angles(roll_deg.to_radians(), pitch_deg.to_radians(), 0.0),
            bias_dps,
            rate_noise_dps: 0.05,
            acceleration_noise_mps2: 0.016,
            random: 1,
            filter: AttitudeFilter::default(),
            time_s: 0.0,
        }
    }

    /// A sum of twelve uniform numbers (splitmix64), of unit variance.
    fn noise(&mut self) -> f64 {
        let mut uniform = || {
            self.random = self.random.wrapping_add(0x9E37_79B9_7F4A_7C15);
            let mixed = (self.random ^ (self.random >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
            let mixed = (mixed ^ (mixed >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
            ((mixed ^ (mixed >> 31)) >> 11) as f64 / (1_u64 << 53) as f64 - 0.5
        };
        (0..12).map(|_| uniform()).sum()
    }

    /// Moves for `duration_s` with these body rates and this acceleration over the ground, level frame, both of the
    /// time since the motion began. Returns the filter's last answer.
    fn fly(
        &mut self,
        duration_s: f64,
        rate_dps: impl Fn(f64) -> [f64; 3],
        acceleration_mps2: impl Fn(f64) -> [f64; 3],
    ) -> Option<[f32; 3]> {
        let mut answer = None;
        for step in 0..(duration_s / DT_S).round() as u32 {
            for substep in 0..SUBSTEPS {
                let middle_s = (f64::from(step) + (f64::from(substep) + 0.5) / f64::from(SUBSTEPS)) * DT_S;
                let turn = Vector3::from(rate_dps(middle_s).map(f64::to_radians)) * (DT_S / f64::from(SUBSTEPS));
                self.level_from_body *= UnitQuaternion::from_scaled_axis(turn);
            }
            let now_s = f64::from(step + 1) * DT_S;
            let sample = self.sample(rate_dps(now_s), acceleration_mps2(now_s));
            self.time_s += DT_S;
            answer = self.filter.update(DT_S as f32, &sample);
        }
        answer
    }

    fn sample(&mut self, rate_dps: [f64; 3], acceleration_mps2: [f64; 3]) -> ImuSample {
        let felt = Vector3::from(acceleration_mps2) - Vector3::new(0.0, 0.0, GRAVITY_MPS2);
        let felt = self.level_from_body.inverse_transform_vector(&felt);
        let mut sample = ImuSample { temperature_c: 25.0, ..ImuSample::default() };
        for axis in 0..3 {
            let rate_dps = rate_dps[axis] + self.bias_dps[axis] + self.rate_noise_dps * self.noise();
            sample.rate_radps[axis] = rate_dps.to_radians() as f32;
            sample.acceleration_mps2[axis] = (felt[axis] + self.acceleration_noise_mps2 * self.noise()) as f32;
        }
        sample
    }

    fn rest(&mut self, duration_s: f64) -> Option<[f32; 3]> {
        self.fly(duration_s, |_| [0.0; 3], |_| [0.0; 3])
    }

    /// Roll, pitch and yaw from the elements of the rotation matrix.
    fn truth_deg(&self) -> [f64; 3] {
        let m = self.level_from_body.to_rotation_matrix();
        [m[(2, 1)].atan2(m[(2, 2)]), (-m[(2, 0)]).asin(), m[(1, 0)].atan2(m[(0, 0)])].map(f64::to_degrees)
    }

    /// How far the filter is from the truth, degrees per angle.
    fn errors_deg(&self) -> [f64; 3] {
        let found = self.filter.attitude_rad().expect("settled").map(|angle_rad| f64::from(angle_rad).to_degrees());
        let truth = self.truth_deg();
        std::array::from_fn(|axis| (found[axis] - truth[axis] + 540.0).rem_euclid(360.0) - 180.0)
    }
}

fn assert_within(vehicle: &Vehicle, limits_deg: [f64; 3], what: &str) {
    let errors_deg = vehicle.errors_deg();
    let within = errors_deg.iter().zip(limits_deg).all(|(error, limit)| error.abs() <= limit);
    assert!(within, "{what}: errors {errors_deg:.3?} exceed {limits_deg:?} degrees");
}

#[test]
fn a_level_vehicle_is_level_after_two_seconds() {
    let mut vehicle = Vehicle::new(0.0, 0.0, [0.0; 3]);
    assert_eq!(vehicle.rest(1.9), None, "not settled yet");
    assert!(vehicle.rest(0.2).is_some());
    assert_within(&vehicle, [0.05; 3], "level");
}

#[test]
fn tilts_at_rest_have_the_right_sign_on_each_axis() {
    for (roll_deg, pitch_deg) in [(10.0, 0.0), (-10.0, 0.0), (0.0, 10.0), (0.0, -10.0), (170.0, 0.0)] {
        let mut vehicle = Vehicle::new(roll_deg, pitch_deg, [0.0; 3]);
        let [roll, pitch, _] = vehicle.rest(3.0).expect("settled").map(|angle| f64::from(angle).to_degrees());
        assert!((roll - roll_deg).abs() < 0.05, "roll {roll}, expected {roll_deg}");
        assert!((pitch - pitch_deg).abs() < 0.05, "pitch {pitch}, expected {pitch_deg}");
    }
}

#[test]
fn what_a_tilted_chip_feels_is_what_the_hand_calculates() {
    // Right side down by 10 degrees: gravity's reaction shows to the left. Nose up: to the front.
    let rows = [([0.0, -1.702_92, -9.657_67], [10.0, 0.0]), ([1.702_92, 0.0, -9.657_67], [0.0, 10.0])];
    for (acceleration_mps2, [roll_deg, pitch_deg]) in rows {
        let mut filter = AttitudeFilter::default();
        let sample = ImuSample { acceleration_mps2, ..ImuSample::default() };
        let attitude = (0..500).find_map(|_| filter.update(0.005, &sample)).expect("settled");
        let [roll, pitch, yaw] = attitude.map(f32::to_degrees);
        assert!((roll - roll_deg).abs() < 0.01 && (pitch - pitch_deg).abs() < 0.01 && yaw == 0.0, "{attitude:?}");
    }
}

#[test]
fn turns_have_the_right_sign_on_each_axis() {
    for axis in 0..3 {
        for sign in [1.0, -1.0] {
            let mut vehicle = Vehicle::new(0.0, 0.0, [0.0; 3]);
            vehicle.rest(3.0);
            let mut rate_dps = [0.0; 3];
            rate_dps[axis] = sign * 10.0;
            let attitude = vehicle.fly(1.0, |_| rate_dps, |_| [0.0; 3]).expect("settled");
            let mut expected_deg = [0.0; 3];
            expected_deg[axis] = sign * 10.0;
            for (found, expected) in attitude.map(f32::to_degrees).iter().zip(expected_deg) {
                assert!((f64::from(*found) - expected).abs() < 0.2, "axis {axis}: {attitude:?}");
            }
        }
    }
}

#[test]
fn the_bias_is_found_at_rest_and_taken_off() {
    let bias_dps = [2.0, -4.0, 3.0];
    let mut vehicle = Vehicle::new(3.0, -2.0, bias_dps);
    vehicle.rest(10.0);
    for (found, expected) in vehicle.filter.bias_radps().iter().zip(bias_dps) {
        assert!((f64::from(found.to_degrees()) - expected).abs() < 0.01, "{found} for {expected}");
    }
    let yaw_before = vehicle.errors_deg()[2];
    vehicle.rest(60.0);
    assert!((vehicle.errors_deg()[2] - yaw_before).abs() < 0.2, "yaw drifts: {:?}", vehicle.errors_deg());
}

#[test]
fn a_bias_that_creeps_is_followed_from_rest_to_rest() {
    let mut vehicle = Vehicle::new(0.0, 0.0, [0.0; 3]);
    vehicle.rest(5.0);
    for step in 1..=10 {
        vehicle.bias_dps = [0.3 * f64::from(step); 3];
        vehicle.fly(0.5, |_| [5.0, 0.0, 0.0], |_| [0.0; 3]);
        vehicle.fly(0.5, |_| [-5.0, 0.0, 0.0], |_| [0.0; 3]);
        vehicle.rest(5.0);
    }
    let [x, ..] = vehicle.filter.bias_radps().map(f32::to_degrees);
    assert!((x - 3.0).abs() < 0.02, "{x}");
}

#[test]
fn a_steady_turn_is_no_bias() {
    let mut vehicle = Vehicle::new(0.0, 0.0, [0.0; 3]);
    vehicle.rest(3.0);
    vehicle.fly(20.0, |_| [0.0, 0.0, 2.0], |_| [0.0; 3]);
    assert_within(&vehicle, [0.1, 0.1, 0.3], "40 degrees of slow yaw");
}

#[test]
fn sixty_seconds_of_motion_cost_fractions_of_a_degree() {
    use std::f64::consts::TAU;
    type Motion = (&'static str, fn(f64) -> [f64; 3], fn(f64) -> [f64; 3], [f64; 3]);
    // Bias (1, -2, 1.5) degrees per second and the chip's noise throughout; limits: roll, pitch, yaw in degrees.
    let still = |_: f64| [0.0; 3];
    let motions: [Motion; 7] = [
        ("rest", still, still, [0.05, 0.05, 0.10]),
        ("yaw at 10 deg/s", |_| [0.0, 0.0, 10.0], still, [0.05, 0.05, 0.10]),
        (
            "roll of 20 deg at 0.3 Hz",
            |t| [20.0 * 0.3 * TAU * (0.3 * TAU * t).cos(), 0.0, 0.0],
            still,
            [0.15, 0.05, 0.10],
        ),
        (
            "pitch of 20 deg at 0.3 Hz",
            |t| [0.0, 20.0 * 0.3 * TAU * (0.3 * TAU * t).cos(), 0.0],
            still,
            [0.05, 0.15, 0.10],
        ),
        (
            "coning, 30 deg/s at 1 Hz, with yaw",
            |t| [30.0 * (TAU * t).cos(), 30.0 * (TAU * t).sin(), 5.0],
            still,
            [0.15, 0.05, 0.10],
        ),
        ("surge of 0.5 m/s2 at 0.3 Hz", still, |t| [0.5 * (0.3 * TAU * t).sin(), 0.0, 0.0], [0.05, 0.40, 0.10]),
        ("shaking, 5 m/s2 at 37 Hz", still, |t| [0.0, 0.0, 5.0 * (37.0 * TAU * t).sin()], [0.05, 0.10, 0.10]),
    ];
    for (name, rate_dps, acceleration_mps2, limits_deg) in motions {
        let mut vehicle = Vehicle::new(1.0, -2.0, [1.0, -2.0, 1.5]);
        vehicle.rest(5.0);
        vehicle.fly(60.0, rate_dps, acceleration_mps2);
        println!("{name:<36} {:>6.2?}", vehicle.errors_deg());
        assert_within(&vehicle, limits_deg, name);
    }
}

#[test]
fn yaw_is_zero_where_it_was_zeroed() {
    let mut vehicle = Vehicle::new(5.0, -3.0, [0.0; 3]);
    vehicle.rest(3.0);
    vehicle.fly(5.0, |_| [0.0, 0.0, 10.0], |_| [0.0; 3]);
    let [roll_deg, pitch_deg, _] = vehicle.truth_deg();
    vehicle.filter.zero_yaw();
    let [roll, pitch, yaw] = vehicle.filter.attitude_rad().expect("settled").map(|angle| f64::from(angle).to_degrees());
    assert!(yaw.abs() < 1e-3, "{yaw}");
    assert!((roll - roll_deg).abs() < 0.1 && (pitch - pitch_deg).abs() < 0.1, "zeroing yaw tilts: {roll}, {pitch}");
}

#[test]
fn a_wrong_attitude_comes_back_with_the_accelerometer() {
    let mut vehicle = Vehicle::new(0.0, 0.0, [0.0; 3]);
    vehicle.rest(3.0);
    // The truth jumps; the gyroscope never tells. Shaking keeps the filter from taking this for rest.
    vehicle.level_from_body = UnitQuaternion::from_euler_angles(10.0_f64.to_radians(), 0.0, 0.0);
    let shaking = |t: f64| [0.0, 0.0, 0.5 * (200.0 * t).sin()];
    vehicle.fly(5.0, |_| [0.0; 3], shaking);
    let after_one_constant_deg = vehicle.errors_deg()[0].abs();
    assert!((3.0..4.5).contains(&after_one_constant_deg), "10 / e = 3.7 expected, {after_one_constant_deg} found");
    vehicle.fly(30.0, |_| [0.0; 3], shaking);
    assert_within(&vehicle, [0.1, 0.1, 0.3], "after seven time constants");
}

#[test]
fn nothing_settles_while_it_moves() {
    let mut vehicle = Vehicle::new(0.0, 0.0, [0.0; 3]);
    assert_eq!(vehicle.fly(20.0, |t| [0.0, 0.0, 10.0 * (3.0 * t).sin()], |_| [0.0; 3]), None);
    let mut vehicle = Vehicle::new(0.0, 0.0, [0.0, 0.0, 10.0]);
    assert_eq!(vehicle.rest(20.0), None, "more bias than a healthy chip has");
    let mut vehicle = Vehicle::new(0.0, 0.0, [0.0; 3]);
    assert_eq!(vehicle.fly(20.0, |_| [0.0; 3], |_| [0.0, 0.0, 9.0]), None, "falling is no rest");
}

#[test]
fn short_gaps_are_bridged_and_long_ones_are_not() {
    let bad = ImuSample { rate_radps: [f32::NAN, 0.0, 0.0], ..ImuSample::default() };
    let mut vehicle = Vehicle::new(0.0, 0.0, [0.0; 3]);
    vehicle.rest(3.0);
    // A turn of 20 degrees per second, of which 0.1 s are not seen: the next sample stands for them.
    vehicle.fly(1.0, |_| [0.0, 0.0, 20.0], |_| [0.0; 3]);
    for _ in 0..20 {
        assert!(vehicle.filter.update(0.005, &bad).is_some());
    }
    vehicle.level_from_body *= UnitQuaternion::from_euler_angles(0.0, 0.0, 2.0_f64.to_radians());
    vehicle.fly(1.0, |_| [0.0, 0.0, 20.0], |_| [0.0; 3]);
    assert_within(&vehicle, [0.1, 0.1, 0.2], "bridged");
    assert!((0..41).all(|_| vehicle.filter.update(0.005, &bad).is_none() || vehicle.filter.gap_s < 0.2001));
    assert_eq!(vehicle.filter.attitude_rad(), None, "0.2 s are too long");
    assert!(vehicle.rest(3.0).is_some(), "it settles again");
}

#[test]
fn time_that_is_no_time_unsettles() {
    for dt_s in [f32::NAN, f32::INFINITY, -0.001, 1.0] {
        let mut vehicle = Vehicle::new(0.0, 0.0, [0.0; 3]);
        vehicle.rest(3.0);
        let sample = vehicle.sample([0.0; 3], [0.0; 3]);
        assert!(vehicle.filter.update(0.0, &sample).is_some(), "no time at all is harmless");
        assert_eq!(vehicle.filter.update(dt_s, &sample), None, "{dt_s}");
        assert!(vehicle.rest(3.0).is_some(), "{dt_s}: it settles again");
    }
}

/// Anything at all, or anything that the chip can say.
fn any_vector() -> impl Strategy<Value = [f32; 3]> {
    prop_oneof![any::<[f32; 3]>(), prop::array::uniform3(-9.0_f32..9.0)]
}

proptest! {
    #[test]
    fn any_samples_give_finite_angles_or_none(
        samples in prop::collection::vec((any::<f32>(), any_vector(), any_vector()), 0..50),
        honest in any::<bool>(),
    ) {
        let mut vehicle = Vehicle::new(0.0, 0.0, [0.0; 3]);
        vehicle.rest(3.0);
        for (dt_s, rate_radps, acceleration_mps2) in samples {
            let dt_s = if honest { 0.005 } else { dt_s };
            let sample = ImuSample { rate_radps, acceleration_mps2, temperature_c: 0.0 };
            let attitude = vehicle.filter.update(dt_s, &sample);
            prop_assert!(attitude.is_none_or(|angles| angles.iter().all(|angle| angle.is_finite())), "{:?}", attitude);
        }
        prop_assert!(vehicle.rest(6.0).is_some(), "nothing spoils the filter for good");
    }
}
