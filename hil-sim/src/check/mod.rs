//! Judges a flight after it, with arithmetic of its own: nothing here calls the board's speed law, centring or capture
//! bookkeeping. It reads what the board wrote (through the log's decoder) and what was true.
//!
//! What is checked, and what that proves:
//! - **Limit**: at every moment of a scan, the commanded speed times the time that one image takes (measured in the
//!   world, on the last images) is no longer than the exact bound at the vehicle's *true* place in the section, plus
//!   [`LIMIT_TOLERANCE`]. That is: a vehicle that obeys leaves no hole. It holds as long as the board's own estimate is as
//!   good as its margin assumes; where sensors lie, the estimate's error is reported beside.
//! - **Photos**: every photo on the card either was asked for and has exactly one tag near its time, or is in the
//!   surplus list. Only a power loss may cost the last tag. No capture is called confirmed that has no photo.
//! - **Captures**: numbers start at 1 and grow by one.

mod bound;
mod coverage;

use std::collections::HashMap;

use adit_geometry::camera::Camera;
use adit_geometry::profile::Profile;
use adit_geometry::rig::Rig;
use adit_protocol::log::FlightLog;
use adit_protocol::mission::Mission;
use adit_protocol::parameters::SpeedBound;
use adit_protocol::record::Mode;
use adit_protocol::tag::{CaptureState, CaptureTag};
use serde::Serialize;

pub use bound::Footprints;
pub use coverage::{Coverage, coverage};

use crate::flight::{Flight, Moment, Outcome};
use crate::world::Exposure;

/// By so much the limit may lie above the bound at the true place: rounding of places to the table's grid, the vehicle's
/// movement since the board's last ranges, and the spread of the image period.
pub const LIMIT_TOLERANCE: f64 = 0.05;
/// A tag belongs to a photo if their times differ by no more than this.
const TAG_TIME_TOLERANCE_S: f64 = 0.25;
/// Places in the section are rounded to this for the table of bounds.
const PLACE_GRID_M: f64 = 0.025;
/// The limit is checked this often.
const LIMIT_CHECK_S: f64 = 0.1;
/// Side of a coverage cell.
const CELL_M: f64 = 0.05;
/// The last photos before a power loss may be without a tag within this time.
const POWER_LOSS_GRACE_S: f64 = 1.0;

/// Something that must not be.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Violation {
    /// A speed limit is not a number, negative, or above the mission's highest speed.
    LimitAbsurd {
        /// When.
        time_s: f64,
        /// The limit.
        limit_mps: f32,
    },
    /// A speed limit above zero stands outside a scan.
    LimitOutsideScan {
        /// When.
        time_s: f64,
        /// The limit.
        limit_mps: f32,
    },
    /// A vehicle that obeys the limit would leave a hole.
    LimitAboveBound {
        /// When.
        time_s: f64,
        /// The limit.
        limit_mps: f32,
        /// Time that one image takes.
        period_s: f64,
        /// Longest step per image at the true place.
        bound_m: f64,
    },
    /// The numbers of captures do not run on.
    CaptureNumber {
        /// Number found.
        found: u32,
        /// Number expected.
        expected: u32,
    },
    /// A photo that was asked for has no tag.
    PhotoWithoutTag {
        /// Place on the card, from 0.
        photo: usize,
        /// When it was taken.
        time_s: f64,
    },
    /// A capture counts as confirmed, but there is no photo.
    ConfirmedWithoutPhoto {
        /// Its number.
        capture: u32,
    },
    /// The log holds damage that no power loss explains.
    LogDamaged {
        /// Number of damaged places.
        places: usize,
    },
}

/// Figures of a flight.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Figures {
    /// How it ended.
    pub outcome: Outcome,
    /// How long the board ran.
    pub duration_s: f64,
    /// How far the vehicle came.
    pub distance_m: f64,
    /// Times that the shutter contact was closed.
    pub presses: usize,
    /// Photos on the card.
    pub photos: usize,
    /// Those that nobody asked for.
    pub surplus: usize,
    /// Presses that brought no photo.
    pub missed: usize,
    /// Tags in the log.
    pub tags: usize,
    /// Those that are confirmed.
    pub confirmed: usize,
    /// Root mean square of the board's error about where it is in the section, while scanning.
    pub centring_error_mm: f64,
    /// Root mean square of the distance from the axis, while scanning.
    pub offset_mm: f64,
    /// Largest share of the bound (at the true place) that the limit reached.
    pub limit_use: f64,
    /// Share of the wall seen at least once, in per cent, a turn and a photo's reach away from the ends.
    pub seen_once_percent: f64,
    /// Share of it seen at least twice.
    pub seen_twice_percent: f64,
}

/// What the checker found.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Report {
    /// Everything that must not be.
    pub violations: Vec<Violation>,
    /// Figures.
    pub figures: Figures,
}

/// Bounds on the step for places in the section, computed when first asked for.
#[derive(Clone, Debug)]
pub struct BoundTable {
    profile: Profile<f64>,
    camera: Camera<f64>,
    rig: Rig<f64>,
    views: usize,
    steps_m: HashMap<(i32, i32), f64>,
}

impl BoundTable {
    /// An empty table for a mission.
    ///
    /// # Errors
    /// [`adit_geometry::profile::ProfileError`] if the profile cannot be built.
    pub fn new(mission: &Mission) -> Result<Self, adit_geometry::profile::ProfileError> {
        let views = match mission.flight.speed_bound {
            SpeedBound::TwoViews => 2,
            SpeedBound::OneView | SpeedBound::Paper => 1,
        };
        Ok(Self {
            profile: mission.survey.profile.build()?,
            camera: mission.survey.camera.camera,
            rig: mission.survey.rig,
            views,
            steps_m: HashMap::new(),
        })
    }

    /// Computes all places within `reach_m` of the axis, so that clones of the table share them.
    pub fn fill(&mut self, reach_m: f64) {
        let most = (reach_m / PLACE_GRID_M).ceil() as i32;
        for y in -most..=most {
            for z in -most..=most {
                self.step_m([f64::from(y) * PLACE_GRID_M, f64::from(z) * PLACE_GRID_M]);
            }
        }
    }

    /// The longest step per image from about this place.
    pub fn step_m(&mut self, offset_m: [f64; 2]) -> f64 {
        let place = offset_m.map(|offset| (offset / PLACE_GRID_M).round() as i32);
        let Self { profile, camera, rig, views, steps_m } = self;
        *steps_m.entry((place[0], place[1])).or_insert_with(|| {
            let offset_m = place.map(|index| f64::from(index) * PLACE_GRID_M);
            Footprints::new(profile, camera, rig, offset_m).longest_step_m(*views)
        })
    }
}

/// Judges a flight and the log it left.
pub fn check(flight: &Flight, log: &[u8], mission: &Mission, bounds: &mut BoundTable) -> Report {
    let decoded = FlightLog::from_bytes(log);
    let tags: Vec<&CaptureTag> = decoded.tags().collect();
    let mut violations = Vec::new();
    let limit_use = check_limits(flight, mission, bounds, &mut violations);
    check_captures(flight, &tags, &mut violations);
    let torn = usize::from(flight.outcome == Outcome::PowerLost);
    let damaged = decoded.damage.len() + decoded.conflicts.len();
    if damaged > torn {
        violations.push(Violation::LogDamaged { places: damaged });
    }
    let figures = figures(flight, &tags, bounds, limit_use);
    Report { violations, figures }
}

fn scanning(moment: &Moment) -> bool {
    matches!(moment.mode, Mode::Scanning | Mode::Degraded)
}

/// Checks every limit; returns the largest share of the bound that one reached.
fn check_limits(flight: &Flight, mission: &Mission, bounds: &mut BoundTable, found: &mut Vec<Violation>) -> f64 {
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

fn check_captures(flight: &Flight, tags: &[&CaptureTag], found: &mut Vec<Violation>) {
    for (tag, expected) in tags.iter().zip(1..) {
        if tag.capture != expected {
            found.push(Violation::CaptureNumber { found: tag.capture, expected });
            break;
        }
    }
    let mut claimed = vec![false; tags.len()];
    let power_lost = flight.outcome == Outcome::PowerLost;
    for (photo, exposure) in flight.exposures.iter().enumerate().filter(|(_, exposure)| !exposure.surplus) {
        let nearest = tags
            .iter()
            .enumerate()
            .filter(|(index, _)| !claimed[*index])
            .map(|(index, tag)| (index, (seconds(tag) - exposure.time_s).abs()))
            .min_by(|a, b| a.1.total_cmp(&b.1));
        match nearest {
            Some((index, apart_s)) if apart_s <= TAG_TIME_TOLERANCE_S => claimed[index] = true,
            _ if power_lost && exposure.time_s > flight.duration_s() - POWER_LOSS_GRACE_S => {}
            _ => found.push(Violation::PhotoWithoutTag { photo, time_s: exposure.time_s }),
        }
    }
    for (tag, claimed) in tags.iter().zip(&claimed) {
        if tag.state == CaptureState::Confirmed && !claimed {
            found.push(Violation::ConfirmedWithoutPhoto { capture: tag.capture });
        }
    }
}

fn seconds(tag: &CaptureTag) -> f64 {
    tag.time_us as f64 * 1e-6
}

/// Root mean square of the board's error about where it is in the section, while scanning; zero if it never knew.
pub fn centring_error_mm(flight: &Flight) -> f64 {
    rms_mm(flight.moments.iter().filter(|moment| scanning(moment)).filter_map(|moment| {
        let estimate_m = nalgebra::Vector2::from(moment.estimate_m?.map(f64::from));
        Some((moment.vehicle.position_m.yz() - estimate_m).norm_squared())
    }))
}

fn rms_mm(squares_m2: impl Iterator<Item = f64>) -> f64 {
    let (sum, count) = squares_m2.fold((0.0, 0_u32), |(sum, count), square| (sum + square, count + 1));
    (sum / f64::from(count.max(1))).sqrt() * 1000.0
}

fn figures(flight: &Flight, tags: &[&CaptureTag], bounds: &BoundTable, limit_use: f64) -> Figures {
    let in_scan = flight.moments.iter().filter(|moment| scanning(moment));
    let surplus = flight.exposures.iter().filter(|exposure| exposure.surplus).count();
    let x_m = |moment: Option<&Moment>| moment.map_or(0.0, |moment| moment.vehicle.position_m.x);
    let seen = seen(flight, bounds);
    Figures {
        outcome: flight.outcome,
        duration_s: flight.duration_s(),
        distance_m: x_m(flight.moments.last()) - x_m(flight.moments.first()),
        presses: flight.presses_s.len(),
        photos: flight.exposures.len(),
        surplus,
        missed: flight.presses_s.len() + surplus - flight.exposures.len(),
        tags: tags.len(),
        confirmed: tags.iter().filter(|tag| tag.state == CaptureState::Confirmed).count(),
        centring_error_mm: centring_error_mm(flight),
        offset_mm: rms_mm(in_scan.map(|moment| moment.vehicle.position_m.yz().norm_squared())),
        limit_use,
        seen_once_percent: seen.once * 100.0,
        seen_twice_percent: seen.twice * 100.0,
    }
}

/// Coverage between the first and the last full turn of photos.
fn seen(flight: &Flight, bounds: &BoundTable) -> Coverage {
    let turn = usize::from(bounds.rig.images_per_turn);
    let station = |exposure: &Exposure| exposure.tunnel_from_cam.translation.x;
    let first = flight.exposures.get(turn).map(station);
    let last = flight.exposures.iter().rev().nth(turn).map(station);
    let (Some(from_x_m), Some(to_x_m)) = (first, last) else { return Coverage::default() };
    coverage(&bounds.profile, &bounds.camera, &flight.exposures, [from_x_m, to_x_m], CELL_M)
}

#[cfg(test)]
mod tests;
