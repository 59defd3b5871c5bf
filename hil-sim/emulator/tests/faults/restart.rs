//! Faults that only a restart cures.

use adit_emulator::{BoardFaultKind, RestartCause};
use adit_protocol::record::{EventKind, StartCause};

use crate::common::{Case, Flown, board, fly};

/// A task's deadline and the supervisor's period, then the watchdog's 0.5 s.
const HANG_TO_RESTART_S: f64 = 0.5 + 0.05 + 0.55;

/// Where the restart was; there must be one only.
fn restart_s(flown: &Flown, cause: RestartCause) -> f64 {
    let [restart] = flown.report.restarts[..] else { panic!("{:?}", flown.report.restarts) };
    assert_eq!(restart.cause, cause);
    restart.at_ns as f64 * 1e-9
}

/// Fails unless servo and shutter are let go all the time from then to then.
fn expect_safe(flown: &Flown, from_s: f64, to_s: f64) {
    let between = flown.pins.iter().filter(|(at_s, _)| (from_s..to_s).contains(at_s));
    for (at_s, pins) in between {
        assert!(pins.servo_pulse_us.is_none() && !pins.shutter, "{pins:?} at {at_s} s");
    }
}

/// Fails unless the second log begins with this cause and words that contain these, and numbers go on.
fn expect_second_log(flown: &Flown, cause: StartCause, words: &str) {
    let session = flown.log.sessions.get(1).expect("a second log");
    assert!(session.events.iter().any(|event| event.kind == EventKind::Started(cause)), "{:?}", session.events);
    let said: Vec<&str> = session.messages.iter().map(|message| message.text.as_str()).collect();
    assert!(said.iter().any(|text| text.contains(words)), "no {words:?} in {said:?}");
    let captures = flown.captures();
    assert!(captures.windows(2).all(|pair| pair[0] < pair[1]), "numbers repeat: {captures:?}");
    assert!(!session.tags.is_empty(), "no capture after the restart");
    assert!(flown.log.damage.len() <= 1, "{:?}", flown.log.damage);
}

#[test]
fn a_task_that_hangs_is_ended_by_the_watchdog_with_the_servo_let_go() {
    let stuck = vec![board(BoardFaultKind::TelemetryStuck, 6.0, 7.2)];
    let flown = fly(&Case { board: stuck, most_s: 16.0, ..Case::default() });
    let restarted_s = restart_s(&flown, RestartCause::Watchdog);
    assert!(restarted_s < 6.0 + HANG_TO_RESTART_S, "only at {restarted_s} s");
    // The supervisor lets go when the deadline is over; the watchdog follows.
    expect_safe(&flown, restarted_s - 0.3, restarted_s + 0.5);
    expect_second_log(&flown, StartCause::Watchdog, "task link silent for");
}

#[test]
fn a_core_that_hangs_is_ended_by_the_watchdog() {
    let hang = vec![board(BoardFaultKind::CoreHang, 6.0, 7.0)];
    let flown = fly(&Case { board: hang, most_s: 16.0, ..Case::default() });
    let restarted_s = restart_s(&flown, RestartCause::Watchdog);
    assert!(restarted_s < 6.6, "only at {restarted_s} s");
    let session = flown.log.sessions.get(1).expect("a second log");
    assert!(session.events.iter().any(|event| event.kind == EventKind::Started(StartCause::Watchdog)));
    assert!(!session.tags.is_empty(), "no capture after the restart");
}

#[test]
fn a_fault_of_the_core_restarts_the_board_and_is_told() {
    let crash = vec![board(BoardFaultKind::CoreCrash, 6.0, 7.0)];
    let flown = fly(&Case { board: crash, most_s: 16.0, ..Case::default() });
    let restarted_s = restart_s(&flown, RestartCause::Firmware);
    assert!(restarted_s < 6.1, "only at {restarted_s} s");
    expect_second_log(&flown, StartCause::Software, "hard fault at");
    flown.expect_text("rotator restarted: Software");
}
