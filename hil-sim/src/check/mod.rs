//! Judges a flight after it, with arithmetic of its own: nothing here calls the board's speed law, centring or capture
//! bookkeeping. It reads what the board wrote (through the log's decoder) and what was true.
//!
//! What is checked, and what that proves:
//! - **Limit**: at every moment of a scan, the commanded speed times the time that one image takes (measured in the
//!   world, on the last images) is no longer than the exact bound at the vehicle's *true* place in the section, plus
//!   [`LIMIT_TOLERANCE`]. That is: a vehicle that obeys leaves no hole. It holds as long as the board's own estimate is as
//!   good as its margin assumes; where sensors lie, the estimate's error is reported beside.
//! - **Steps**: where the vehicle did obey, the way between two photos that follow each other is no longer than that bound,
//!   missed photos included.
//! - **Photos**: every photo on the card either was asked for and has exactly one tag near its time, or is in the
//!   surplus list. Only a power loss may cost the last tag. No capture is called confirmed that has no photo.
//! - **Captures**: numbers start at 1 and grow by one.

mod bound;
mod captures;
mod clock;
mod coverage;
mod limits;
mod report;
mod table;

use adit_geometry::angles::wrap_half_turn;
use adit_protocol::log::FlightLog;
use adit_protocol::mission::Mission;
use adit_protocol::record::Mode;
use adit_protocol::tag::{CaptureState, CaptureTag};

pub use bound::Footprints;
pub use coverage::{Coverage, coverage};
pub use report::{Figures, Report, Violation};
pub use table::BoundTable;

use crate::flight::{Flight, Moment, Outcome};
use crate::world::Exposure;
use captures::{check_captures, seconds};
use clock::tags_into_flight_time;
use limits::{check_limits, check_steps};

/// By so much the limit may lie above the bound at the true place: rounding of places to the table's grid, the vehicle's
/// movement since the board's last ranges, and the spread of the image period.
pub const LIMIT_TOLERANCE: f64 = 0.05;

/// Side of a coverage cell.
const CELL_M: f64 = 0.05;

/// Judges a flight and the log it left.
pub fn check(flight: &Flight, log: &[u8], mission: &Mission, bounds: &mut BoundTable) -> Report {
    let mut decoded = FlightLog::from_bytes(log);
    tags_into_flight_time(&mut decoded, &flight.restarts_s);
    let tags: Vec<&CaptureTag> = decoded.tags().collect();
    let mut violations = Vec::new();
    let limit_use = check_limits(flight, mission, bounds, &mut violations);
    let longest_step = check_steps(flight, bounds, &mut violations);
    let pairs = check_captures(flight, &tags, &mut violations);
    // Whatever stops the board may tear the record it is writing.
    let torn = usize::from(flight.outcome == Outcome::PowerLost) + flight.restarts_s.len();
    let damaged = decoded.damage.len() + decoded.conflicts.len();
    if damaged > torn {
        violations.push(Violation::LogDamaged { places: damaged });
    }
    let seen = seen(flight, bounds);
    let time_errors = pairs.iter().map(|(tag, exposure)| seconds(tag) - exposure.time_s);
    // Which turn the shaft was left in, nobody knows.
    let shaft_errors =
        pairs.iter().map(|(tag, exposure)| wrap_half_turn(f64::from(tag.shaft_rad) - exposure.shaft_rad));
    let figures = Figures {
        limit_use,
        longest_step,
        tag_time_error_ms: rms(time_errors) * 1000.0,
        tag_shaft_error_deg: rms(shaft_errors).to_degrees(),
        seen_once_percent: seen.once * 100.0,
        seen_twice_percent: seen.twice * 100.0,
        ..counts(flight, &tags)
    };
    Report { violations, figures }
}

fn scanning(moment: &Moment) -> bool {
    matches!(moment.mode, Mode::Scanning | Mode::Degraded)
}

/// Root mean square of the board's error about where it is in the section, while scanning; zero if it never knew.
pub fn centring_error_mm(flight: &Flight) -> f64 {
    let errors_m = flight.moments.iter().filter(|moment| scanning(moment)).filter_map(|moment| {
        let estimate_m = nalgebra::Vector2::from(moment.estimate_m?.map(f64::from));
        Some((moment.vehicle.position_m.yz() - estimate_m).norm())
    });
    rms(errors_m) * 1000.0
}

fn rms(values: impl Iterator<Item = f64>) -> f64 {
    let (sum, count) = values.fold((0.0, 0_u32), |(sum, count), value| (sum + value * value, count + 1));
    (sum / f64::from(count.max(1))).sqrt()
}

/// The figures that are counted, the others zero.
fn counts(flight: &Flight, tags: &[&CaptureTag]) -> Figures {
    let in_scan = flight.moments.iter().filter(|moment| scanning(moment));
    let surplus = flight.exposures.iter().filter(|exposure| exposure.surplus).count();
    let x_m = |moment: Option<&Moment>| moment.map_or(0.0, |moment| moment.vehicle.position_m.x);
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
        offset_mm: rms(in_scan.map(|moment| moment.vehicle.position_m.yz().norm())) * 1000.0,
        limit_use: 0.0,
        longest_step: 0.0,
        tag_time_error_ms: 0.0,
        tag_shaft_error_deg: 0.0,
        seen_once_percent: 0.0,
        seen_twice_percent: 0.0,
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
