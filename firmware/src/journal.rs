//! The queue between what happens and what is written: a few entries leave with every step.

use adit_protocol::record::{Entry, Event, EventKind};

use crate::io::MAX_ENTRIES;

/// Room for the worst step many times over.
const CAPACITY: usize = 32;
/// Places that only tags and their updates may use: a storm of events never costs a tag.
const KEPT_FOR_TAGS: usize = 8;

/// The queue.
#[derive(Clone, Debug, Default)]
pub(crate) struct Journal {
    queue: heapless::Deque<Entry, CAPACITY>,
    dropped: u32,
}

impl Journal {
    /// Queues an event.
    pub(crate) fn event(&mut self, time_us: u64, kind: EventKind) {
        self.entry(Entry::Event(Event { time_us, kind }));
    }

    /// Queues any entry.
    pub(crate) fn entry(&mut self, entry: Entry) {
        let is_tag = matches!(entry, Entry::Tag(_) | Entry::TagUpdate(_));
        let room = CAPACITY - self.queue.len();
        if !is_tag && room <= KEPT_FOR_TAGS || self.queue.push_back(entry).is_err() {
            self.dropped = self.dropped.saturating_add(1);
        }
    }

    /// Takes out what one step may hand over.
    pub(crate) fn drain(&mut self, now_us: u64) -> heapless::Vec<Entry, MAX_ENTRIES> {
        if self.dropped > 0 && CAPACITY - self.queue.len() > KEPT_FOR_TAGS {
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
}

#[cfg(test)]
mod tests {
    use adit_protocol::record::TagUpdate;
    use adit_protocol::tag::CaptureState;

    use super::*;

    #[test]
    fn a_storm_of_events_costs_no_tag_and_is_counted() {
        let mut journal = Journal::default();
        for _ in 0..100 {
            journal.event(0, EventKind::CentringLost);
        }
        for capture in 0..8 {
            let update = TagUpdate { capture, state: CaptureState::Busy, time_us: 0 };
            journal.entry(Entry::TagUpdate(update));
        }
        let mut all = Vec::new();
        loop {
            let entries = journal.drain(1);
            if entries.is_empty() {
                break;
            }
            all.extend(entries);
        }
        assert_eq!(all.iter().filter(|entry| matches!(entry, Entry::TagUpdate(_))).count(), 8);
        let written = all.iter().filter(|entry| matches!(entry, Entry::Event(e) if e.kind == EventKind::CentringLost));
        let dropped = all.iter().find_map(|entry| match entry {
            Entry::Event(Event { kind: EventKind::EntriesDropped { count }, .. }) => Some(*count as usize),
            _ => None,
        });
        assert_eq!(written.count() + dropped.unwrap(), 100);
    }
}
