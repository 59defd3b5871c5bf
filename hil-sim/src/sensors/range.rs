//! A time-of-flight range sensor with a beam of finite width.
//!
//! Model: the reading is the mean over rays spread over the beam (centre and a ring), plus a bias that this very sensor
//! has, plus noise that grows with distance; then quantised and turned into the value that goes over the wire, special
//! values and all. Water mirrors or swallows some of the light: on it the sensor sometimes cannot measure. A wall met
//! at a grazing angle sends nothing back.
//! Sources: Evo and One manuals for ranges, beam and special values; accuracy of the Evo family is not documented, so
//! noise and bias are configuration.

use adit_firmware::io::{RangeReading, RangeSample};
use adit_protocol::beams::Beam;
use adit_protocol::parameters::RangeFamily;
use nalgebra::{Point3, Unit, Vector3};

use crate::config::RangeConfig;
use crate::seed::{Random, Stream};

/// Below this cosine of the incidence angle nothing comes back.
const GRAZING_COSINE: f64 = 0.2;
/// Rays on the ring of the beam.
const RING_RAYS: usize = 6;
/// Radius of the ring, as a share of the beam's half angle: the radius of gyration of a uniform disc.
const RING_SHARE: f64 = 0.707;

/// What a ray meets.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Echo {
    /// Distance along the ray.
    pub distance_m: f64,
    /// Cosine of the angle between the ray and the surface's normal.
    pub incidence_cosine: f64,
    /// Whether it is water.
    pub water: bool,
}

/// Something that answers rays in the tunnel frame.
pub trait Surroundings {
    /// What the ray from `origin` along `direction` meets first; `None` if nothing within reach.
    fn echo(&self, origin: &Point3<f64>, direction: &Unit<Vector3<f64>>) -> Option<Echo>;
}

/// How a sensor is broken.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RangeDefect {
    /// No samples.
    Dead,
    /// Samples go on with the value they had.
    Frozen,
    /// The bus reads zeros, with a valid checksum.
    Zeros,
}

/// Nearest and farthest distance that a family measures, and its step.
#[derive(Clone, Copy, Debug, PartialEq)]
struct FamilyLimits {
    min_m: f64,
    max_m: f64,
    step_m: f64,
    half_beam_rad: f64,
}

fn limits(family: RangeFamily) -> FamilyLimits {
    match family {
        // Evo 15m: 0.5 m to 15 m, 2 degrees, millimetres.
        RangeFamily::Evo => FamilyLimits { min_m: 0.5, max_m: 15.0, step_m: 0.001, half_beam_rad: 0.0175 },
        // One: 0.2 m to 14 m, 3 degrees, steps of 5 mm.
        RangeFamily::One | RangeFamily::OneHub => {
            FamilyLimits { min_m: 0.2, max_m: 14.0, step_m: 0.005, half_beam_rad: 0.0262 }
        }
    }
}

/// One sensor.
#[derive(Clone, Debug)]
pub struct RangeSensor {
    config: RangeConfig,
    family: RangeFamily,
    limits: FamilyLimits,
    bias_m: f64,
    since_sample_s: f64,
    raw_mm: u16,
    count: u32,
    random: Random,
}

impl RangeSensor {
    /// The `index`-th sensor: 0 to 3 in the order of [`Beam::ALL`], 4 on the head.
    pub fn new(index: usize, family: RangeFamily, config: &RangeConfig, seed: u64) -> Self {
        let mut random = Random::numbered(seed, Stream::Range, index as u64);
        let bias_m = random.gauss(config.bias_sigma_m);
        // Sensors are not in step with each other.
        let since_sample_s = random.uniform(0.0, config.period_s);
        Self { config: *config, family, limits: limits(family), bias_m, since_sample_s, raw_mm: 0, count: 0, random }
    }

    /// Goes on by `dt_s` at the given place and returns what the board's driver has.
    pub fn step(
        &mut self,
        around: &impl Surroundings,
        origin: &Point3<f64>,
        direction: &Unit<Vector3<f64>>,
        defect: Option<RangeDefect>,
        dt_s: f64,
    ) -> RangeSample {
        self.since_sample_s += dt_s;
        if self.since_sample_s >= self.config.period_s {
            self.since_sample_s -= self.config.period_s;
            let raw_mm = self.measure(around, origin, direction);
            match defect {
                None => self.raw_mm = raw_mm,
                Some(RangeDefect::Zeros) => self.raw_mm = 0,
                Some(RangeDefect::Frozen | RangeDefect::Dead) => {}
            }
            if defect != Some(RangeDefect::Dead) {
                self.count = self.count.wrapping_add(1);
            }
        }
        if self.count == 0 {
            return RangeSample::default();
        }
        RangeSample { reading: RangeReading::from_raw(self.family, self.raw_mm), count: self.count }
    }

    /// One measurement as it goes over the wire.
    fn measure(&mut self, around: &impl Surroundings, origin: &Point3<f64>, direction: &Unit<Vector3<f64>>) -> u16 {
        let noise = self.random.gauss(1.0);
        let dropped = self.random.chance(self.config.dropout_share);
        let drowned = self.random.chance(self.config.water_dropout_share);
        let (mut sum_m, mut rays, mut on_water) = (0.0, 0, false);
        for ray in self.rays(direction) {
            match around.echo(origin, &ray) {
                Some(echo) if echo.incidence_cosine >= GRAZING_COSINE || echo.water => {
                    on_water |= echo.water;
                    sum_m += echo.distance_m;
                    rays += 1;
                }
                _ => {}
            }
        }
        if rays == 0 || dropped || (on_water && drowned) {
            return self.cannot_measure();
        }
        let distance_m = sum_m / f64::from(rays);
        let sigma_m = self.config.noise_sigma_m + self.config.noise_m_per_m * distance_m;
        self.encode(distance_m + self.bias_m + sigma_m * noise)
    }

    fn rays(&self, direction: &Unit<Vector3<f64>>) -> impl Iterator<Item = Unit<Vector3<f64>>> + use<> {
        let centre = direction.into_inner();
        let across = if centre.x.abs() < 0.9 { Vector3::x() } else { Vector3::y() };
        let first = (across - centre * centre.dot(&across)).normalize();
        let second = centre.cross(&first);
        let radius = (self.limits.half_beam_rad * RING_SHARE).tan();
        std::iter::once(*direction).chain((0..RING_RAYS).map(move |ray| {
            let (sin, cos) = (ray as f64 * std::f64::consts::TAU / RING_RAYS as f64).sin_cos();
            Unit::new_normalize(centre + (first * cos + second * sin) * radius)
        }))
    }

    fn encode(&self, distance_m: f64) -> u16 {
        let FamilyLimits { min_m, max_m, step_m, .. } = self.limits;
        let value = || ((distance_m / step_m).round() * step_m * 1000.0).round() as u16;
        match self.family {
            RangeFamily::Evo if distance_m < min_m => 0,
            RangeFamily::Evo if distance_m > max_m => 0xFFFF,
            RangeFamily::One if distance_m < min_m || distance_m > max_m => 0,
            RangeFamily::OneHub if distance_m < min_m => 200,
            RangeFamily::OneHub if distance_m > max_m => 0,
            _ => value(),
        }
    }

    fn cannot_measure(&self) -> u16 {
        match self.family {
            RangeFamily::Evo => 1,
            RangeFamily::One | RangeFamily::OneHub => 0,
        }
    }
}

/// Direction of a body-fixed beam in the body frame.
pub fn beam_in_body(beam: Beam) -> Unit<Vector3<f64>> {
    Unit::new_unchecked(match beam {
        Beam::Up => -Vector3::z(),
        Beam::Right => Vector3::y(),
        Beam::Down => Vector3::z(),
        Beam::Left => -Vector3::y(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A wall across the beam.
    struct Flat(f64);
    impl Surroundings for Flat {
        fn echo(&self, origin: &Point3<f64>, direction: &Unit<Vector3<f64>>) -> Option<Echo> {
            let distance_m = (self.0 - origin.y) / direction.y;
            Some(Echo { distance_m, incidence_cosine: direction.y, water: false })
        }
    }

    fn quiet() -> RangeConfig {
        RangeConfig {
            noise_sigma_m: 0.0,
            noise_m_per_m: 0.0,
            bias_sigma_m: 0.0,
            dropout_share: 0.0,
            ..RangeConfig::default()
        }
    }

    fn read(family: RangeFamily, wall_m: f64, defect: Option<RangeDefect>) -> RangeReading {
        let mut sensor = RangeSensor::new(1, family, &quiet(), 9);
        let mut last = RangeSample::default();
        for _ in 0..10 {
            last = sensor.step(&Flat(wall_m), &Point3::origin(), &Vector3::y_axis(), defect, 0.02);
        }
        last.reading
    }

    #[test]
    fn a_quiet_sensor_reads_the_distance() {
        let RangeReading::Measured(distance_m) = read(RangeFamily::Evo, 2.0, None) else { panic!("no distance") };
        assert!((distance_m - 2.0).abs() < 0.0015, "{distance_m}");
    }

    #[test]
    fn near_and_far_come_as_the_family_says_them() {
        assert_eq!(read(RangeFamily::Evo, 0.3, None), RangeReading::TooClose);
        assert_eq!(read(RangeFamily::Evo, 20.0, None), RangeReading::TooFar);
        assert_eq!(read(RangeFamily::One, 20.0, None), RangeReading::CannotMeasure);
        assert_eq!(read(RangeFamily::OneHub, 20.0, None), RangeReading::TooFar);
    }

    #[test]
    fn a_dead_sensor_brings_no_sample_and_a_zero_bus_brings_zeros() {
        assert_eq!(read(RangeFamily::Evo, 2.0, Some(RangeDefect::Dead)), RangeReading::Disconnected);
        assert_eq!(read(RangeFamily::Evo, 2.0, Some(RangeDefect::Zeros)), RangeReading::TooClose);
    }
}
