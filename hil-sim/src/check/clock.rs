//! The board's clock begins anew at every start; the flight's does not.

use adit_protocol::log::FlightLog;
use adit_protocol::record::EventKind;

/// Puts the times of the tags into the flight's time, given when the board started again.
///
/// A run of the board begins with the session that holds its `Started` event; a session without one (another card, a
/// log that went on in another file) belongs to the run before it.
pub(super) fn tags_into_flight_time(log: &mut FlightLog, restarts_s: &[f64]) {
    let starts_s: Vec<f64> = std::iter::once(0.0).chain(restarts_s.iter().copied()).collect();
    let mut starts_seen = 0;
    for session in &mut log.sessions {
        let starts = session.events.iter().any(|event| matches!(event.kind, EventKind::Started(_)));
        starts_seen += usize::from(starts);
        let run = starts_seen.saturating_sub(1).min(starts_s.len() - 1);
        let start_us = (starts_s[run] * 1e6).round() as u64;
        for tag in &mut session.tags {
            tag.time_us += start_us;
        }
    }
}

#[cfg(test)]
mod tests {
    use adit_protocol::log::Session;
    use adit_protocol::record::{Event, StartCause};
    use adit_protocol::tag::{CaptureState, CaptureTag, Ranges, TagFlags};

    use super::*;

    fn session(started: bool, time_us: u64) -> Session {
        let event = Event { time_us: 0, kind: EventKind::Started(StartCause::PowerOn) };
        let tag = CaptureTag {
            capture: 1,
            state: CaptureState::Commanded,
            time_us,
            shaft_rad: 0.0,
            ranges: Ranges::default(),
            range_head_m: None,
            odometer_m: None,
            attitude_rad: None,
            offset_m: None,
            speed_mps: None,
            speed_limit_mps: None,
            flags: TagFlags::default(),
        };
        let events = if started { vec![event] } else { Vec::new() };
        Session { events, tags: vec![tag], ..Session::default() }
    }

    #[test]
    fn tags_of_a_second_run_lie_behind_its_start() {
        let sessions = vec![session(true, 5), session(false, 7), session(true, 1)];
        let mut log = FlightLog { sessions, ..FlightLog::default() };
        tags_into_flight_time(&mut log, &[20.0]);
        assert_eq!(log.tags().map(|tag| tag.time_us).collect::<Vec<_>>(), [5, 7, 20_000_001]);
    }
}
