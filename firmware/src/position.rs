//! Where the vehicle is in the section: the range monitors' beams through [`adit_geometry::centring`].
//!
//! The downward beam takes no part; expected minus measured is the level of water or sludge. A position is held for a
//! moment when the beams stop giving one, then it is lost. Where the last place does not explain the beams, the whole section
//! is searched, a piece in each step without samples, so that no step takes long; the position is then some 30 steps old.

use adit_geometry::SectionVector;
use adit_geometry::centring::general::{Beam as SolverBeam, Centring, Fix, Search};
use adit_geometry::profile::Profile;
use adit_geometry::rig::attitude;
use adit_geometry::single::{advance, expected_range_m, locate_near};
use adit_protocol::beams::{Beam, Beams};
use adit_protocol::parameters::RangeParameters;
use adit_protocol::tag::Ranges;
use nalgebra::{ComplexField, UnitQuaternion, Vector3};

use crate::io::{CentringStatus, Inputs};
use crate::ranges::{RangeChange, RangeMonitor};
use crate::time::has_passed;

/// A position older than this is lost: at a drift of 0.2 m/s it is wrong by the width of a hand.
const POSITION_STALE_S: f32 = 0.5;
/// The beams that give the position, in the order in which the solver sees them.
const SOLVER_BEAMS: [Beam; 3] = [Beam::Up, Beam::Right, Beam::Left];

/// The vehicle's place in the section.
#[derive(Clone, Debug)]
pub(crate) struct Position {
    parameters: RangeParameters,
    monitors: Beams<RangeMonitor>,
    head: RangeMonitor,
    fix: Option<(CentringStatus, u64)>,
    /// A search of the whole section, and when its beams were measured.
    search: Option<(Search<f32>, u64)>,
    /// Whether the step before looked near the last place.
    sought_near: bool,
    water_level_m: Option<f32>,
}

impl Position {
    pub(crate) fn new(parameters: RangeParameters) -> Self {
        Self {
            parameters,
            monitors: Beams::default(),
            head: RangeMonitor::default(),
            fix: None,
            search: None,
            sought_near: false,
            water_level_m: None,
        }
    }

    /// The position, if it is known.
    pub(crate) fn status(&self) -> Option<&CentringStatus> {
        self.fix.as_ref().map(|(status, _)| status)
    }

    /// Level of water or sludge above the floor.
    pub(crate) fn water_level_m(&self) -> Option<f32> {
        self.water_level_m
    }

    /// The ranges that are to be believed.
    pub(crate) fn ranges(&self) -> Ranges {
        Ranges {
            up_m: self.monitors.up.range_m(),
            right_m: self.monitors.right.range_m(),
            down_m: self.monitors.down.range_m(),
            left_m: self.monitors.left.range_m(),
        }
    }

    /// The range along the optical axis.
    pub(crate) fn head_m(&self) -> Option<f32> {
        self.head.range_m()
    }

    /// Which sensors are faulty.
    pub(crate) fn faults(&self) -> Beams<bool> {
        Beams::from_fn(|beam| self.monitors.get(beam).is_faulty())
    }

    /// Whether any of the sensors is faulty, the head's included.
    pub(crate) fn any_fault(&self) -> bool {
        Beam::ALL.iter().any(|beam| self.monitors.get(*beam).is_faulty()) || self.head.is_faulty()
    }

    /// Takes this step's samples. Tells what changed with each body-fixed sensor.
    pub(crate) fn update(
        &mut self,
        now_us: u64,
        inputs: &Inputs,
        profile: Option<&Profile<f32>>,
    ) -> Beams<Option<RangeChange>> {
        let parameters = self.parameters;
        let changes = Beams::from_fn(|beam| {
            let monitor = self.monitors.get_mut(beam);
            let fitted = *parameters.fitted.get(beam);
            if fitted { monitor.update(now_us, inputs.ranges.get(beam), &parameters) } else { None }
        });
        if parameters.head_fitted {
            let _ = self.head.update(now_us, &inputs.head, &parameters);
        }
        let attitude_rad = inputs.attitude_rad.filter(|angles| angles.iter().copied().all(f32::is_finite));
        let [roll, pitch, yaw] = attitude_rad.unwrap_or_default();
        let tunnel_from_body = attitude(roll, pitch, yaw);
        if let Some(profile) = profile {
            self.locate(now_us, profile, &tunnel_from_body);
            if self.monitors.down.is_fresh() {
                self.measure_water(profile, &tunnel_from_body);
            }
        }
        if self.fix.is_some_and(|(_, at_us)| has_passed(at_us, now_us, POSITION_STALE_S)) {
            self.fix = None;
        }
        changes
    }

    fn beam(&self, beam: Beam) -> SolverBeam<f32> {
        let [lever_y_m, lever_z_m] = *self.parameters.lever_m.get(beam);
        let [y, z] = beam.direction();
        SolverBeam {
            origin_in_body_m: Vector3::new(0.0, lever_y_m, lever_z_m),
            direction_in_body: Vector3::new(0.0, y, z),
            range_m: self.monitors.get(beam).range_m(),
            sigma_m: self.parameters.sigma_m,
        }
    }

    /// With new samples a solution near the last place; between them, and after one that gave nothing, a piece of a search.
    fn locate(&mut self, now_us: u64, profile: &Profile<f32>, tunnel_from_body: &UnitQuaternion<f32>) {
        let is_fresh = SOLVER_BEAMS.iter().any(|beam| self.monitors.get(*beam).is_fresh());
        let seeks_near = is_fresh && self.fix.is_some() && !self.sought_near;
        self.sought_near = false;
        match &mut self.search {
            Some((search, measured_us)) if !seeks_near => {
                let measured_us = *measured_us;
                if let Some(outcome) = advance(search, profile) {
                    self.search = None;
                    self.note(&outcome, measured_us);
                }
            }
            _ if is_fresh => self.solve(now_us, profile, tunnel_from_body),
            _ => {}
        }
    }

    fn solve(&mut self, now_us: u64, profile: &Profile<f32>, tunnel_from_body: &UnitQuaternion<f32>) {
        self.sought_near = true;
        let beams = SOLVER_BEAMS.map(|beam| self.beam(beam));
        let hint_m = self.status().map(|status| SectionVector::from(status.offset_m));
        if let Some(outcome) = hint_m.and_then(|hint_m| locate_near(profile, &beams, tunnel_from_body, hint_m)) {
            self.search = None;
            self.note(&outcome, now_us);
        } else if self.search.is_none() {
            self.search = Some((Search::new(profile, &beams, tunnel_from_body, hint_m), now_us));
        }
    }

    fn note(&mut self, outcome: &Centring<f32>, measured_us: u64) {
        if let Some(status) = outcome.solved().and_then(status_of) {
            self.fix = Some((status, measured_us));
        }
    }

    fn measure_water(&mut self, profile: &Profile<f32>, tunnel_from_body: &UnitQuaternion<f32>) {
        let beam = self.beam(Beam::Down);
        self.water_level_m = self.status().zip(beam.range_m).and_then(|(status, range_m)| {
            let expected_m = expected_range_m(profile, &beam, tunnel_from_body, status.offset_m.into())?;
            let level_m = expected_m - range_m;
            level_m.is_finite().then_some(level_m)
        });
    }
}

/// The solver's fix as plain data; `None` unless two beams at least agree and all figures are finite.
fn status_of(fix: &Fix<f32>) -> Option<CentringStatus> {
    let offset_m: [f32; 2] = fix.offset_m.into();
    let variances: [f32; 2] = fix.covariance_m2.diagonal().into();
    let sigma_m = variances.map(|variance| ComplexField::sqrt(variance.max(0.0)));
    let mut used = Beams::default();
    for (index, beam) in SOLVER_BEAMS.into_iter().enumerate() {
        *used.get_mut(beam) = fix.used.contains(index);
    }
    let finite = offset_m.iter().chain(&sigma_m).copied().all(f32::is_finite);
    (fix.used.len() >= 2 && finite).then_some(CentringStatus { offset_m, sigma_m, used })
}

#[cfg(test)]
mod tests {
    use adit_geometry::profile::ProfileSpec;

    use super::*;
    use crate::io::{RangeReading, RangeSample};

    fn profile() -> Profile<f32> {
        ProfileSpec::Circle { radius_m: 3.0 }.build().unwrap()
    }

    /// Inputs of a level vehicle at `[y, z]` in a circle of 3 m, with water of this level.
    fn inputs_at(y_m: f32, z_m: f32, level_m: f32, count: u32) -> Inputs {
        let sample = |range_m| RangeSample { reading: RangeReading::Measured(range_m), count };
        let half_chord_m = (9.0 - z_m * z_m).sqrt();
        let height_m = (9.0 - y_m * y_m).sqrt();
        let ranges = Beams {
            up: sample(height_m + z_m),
            right: sample(half_chord_m - y_m),
            down: sample(height_m - z_m - level_m),
            left: sample(half_chord_m + y_m),
        };
        Inputs { ranges, ..Inputs::default() }
    }

    /// Long enough for a search of the whole section and a few solutions more.
    const STEPS: u32 = 40;

    /// A position after some steps of 5 ms at the same place.
    fn settled(y_m: f32, z_m: f32, level_m: f32) -> Position {
        let mut position = Position::new(RangeParameters::default());
        for step in 0..STEPS {
            let inputs = inputs_at(y_m, z_m, level_m, step + 1);
            position.update(u64::from(step) * 5_000, &inputs, Some(&profile()));
        }
        position
    }

    #[test]
    fn the_position_and_the_water_level_are_found() {
        let position = settled(0.3, -0.4, 0.15);
        let status = position.status().unwrap();
        assert!((status.offset_m[0] - 0.3).abs() < 1e-3 && (status.offset_m[1] + 0.4).abs() < 1e-3, "{status:?}");
        assert!(!status.used.down);
        assert!((position.water_level_m().unwrap() - 0.15).abs() < 1e-3);
    }

    #[test]
    fn the_position_is_held_for_a_moment_and_then_lost() {
        let mut position = settled(0.1, 0.1, 0.0);
        let still = inputs_at(0.1, 0.1, 0.0, STEPS);
        position.update(600_000, &still, Some(&profile()));
        assert!(position.status().is_some());
        position.update(800_000, &still, Some(&profile()));
        assert!(position.status().is_none());
    }
}
