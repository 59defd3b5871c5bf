use adit_protocol::mavlink::{OutFrame, Sender, Severity};
use adit_protocol::record::Mode;
use proptest::prelude::*;

use super::super::enactment::{Flight, MISSING, heard, tag};
use super::*;
use crate::link::Trust;

fn range(flight: &Flight, beam: Beam) -> RangeView {
    flight.state.show(flight.now).ranges[place(beam)]
}

fn texts(flight: &Flight) -> String {
    let warnings = flight.state.show(flight.now).warnings;
    warnings.into_iter().map(|warning| warning.text).collect::<Vec<_>>().join("\n")
}

#[test]
fn an_unplugged_sensor_is_invalid_with_the_boards_next_word() {
    let mut flight = Flight::new();
    flight.tell();
    flight.range(Beam::Up, 1.57);
    assert_eq!(range(&flight, Beam::Up).range_m.map(|range_m| (range_m * 100.0).round()), Some(157.0));
    flight.wait_s(0.5);
    flight.telemetry.ranges_m[0] = None;
    flight.tell();
    let up = range(&flight, Beam::Up);
    assert_eq!((up.state, up.range_m), (RangeState::Invalid, None));
    assert!(texts(&flight).contains("range up: no reading"));
    assert_eq!(range(&flight, Beam::Right).state, RangeState::Valid);
}

#[test]
fn a_sensor_that_falls_silent_is_stale_within_a_second_even_where_the_board_can_only_tell_readings() {
    let mut flight = Flight::new();
    flight.range(Beam::Left, 1.4);
    flight.wait_s(0.75);
    assert_eq!(range(&flight, Beam::Left).state, RangeState::Valid);
    flight.wait_s(0.2);
    let left = range(&flight, Beam::Left);
    assert_eq!((left.state, left.range_m), (RangeState::Stale, None));
    assert_eq!(range(&flight, Beam::Down).state, RangeState::Unknown);
}

#[test]
fn a_silent_board_is_a_lost_link_within_two_seconds_and_its_first_word_ends_that() {
    let mut flight = Flight::new();
    assert_eq!(flight.state.show(flight.now).link.status, LinkStatus::Waiting);
    flight.tell();
    flight.wait_s(1.2);
    assert_eq!(flight.state.show(flight.now).link.status, LinkStatus::Up);
    flight.wait_s(0.5);
    let view = flight.state.show(flight.now);
    assert_eq!(view.link.status, LinkStatus::Lost);
    assert!(view.offset_m.is_stale && view.speed_mps.is_stale && view.steer_m().is_none());
    assert_eq!(view.offset_m.value.map(|[y_m, _]| (y_m * 100.0).round()), Some(-12.0), "the last place stays in sight");
    assert!(texts(&flight).starts_with("LINK LOST"));
    flight.tell();
    assert_eq!(flight.state.show(flight.now).link.status, LinkStatus::Up);
}

#[test]
fn a_line_that_is_down_is_a_lost_link_at_once_with_the_reason() {
    let mut flight = Flight::new();
    flight.tell();
    flight.state.line(Err("the peer closed the line".to_owned()), Counters::default());
    assert_eq!(flight.state.show(flight.now).link.status, LinkStatus::Lost);
    assert!(texts(&flight).contains("the peer closed the line"));
}

#[test]
fn the_pilot_steers_against_the_offset() {
    let mut flight = Flight::new();
    flight.telemetry.offset_m = Some([0.2, -0.1]);
    flight.tell();
    let [right_m, down_m] = flight.state.show(flight.now).steer_m().unwrap();
    assert!(right_m < 0.0 && down_m > 0.0, "right of and above the axis: to the left and down");
}

#[test]
fn figures_for_plain_displays_are_enough_for_place_speed_and_counts() {
    let mut flight = Flight::new();
    let figures =
        [("off_y", 0.1), ("off_z", -0.2), ("limit", 0.3), ("speed", 0.25), ("captures", 12.0), ("missed", 1.0)];
    for (name, value) in figures {
        flight.figure(name, value);
    }
    flight.figure("enforce", 3.0);
    flight.figure("water", f32::NAN);
    let view = flight.state.show(flight.now);
    assert_eq!(view.offset_m.value.map(|offset_m| offset_m.map(|along_m| (along_m * 10.0).round())), Some([1.0, -2.0]));
    assert_eq!((view.captures.value, view.missed.value, view.water_level_m.value), (Some(12), Some(1), None));
    assert_eq!(view.enforcement.value, Some(Enforcement::Ineffective));
    flight.figure("water", -0.05);
    assert_eq!(flight.state.show(flight.now).water_level_m.value, Some(0.0));
}

#[test]
fn captures_are_counted_by_their_fate_and_a_missed_one_is_a_gap() {
    let mut flight = Flight::new();
    (1..=80).for_each(|capture| flight.photo(capture, !MISSING.contains(&capture)));
    flight.tell();
    let view = flight.state.show(flight.now);
    assert_eq!((view.captures.value, view.confirmed, view.missed.value), (Some(80), Some(71), Some(9)));
    assert!(!view.gaps.is_empty());
    assert!(texts(&flight).starts_with("GAP behind: "), "{}", texts(&flight));
}

#[test]
fn a_report_that_comes_before_its_tag_counts_too() {
    let mut flight = Flight::new();
    (1..45).filter(|capture| *capture != 42).for_each(|capture| flight.photo(capture, true));
    flight.report(42, false);
    flight.tagged(&tag(42));
    assert!(!flight.state.strip.as_mut().unwrap().tell(42, false), "it is known already");
}

#[test]
fn the_fate_of_a_capture_that_was_not_heard_is_asked_for() {
    let mut flight = Flight::new();
    flight.photo(1, true);
    flight.tagged(&tag(2));
    assert_eq!(flight.state.missing_report(flight.now), None);
    flight.wait_s(10.0);
    assert_eq!(flight.state.missing_report(flight.now), Some(([1, 100], 1)));
    flight.report(2, true);
    assert_eq!(flight.state.missing_report(flight.now), None);
}

#[test]
fn a_board_that_starts_again_counts_anew_and_keeps_the_wall() {
    let mut flight = Flight::new();
    flight.wait_s(60.0);
    (1..=40).for_each(|capture| flight.photo(capture, true));
    flight.tell();
    let wall = flight.state.strip().unwrap().blocks().count();
    flight.now = Duration::from_secs(61);
    flight.telemetry = Telemetry { time_us: 5, ..flight.telemetry };
    let frame = Sender::new(1, 191).tunnel(
        [0, 0],
        adit_protocol::telemetry::TELEMETRY_KIND,
        &adit_protocol::telemetry::tunnelled(&flight.telemetry).unwrap(),
    );
    flight.hear(&frame);
    let view = flight.state.show(flight.now);
    assert_eq!((view.confirmed, view.notices[0].text.as_str()), (Some(0), "the board has started again"));
    assert_eq!(flight.state.strip().unwrap().blocks().count(), wall);
    // Capture 1 of the new count is another photo.
    let revision = flight.state.strip().unwrap().revision();
    flight.photo(1, true);
    assert!(flight.state.strip().unwrap().revision() > revision);
}

#[test]
fn strangers_and_unsigned_frames_change_nothing_and_are_counted() {
    let mut flight = Flight::new();
    flight.tell();
    let frame = Sender::new(2, 191).text(Severity::Error, &"another vehicle".try_into().unwrap());
    flight.hear(&frame);
    let mut forged = heard(&Sender::new(1, 191).text(Severity::Error, &"forged".try_into().unwrap()));
    forged.trust = Trust::Refused(adit_protocol::mavlink::SignatureError::Unsigned);
    flight.state.hear(flight.now, &forged);
    let view = flight.state.show(flight.now);
    assert_eq!((view.notices.len(), view.link.refused), (0, 1));
    assert!(texts(&flight).contains("1 messages not believed"));
}

#[test]
fn warnings_say_what_is_wrong_the_worst_first() {
    let mut flight = Flight::new();
    flight.telemetry = Telemetry {
        mode: Mode::Degraded,
        speed_mps: Some(0.2),
        overspeed: true,
        gap_open: true,
        offset_m: Some([0.0, 0.9]),
        enforcement: Enforcement::NotPossible,
        ranges_m: [None; 4],
        ..flight.telemetry
    };
    flight.tell();
    flight.state.leave_out(7);
    insta::assert_snapshot!(texts(&flight));
}

/// 600,000 messages are a minute at 10,000 per second.
#[test]
fn a_minute_of_a_flood_takes_no_more_memory_than_its_first_second() {
    let mut flight = Flight::new();
    let size = |flight: &Flight| {
        let state = &flight.state;
        (
            serde_json::to_string(&state.show(flight.now)).unwrap().len() / 1000,
            state.notices.len(),
            state.notices.capacity(),
        )
    };
    let mut after_a_second = None;
    for second in 0..60 {
        for _ in 0..10 {
            for count in 0..200_u16 {
                flight.range(Beam::Up, 1.5);
                flight.figure("speed", f32::from(count) * 0.001);
                flight.figure("off_y", 0.01);
                flight.say(Severity::Warning, "flood");
                flight.vehicle();
            }
            flight.tell();
            flight.wait_s(0.1);
        }
        if second == 0 {
            after_a_second = Some(size(&flight));
        }
    }
    assert_eq!(Some(size(&flight)), after_a_second);
    let view = flight.state.show(flight.now);
    assert!((view.link.rate_hz - 12_010.0).abs() < 20.0, "{}", view.link.rate_hz);
    assert_eq!(view.link.lost, Some(0.0));
}

proptest! {
    /// Any bytes that pass for frames of the board, its camera or its autopilot.
    #[test]
    fn whatever_is_heard_something_can_be_shown(
        messages in proptest::collection::vec((any::<u8>(), proptest::collection::vec(any::<u8>(), 0..120)), 1..40),
    ) {
        let mut flight = Flight::new();
        for (which, payload) in messages {
            let (mut board, mut camera) = (Sender::new(1, 191), Sender::new(1, 100));
            let f32_of = |at: usize| payload.get(at..at + 4).map_or(f32::NAN, |bytes| f32::from_le_bytes(bytes.try_into().unwrap()));
            let frame: OutFrame = match which % 5 {
                0 => board.tunnel([0, 0], 44_001, &payload),
                1 => board.tunnel([0, 0], 44_002, &payload),
                2 => board.named_value(0, ["off_y", "limit", "captures", "enforce", "water"][usize::from(which) / 5 % 5], f32_of(0)),
                3 => camera.image_captured(&adit_protocol::mavlink::CaptureReport {
                    index: f32_of(0).to_bits().cast_signed(), taken: which > 100, ..Default::default()
                }),
                _ => Sender::new(1, 1).attitude(0, [f32_of(0), f32_of(4), f32_of(8)]),
            };
            flight.hear(&frame);
            flight.wait_s(0.3);
        }
        let view = flight.state.show(flight.now);
        prop_assert!(serde_json::to_string(&view).is_ok());
        let _ = flight.state.missing_report(flight.now);
    }
}
