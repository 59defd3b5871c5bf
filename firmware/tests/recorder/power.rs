//! The power fails within any write to the card.

use adit_protocol::log::encode_entry;
use adit_protocol::record::Record;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use crate::card::{self, Card, FAT16, FAT32_8GB, FAT32_TINY, PHOTO, SECTOR_BYTES, fat_of, file_of};
use crate::{header, name, open, read_back, tag, update};

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
