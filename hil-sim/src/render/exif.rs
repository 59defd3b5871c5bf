//! The EXIF block of a photo, as a `GoPro` writes it: TIFF, big-endian, two directories.
//!
//! Source: EXIF 2.3 (CIPA DC-008), tables 3 to 8.

/// Seconds in a day.
const DAY_S: i64 = 86_400;
/// Offset of the first directory from the TIFF header.
const FIRST_DIRECTORY: u32 = 8;

const ASCII: u16 = 2;
const SHORT: u16 = 3;
const LONG: u16 = 4;
const RATIONAL: u16 = 5;
const UNDEFINED: u16 = 7;

/// Camera clock: seconds since 1970-01-01T00:00:00 of the camera's own (zoneless) time.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct ExifTime(pub i64);

impl ExifTime {
    /// `YYYY:MM:DD hh:mm:ss`.
    ///
    /// Method: civil-from-days in the proleptic Gregorian calendar, eras of 400 years starting on 1 March 0000.
    pub fn text(self) -> String {
        let days = self.0.div_euclid(DAY_S) + 719_468;
        let second = self.0.rem_euclid(DAY_S);
        let era = days.div_euclid(146_097);
        let day_of_era = days.rem_euclid(146_097);
        let year_of_era = (day_of_era - day_of_era / 1460 + day_of_era / 36_524 - day_of_era / 146_096) / 365;
        let day_of_year = day_of_era - (365 * year_of_era + year_of_era / 4 - year_of_era / 100);
        let month_from_march = (5 * day_of_year + 2) / 153;
        let day = day_of_year - (153 * month_from_march + 2) / 5 + 1;
        let month = if month_from_march < 10 { month_from_march + 3 } else { month_from_march - 9 };
        let year = year_of_era + era * 400 + i64::from(month <= 2);
        let (hour, minute, second) = (second / 3600, second / 60 % 60, second % 60);
        format!("{year:04}:{month:02}:{day:02} {hour:02}:{minute:02}:{second:02}")
    }
}

/// One entry of a directory.
struct Entry {
    tag: u16,
    kind: u16,
    count: u32,
    value: Vec<u8>,
}

fn ascii(tag: u16, text: &str) -> Entry {
    let mut value = text.as_bytes().to_vec();
    value.push(0);
    Entry { tag, kind: ASCII, count: value.len() as u32, value }
}

fn short(tag: u16, value: u16) -> Entry {
    Entry { tag, kind: SHORT, count: 1, value: value.to_be_bytes().to_vec() }
}

fn long(tag: u16, value: u32) -> Entry {
    Entry { tag, kind: LONG, count: 1, value: value.to_be_bytes().to_vec() }
}

fn rational(tag: u16, numerator: u32, denominator: u32) -> Entry {
    let value = [numerator.to_be_bytes(), denominator.to_be_bytes()].concat();
    Entry { tag, kind: RATIONAL, count: 1, value }
}

/// Returns the TIFF block that follows `Exif\0\0`.
///
/// Times have a resolution of one second, as the camera's own; entries are in order of their tags, as TIFF demands.
pub(super) fn exif_block(width_px: u32, height_px: u32, exposure_s: f64, taken: ExifTime) -> Vec<u8> {
    let time = taken.text();
    let exposure_us = (exposure_s * 1e6).round().max(1.0) as u32;
    let camera_entries = [
        rational(0x829a, exposure_us, 1_000_000),
        rational(0x829d, 28, 10),
        Entry { tag: 0x9000, kind: UNDEFINED, count: 4, value: b"0230".to_vec() },
        ascii(0x9003, &time),
        ascii(0x9004, &time),
        rational(0x920a, 3, 1),
        long(0xa002, width_px),
        long(0xa003, height_px),
        short(0xa405, 15),
    ];
    let first_entries = |camera_directory: u32| {
        [
            ascii(0x010f, "GoPro"),
            ascii(0x0110, "HERO4 (simulated)"),
            short(0x0112, 1),
            ascii(0x0132, &time),
            long(0x8769, camera_directory),
        ]
    };
    let first_length = directory(&first_entries(0), FIRST_DIRECTORY).len() as u32;
    let camera_directory = FIRST_DIRECTORY + first_length;
    let mut block = b"MM\0\x2a".to_vec();
    block.extend(FIRST_DIRECTORY.to_be_bytes());
    block.extend(directory(&first_entries(camera_directory), FIRST_DIRECTORY));
    block.extend(directory(&camera_entries, camera_directory));
    block
}

/// A directory that starts at `offset`, followed by the values that do not fit into its entries.
fn directory(entries: &[Entry], offset: u32) -> Vec<u8> {
    let mut table = (entries.len() as u16).to_be_bytes().to_vec();
    let mut values: Vec<u8> = Vec::new();
    let values_offset = offset + 2 + 12 * entries.len() as u32 + 4;
    for entry in entries {
        table.extend(entry.tag.to_be_bytes());
        table.extend(entry.kind.to_be_bytes());
        table.extend(entry.count.to_be_bytes());
        if entry.value.len() <= 4 {
            let mut inline = entry.value.clone();
            inline.resize(4, 0);
            table.extend(inline);
        } else {
            table.extend((values_offset + values.len() as u32).to_be_bytes());
            values.extend(&entry.value);
            if values.len() % 2 == 1 {
                values.push(0);
            }
        }
    }
    table.extend(0_u32.to_be_bytes());
    table.extend(values);
    table
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn calendar_dates_come_out_right() {
        assert_eq!(ExifTime(0).text(), "1970:01:01 00:00:00");
        assert_eq!(ExifTime(951_782_399).text(), "2000:02:28 23:59:59");
        assert_eq!(ExifTime(951_782_400).text(), "2000:02:29 00:00:00");
        assert_eq!(ExifTime(1_709_251_199).text(), "2024:02:29 23:59:59");
        assert_eq!(ExifTime(4_107_542_400).text(), "2100:03:01 00:00:00");
        assert_eq!(ExifTime(-1).text(), "1969:12:31 23:59:59");
    }
}
