//! The speed limit against the bound, and the way between photos against it.

use adit_protocol::mission::Mission;

use super::report::Violation;
use super::table::BoundTable;
use super::{LIMIT_TOLERANCE, scanning};
use crate::flight::{Flight, Moment};
use crate::world::Exposure;

/// The limit is checked this often.
const LIMIT_CHECK_S: f64 = 0.1;
/// A vehicle that is faster than its limit by no more than this obeys: gusts, and its lag when the limit falls.
const OBEYING_SLACK_MPS: f64 = 0.05;

/// Checks every limit; returns the largest share of the bound that one reached.
pub(super) fn check_limits(
    flight: &Flight,
    mission: &Mission,
    bounds: &mut BoundTable,
    found: &mut Vec<Violation>,
) -> f64 {
    let mut periods = Periods::new(flight, mission.flight.image_period_s);
    let mut checked_s = f64::NEG_INFINITY;
    let mut largest_use = 0.0_f64;
    let most_mps = mission.flight.max_speed_mps as f32;
    for moment in &flight.moments {
        let Some(limit_mps) = moment.limit_mps else { continue };
        let time_s = moment.time_s;
        if !(0.0..=most_mps).contains(&limit_mps) {
            found.push(Violation::LimitAbsurd { time_s, limit_mps });
        }
        if !scanning(moment) {
            if limit_mps > 0.0 {
                found.push(Violation::LimitOutsideScan { time_s, limit_mps });
            }
            continue;
        }
        if time_s - checked_s < LIMIT_CHECK_S {
            continue;
        }
        checked_s = time_s;
        let period_s = periods.at(time_s);
        let bound_m = bounds.step_m(moment.vehicle.position_m.yz().into());
        let used = f64::from(limit_mps) * period_s / bound_m.max(1e-9);
        largest_use = largest_use.max(used);
        if used > 1.0 + LIMIT_TOLERANCE {
            found.push(Violation::LimitAboveBound { time_s, limit_mps, period_s, bound_m });
        }
    }
    largest_use
}

/// The time that one image takes: the mean of the last few intervals between presses.
struct Periods<'f> {
    presses_s: &'f [f64],
    next: usize,
    recent_s: Vec<f64>,
    fallback_s: f64,
}

/// So many intervals are averaged.
const PERIODS: usize = 3;
/// An interval longer than this many times the mean is a pause, not an image.
const PAUSE: f64 = 3.0;

impl<'f> Periods<'f> {
    fn new(flight: &'f Flight, fallback_s: f64) -> Self {
        Self { presses_s: &flight.presses_s, next: 1, recent_s: Vec::new(), fallback_s }
    }

    /// The period as known at `time_s`, which must not run backwards.
    fn at(&mut self, time_s: f64) -> f64 {
        while let (Some(before_s), Some(press_s)) = (self.presses_s.get(self.next - 1), self.presses_s.get(self.next)) {
            if *press_s > time_s {
                break;
            }
            let interval_s = press_s - before_s;
            if interval_s < PAUSE * self.mean_s() {
                self.recent_s.push(interval_s);
            }
            self.next += 1;
        }
        self.mean_s()
    }

    fn mean_s(&self) -> f64 {
        let last = &self.recent_s[self.recent_s.len().saturating_sub(PERIODS)..];
        if last.len() < PERIODS { self.fallback_s } else { last.iter().sum::<f64>() / last.len() as f64 }
    }
}

/// Checks the way between photos; returns the longest way between two that follow each other in one scan while the vehicle obeyed, over the bound there.
pub(super) fn check_steps(flight: &Flight, bounds: &mut BoundTable, found: &mut Vec<Violation>) -> f64 {
    let mut longest = 0.0_f64;
    let asked_for: Vec<&Exposure> = flight.exposures.iter().filter(|exposure| !exposure.surplus).collect();
    for (before, after) in asked_for.iter().zip(asked_for.iter().skip(1)) {
        let from = flight.moments.partition_point(|moment| moment.time_s < before.time_s);
        let to = flight.moments.partition_point(|moment| moment.time_s < after.time_s);
        let between = flight.moments.get(from..to).unwrap_or_default();
        if !between.iter().all(|moment| scanning(moment) && obeys(moment)) {
            continue;
        }
        let bound_m = [before, after]
            .map(|exposure| bounds.step_m(exposure.tunnel_from_body.translation.vector.yz().into()))
            .into_iter()
            .fold(f64::INFINITY, f64::min);
        let way_m = after.tunnel_from_body.translation.x - before.tunnel_from_body.translation.x;
        longest = longest.max(way_m / bound_m.max(1e-9));
        if way_m > bound_m {
            found.push(Violation::StepAboveBound { time_s: after.time_s, way_m, bound_m });
        }
    }
    longest
}

/// Whether the vehicle was no faster than it was told just then, but for gusts and its lag.
fn obeys(moment: &Moment) -> bool {
    let limit_mps = moment.limit_mps.map_or(0.0, f64::from);
    moment.vehicle.velocity_mps.x <= limit_mps + OBEYING_SLACK_MPS
}
