//! Bounded queues between what happens and what is written.
//!
//! Two stand one behind the other: the controller's, from which a few entries leave with every step, and the
//! [`LogQueue`], in which they wait while the card is slow. Tags and their updates always win over events and samples,
//! and whatever is dropped is counted and told in the log.

use adit_protocol::record::{Entry, Event, EventKind};

use crate::io::MAX_ENTRIES;

/// The queue from the controller to the recorder: one capture (a tag, two updates) and two pairs of samples a second fill it
/// in nine seconds, many times longer than a card may be busy.
pub type LogQueue = Journal<64>;

/// The controller's own: room for the worst step many times over.
pub(crate) type StepJournal = Journal<32>;

/// A queue of at most `CAPACITY` entries.
#[derive(Clone, Debug, Default)]
pub struct Journal<const CAPACITY: usize> {
    queue: heapless::Deque<Entry, CAPACITY>,
    dropped: u32,
}

impl<const CAPACITY: usize> Journal<CAPACITY> {
    /// An empty queue.
    pub const fn new() -> Self {
        Self { queue: heapless::Deque::new(), dropped: 0 }
    }

    /// Queues an event.
    pub fn event(&mut self, time_us: u64, kind: EventKind) {
        self.entry(Entry::Event(Event { time_us, kind }));
    }

    /// Queues any entry. A full queue drops its oldest entry that is no tag; if it holds tags only, the new one is dropped.
    pub fn entry(&mut self, entry: Entry) {
        if self.queue.is_full() {
            self.drop_oldest();
        }
        if let Err(entry) = self.queue.push_back(entry) {
            self.count(&entry);
        }
    }

    /// Takes out the oldest entries, as many as one step may hand over; behind them, how many were dropped before.
    pub fn drain(&mut self, now_us: u64) -> heapless::Vec<Entry, MAX_ENTRIES> {
        if self.dropped > 0 && !self.queue.is_full() {
            let count = core::mem::take(&mut self.dropped);
            self.event(now_us, EventKind::EntriesDropped { count });
        }
        let mut entries = heapless::Vec::new();
        while !entries.is_full()
            && let Some(entry) = self.queue.pop_front()
        {
            // There is room: asked above.
            let _ = entries.push(entry);
        }
        entries
    }

    /// Takes back, to its front, what [`drain`](Self::drain) handed over and could not be written. In a full queue the
    /// oldest entries that are no tags make room for tags; what else does not fit is dropped.
    pub fn give_back(&mut self, entries: &[Entry]) {
        for entry in entries.iter().rev() {
            if self.queue.is_full() && is_tag(entry) {
                self.drop_oldest();
            }
            if let Err(entry) = self.queue.push_front(*entry) {
                self.count(&entry);
            }
        }
    }

    /// How many entries wait.
    pub fn len(&self) -> usize {
        self.queue.len()
    }

    /// Does none wait?
    pub fn is_empty(&self) -> bool {
        self.queue.is_empty()
    }

    /// Drops the oldest entry that is no tag, if there is one; the order of the others stays.
    fn drop_oldest(&mut self) {
        let Some(place) = self.queue.iter().position(|entry| !is_tag(entry)) else {
            return;
        };
        for behind in (1..=place).rev() {
            self.queue.swap(behind, behind - 1);
        }
        if let Some(victim) = self.queue.pop_front() {
            self.count(&victim);
        }
    }

    /// Counts a dropped entry, and with it whatever it was to tell about entries dropped before.
    fn count(&mut self, victim: &Entry) {
        let count = match victim {
            Entry::Event(Event { kind: EventKind::EntriesDropped { count }, .. }) => *count,
            _ => 1,
        };
        self.dropped = self.dropped.saturating_add(count);
    }
}

fn is_tag(entry: &Entry) -> bool {
    matches!(entry, Entry::Tag(_) | Entry::TagUpdate(_))
}

#[cfg(test)]
mod tests {
    use adit_protocol::record::TagUpdate;
    use adit_protocol::tag::CaptureState;
    use proptest::prelude::*;

    use super::*;

    fn update(capture: u32) -> Entry {
        Entry::TagUpdate(TagUpdate { capture, state: CaptureState::Busy, time_us: 0 })
    }

    fn event(time_us: u64) -> Entry {
        Entry::Event(Event { time_us, kind: EventKind::CentringLost })
    }

    fn all_of<const CAPACITY: usize>(journal: &mut Journal<CAPACITY>) -> Vec<Entry> {
        let mut all = Vec::new();
        while !journal.is_empty() || journal.dropped > 0 {
            all.extend(journal.drain(1));
        }
        all
    }

    fn dropped_in(entries: &[Entry]) -> usize {
        let counts = entries.iter().filter_map(|entry| match entry {
            Entry::Event(Event { kind: EventKind::EntriesDropped { count }, .. }) => Some(*count as usize),
            _ => None,
        });
        counts.sum()
    }

    #[test]
    fn a_storm_of_events_costs_no_tag_and_is_counted() {
        let mut journal = Journal::<32>::new();
        for capture in 0..8 {
            journal.entry(update(capture));
            for _ in 0..100 {
                journal.entry(event(0));
            }
        }
        let all = all_of(&mut journal);
        let tags: Vec<Entry> = all.iter().copied().filter(is_tag).collect();
        assert_eq!(tags, (0..8).map(update).collect::<Vec<_>>());
        assert_eq!(all.iter().filter(|entry| **entry == event(0)).count() + dropped_in(&all), 800);
    }

    #[test]
    fn the_oldest_event_goes_first() {
        let mut journal = Journal::<4>::new();
        for entry in [update(1), event(1), update(2), event(2), update(3), event(3)] {
            journal.entry(entry);
        }
        let all = journal.drain(0);
        assert_eq!(all[..], [update(1), update(2), update(3), event(3)]);
        assert_eq!(dropped_in(&all_of(&mut journal)), 2);
    }

    #[test]
    fn among_tags_alone_the_newest_goes() {
        let mut journal = Journal::<4>::new();
        for capture in 0..6 {
            journal.entry(update(capture));
        }
        let all = all_of(&mut journal);
        assert_eq!(all[..4], [update(0), update(1), update(2), update(3)]);
        assert_eq!(dropped_in(&all), 2);
    }

    #[test]
    fn what_could_not_be_written_comes_first_again() {
        let mut journal = Journal::<32>::new();
        for capture in 0..12 {
            journal.entry(update(capture));
        }
        let handed = journal.drain(0);
        journal.give_back(&handed);
        assert_eq!(all_of(&mut journal), (0..12).map(update).collect::<Vec<_>>());
    }

    proptest! {
        #[test]
        fn every_entry_comes_out_or_is_counted(steps in proptest::collection::vec(0u8..8, 0..300)) {
            let mut journal = Journal::<16>::new();
            let mut put = 0;
            let mut out = Vec::new();
            let mut unwritten: heapless::Vec<Entry, MAX_ENTRIES> = heapless::Vec::new();
            for (time_us, step) in (0..).zip(steps) {
                match step {
                    0..4 => journal.entry(event(time_us)),
                    4..6 => journal.entry(update(time_us as u32)),
                    6 => {
                        journal.give_back(&unwritten);
                        unwritten = journal.drain(time_us);
                    }
                    _ => {
                        out.extend(unwritten.clone());
                        unwritten = journal.drain(time_us);
                    }
                }
                put += usize::from(step < 6);
                prop_assert!(journal.len() <= 16);
            }
            out.extend(unwritten);
            out.extend(all_of(&mut journal));
            let real = out.iter().filter(|entry| is_tag(entry) || matches!(entry, Entry::Event(e) if e.kind == EventKind::CentringLost));
            prop_assert_eq!(real.count() + dropped_in(&out), put);
            let tags: Vec<u32> = out.iter().filter_map(|entry| match entry {
                Entry::TagUpdate(update) => Some(update.capture),
                _ => None,
            }).collect();
            prop_assert!(tags.is_sorted(), "tags keep their order");
        }
    }
}
