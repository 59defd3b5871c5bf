//! The board log on a card: read back by another library than it was written with, after power failed anywhere.

mod card;
mod failing;
mod formats;
mod power;

use adit_firmware::recorder::{Recorder, RecorderError, logs, read_log};
use adit_protocol::log::{Decoder, encode_entry, encode_header};
use adit_protocol::parameters::Parameters;
use adit_protocol::record::{Entry, Header, Record, TagUpdate};
use adit_protocol::tag::{CaptureState, CaptureTag, Ranges, TagFlags};

use card::{Card, FAT16, FAT32_8GB, FAT32_TINY, Geometry, NoClock, Pulled, files_of};

/// What a log file grows by.
const CHUNK_BYTES: usize = 64 * 1024;

fn header() -> Header {
    Header::new(&Parameters::default(), "a test").unwrap()
}

fn header_frame() -> Vec<u8> {
    encode_header(&header()).unwrap().to_vec()
}

fn tag(capture: u32) -> Entry {
    let at = |value: f32| Some(value + capture as f32 / 128.0);
    Entry::Tag(CaptureTag {
        capture,
        state: CaptureState::Commanded,
        time_us: u64::from(capture) * 1_234_567,
        shaft_rad: capture as f32 * 0.628,
        ranges: Ranges { up_m: at(2.5), right_m: at(2.6), down_m: at(2.7), left_m: at(2.8) },
        range_head_m: at(2.9),
        odometer_m: at(100.0),
        attitude_rad: Some([0.1, 0.2, 0.3]),
        offset_m: Some([0.1, -0.1]),
        speed_mps: at(0.3),
        speed_limit_mps: at(0.4),
        flags: TagFlags::default(),
    })
}

fn update(capture: u32) -> Entry {
    Entry::TagUpdate(TagUpdate { capture, state: CaptureState::Confirmed, time_us: u64::from(capture) * 1000 })
}

fn open(card: &Card, number: u32) -> Result<Recorder<'_, Card, NoClock>, RecorderError<Pulled>> {
    Recorder::open(card, NoClock, &header_frame(), number)
}

/// The records of a file, and how many stretches of it gave none.
fn read_back(bytes: &[u8]) -> (Vec<Record>, usize) {
    let mut records = Vec::new();
    let mut damage = 0;
    for item in Decoder::new(bytes) {
        match item {
            Ok(located) => {
                assert_eq!(damage, 0, "a record behind damage, at byte {}", located.offset);
                records.push(located.record);
            }
            Err(_) => damage += 1,
        }
    }
    (records, damage)
}

fn name(number: u32) -> String {
    format!("ADIT{number:04}.LOG")
}

/// Records until an error, at most so many captures, with extension by steps.
fn record_chunks(card: &Card, captures: u32) -> (Option<RecorderError<Pulled>>, Option<u16>) {
    let mut recorder = match open(card, 1) {
        Ok(recorder) => recorder,
        Err(error) => return (Some(error), None),
    };
    let number = Some(recorder.number());
    for capture in 1..captures {
        // Padded by zeros, which every reader skips, so that a chunk is soon used up.
        let mut frame = encode_entry(&tag(capture)).unwrap().to_vec();
        frame.resize(900, 0);
        let result = recorder.append(&frame).and_then(|()| recorder.commit()).and_then(|()| recorder.make_room());
        if let Err(error) = result {
            return (Some(error), number);
        }
    }
    (None, number)
}

#[test]
fn a_computer_reads_what_was_recorded() {
    for geometry in [FAT16, FAT32_TINY, FAT32_8GB] {
        let card = Card::formatted(geometry);
        let mut recorder = open(&card, 1).unwrap();
        let mut expected = vec![Record::Header(header())];
        // Over several chunks.
        for capture in 1..3000 {
            for entry in [tag(capture), update(capture)] {
                recorder.append(&encode_entry(&entry).unwrap()).unwrap();
                expected.push(Record::Entry(entry));
            }
            recorder.commit().unwrap();
            recorder.make_room().unwrap();
        }
        assert!(recorder.log_bytes() as usize > 4 * CHUNK_BYTES, "{} bytes", recorder.log_bytes());
        let files = files_of(&mut card.image.borrow_mut());
        assert_eq!(files.keys().collect::<Vec<_>>(), [&name(1)], "{geometry:?}");
        assert_eq!(files[&name(1)].len() % CHUNK_BYTES, 0);
        assert_eq!(read_back(&files[&name(1)]), (expected, 0), "{geometry:?}");
    }
}

#[test]
fn writes_per_record_and_per_extension() {
    let expected = [
        "Fat16 4096: open 193; record 1.16, at most 2 and 1 reads; extension 193, its steps at most 25",
        "Fat32 512: open 642; record 1.16, at most 2 and 1 reads; extension 642, its steps at most 82",
        "Fat32 32768: open 138; record 1.16, at most 2 and 0 reads; extension 138, its steps at most 20",
    ];
    assert_eq!([FAT16, FAT32_TINY, FAT32_8GB].map(writes_of), expected, "sectors written");
}

fn writes_of(geometry: Geometry) -> String {
    let card = Card::formatted(geometry);
    let mut recorder = open(&card, 1).unwrap();
    let opening = card.take_writes();
    let (mut worst, mut worst_reads, mut all) = (0, 0, 0);
    for capture in 0..400 {
        card.reads.set(0);
        recorder.append(&encode_entry(&tag(capture)).unwrap()).unwrap();
        recorder.commit().unwrap();
        let writes = card.take_writes();
        worst = worst.max(writes);
        worst_reads = worst_reads.max(card.reads.get());
        all += writes;
    }
    let mean = f64::from(all as u32) / 400.0;
    while recorder.left_bytes() >= 16 * 1024 {
        recorder.append(&encode_entry(&tag(0)).unwrap()).unwrap();
    }
    card.take_writes();
    let before = recorder.left_bytes();
    let mut steps = Vec::new();
    while recorder.make_room().unwrap() {
        steps.push(card.take_writes());
    }
    steps.push(card.take_writes());
    assert_eq!(recorder.left_bytes() - before, CHUNK_BYTES as u32);
    let (fat, cluster) = (geometry.fat, geometry.cluster_bytes);
    let (extension, step) = (steps.iter().sum::<usize>(), steps.iter().max().unwrap());
    format!(
        "{fat:?} {cluster}: open {opening}; record {mean:.2}, at most {worst} and {worst_reads} reads; \
         extension {extension}, its steps at most {step}"
    )
}

#[test]
fn logs_are_listed_and_read_beside_the_one_that_is_written() {
    let card = Card::formatted(FAT32_TINY);
    for number in [3, 1, 2] {
        let mut recorder = open(&card, number).unwrap();
        recorder.append(&encode_entry(&tag(number)).unwrap()).unwrap();
        recorder.commit().unwrap();
    }
    let mut recorder = open(&card, 4).unwrap();
    let listed = logs::<_, _, 3>(&card, NoClock).unwrap();
    assert_eq!(listed, [2, 3, 4].map(|number| (number, CHUNK_BYTES as u32)));
    recorder.append(&encode_entry(&tag(9)).unwrap()).unwrap();
    recorder.commit().unwrap();
    let mut fetched = Vec::new();
    loop {
        let mut bytes = [0; 450];
        let count = read_log(&card, NoClock, 4, fetched.len() as u32, &mut bytes).unwrap();
        fetched.extend_from_slice(&bytes[..count]);
        if count < bytes.len() {
            break;
        }
    }
    assert_eq!(fetched, files_of(&mut card.image.borrow_mut())[&name(4)]);
    assert_eq!(read_log(&card, NoClock, 4, u32::MAX, &mut [0; 8]).unwrap(), 0);
    assert_eq!(read_log(&card, NoClock, 77, 0, &mut [0; 8]).unwrap(), 0);
}
