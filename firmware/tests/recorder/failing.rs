//! Cards that are pulled, fail now and then, or are full.

use adit_firmware::recorder::{Doing, RecorderError};
use adit_protocol::log::encode_entry;
use adit_protocol::record::Record;

use crate::card::{Card, FAT16, FAT32_8GB, FAT32_TINY, Pulled, files_of};
use crate::{CHUNK_BYTES, header, name, open, read_back, record_chunks, tag};

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
