//! Photos by their numbers: commanded, stored, missed, or not known.

use std::collections::VecDeque;
use std::time::Duration;

/// The board tells the fate of its last sixteen captures again if it is asked.
const REMEMBERED: usize = 16;
/// A camera's answer is known by then, be it that there is none.
const ANSWER_TAKES: Duration = Duration::from_secs(6);

#[derive(Clone, Copy, Debug)]
struct Capture {
    number: u32,
    heard: Option<Duration>,
    is_stored: Option<bool>,
}

/// What is known of the captures.
#[derive(Clone, Debug, Default)]
pub(super) struct Captures {
    last: VecDeque<Capture>,
    confirmed: u32,
    first: Option<u32>,
}

impl Captures {
    /// A capture's tag was heard.
    pub(super) fn add(&mut self, now: Duration, number: u32) {
        if let Some(capture) = self.entry(number) {
            capture.heard.get_or_insert(now);
        }
    }

    /// A capture's fate was heard, for the first time or again.
    pub(super) fn tell(&mut self, number: u32, is_stored: bool) {
        let is_news = self.entry(number).is_some_and(|capture| capture.is_stored.replace(is_stored).is_none());
        self.confirmed += u32::from(is_news && is_stored);
    }

    /// The first capture that was heard of.
    pub(super) fn first(&self) -> Option<u32> {
        self.first
    }

    /// Captures that are stored, since the first that was heard of.
    pub(super) fn confirmed(&self) -> u32 {
        self.confirmed
    }

    /// Whether a capture was stored, if that is known.
    pub(super) fn fate(&self, number: u32) -> Option<bool> {
        self.last.iter().find(|capture| capture.number == number).and_then(|capture| capture.is_stored)
    }

    /// The oldest capture whose fate must be known by now and was not heard.
    pub(super) fn unanswered(&self, now: Duration) -> Option<u32> {
        let is_due = |capture: &&Capture| {
            capture.is_stored.is_none() && capture.heard.is_some_and(|heard| now.saturating_sub(heard) > ANSWER_TAKES)
        };
        self.last.iter().find(is_due).map(|capture| capture.number)
    }

    /// `None` for one that is forgotten already.
    fn entry(&mut self, number: u32) -> Option<&mut Capture> {
        self.first.get_or_insert(number);
        let place = self.last.partition_point(|capture| capture.number < number);
        if self.last.get(place).is_none_or(|capture| capture.number != number) {
            if self.last.len() < REMEMBERED {
                self.last.insert(place, Capture { number, heard: None, is_stored: None });
            } else {
                let before = place.checked_sub(1)?;
                self.last.pop_front();
                self.last.insert(before, Capture { number, heard: None, is_stored: None });
                return self.last.get_mut(before);
            }
        }
        self.last.get_mut(place)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SOON: Duration = Duration::from_secs(1);
    const LATE: Duration = Duration::from_mins(1);

    #[test]
    fn a_report_that_comes_twice_counts_once() {
        let mut captures = Captures::default();
        for _ in 0..2 {
            captures.add(SOON, 1);
            captures.tell(1, true);
        }
        captures.tell(2, false);
        assert_eq!((captures.confirmed(), captures.fate(1), captures.fate(2)), (1, Some(true), Some(false)));
    }

    #[test]
    fn a_report_that_was_lost_is_asked_for_while_the_board_remembers_it() {
        let mut captures = Captures::default();
        captures.add(SOON, 1);
        captures.add(SOON, 2);
        captures.tell(2, true);
        assert_eq!((captures.unanswered(SOON), captures.unanswered(LATE)), (None, Some(1)));
        for number in 3..=18 {
            captures.add(SOON, number);
            captures.tell(number, true);
        }
        assert_eq!((captures.unanswered(LATE), captures.confirmed()), (None, 17));
    }
}
