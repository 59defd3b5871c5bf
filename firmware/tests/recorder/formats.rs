//! Cards as they come: used, formatted for something else, or broken.

use adit_firmware::recorder::{CardFormat, RecorderError};
use rand::{Rng, RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use crate::card::{self, Card, FAT16, FAT32_TINY, fat_of, files_of};
use crate::{name, open, read_back, record_chunks};

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
