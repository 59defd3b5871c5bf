//! The names of log files.

use embedded_sdmmc::ShortFileName;

/// The largest number that a name has room for.
const LARGEST: u16 = 9999;

/// Which numbers the card's files have.
#[derive(Debug)]
pub(crate) struct Taken {
    bits: [u8; LARGEST as usize / 8 + 1],
}

impl Taken {
    pub(crate) fn none() -> Self {
        Self { bits: [0; LARGEST as usize / 8 + 1] }
    }

    /// Notes a file of the card.
    pub(crate) fn note(&mut self, name: &ShortFileName) {
        if let Some(number) = number_of(name)
            && let Some(bits) = self.bits.get_mut(usize::from(number) / 8)
        {
            *bits |= 1 << (number % 8);
        }
    }

    /// The number wanted or the next that is free, from 1 to 9999 and round again.
    pub(crate) fn next_free(&self, wanted: u32) -> Option<u16> {
        let largest = u32::from(LARGEST);
        let first = wanted.saturating_sub(1) % largest;
        (0..largest).map(|step| ((first + step) % largest + 1) as u16).find(|number| !self.contains(*number))
    }

    fn contains(&self, number: u16) -> bool {
        self.bits.get(usize::from(number) / 8).is_some_and(|bits| bits & 1 << (number % 8) != 0)
    }
}

/// The number of a log by its name.
pub(crate) fn number_of(name: &ShortFileName) -> Option<u16> {
    let digits = name.base_name().strip_prefix(b"ADIT")?;
    if name.extension() != b"LOG" || digits.len() != 4 || !digits.iter().all(u8::is_ascii_digit) {
        return None;
    }
    Some(digits.iter().fold(0, |number, digit| 10 * number + u16::from(digit - b'0')))
}

/// `ADIT0042.LOG`.
pub(crate) fn name_of(number: u16) -> heapless::String<12> {
    let mut name = heapless::String::new();
    // Twelve letters, as many as there is room for.
    let _ = core::fmt::write(&mut name, format_args!("ADIT{number:04}.LOG"));
    name
}

#[cfg(test)]
mod tests {
    use super::*;

    fn taken(names: &[&str]) -> Taken {
        let mut taken = Taken::none();
        for name in names {
            taken.note(&ShortFileName::create_from_str(name).unwrap());
        }
        taken
    }

    #[test]
    fn numbers_of_existing_files_are_skipped() {
        let taken = taken(&["ADIT0007.LOG", "ADIT0008.LOG", "ADIT0009.TXT", "ADIT001.LOG", "DCIM"]);
        assert_eq!(taken.next_free(6), Some(6));
        assert_eq!(taken.next_free(7), Some(9));
        assert_eq!(taken.next_free(1), Some(1));
    }

    #[test]
    fn numbers_go_round_and_zero_is_none() {
        assert_eq!(Taken::none().next_free(0), Some(1));
        assert_eq!(Taken::none().next_free(10_000), Some(1));
        assert_eq!(taken(&["ADIT9999.LOG", "ADIT0001.LOG"]).next_free(9999), Some(2));
    }

    #[test]
    fn there_is_an_end_of_numbers() {
        let mut taken = Taken::none();
        for number in 1..=LARGEST {
            assert_eq!(taken.next_free(5000).is_some(), number <= LARGEST);
            taken.note(&ShortFileName::create_from_str(&name_of(number)).unwrap());
        }
        assert_eq!(taken.next_free(5000), None);
    }
}
