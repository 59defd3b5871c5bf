//! What the board would have noted of each capture: noisy, and as uncertain as the set's `[sigma]` says.

use adit_firmware::io::RangeReading;
use adit_geometry::rig::Rig;
use adit_protocol::beams::Beam;
use adit_protocol::mission::Sigma;
use adit_protocol::parameters::RangeFamily;
use adit_protocol::tag::{CaptureState, CaptureTag, Ranges, TagFlags};
use nalgebra::{Isometry3, Point3, Unit, Vector3};

use super::path::Capture;
use crate::config::RangeConfig;
use crate::scene::Wall;
use crate::seed::{Random, Stream};
use crate::sensors::range::{RangeSensor, beam_in_body};

/// Error of an odometer over one photo's way.
const ODOMETER_STEP_M: f64 = 0.01;
/// Share of range readings that are missing, as in the samples.
const DROPOUT_SHARE: f64 = 0.02;
/// Time from photo to photo, and how far it strays.
const PERIOD_S: [f64; 2] = [1.0, 0.05];

/// The relative error of this set's odometer: 1 to 2 % either way.
pub(super) fn odometer_scale(seed: u64) -> f64 {
    let mut build = Random::numbered(seed, Stream::Build, 1);
    let size = build.uniform(0.01, 0.02);
    if build.chance(0.5) { size } else { -size }
}

/// The tags of all captures; `rig` is the one survey.toml states.
pub(super) fn tags(captures: &[Capture], wall: &Wall, rig: &Rig<f64>, sigma: &Sigma, seed: u64) -> Vec<CaptureTag> {
    let mut shaft = Random::new(seed, Stream::Encoder);
    let mut odometer = Random::new(seed, Stream::Odometer);
    let mut clock = Random::new(seed, Stream::Camera);
    let mut ranging = Ranging::new(sigma.range_m, seed);
    let scale = 1.0 + odometer_scale(seed);
    let (mut odometer_m, mut x_m, mut time_s) = (odometer.gauss(ODOMETER_STEP_M), 0.0, 0.0);
    let mut tags = Vec::with_capacity(captures.len());
    for (index, capture) in captures.iter().enumerate() {
        let moved_m = capture.tunnel_from_body.translation.x - x_m;
        x_m += moved_m;
        // A vehicle that stands still is not moved by its odometer's noise.
        if moved_m != 0.0 {
            odometer_m += moved_m * scale + odometer.gauss(ODOMETER_STEP_M);
        }
        let head = capture.tunnel_from_body * rig.body_from_cam(capture.shaft_rad);
        tags.push(CaptureTag {
            capture: index as u32 + 1,
            state: CaptureState::Confirmed,
            time_us: (time_s * 1e6) as u64,
            shaft_rad: (capture.shaft_rad + shaft.gauss(sigma.shaft_rad)) as f32,
            ranges: ranging.body(wall, &capture.tunnel_from_body),
            range_head_m: ranging.read(HEAD, wall, &head, Vector3::z_axis()),
            odometer_m: Some(odometer_m as f32),
            attitude_rad: None,
            offset_m: None,
            speed_mps: None,
            speed_limit_mps: None,
            flags: TagFlags::default(),
        });
        time_s += PERIOD_S[0] + clock.gauss(PERIOD_S[1]).clamp(-0.5, 0.5);
    }
    tags
}

/// The head's sensor behind the four of [`Beam::ALL`].
const HEAD: usize = 4;

/// All range sensors, each read once per photo.
struct Ranging([RangeSensor; 5]);

impl Ranging {
    fn new(sigma_m: f64, seed: u64) -> Self {
        let config = RangeConfig {
            period_s: 1.0,
            noise_sigma_m: sigma_m,
            noise_m_per_m: 0.0,
            bias_sigma_m: 0.0,
            dropout_share: DROPOUT_SHARE,
            ..RangeConfig::default()
        };
        Self(std::array::from_fn(|index| RangeSensor::new(index, RangeFamily::Evo, &config, seed)))
    }

    fn body(&mut self, wall: &Wall, tunnel_from_body: &Isometry3<f64>) -> Ranges {
        let [up_m, right_m, down_m, left_m] =
            Beam::ALL.map(|beam| self.read(beam as usize, wall, tunnel_from_body, beam_in_body(beam)));
        Ranges { up_m, right_m, down_m, left_m }
    }

    fn read(
        &mut self,
        sensor: usize,
        wall: &Wall,
        tunnel_from_sensor: &Isometry3<f64>,
        direction: Unit<Vector3<f64>>,
    ) -> Option<f32> {
        let origin = Point3::from(tunnel_from_sensor.translation.vector);
        let direction = tunnel_from_sensor.rotation * direction;
        let sample = self.0.get_mut(sensor)?.step(wall, &origin, &direction, None, 1.0);
        match sample.reading {
            RangeReading::Measured(distance_m) => Some(distance_m),
            _ => None,
        }
    }
}
