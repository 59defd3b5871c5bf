//! Power cuts at 200 points of a scan, and at every byte of a parameter write: from one run's journals the media are
//! rebuilt as they were at each cut.

use adit_emulator::{
    BlockImage, BlockWrite, EmulatedBoard, FRAM_BYTES, FramWrite, Setup, log_of, parameters_in, provisioned_fram,
};
use adit_firmware::io::Inputs;
use adit_hil_sim::flight::Board as _;
use adit_hil_sim::seed::{Random, Stream};
use adit_protocol::log::{FlightLog, PARAMETERS_FILE, encode_header};
use adit_protocol::record::{Event, EventKind, Header, Mode};

use crate::common::{Case, Flown, fly, image, is_log, parameters};

const CUTS: usize = 200;
/// Long enough for a board to boot and open its log.
const BOOT_STEPS: u64 = 300;
/// And to take over parameters from the card and start again with them.
const ADOPT_STEPS: u64 = 800;

/// The media at a moment.
struct Media {
    card: BlockImage,
    fram: Vec<u8>,
}

/// The media when the power went `at_ns`; `torn` bytes of the block that was being written got through, `None`: none.
fn media_at(flown: &Flown, at_ns: u64, torn: Option<usize>) -> Media {
    let mut card = Setup::new(5).expect("a card").card;
    let (before, after) = flown.report.card_writes.split_at(written_by(flown, at_ns));
    for write in before {
        card.set_block(write.block, &write.data);
    }
    if let (Some(torn), Some(write)) = (torn, after.first()) {
        let mut block = card.block(write.block);
        block[..torn].copy_from_slice(&write.data[..torn]);
        card.set_block(write.block, &block);
    }
    let mut fram = provisioned_fram(&parameters()).expect("parameters fit");
    fram.resize(FRAM_BYTES, 0);
    let before = flown.report.fram_writes.iter().filter(|write: &&FramWrite| write.at_ns < at_ns);
    before.for_each(|write| put(&mut fram, write));
    Media { card, fram }
}

fn put(fram: &mut [u8], write: &FramWrite) {
    fram[usize::from(write.address) % FRAM_BYTES] = write.byte;
}

fn written_by(flown: &Flown, at_ns: u64) -> usize {
    flown.report.card_writes.iter().filter(|write: &&BlockWrite| write.at_ns < at_ns).count()
}

fn log_on(card: &BlockImage) -> FlightLog {
    let files = card.root_files().expect("the volume mounts");
    let mut bytes = Vec::new();
    for (_, file) in files.iter().filter(|(name, _)| is_log(name)) {
        bytes.extend_from_slice(file);
    }
    FlightLog::from_bytes(&bytes)
}

/// Every record, so that logs can be compared.
fn events_and_tags(log: &FlightLog) -> (Vec<Event>, Vec<u32>) {
    let events = log.sessions.iter().flat_map(|session| session.events.clone()).collect();
    (events, log.tags().map(|tag| tag.capture).collect())
}

#[test]
fn a_cut_anywhere_leaves_parameters_whole_and_costs_the_last_record_at_most() {
    let flown = fly(&Case { most_s: 12.0, ..Case::default() });
    let (all_events, all_tags) = events_and_tags(&flown.log);
    let mut random = Random::new(7, Stream::Faults);
    let writes = &flown.report.card_writes;
    let first_ns = writes.first().expect("writes").at_ns;
    let mut booted = 0;
    for cut in 0..CUTS {
        // Half of the cuts fall upon a block that is being written, where it hurts.
        let (at_ns, torn) = if cut % 2 == 0 {
            let write = &writes[random.index(writes.len())];
            (write.at_ns, Some(random.index(512)))
        } else {
            (first_ns + (random.uniform(0.0, 1.0) * (12e9 - first_ns as f64)) as u64, None)
        };
        let media = media_at(&flown, at_ns, torn);
        let place = format!("cut {cut} at {} s, torn {torn:?}", at_ns as f64 * 1e-9);
        assert_eq!(parameters_in(&media.fram).expect("the FRAM").as_ref(), Some(&parameters()), "{place}");
        let log = log_on(&media.card);
        assert!(log.damage.len() <= 1 && log.conflicts.is_empty(), "{place}: {:?} {:?}", log.damage, log.conflicts);
        let (events, tags) = events_and_tags(&log);
        assert!(all_events.starts_with(&events) && all_tags.starts_with(&tags), "{place}: not a beginning of the log");
        // What was written before the block in flight is there: compare with the media one block earlier.
        let earlier = written_by(&flown, at_ns).checked_sub(1).map(|last| writes[last].at_ns);
        if let Some(earlier_ns) = earlier {
            let (earlier_events, earlier_tags) = events_and_tags(&log_on(&media_at(&flown, earlier_ns, None).card));
            assert!(events.len() >= earlier_events.len() && tags.len() >= earlier_tags.len(), "{place}: records lost");
        }
        if cut % 70 == 0 {
            booted += 1;
            boots(media, &place);
        }
    }
    assert_eq!(booted, 3);
}

#[test]
fn a_cut_anywhere_in_a_parameter_write_leaves_the_old_or_the_new_ones() {
    let old = parameters();
    let mut new = parameters();
    new.shutter.light_level = 0.25;
    assert_ne!(old, new);
    let header = Header::new(&new, "adit").and_then(|header| encode_header(&header)).expect("a header");
    let mut provisioned = provisioned_fram(&old).expect("parameters fit");
    provisioned.resize(FRAM_BYTES, 0);
    // The board starts with a FRAM of this content and with the new parameters on its card.
    let starts = |fram: Vec<u8>| {
        let mut setup = Setup { fram, ..Setup::new(5).expect("a card") };
        setup.card.put_file(PARAMETERS_FILE, &header).expect("room on the card");
        let mut board = EmulatedBoard::new(&image(), &old, setup).expect("a board");
        for step in 0..ADOPT_STEPS {
            board.step(step * 5_000, &Inputs::default()).expect("a step");
        }
        board.finish().expect("a report")
    };
    let writes = starts(provisioned.clone()).fram_writes;
    let after = |count: usize| {
        let mut fram = provisioned.clone();
        writes[..count].iter().for_each(|write| put(&mut fram, write));
        fram
    };
    let is_new = |count: usize| {
        let found = parameters_in(&after(count)).expect("the FRAM");
        assert!(
            found.as_ref() == Some(&old) || found.as_ref() == Some(&new),
            "cut after {count} of {} bytes: {found:?}",
            writes.len()
        );
        found.as_ref() == Some(&new)
    };
    // The bytes of the parameters themselves: after this many they are the new ones; most cuts fall before it.
    let whole = (0..=writes.len()).find(|count| is_new(*count)).expect("the new parameters were never written");
    assert!(whole > CUTS, "only {whole} bytes: not {CUTS} places to cut");
    assert!((whole..=writes.len()).all(is_new), "new parameters that were written were lost again");
    // Cut in the middle of them, the board takes them over at its next start.
    let report = starts(after(whole - CUTS / 2));
    assert_eq!(parameters_in(&report.fram).expect("the FRAM"), Some(new));
}

/// The board starts again on what the cut left: with its parameters, with a new log file.
fn boots(media: Media, place: &str) {
    let setup = Setup { fram: media.fram, card: media.card, ..Setup::new(5).expect("a card") };
    let mut board = EmulatedBoard::new(&image(), &parameters(), setup).expect("a board");
    for step in 0..BOOT_STEPS {
        board.step(step * 5_000, &Inputs::default()).expect("a step");
    }
    let report = board.finish().expect("a report");
    let log = FlightLog::from_bytes(&log_of(&report).expect("a log").bytes);
    let last = log.sessions.last().unwrap_or_else(|| panic!("{place}: no log"));
    assert_eq!(last.header.as_ref().map(|header| &header.parameters), Some(&parameters()), "{place}");
    let idle = EventKind::Mode { from: Mode::Boot, to: Mode::Idle };
    assert!(last.events.iter().any(|event| event.kind == idle), "{place}: {:?}", last.events);
    assert_eq!(report.restarts, [], "{place}");
}
