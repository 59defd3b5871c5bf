//! The board's link and its memory that outlives the power; the only place that knows how a link is used.

use adit_firmware::io::Outputs;
use adit_firmware::link::{Diagnosis, Keep, Link, Memory, Port};
use adit_protocol::parameters::Parameters;
use adit_protocol::record::Mode;
use adit_protocol::telemetry::Enforcement;

/// A number that no other board has.
const UID: u64 = 7;
/// From a reset to the first step: what the image takes on the emulated board.
pub(crate) const BOOT_S: f64 = 0.8;

/// The board, as far as the autopilot sees it.
pub(crate) struct BoardSide {
    parameters: Parameters,
    link: Link,
    memory: Memory,
    started_s: f64,
    /// The memory answers in the step after it was written.
    is_keeping: bool,
    /// The memory says that it keeps, and does not.
    forgets: bool,
}

impl BoardSide {
    /// A board that is on since time zero and whose memory is empty, or `forgets` whatever it is given.
    pub(crate) fn new(parameters: &Parameters, forgets: bool) -> Self {
        let memory = Memory::default();
        let link = Link::new(parameters, memory.clone(), UID);
        Self { parameters: parameters.clone(), link, memory, started_s: 0.0, is_keeping: false, forgets }
    }

    /// Loses its power for a moment: only the memory stays.
    pub(crate) fn reset(&mut self, now_s: f64) {
        self.link = Link::new(&self.parameters, self.memory.clone(), UID);
        (self.started_s, self.is_keeping) = (now_s + BOOT_S, false);
    }

    /// Has it started?
    pub(crate) fn is_up(&self, now_s: f64) -> bool {
        now_s >= self.started_s
    }

    /// Hears the line, takes a step of 5 ms with this limit, and says what is due.
    pub(crate) fn step(&mut self, now_s: f64, heard: &[u8], mode: Mode, limit_mps: Option<f64>) -> Vec<u8> {
        if !self.is_up(now_s) {
            return Vec::new();
        }
        let now_us = ((now_s - self.started_s) * 1e6).round() as u64;
        self.link.receive(now_us, Port::Autopilot, heard);
        if std::mem::take(&mut self.is_keeping) {
            self.link.kept(true);
        }
        if let Some(keep) = self.link.take_keep(now_us) {
            self.keep(keep);
        }
        let outputs = Outputs { mode, speed_limit_mps: limit_mps.map(|limit| limit as f32), ..Outputs::default() };
        self.link.note(now_us, &outputs, [None; 4], Diagnosis::default());
        let mut said = Vec::new();
        while let Some((ports, frame)) = self.link.next_frame(now_us) {
            if ports.contains(Port::Autopilot) {
                said.extend(frame);
            }
        }
        said
    }

    fn keep(&mut self, keep: Keep) {
        self.is_keeping = true;
        match keep {
            _ if self.forgets => {}
            Keep::Borrowed(borrowed) => self.memory.borrowed = borrowed,
            Keep::Key(key) => self.memory.key = key,
            Keep::Streams(streams) => self.memory.streams = streams,
            Keep::Parameters(_) => {}
        }
    }

    /// How far the limit is in force, as it says.
    pub(crate) fn claims(&self) -> Enforcement {
        self.link.enforcement()
    }
}
