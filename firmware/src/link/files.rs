//! The card's logs, for ground stations: a list, and stretches of a file. The reading itself is done by who has the card.

use adit_protocol::mavlink::{LOG_BYTES, OutFrame, Sender};

use super::Port;

/// Logs of a list, the newest.
pub const MAX_LOGS: usize = 32;
/// Bytes that are read at a time: five pieces of the protocol.
pub const READ_BYTES: usize = 5 * LOG_BYTES;

/// Number and length of a log.
pub type LogList = heapless::Vec<(u16, u32), MAX_LOGS>;
/// Bytes of a log, fewer than [`READ_BYTES`] at its end only.
pub type LogBytes = heapless::Vec<u8, READ_BYTES>;

/// What is wanted from the card.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LogWish {
    /// What logs there are.
    List,
    /// Some bytes of one.
    Read {
        /// Which.
        number: u16,
        /// From where.
        offset: u32,
    },
}

/// What the card says. A log that is not there has no bytes.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum LogAnswer {
    /// Logs by number, the oldest first.
    List(LogList),
    /// Bytes from where they were wanted.
    Read(LogBytes),
    /// The card failed. Nothing is said, as if the question had been lost on the line: who asked asks again.
    Failed,
}

/// The service.
#[derive(Clone, Debug, Default)]
pub(super) struct LogServer {
    /// To whom answers go.
    port: Option<Port>,
    list: Option<LogList>,
    listed: usize,
    wants_list: bool,
    stretch: Option<Stretch>,
    bytes: LogBytes,
    sent: usize,
    /// Waits for the card.
    waits: bool,
}

/// What is still wanted of a log.
#[derive(Clone, Copy, Debug)]
struct Stretch {
    number: u16,
    offset: u32,
    left: u32,
}

impl LogServer {
    /// A list is wanted.
    pub(super) fn list(&mut self, port: Port) {
        *self = Self { port: Some(port), wants_list: true, waits: self.waits, ..Self::default() };
    }

    /// A stretch is wanted; another one under way is given up.
    pub(super) fn read(&mut self, port: Port, number: u16, offset: u32, count: u32) {
        // No log reaches beyond what an offset can say.
        let stretch = Some(Stretch { number, offset, left: count.min(u32::MAX - offset) });
        *self = Self { port: Some(port), stretch, waits: self.waits, ..Self::default() };
    }

    /// Nothing is wanted any more.
    pub(super) fn end(&mut self) {
        *self = Self { waits: self.waits, ..Self::default() };
    }

    /// The next question to the card; one at a time.
    pub(super) fn take_wish(&mut self) -> Option<LogWish> {
        if self.waits {
            return None;
        }
        let wish = match self.stretch {
            _ if self.wants_list => LogWish::List,
            Some(stretch) if self.sent >= self.bytes.len() => {
                LogWish::Read { number: stretch.number, offset: stretch.offset }
            }
            _ => return None,
        };
        self.waits = true;
        Some(wish)
    }

    /// The card answers. What nobody wants any more is dropped.
    pub(super) fn hear(&mut self, wish: LogWish, answer: LogAnswer) {
        self.waits = false;
        match answer {
            LogAnswer::List(list) if self.wants_list => {
                (self.list, self.listed, self.wants_list) = (Some(list), 0, false);
            }
            LogAnswer::Read(bytes) if self.wants_bytes(wish) => {
                (self.bytes, self.sent) = (bytes, 0);
                if self.bytes.is_empty() {
                    // An empty piece tells the end.
                    self.sent = usize::MAX;
                }
            }
            LogAnswer::Failed if self.wants_list || self.wants_bytes(wish) => self.end(),
            _ => {}
        }
    }

    fn wants_bytes(&self, wish: LogWish) -> bool {
        self.stretch.is_some_and(|stretch| wish == LogWish::Read { number: stretch.number, offset: stretch.offset })
    }

    /// To whom the next frame goes, if there is one.
    pub(super) fn next_port(&self) -> Option<Port> {
        let has_bytes = self.stretch.is_some() && (self.sent < self.bytes.len() || self.sent == usize::MAX);
        self.port.filter(|_| self.list.is_some() || has_bytes)
    }

    /// The next frame.
    pub(super) fn next_frame(&mut self, sender: &mut Sender) -> Option<OutFrame> {
        if let Some(list) = &self.list {
            let (count, last) = (list.len() as u16, list.last().map_or(0, |(number, _)| *number));
            let (number, bytes) = list.get(self.listed).copied().unwrap_or_default();
            self.listed += 1;
            if self.listed >= list.len() {
                self.list = None;
            }
            return Some(sender.log_entry([number, count, last], bytes));
        }
        let stretch = self.stretch.as_mut()?;
        let rest = self.bytes.get(self.sent..).unwrap_or_default();
        let piece = rest.get(..rest.len().min(LOG_BYTES).min(stretch.left as usize)).unwrap_or_default();
        let frame = sender.log_data(stretch.number, stretch.offset, piece);
        let is_end = piece.len() < LOG_BYTES;
        self.sent += piece.len();
        stretch.offset += piece.len() as u32;
        stretch.left -= piece.len() as u32;
        if is_end || stretch.left == 0 {
            self.end();
        }
        Some(frame)
    }
}
