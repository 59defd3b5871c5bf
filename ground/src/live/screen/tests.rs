use adit_protocol::mavlink::Severity;
use ratatui::Terminal;
use ratatui::backend::TestBackend;

use super::*;
use crate::live::enactment::{Flight, MISSING};
use crate::live::picture::Picture;
use crate::live::view::{RecordView, ReplayView};

fn drawn(screen: &Screen, frame: &Frame, [width, height]: [u16; 2]) -> String {
    let mut terminal = Terminal::new(TestBackend::new(width, height)).unwrap();
    terminal.draw(|target| screen.draw(target, frame)).unwrap();
    terminal.backend().to_string()
}

fn frame(flight: &Flight) -> Frame {
    let strip = Picture::of(flight.state.strip().unwrap(), &Picture::default());
    let mut view = flight.state.show(flight.now);
    view.wall = strip.wall();
    Frame { view, strip: Arc::new(strip) }
}

/// Eighty photos of which ten are missing, and a sensor that cannot measure.
fn flight() -> Flight {
    let mut flight = Flight::new();
    (1..=80).for_each(|capture| flight.photo(capture, capture != 78 && !MISSING.contains(&capture)));
    flight.telemetry.ranges_m[3] = None;
    flight.wait_s(75.0);
    flight.say(Severity::Info, "limit 0.09 m/s in force in AUTO");
    flight.wait_s(5.0);
    flight.vehicle();
    flight.tell();
    flight
}

#[test]
fn a_flight_with_a_gap_and_a_sensor_without_a_reading() {
    let mut frame = frame(&flight());
    frame.view.record = Some(RecordView { file: "flight.tlog".to_owned(), has_failed: false });
    let screen = Screen { page: Some("http://127.0.0.1:8080/".to_owned()), is_help: false };
    insta::assert_snapshot!(drawn(&screen, &frame, [80, 24]));
}

#[test]
fn a_lost_link_while_a_full_disk_ended_the_record() {
    let mut flight = flight();
    flight.wait_s(12.0);
    let mut frame = frame(&flight);
    frame.view.record = Some(RecordView { file: "flight.tlog".to_owned(), has_failed: true });
    insta::assert_snapshot!(drawn(&Screen::default(), &frame, [80, 24]));
}

#[test]
fn before_anything_was_heard_and_without_a_mission() {
    let state = crate::live::State::new(None);
    let frame = Frame { view: state.show(Duration::ZERO), strip: Arc::default() };
    insta::assert_snapshot!(drawn(&Screen::default(), &frame, [80, 24]));
}

#[test]
fn a_replay_on_a_large_terminal() {
    let mut frame = frame(&flight());
    frame.view.replay = Some(ReplayView { speed: 10.0, is_over: false });
    insta::assert_snapshot!(drawn(&Screen::default(), &frame, [120, 36]));
}

#[test]
fn the_help_lies_over_the_screen() {
    insta::assert_snapshot!(drawn(&Screen { page: None, is_help: true }, &frame(&flight()), [80, 24]));
}

#[test]
fn a_terminal_that_is_too_small_says_so() {
    let text = drawn(&Screen::default(), &frame(&flight()), [60, 20]);
    assert!(text.contains("60 x 20; 80 x 24 are needed"), "{text}");
}
