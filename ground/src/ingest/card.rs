//! The camera's memory card: photos in the order in which they were taken, with their times.

use std::fs::File;
use std::io::BufReader;
use std::path::{Path, PathBuf};

use exif::{DateTime, In, Tag, Value};
use rayon::prelude::*;

use super::IngestError;
use super::clock::Stamp;
use crate::survey::find_photos;

/// A photo on the card.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct CardPhoto {
    /// Path relative to the folder given, joined by `/`.
    pub(super) name: String,
    pub(super) path: PathBuf,
    /// When it was taken, by the camera's clock.
    pub(super) stamp: Option<Stamp>,
    /// Why there is no time, if there is none.
    pub(super) no_stamp: Option<String>,
}

/// A gap in the numbers wider than this, with numbers at both ends of the range, is a counter that began again.
const WRAP_GAP: u32 = 5000;

/// Lists the photos below `folder` in the order in which the camera took them and reads their times.
///
/// Order: folders by name (100GOPRO before 101GOPRO), numbers within a folder; a folder into which 9999 and 0001 were
/// copied together starts after its widest gap.
pub(super) fn read_card(folder: &Path) -> Result<Vec<CardPhoto>, IngestError> {
    let found = find_photos(folder).map_err(|source| IngestError::Photos { path: folder.to_owned(), source })?;
    if found.is_empty() {
        return Err(IngestError::NoPhotos { path: folder.to_owned() });
    }
    let mut photos: Vec<CardPhoto> = found
        .into_par_iter()
        .map(|photo| {
            let (stamp, no_stamp) = match read_stamp(&photo.path) {
                Ok(stamp) => (Some(stamp), None),
                Err(reason) => (None, Some(reason)),
            };
            CardPhoto { name: photo.name, path: photo.path, stamp, no_stamp }
        })
        .collect();
    photos.sort_by(|a, b| place(&a.name).cmp(&place(&b.name)));
    let mut ordered = Vec::with_capacity(photos.len());
    for folder in photos.chunk_by(|a, b| place(&a.name).0 == place(&b.name).0) {
        let start = start_after_wrap(folder);
        ordered.extend_from_slice(&folder[start..]);
        ordered.extend_from_slice(&folder[..start]);
    }
    Ok(ordered)
}

/// Folder, number (the last four digits of the name), name.
fn place(name: &str) -> (&str, Option<u32>, &str) {
    let (folder, file) = name.rsplit_once('/').unwrap_or(("", name));
    let stem = file.split('.').next().unwrap_or(file);
    let digits = stem.len() - stem.trim_end_matches(|c: char| c.is_ascii_digit()).len();
    let number = stem.get(stem.len() - digits.min(4)..).and_then(|digits| digits.parse().ok());
    (folder, number, file)
}

/// Index of the photo that was taken first.
fn start_after_wrap(folder: &[CardPhoto]) -> usize {
    let number = |i: usize| folder.get(i).and_then(|photo| place(&photo.name).1);
    let gap = |i: usize| number(i).zip(number(i - 1)).map_or(0, |(next, last)| next.saturating_sub(last));
    let Some(widest) = (1..folder.len()).max_by_key(|&i| gap(i)) else { return 0 };
    if gap(widest) < WRAP_GAP {
        return 0;
    }
    // The times, where there are any, must not contradict it.
    let first_s = folder.first().and_then(|photo| photo.stamp).map(|stamp| stamp.from_s);
    let after_gap_s = folder.get(widest).and_then(|photo| photo.stamp).map(|stamp| stamp.from_s);
    match first_s.zip(after_gap_s) {
        Some((first_s, after_gap_s)) if after_gap_s > first_s => 0,
        _ => widest,
    }
}

/// Reads `DateTimeOriginal` with its fraction of a second; the reason if there is none.
fn read_stamp(path: &Path) -> Result<Stamp, String> {
    let file = File::open(path).map_err(|error| format!("cannot be read: {error}"))?;
    let exif = exif::Reader::new()
        .read_from_container(&mut BufReader::new(file))
        .map_err(|error| format!("no readable EXIF: {error}"))?;
    let text_of = |tag: Tag| match exif.get_field(tag, In::PRIMARY).map(|field| &field.value) {
        Some(Value::Ascii(texts)) => texts.first().cloned(),
        _ => None,
    };
    let text = [Tag::DateTimeOriginal, Tag::DateTimeDigitized, Tag::DateTime].into_iter().find_map(text_of);
    let text = text.ok_or_else(|| "no time in its EXIF".to_owned())?;
    let shown = || String::from_utf8_lossy(&text).into_owned();
    let time = DateTime::from_ascii(&text).map_err(|_| format!("its EXIF time `{}` is no time", shown()))?;
    let seconds = unix_seconds(&time).ok_or_else(|| format!("its EXIF time `{}` is no time", shown()))?;
    let fraction = text_of(Tag::SubSecTimeOriginal).and_then(|digits| fraction_of(&digits));
    let (fraction_s, resolution_s) = fraction.unwrap_or((0.0, 1.0));
    Ok(Stamp { from_s: seconds as f64 + fraction_s, resolution_s })
}

/// Digits after the decimal point: their value and that of the last digit.
fn fraction_of(digits: &[u8]) -> Option<(f64, f64)> {
    let text = std::str::from_utf8(digits).ok()?.trim();
    if text.is_empty() || text.len() > 9 {
        return None;
    }
    let resolution_s = 0.1_f64.powi(i32::try_from(text.len()).ok()?);
    Some((f64::from(text.parse::<u32>().ok()?) * resolution_s, resolution_s))
}

/// Seconds since 1970 of a date of the proleptic Gregorian calendar; `None` if it is none.
///
/// Days are counted from 1 March, so that the leap day is the last of its year (Hinnant, "chrono-compatible low-level
/// date algorithms").
fn unix_seconds(time: &DateTime) -> Option<i64> {
    let (month, day) = (i64::from(time.month), i64::from(time.day));
    let in_range = (1..=12).contains(&month) && (1..=31).contains(&day);
    if !in_range || time.hour > 23 || time.minute > 59 || time.second > 60 || time.year == 0 {
        return None;
    }
    let year = i64::from(time.year) - i64::from(month <= 2);
    let era = year.div_euclid(400);
    let year_of_era = year.rem_euclid(400);
    let day_of_year = (153 * ((month + 9) % 12) + 2) / 5 + day - 1;
    let days = era * 146_097 + year_of_era * 365 + year_of_era / 4 - year_of_era / 100 + day_of_year - 719_468;
    Some(((days * 24 + i64::from(time.hour)) * 60 + i64::from(time.minute)) * 60 + i64::from(time.second))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn photo(name: &str, from_s: Option<f64>) -> CardPhoto {
        let stamp = from_s.map(|from_s| Stamp { from_s, resolution_s: 1.0 });
        CardPhoto { name: name.to_owned(), path: PathBuf::from(name), stamp, no_stamp: None }
    }

    #[test]
    fn dates_become_seconds_since_1970() {
        let at = |text: &[u8]| unix_seconds(&DateTime::from_ascii(text).unwrap());
        assert_eq!(at(b"1970:01:01 00:00:00"), Some(0));
        assert_eq!(at(b"2000:02:29 00:00:00"), Some(951_782_400));
        assert_eq!(at(b"2024:02:29 23:59:59"), Some(1_709_251_199));
        assert_eq!(at(b"2018:05:17 10:20:00"), Some(1_526_552_400));
        assert_eq!(at(b"2018:13:17 10:20:00"), None);
        assert_eq!(at(b"0000:00:00 00:00:00"), None);
    }

    #[test]
    fn the_number_is_the_last_four_digits() {
        assert_eq!(place("DCIM/100GOPRO/GOPR0042.JPG"), ("DCIM/100GOPRO", Some(42), "GOPR0042.JPG"));
        assert_eq!(place("G0120043.JPG").1, Some(43));
        assert_eq!(place("mask.jpg").1, None);
    }

    #[test]
    fn a_folder_that_holds_9999_and_0001_starts_after_the_gap() {
        let folder = [
            photo("GOPR0001.JPG", Some(102.0)),
            photo("GOPR0002.JPG", Some(104.0)),
            photo("GOPR9998.JPG", Some(98.0)),
            photo("GOPR9999.JPG", Some(100.0)),
        ];
        assert_eq!(start_after_wrap(&folder), 2);
        let without_times: Vec<CardPhoto> = folder.iter().map(|p| photo(&p.name, None)).collect();
        assert_eq!(start_after_wrap(&without_times), 2);
    }

    #[test]
    fn a_gap_that_the_times_explain_is_no_wrap() {
        let folder = [photo("GOPR0001.JPG", Some(1.0)), photo("GOPR9000.JPG", Some(9000.0))];
        assert_eq!(start_after_wrap(&folder), 0);
        assert_eq!(start_after_wrap(&[]), 0);
    }

    #[test]
    fn a_fraction_of_a_second_sharpens_the_time() {
        let (value_s, resolution_s) = fraction_of(b"25").unwrap();
        assert!((value_s - 0.25).abs() < 1e-12 && (resolution_s - 0.01).abs() < 1e-12);
        assert_eq!(fraction_of(b"  "), None);
    }

    #[test]
    fn real_gopro_photos_have_a_time() {
        let Some(samples) = crate::samples_folder() else {
            eprintln!("skipped: no shared/samples above this crate");
            return;
        };
        let photos = read_card(&samples.join("gopro-hero4-chessboard")).unwrap();
        assert_eq!(photos.len(), 24);
        assert!(photos.iter().all(|photo| photo.stamp.is_some()), "{photos:?}");
        assert!(photos.windows(2).all(|two| two[0].stamp.unwrap().from_s <= two[1].stamp.unwrap().from_s));
    }
}
