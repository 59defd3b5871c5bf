//! A whole log folded: per run of the board its header, the tags with their final states, events and samples.

use std::collections::HashMap;

use super::{DecodeError, Decoder};
use crate::record::{CentringSample, Entry, Event, Header, Message, Record, SpeedSample};
use crate::tag::{CaptureState, CaptureTag};

/// Something about tags that should not be.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum TagConflict {
    /// A second tag with the same number; the first is kept.
    #[error("byte {offset}: capture {capture} has a second tag; the first is kept")]
    Repeated {
        /// Where the second is.
        offset: usize,
        /// The number.
        capture: u32,
    },
    /// A change of state for a capture without tag.
    #[error("byte {offset}: a change of state for capture {capture}, which has no tag")]
    Orphan {
        /// Where it is.
        offset: usize,
        /// The number.
        capture: u32,
    },
}

/// One run of the board: from a header to the next.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Session {
    /// `None` if the log's start is lost.
    pub header: Option<Header>,
    /// In order of capture, with final states.
    pub tags: Vec<CaptureTag>,
    /// In order of time.
    pub events: Vec<Event>,
    /// In order of time.
    pub centring: Vec<CentringSample>,
    /// In order of time.
    pub speed: Vec<SpeedSample>,
    /// In order of time.
    pub messages: Vec<Message>,
}

impl Session {
    fn is_empty(&self) -> bool {
        self.header.is_none()
            && self.tags.is_empty()
            && self.events.is_empty()
            && self.centring.is_empty()
            && self.speed.is_empty()
            && self.messages.is_empty()
    }
}

/// A whole log.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct FlightLog {
    /// One per header, in the log's order; a board that restarted in flight leaves two.
    pub sessions: Vec<Session>,
    /// Stretches that gave no record.
    pub damage: Vec<DecodeError>,
    /// Tags that contradict each other.
    pub conflicts: Vec<TagConflict>,
}

impl FlightLog {
    /// Reads a log. Any bytes give an answer.
    pub fn from_bytes(bytes: &[u8]) -> Self {
        let mut log = Self::default();
        let mut session = Session::default();
        let mut place_of: HashMap<u32, usize> = HashMap::new();
        for item in Decoder::new(bytes) {
            let located = match item {
                Ok(located) => located,
                Err(error) => {
                    log.damage.push(error);
                    continue;
                }
            };
            match located.record {
                Record::Header(header) => {
                    log.close(core::mem::take(&mut session));
                    place_of.clear();
                    session.header = Some(header);
                }
                Record::Message(message) => session.messages.push(message),
                Record::Entry(entry) => {
                    if let Some(conflict) = session.take(entry, located.offset, &mut place_of) {
                        log.conflicts.push(conflict);
                    }
                }
            }
        }
        log.close(session);
        log
    }

    /// All tags, in the log's order.
    pub fn tags(&self) -> impl Iterator<Item = &CaptureTag> {
        self.sessions.iter().flat_map(|session| &session.tags)
    }

    fn close(&mut self, mut session: Session) {
        if !session.is_empty() {
            session.tags.sort_by_key(|tag| tag.capture);
            self.sessions.push(session);
        }
    }
}

impl Session {
    fn take(&mut self, entry: Entry, offset: usize, place_of: &mut HashMap<u32, usize>) -> Option<TagConflict> {
        match entry {
            Entry::Tag(tag) => {
                if place_of.contains_key(&tag.capture) {
                    return Some(TagConflict::Repeated { offset, capture: tag.capture });
                }
                place_of.insert(tag.capture, self.tags.len());
                self.tags.push(tag);
            }
            Entry::TagUpdate(update) => {
                let tag = place_of.get(&update.capture).and_then(|place| self.tags.get_mut(*place));
                let Some(tag) = tag else {
                    return Some(TagConflict::Orphan { offset, capture: update.capture });
                };
                if rank(update.state) > rank(tag.state) {
                    tag.state = update.state;
                }
            }
            Entry::Event(event) => self.events.push(event),
            Entry::Centring(sample) => self.centring.push(sample),
            Entry::Speed(sample) => self.speed.push(sample),
        }
        None
    }
}

/// States only move on.
fn rank(state: CaptureState) -> u8 {
    match state {
        CaptureState::Commanded => 0,
        CaptureState::Busy => 1,
        CaptureState::Confirmed => 2,
    }
}
