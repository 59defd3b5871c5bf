use proptest::prelude::*;

use super::*;
use crate::beams::{Beam, Beams};
use crate::record::{
    CentringSample, Event, EventKind, Failure, Message, MissReason, Mode, RangeFault, SpeedSample, TagUpdate,
};
use crate::tag::{CaptureState, CaptureTag, Ranges, TagFlags};

fn real() -> impl Strategy<Value = f32> {
    any::<f32>().prop_filter("NaN is not equal to itself", |value| !value.is_nan())
}

fn maybe() -> impl Strategy<Value = Option<f32>> {
    proptest::option::of(real())
}

fn state() -> impl Strategy<Value = CaptureState> {
    prop_oneof![Just(CaptureState::Commanded), Just(CaptureState::Busy), Just(CaptureState::Confirmed)]
}

fn tag() -> impl Strategy<Value = CaptureTag> {
    let ranges = (maybe(), maybe(), maybe(), maybe()).prop_map(|(up_m, right_m, down_m, left_m)| Ranges {
        up_m,
        right_m,
        down_m,
        left_m,
    });
    let first = (any::<u32>(), state(), any::<u64>(), real(), ranges);
    let second = (maybe(), maybe(), proptest::option::of([real(), real(), real()]));
    let third = (proptest::option::of([real(), real()]), maybe(), maybe(), any::<u16>());
    (first, second, third).prop_map(|(first, second, third)| {
        let (capture, state, time_us, shaft_rad, ranges) = first;
        let (range_head_m, odometer_m, attitude_rad) = second;
        let (offset_m, speed_mps, speed_limit_mps, flags) = third;
        let flags = TagFlags(flags);
        CaptureTag {
            capture,
            state,
            time_us,
            shaft_rad,
            ranges,
            range_head_m,
            odometer_m,
            attitude_rad,
            offset_m,
            speed_mps,
            speed_limit_mps,
            flags,
        }
    })
}

fn event_kind() -> impl Strategy<Value = EventKind> {
    prop_oneof![
        Just(EventKind::Mode { from: Mode::Idle, to: Mode::Fault }),
        Just(EventKind::Failed(Failure::Camera)),
        Just(EventKind::RangeFault { beam: Beam::Down, fault: RangeFault::Frozen }),
        (any::<u32>(), any::<bool>()).prop_map(|(capture, retry)| EventKind::Missed {
            capture,
            reason: MissReason::NeverBusy,
            retry
        }),
        any::<u32>().prop_map(|count| EventKind::EntriesDropped { count }),
    ]
}

fn entry() -> impl Strategy<Value = Entry> {
    prop_oneof![
        tag().prop_map(Entry::Tag),
        (any::<u32>(), state(), any::<u64>()).prop_map(|(capture, state, time_us)| Entry::TagUpdate(TagUpdate {
            capture,
            state,
            time_us
        })),
        (any::<u64>(), event_kind()).prop_map(|(time_us, kind)| Entry::Event(Event { time_us, kind })),
        (any::<u64>(), proptest::option::of([real(), real()]), maybe(), any::<bool>()).prop_map(
            |(time_us, offset_m, water_level_m, up)| Entry::Centring(CentringSample {
                time_us,
                offset_m,
                sigma_m: offset_m,
                used: Beams { up, ..Beams::default() },
                water_level_m
            })
        ),
        (any::<u64>(), maybe(), maybe(), maybe(), real()).prop_map(
            |(time_us, limit_mps, speed_mps, step_m, image_period_s)| Entry::Speed(SpeedSample {
                time_us,
                limit_mps,
                speed_mps,
                step_m,
                image_period_s
            })
        ),
    ]
}

fn header() -> Header {
    Header::new(&Parameters::default(), "adit-firmware 0.1.0").unwrap()
}

/// A log of a header and these entries, and the offset behind each frame.
fn log_of(entries: &[Entry]) -> (Vec<u8>, Vec<usize>) {
    let mut bytes = encode_header(&header()).unwrap().to_vec();
    let mut ends = vec![bytes.len()];
    for entry in entries {
        bytes.extend_from_slice(&encode_entry(entry).unwrap());
        ends.push(bytes.len());
    }
    (bytes, ends)
}

/// A frame around these bytes, kind first.
fn sealed(content: &[u8]) -> Vec<u8> {
    let mut buffer = [0; MAX_CONTENT_BYTES];
    buffer[..content.len()].copy_from_slice(content);
    seal(buffer, content.len(), false).unwrap().to_vec()
}

proptest! {
    #[test]
    fn what_is_written_reads_back_the_same(entries in proptest::collection::vec(entry(), 0..20)) {
        let (bytes, _) = log_of(&entries);
        let read: Vec<Record> = Decoder::new(&bytes).map(|item| item.unwrap().record).collect();
        prop_assert_eq!(&read[0], &Record::Header(header()));
        let entries: Vec<Record> = entries.into_iter().map(Record::Entry).collect();
        prop_assert_eq!(&read[1..], &entries[..]);
    }

    #[test]
    fn any_bytes_give_an_answer(bytes in proptest::collection::vec(any::<u8>(), 0..3000)) {
        let mut last = None;
        for item in Decoder::new(&bytes) {
            let offset = match item { Ok(located) => located.offset, Err(error) => error.offset() };
            prop_assert!(last < Some(offset), "the reader goes forward");
            last = Some(offset);
        }
        let _ = FlightLog::from_bytes(&bytes);
    }

    #[test]
    fn a_log_torn_at_any_byte_loses_at_most_its_last_record(entries in proptest::collection::vec(entry(), 1..4)) {
        let (bytes, ends) = log_of(&entries);
        for cut in 0..=bytes.len() {
            let whole = ends.iter().filter(|end| **end <= cut).count();
            let read = Decoder::new(&bytes[..cut]).flatten().count();
            prop_assert_eq!(read, whole, "cut at {}", cut);
            prop_assert!(Decoder::new(&bytes[..cut]).filter(Result::is_err).count() <= 1);
        }
    }

    #[test]
    fn a_torn_log_goes_on_after_a_restart(entries in proptest::collection::vec(entry(), 1..4), cut in any::<prop::sample::Index>()) {
        let (bytes, ends) = log_of(&entries);
        let cut = cut.index(bytes.len());
        let mut again = bytes[..cut].to_vec();
        again.extend_from_slice(&bytes);
        // The zero in front of the second header also closes a record that lacks nothing but its own.
        let whole = ends.iter().filter(|end| **end <= cut + 1).count();
        prop_assert_eq!(Decoder::new(&again).flatten().count(), whole + entries.len() + 1);
    }

    #[test]
    fn one_wrong_bit_costs_at_most_two_records(
        entries in proptest::collection::vec(entry(), 3..8),
        place in any::<prop::sample::Index>(),
        bit in 0u32..8,
    ) {
        let (mut bytes, _) = log_of(&entries);
        let place = place.index(bytes.len());
        bytes[place] ^= 1 << bit;
        // Two, where the zero between them was hit.
        let read: Vec<Record> = Decoder::new(&bytes).filter_map(Result::ok).map(|located| located.record).collect();
        prop_assert!(read.len() + 2 > entries.len());
        for record in read {
            let known = match &record {
                Record::Header(read) => *read == header(),
                Record::Entry(read) => entries.contains(read),
                Record::Message(_) => false,
            };
            prop_assert!(known, "a record that was never written: {record:?}");
        }
    }
}

#[test]
fn the_longest_parameters_fit_a_frame() {
    let vertex = adit_geometry::profile::ChainVertex { y_m: 1.0, z_m: -1.0, bulge: 0.5 };
    let vertices = core::iter::repeat_n(vertex, adit_geometry::profile::MAX_PIECES).collect();
    let profile = adit_geometry::profile::ProfileSpec::Chain { vertices };
    let parameters = Parameters { profile, ..Parameters::default() };
    let header = Header::new(&parameters, "a name much longer than the field holds").unwrap();
    let frame = encode_header(&header).unwrap();
    assert!(frame.len() < MAX_FRAME_BYTES - 100, "only {} bytes left", MAX_FRAME_BYTES - frame.len());
    let read = Decoder::new(&frame).next().unwrap().unwrap();
    assert_eq!(read.record, Record::Header(header));
}

#[test]
fn the_hash_tells_parameters_apart() {
    let mut other = Parameters::default();
    other.shutter.retries += 1;
    assert_ne!(parameters_hash(&Parameters::default()), parameters_hash(&other));
}

#[test]
fn a_newer_kind_is_named_and_skipped() {
    let (mut bytes, _) = log_of(&[]);
    let offset = bytes.len();
    bytes.extend_from_slice(&sealed(&[77, 1, 2, 3]));
    bytes.extend_from_slice(&log_of(&[]).0);
    let read: Vec<_> = Decoder::new(&bytes).collect();
    assert_eq!(read.len(), 3);
    assert_eq!(read[1], Err(DecodeError::UnknownKind { offset, kind: 77 }));
    assert!(read[2].is_ok());
}

#[test]
fn fields_appended_by_a_newer_program_are_ignored() {
    let update = TagUpdate { capture: 3, state: CaptureState::Busy, time_us: 9 };
    let mut content = vec![Kind::TagUpdate as u8];
    let mut buffer = [0; 32];
    content.extend_from_slice(postcard::to_slice(&update, &mut buffer).unwrap());
    content.extend_from_slice(&[5, 6, 7]);
    let bytes = sealed(&content);
    let read = Decoder::new(&bytes).next().unwrap().unwrap();
    assert_eq!(read.record, Record::Entry(Entry::TagUpdate(update)));
}

#[test]
fn an_event_of_a_newer_program_is_named_and_skipped() {
    let bytes = sealed(&[Kind::Event as u8, 1, 200, 1]);
    let read = Decoder::new(&bytes).next().unwrap();
    assert_eq!(read, Err(DecodeError::UnknownContent { offset: 0, kind: Kind::Event }));
}

fn simple_tag(capture: u32) -> CaptureTag {
    CaptureTag {
        capture,
        state: CaptureState::Commanded,
        time_us: u64::from(capture) * 1000,
        shaft_rad: 0.0,
        ranges: Ranges::default(),
        range_head_m: None,
        odometer_m: None,
        attitude_rad: None,
        offset_m: None,
        speed_mps: None,
        speed_limit_mps: None,
        flags: TagFlags::default(),
    }
}

#[test]
fn a_flight_has_one_tag_per_capture_with_its_final_state() {
    let update = |capture, state| Entry::TagUpdate(TagUpdate { capture, state, time_us: 0 });
    let entries = [
        Entry::Tag(simple_tag(1)),
        update(1, CaptureState::Busy),
        Entry::Tag(simple_tag(2)),
        update(1, CaptureState::Confirmed),
        update(1, CaptureState::Busy),
        update(7, CaptureState::Busy),
        Entry::Tag(simple_tag(2)),
    ];
    let (bytes, _) = log_of(&entries);
    let log = FlightLog::from_bytes(&bytes);
    assert_eq!(log.sessions.len(), 1);
    let states: Vec<_> = log.tags().map(|tag| (tag.capture, tag.state)).collect();
    assert_eq!(states, [(1, CaptureState::Confirmed), (2, CaptureState::Commanded)]);
    assert!(log.damage.is_empty());
    assert!(matches!(
        log.conflicts[..],
        [TagConflict::Orphan { capture: 7, .. }, TagConflict::Repeated { capture: 2, .. }]
    ));
}

#[test]
fn a_restart_opens_a_second_session() {
    let (mut bytes, _) = log_of(&[Entry::Tag(simple_tag(1))]);
    bytes.truncate(bytes.len() - 4);
    bytes.extend_from_slice(&log_of(&[Entry::Tag(simple_tag(1))]).0);
    let log = FlightLog::from_bytes(&bytes);
    assert_eq!(log.sessions.iter().map(|session| session.tags.len()).collect::<Vec<_>>(), [0, 1]);
    assert_eq!(log.damage.len(), 1);
    assert!(log.conflicts.is_empty());
}

#[test]
fn a_message_reads_back_the_same() {
    let text = heapless::String::try_from("panicked at firmware/src/limit.rs:1").unwrap();
    let message = Record::Message(Message { time_us: 7, text });
    let bytes = encode(&message).unwrap();
    assert_eq!(Decoder::new(&bytes).next().unwrap().unwrap().record, message);
    assert_eq!(FlightLog::from_bytes(&bytes).sessions[0].messages.len(), 1);
}

#[test]
fn a_tail_of_zeros_is_no_damage() {
    let (mut bytes, _) = log_of(&[Entry::Tag(simple_tag(1))]);
    let whole = bytes.len();
    bytes.resize(64 * 1024, 0);
    let log = FlightLog::from_bytes(&bytes);
    assert_eq!((log.sessions.len(), log.tags().count(), log.damage.len()), (1, 1, 0));
    // Torn at any byte, the last record is one damaged stretch: the zeros behind it close it.
    for torn in 1..20 {
        bytes[whole - torn..].fill(0);
        let log = FlightLog::from_bytes(&bytes);
        let lost = usize::from(torn > 1);
        assert_eq!((log.tags().count(), log.damage.len()), (1 - lost, lost), "{torn} bytes torn off");
    }
}
