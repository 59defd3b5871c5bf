//! The board log on a card: read back by another library than it was written with, after the power failed anywhere.

mod card;

use adit_firmware::recorder::{CardFormat, Doing, Recorder, RecorderError};
use adit_protocol::log::{Decoder, encode_entry, encode_header};
use adit_protocol::parameters::Parameters;
use adit_protocol::record::{Entry, Header, Record, TagUpdate};
use adit_protocol::tag::{CaptureState, CaptureTag, Ranges, TagFlags};
use rand::{Rng, RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use card::{
    Card, FAT16, FAT32_8GB, FAT32_TINY, Geometry, NoClock, PHOTO, Pulled, SECTOR_BYTES, fat_of, file_of, files_of,
};

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

/// What the card must hold once its journal has this many sectors.
struct Promise {
    journal: usize,
    /// Records of each file.
    files: Vec<(u32, usize)>,
}

/// Flies with three starts of the board; returns the journal, what was appended per file, and what was promised when.
fn flown(card: &Card, rng: &mut ChaCha8Rng) -> (Vec<(u32, Vec<Record>)>, Vec<Promise>) {
    let mut appended: Vec<(u32, Vec<Record>)> = Vec::new();
    let mut promises = vec![Promise { journal: 0, files: Vec::new() }];
    for start in 0..3 {
        let mut recorder = open(card, start + 7).unwrap();
        let number = u32::from(recorder.number());
        appended.push((number, vec![Record::Header(header())]));
        for capture in 1..rng.random_range(400..900) {
            let records = &mut appended.last_mut().unwrap().1;
            for entry in [tag(capture), update(capture)] {
                recorder.append(&encode_entry(&entry).unwrap()).unwrap();
                records.push(Record::Entry(entry));
            }
            if rng.random_bool(0.7) {
                recorder.commit().unwrap();
                promises.push(Promise {
                    journal: card.journal.borrow().len(),
                    files: appended.iter().map(|(number, records)| (*number, records.len())).collect(),
                });
                if rng.random_bool(0.5) {
                    recorder.make_room().unwrap();
                }
            }
        }
        recorder.commit().unwrap();
    }
    (appended, promises)
}

#[test]
fn power_may_fail_within_any_sector_write() {
    for (geometry, cuts, seed) in [(FAT16, 300, 1), (FAT32_TINY, 300, 2), (FAT32_8GB, 100, 3)] {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let card = Card::used(geometry);
        let base = card.image.borrow().clone();
        let (appended, promises) = flown(&card, &mut rng);
        let journal = card.journal.borrow().clone();

        let mut points: Vec<usize> = (0..cuts).map(|_| rng.random_range(0..journal.len())).collect();
        // Changes of FAT and directory are rare among the writes; half of the cuts go there.
        let rare: Vec<usize> = (0..journal.len()).filter(|at| is_file_system(&base, journal[*at].0)).collect();
        points.extend((0..cuts).map(|_| rare[rng.random_range(0..rare.len())]));
        points.sort_unstable();

        let mut image = base.clone();
        let mut replayed = 0;
        for point in points {
            for (sector, content) in &journal[replayed..point] {
                image.insert(*sector, *content);
            }
            replayed = point;
            let (sector, content) = journal[point];
            let before = image.get(&sector).copied();
            let torn_bytes = rng.random_range(0..=SECTOR_BYTES);
            image.entry(sector).or_insert([0; SECTOR_BYTES])[..torn_bytes].copy_from_slice(&content[..torn_bytes]);

            let place = format!("{geometry:?}, seed {seed}, write {point} torn at byte {torn_bytes}");
            let promise = promises.iter().rev().find(|promise| promise.journal <= point).unwrap();
            check(&mut image, &appended, promise, &place);

            match before {
                Some(before) => image.insert(sector, before),
                None => image.remove(&sector),
            };
        }
    }
}

/// Is this sector FAT, information sector or near the directory's beginning?
fn is_file_system(image: &card::Image, sector: u32) -> bool {
    let (start, sectors, _) = fat_of(image);
    sector < start + 2 * sectors + 8
}

fn check(image: &mut card::Image, appended: &[(u32, Vec<Record>)], promise: &Promise, place: &str) {
    assert!(file_of(image, PHOTO).is_some_and(|bytes| bytes == vec![0xA5; 100_000]), "{place}: the photo is gone");
    for (number, promised) in &promise.files {
        let file = file_of(image, &name(*number)).unwrap_or_else(|| panic!("{place}: {} is gone", name(*number)));
        let (records, damage) = read_back(&file);
        let all = &appended.iter().find(|(of, _)| of == number).unwrap().1;
        assert!(records.len() >= *promised, "{place}: {} of {promised} committed records", records.len());
        assert!(records[..] == all[..records.len()], "{place}: records that were never written");
        assert!(damage <= 1, "{place}: {damage} damaged stretches");
    }
}

/// The card after the first `point` of these writes, and so many bytes of the next.
fn torn(base: &card::Image, journal: &[(u32, [u8; SECTOR_BYTES])], point: usize, torn_bytes: usize) -> card::Image {
    let mut image = base.clone();
    image.extend(journal[..point].iter().copied());
    let (sector, content) = journal[point];
    image.entry(sector).or_insert([0; SECTOR_BYTES])[..torn_bytes].copy_from_slice(&content[..torn_bytes]);
    image
}

#[test]
fn the_board_starts_again_after_a_cut_anywhere_in_a_start() {
    let mut rng = ChaCha8Rng::seed_from_u64(5);
    // With 14 logs before, the root directory of the small FAT32 has no entry left: it grows in the start that is cut.
    for (geometry, logs) in [(FAT16, 0), (FAT32_TINY, 0), (FAT32_TINY, 14)] {
        let card = Card::used(geometry);
        for number in 1..=logs {
            drop(open(&card, number).unwrap());
        }
        card.take_writes();
        let base = card.image.borrow().clone();
        drop(open(&card, logs + 1).unwrap());
        let journal = card.journal.take();
        // One zeroed sector is like another: a few of them will do.
        let is_zero = |point: &usize| journal[*point].1 == [0; SECTOR_BYTES];
        for point in (0..journal.len()).filter(|point| point % 16 == 0 || !is_zero(point)) {
            for torn_bytes in [3, 10, 28, rng.random_range(0..=SECTOR_BYTES)] {
                let place = format!("{geometry:?}, {logs} logs, write {point} torn at byte {torn_bytes}");
                let again = Card::unformatted(card.sectors);
                again.image.replace(torn(&base, &journal, point, torn_bytes));
                let number = u32::from(open(&again, logs + 1).unwrap_or_else(|e| panic!("{place}: {e}")).number());
                let image = &mut again.image.borrow_mut();
                for number in if logs > 0 { vec![1, logs, number] } else { vec![number] } {
                    let file = file_of(image, &name(number)).unwrap_or_else(|| panic!("{place}: {number} is gone"));
                    assert_eq!(read_back(&file), (vec![Record::Header(header())], 0), "{place}: {number}");
                }
                assert!(file_of(image, PHOTO).is_some_and(|bytes| bytes == vec![0xA5; 100_000]), "{place}: no photo");
            }
        }
    }
}

#[test]
fn a_pulled_card_is_an_error_and_the_next_file_goes_on() {
    let card = Card::formatted(FAT32_TINY);
    let mut recorder = open(&card, 5).unwrap();
    recorder.append(&encode_entry(&tag(1)).unwrap()).unwrap();
    recorder.commit().unwrap();
    card.accesses_left.set(1);
    recorder.append(&encode_entry(&tag(2)).unwrap()).unwrap();
    assert_eq!(recorder.commit(), Err(RecorderError::Device { doing: Doing::Writing, error: Pulled }));
    assert_eq!(open(&card, 5).err(), Some(RecorderError::Device { doing: Doing::Examining, error: Pulled }));
    card.accesses_left.set(usize::MAX);
    let mut recorder = open(&card, 5).unwrap();
    assert_eq!(recorder.number(), 6);
    recorder.append(&encode_entry(&tag(2)).unwrap()).unwrap();
    recorder.commit().unwrap();
    let files = files_of(&mut card.image.borrow_mut());
    for (number, capture) in [(5, 1), (6, 2)] {
        let expected = vec![Record::Header(header()), Record::Entry(tag(capture))];
        assert_eq!(read_back(&files[&name(number)]), (expected, 0));
    }
}

#[test]
fn a_card_that_fails_at_any_access_gives_a_device_error_and_is_left_alone() {
    // Pulled, or failing once and well again: the library takes some errors for answers.
    for (geometry, failures) in [(FAT16, usize::MAX), (FAT32_TINY, usize::MAX), (FAT16, 1), (FAT32_TINY, 1)] {
        let card = Card::used(geometry);
        let base = card.image.borrow().clone();
        let mut seen = Vec::new();
        for fails_at in (1..60).chain((60..).step_by(13)) {
            let place = format!("{geometry:?}, {failures} failures from access {fails_at} on");
            card.image.replace(base.clone());
            card.accesses_left.set(fails_at);
            card.failures.set(failures);
            let (failed, number) = record_chunks(&card, 100);
            card.accesses_left.set(usize::MAX);
            match failed {
                None => break,
                Some(RecorderError::Device { doing, error: Pulled }) => seen.push(doing),
                Some(other) => panic!("{place}: {other}"),
            }
            let recorder = open(&card, 1).unwrap();
            assert_ne!(Some(recorder.number()), number, "{place}");
            let files = files_of(&mut card.image.borrow_mut());
            assert!((2..=3).contains(&files.len()), "{place}: {:?}", files.keys());
            if let Some(number) = number {
                let (records, damage) = read_back(&files[&name(u32::from(number))]);
                assert!(damage <= 1, "{place}");
                let mut captures = (0..).zip(&records).skip(1);
                assert!(captures.all(|(at, record)| *record == Record::Entry(tag(at))), "{place}");
            }
        }
        for doing in [Doing::Examining, Doing::Listing, Doing::Creating, Doing::Extending, Doing::Writing] {
            assert!(seen.contains(&doing), "{geometry:?}: never failed while {doing}");
        }
    }
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
fn a_full_card_is_used_to_its_end_and_then_said_to_be_full() {
    for geometry in [FAT16, FAT32_TINY] {
        let card = Card::formatted(geometry);
        let mut files = 0;
        let full = loop {
            match open(&card, 1) {
                Ok(mut recorder) => {
                    files += 1;
                    loop {
                        let mut frame = encode_entry(&tag(1)).unwrap().to_vec();
                        frame.resize(60_000, 0);
                        match recorder.append(&frame) {
                            Ok(()) => recorder.commit().unwrap(),
                            Err(RecorderError::Full { .. } | RecorderError::FileFull { .. }) => break,
                            Err(other) => panic!("{geometry:?}: {other}"),
                        }
                    }
                }
                Err(error) => break error,
            }
        };
        let RecorderError::Full { free_bytes, wanted_bytes } = full else {
            panic!("{geometry:?}: {full}");
        };
        assert!(free_bytes < wanted_bytes && wanted_bytes <= 3 * CHUNK_BYTES as u64, "{free_bytes} of {wanted_bytes}");
        let writes = card.take_writes();
        assert!(writes > 0);
        assert!(open(&card, 1).is_err());
        assert_eq!(card.take_writes(), 0, "{geometry:?}: trying again changes nothing");
        let found = files_of(&mut card.image.borrow_mut());
        assert_eq!(found.len(), files, "{geometry:?}");
        for (name, bytes) in found {
            let (records, damage) = read_back(&bytes);
            assert!(records.len() > 1 && damage == 0, "{geometry:?}: {name} has {} records", records.len());
        }
    }
}

#[test]
fn a_card_that_a_computer_filled_keeps_its_files() {
    use std::io::Write;
    for geometry in [FAT16, FAT32_TINY] {
        let card = Card::formatted(geometry);
        let photos = vec![0xA5; 300_000];
        {
            let mut image = card.image.borrow_mut();
            let volume = fatfs::FileSystem::new(card::Partition::of(&mut image), fatfs::FsOptions::new()).unwrap();
            for number in 0..30 {
                let mut file =
                    volume.root_dir().create_file(&format!("a photo with a long name {number}.jpg")).unwrap();
                file.write_all(&photos).unwrap();
            }
            for number in (0..30).step_by(2) {
                volume.root_dir().remove(&format!("a photo with a long name {number}.jpg")).unwrap();
            }
        }
        assert_eq!(record_chunks(&card, 1000), (None, Some(1)));
        let files = files_of(&mut card.image.borrow_mut());
        assert_eq!(files.len(), 16);
        for (name, bytes) in files {
            if name == self::name(1) {
                let (records, damage) = read_back(&bytes);
                assert_eq!((records.len(), damage), (1000, 0));
            } else {
                assert!(bytes == photos, "{name} has changed");
            }
        }
    }
}

#[test]
fn a_wrong_count_of_free_clusters_does_no_harm() {
    let card = Card::formatted(FAT32_TINY);
    let info = card::PARTITION_START + 1;
    card.image.borrow_mut().get_mut(&info).unwrap()[488..492].copy_from_slice(&1_u32.to_le_bytes());
    assert_eq!(record_chunks(&card, 200), (None, Some(1)));
    let (records, damage) = read_back(&files_of(&mut card.image.borrow_mut())[&name(1)]);
    assert_eq!((records.len(), damage), (200, 0));
}

#[test]
fn a_search_for_room_that_begins_at_the_end_goes_on_at_the_start() {
    let card = Card::formatted(FAT32_TINY);
    let info = card::PARTITION_START + 1;
    let last = card::clusters_of(&mut card.image.borrow_mut()) + 1;
    for start in [last - 20, last, last + 1, u32::MAX - 1] {
        card.image.borrow_mut().get_mut(&info).unwrap()[492..496].copy_from_slice(&start.to_le_bytes());
        let (error, number) = record_chunks(&card, 200);
        assert_eq!(error, None, "search from cluster {start} of {last}");
        let (records, damage) = read_back(&files_of(&mut card.image.borrow_mut())[&name(u32::from(number.unwrap()))]);
        assert_eq!((records.len(), damage), (200, 0));
    }
}

#[test]
fn a_log_of_sixteen_megabytes_goes_on_in_another_file() {
    let card = Card::formatted(FAT32_8GB);
    let mut recorder = open(&card, 1).unwrap();
    let error = loop {
        recorder.make_room().unwrap();
        if let Err(error) = recorder.append(&[0; 4096]) {
            break error;
        }
    };
    assert_eq!(error, RecorderError::FileFull { bytes: (1 << 24) - CHUNK_BYTES as u32 });
}

#[test]
fn a_card_in_the_wrong_format_is_named() {
    let sectors = 100_000;
    let format_of = |card: &Card| match open(card, 1) {
        Err(RecorderError::Format(format)) => format,
        other => panic!("{:?}", other.map(|_| "a recorder")),
    };
    let card = Card::unformatted(sectors);
    assert_eq!(format_of(&card), CardFormat::NoPartitionTable);
    for (kind, format) in [
        (0x00, CardFormat::NoPartition),
        (0x07, CardFormat::ExFat),
        (0x83, CardFormat::PartitionType { kind: 0x83 }),
        (0x0C, CardFormat::NoFat),
    ] {
        card.write_partition_table(kind, sectors);
        assert_eq!(format_of(&card), format);
    }
    let sound = Card::formatted(FAT32_TINY);
    let patches: [(usize, &[u8], CardFormat); 6] = [
        (3, b"EXFAT   ", CardFormat::ExFat),
        (11, &[0, 16], CardFormat::SectorBytes { bytes: 4096 }),
        (13, &[0], CardFormat::NoFat),
        (16, &[0], CardFormat::NoFat),
        (32, &[0, 0, 0, 0], CardFormat::NoFat),
        (32, &[0, 0x10, 0, 0], CardFormat::Fat12 { clusters: 2856 }),
    ];
    let boot = sound.image.borrow()[&card::PARTITION_START];
    for (offset, bytes, format) in patches {
        let mut patched = boot;
        patched[offset..offset + bytes.len()].copy_from_slice(bytes);
        sound.image.borrow_mut().insert(card::PARTITION_START, patched);
        assert_eq!(format_of(&sound), format);
    }
    assert_eq!(sound.take_writes(), 0, "nothing is written to a card that is not understood");
}

#[test]
fn a_root_directory_that_bites_its_tail_is_no_trap() {
    let card = Card::formatted(FAT32_TINY);
    for number in 1..40 {
        drop(open(&card, number).unwrap());
    }
    // The root directory's first entry in the FAT is that of cluster 2: back to itself.
    let (start, ..) = fat_of(&card.image.borrow());
    card.image.borrow_mut().get_mut(&start).unwrap()[8..12].copy_from_slice(&2_u32.to_le_bytes());
    assert_eq!(open(&card, 1).err(), Some(RecorderError::Format(CardFormat::EndlessDirectory)));
}

#[test]
fn a_boot_sector_of_any_bytes_gives_an_answer() {
    let mut rng = ChaCha8Rng::seed_from_u64(4);
    let card = Card::formatted(FAT32_TINY);
    let base = card.image.borrow().clone();
    for _ in 0..3000 {
        let mut image = base.clone();
        let boot = image.get_mut(&card::PARTITION_START).unwrap();
        for _ in 0..rng.random_range(1..4) {
            boot[rng.random_range(11..90)] = (rng.next_u32() >> rng.random_range(0..32)) as u8;
        }
        card.image.replace(image);
        // Some wrong numbers look sound and lead anywhere; an error is as good an answer as a log.
        let _ = open(&card, 1);
    }
}

#[test]
fn writes_per_record_and_per_extension() {
    let expected = [
        "Fat16 4096: open 193; record 1.15, at most 2 and 1 reads; extension 193, its steps at most 25",
        "Fat32 512: open 642; record 1.15, at most 2 and 1 reads; extension 642, its steps at most 82",
        "Fat32 32768: open 138; record 1.15, at most 2 and 0 reads; extension 138, its steps at most 20",
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
