//! The board as a camera: a component that ground stations find, and whose captures they show and count.
//!
//! A capture is told when its fate is known: at its tag where the camera tells nothing, else when it is stored or missed.
//! Who missed a telling asks for it by its number; the last [`REMEMBERED`] are there.

use adit_protocol::mavlink::CaptureReport;
use adit_protocol::parameters::CaptureWiring;
use adit_protocol::record::{Entry, EventKind};
use adit_protocol::tag::{CaptureState, CaptureTag};

/// Captures that can be told again.
const REMEMBERED: usize = 16;

/// The camera.
#[derive(Clone, Debug)]
pub(super) struct Captures {
    wiring: CaptureWiring,
    told: heapless::Deque<CaptureReport, REMEMBERED>,
    due: heapless::Deque<CaptureReport, 4>,
    tags: heapless::Deque<CaptureTag, 4>,
    /// Tagged, with its fate unknown.
    open: Option<CaptureReport>,
    commanded: Option<u32>,
    trigger: Option<u32>,
}

impl Captures {
    pub(super) fn new(wiring: CaptureWiring) -> Self {
        Self {
            wiring,
            told: heapless::Deque::new(),
            due: heapless::Deque::new(),
            tags: heapless::Deque::new(),
            open: None,
            commanded: None,
            trigger: None,
        }
    }

    /// The number of the last capture commanded.
    pub(super) fn note_commanded(&mut self, captures: u32) {
        if self.commanded.replace(captures).is_some_and(|before| before != captures) {
            self.trigger = Some(captures);
        }
    }

    /// A capture whose shutter was commanded just now.
    pub(super) fn take_trigger(&mut self) -> Option<u32> {
        self.trigger.take()
    }

    /// What goes into the log goes past here.
    pub(super) fn note_entry(&mut self, entry: &Entry) {
        match entry {
            Entry::Tag(tag) => {
                let _ = self.tags.push_back(*tag);
                self.open = Some(CaptureReport {
                    index: index_of(tag.capture),
                    time_ms: (tag.time_us / 1000) as u32,
                    rotation: [0.0; 4],
                    taken: true,
                });
                self.conclude(tag.capture, tag.state);
            }
            Entry::TagUpdate(update) => self.conclude(update.capture, update.state),
            Entry::Event(event) => {
                if let EventKind::Missed { capture, .. } = event.kind {
                    let time_ms = (event.time_us / 1000) as u32;
                    self.tell(CaptureReport {
                        index: index_of(capture),
                        time_ms,
                        taken: false,
                        ..CaptureReport::default()
                    });
                }
            }
            _ => {}
        }
    }

    /// Tells the open capture if its state is the last that the camera is wired for.
    fn conclude(&mut self, capture: u32, state: CaptureState) {
        let last = match self.wiring {
            CaptureWiring::None => true,
            CaptureWiring::Busy => state != CaptureState::Commanded,
            CaptureWiring::Confirm => state == CaptureState::Confirmed,
        };
        if let Some(report) = self.open.filter(|open| last && open.index == index_of(capture)) {
            self.tell(report);
        }
    }

    fn tell(&mut self, report: CaptureReport) {
        self.open = self.open.filter(|open| open.index != report.index);
        if self.told.is_full() {
            self.told.pop_front();
        }
        let _ = self.told.push_back(report);
        // The oldest that was not told can be asked for.
        if self.due.is_full() {
            self.due.pop_front();
        }
        let _ = self.due.push_back(report);
    }

    /// Somebody missed a capture; false if it is not remembered.
    pub(super) fn tell_again(&mut self, index: i32) -> bool {
        let found = self.told.iter().find(|report| report.index == index).copied();
        found.is_some_and(|report| self.due.push_back(report).is_ok())
    }

    /// The next to be told.
    pub(super) fn take_report(&mut self) -> Option<CaptureReport> {
        self.due.pop_front()
    }

    /// The next tag for programs of our own kind.
    pub(super) fn take_tag(&mut self) -> Option<CaptureTag> {
        self.tags.pop_front()
    }
}

/// Captures count from 1, images from 0.
fn index_of(capture: u32) -> i32 {
    capture.cast_signed().wrapping_sub(1)
}
