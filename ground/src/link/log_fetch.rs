//! A stretch of a log under way: what is there, what is missing.
//!
//! Pieces have 90 bytes; a shorter one is the log's last. The board serves one request at a time, so that a stretch is asked
//! for window by window, and what is missing of a window before the next.

use std::collections::BTreeMap;

use adit_protocol::mavlink::{Incoming, LOG_BYTES};

const PIECE: u32 = LOG_BYTES as u32;
/// Bytes that are asked for at once: 20 readings of the board's card, 1.6 s on a line at 57,600 baud, against which the wait
/// for the next window weighs little.
pub const LOG_WINDOW_BYTES: u32 = 100 * PIECE;

/// A log is shorter than the board's list says.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "log {number} ends at byte {end}, {length} were expected; is the card still there? Fetch it again: it goes on from here"
)]
pub struct LogEndedEarly {
    /// Which log.
    pub number: u16,
    /// Where it ends.
    pub end: u32,
    /// Its length by the list.
    pub length: u32,
}

/// Collects a stretch of a log.
#[derive(Clone, Debug)]
pub struct LogFetch {
    number: u16,
    /// The first byte that was not handed out yet.
    next: u32,
    /// The byte behind the stretch.
    until: u32,
    /// Pieces behind a gap, by where they begin.
    pieces: BTreeMap<u32, Vec<u8>>,
    /// The byte behind what was asked for.
    asked: u32,
}

impl LogFetch {
    /// A stretch; it begins where a piece begins.
    pub fn new(number: u16, from: u32, until: u32) -> Self {
        let next = from - from % PIECE;
        Self { number, next, until, pieces: BTreeMap::new(), asked: next }
    }

    /// The first byte that was not handed out yet.
    pub fn position(&self) -> u32 {
        self.next
    }

    /// Whether everything was handed out.
    pub fn is_complete(&self) -> bool {
        self.next >= self.until
    }

    /// What to ask for: where it begins, and how long it is, in whole pieces; `None` if nothing is missing.
    pub fn request(&mut self) -> Option<(u32, u32)> {
        if self.is_complete() {
            return None;
        }
        let window = self.next.saturating_add(LOG_WINDOW_BYTES);
        let gap_end = self.pieces.keys().next().copied().unwrap_or(window).min(window).min(self.until);
        let count = (gap_end - self.next).div_ceil(PIECE) * PIECE;
        self.asked = self.next.saturating_add(count);
        Some((self.next, count))
    }

    /// Hears a message; true if it brought a piece that was missing.
    ///
    /// # Errors
    /// [`LogEndedEarly`].
    pub fn hear(&mut self, incoming: &Incoming) -> Result<bool, LogEndedEarly> {
        let Incoming::LogData { id, offset, data } = incoming else { return Ok(false) };
        let is_wanted = *id == self.number
            && offset % PIECE == 0
            && (self.next..self.until).contains(offset)
            && *offset < self.next.saturating_add(LOG_WINDOW_BYTES)
            && !self.pieces.contains_key(offset);
        if !is_wanted {
            return Ok(false);
        }
        let wanted = PIECE.min(self.until - offset) as usize;
        let Some(piece) = data.get(..wanted) else {
            return Err(LogEndedEarly { number: self.number, end: offset + data.len() as u32, length: self.until });
        };
        self.pieces.insert(*offset, piece.to_vec());
        Ok(true)
    }

    /// Whether the last piece of what was asked for is there, so that no more will come unasked.
    pub fn is_answered(&self) -> bool {
        let last = self.asked.min(self.until).saturating_sub(1);
        let last_piece = last - last % PIECE;
        self.next > last || self.pieces.contains_key(&last_piece)
    }

    /// Hands out what follows without a gap on what was handed out before.
    pub fn take(&mut self) -> Vec<u8> {
        let mut bytes = Vec::new();
        while let Some(piece) = self.pieces.remove(&self.next) {
            self.next += piece.len() as u32;
            bytes.extend_from_slice(&piece);
        }
        bytes
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn content(length: u32) -> Vec<u8> {
        (0..length).map(|index| (index * 7 % 251) as u8).collect()
    }

    fn piece(log: &[u8], offset: u32) -> Incoming {
        let rest = log.get(offset as usize..).unwrap_or_default();
        let data = rest.iter().copied().take(LOG_BYTES).collect();
        Incoming::LogData { id: 3, offset, data }
    }

    #[test]
    fn a_gap_is_asked_for_before_the_next_window() {
        let log = content(30_000);
        let mut fetch = LogFetch::new(3, 0, 30_000);
        assert_eq!(fetch.request(), Some((0, LOG_WINDOW_BYTES)));
        for offset in (0..LOG_WINDOW_BYTES).step_by(90).filter(|offset| !(180..360).contains(offset)) {
            assert_eq!(fetch.hear(&piece(&log, offset)), Ok(true));
        }
        assert_eq!(fetch.take().len(), 180);
        assert!(fetch.is_answered());
        assert_eq!(fetch.request(), Some((180, 180)));
        assert!(!fetch.is_answered());
        for offset in [270, 180] {
            assert_eq!(fetch.hear(&piece(&log, offset)), Ok(true));
        }
        assert_eq!(fetch.take().len() as u32, LOG_WINDOW_BYTES - 180);
        assert_eq!(fetch.request(), Some((LOG_WINDOW_BYTES, LOG_WINDOW_BYTES)));
    }

    #[test]
    fn the_last_window_ends_with_the_log_in_whole_pieces() {
        let log = content(100);
        let mut fetch = LogFetch::new(3, 0, 100);
        assert_eq!(fetch.request(), Some((0, 180)));
        assert_eq!(fetch.hear(&piece(&log, 90)), Ok(true));
        assert_eq!(fetch.hear(&piece(&log, 0)), Ok(true));
        assert_eq!(fetch.take(), log);
        assert!(fetch.is_complete() && fetch.request().is_none());
    }

    #[test]
    fn a_log_that_grew_meanwhile_is_cut_at_its_length() {
        let log = content(400);
        let mut fetch = LogFetch::new(3, 0, 100);
        assert_eq!(fetch.hear(&piece(&log, 0)), Ok(true));
        assert_eq!(fetch.hear(&piece(&log, 90)), Ok(true));
        assert_eq!(fetch.hear(&piece(&log, 180)), Ok(false));
        assert_eq!(fetch.take(), log[..100]);
    }

    #[test]
    fn a_short_piece_before_the_end_is_an_error_that_says_where() {
        let mut fetch = LogFetch::new(3, 0, 500);
        let error = fetch.hear(&piece(&content(200), 180)).unwrap_err();
        assert_eq!(error, LogEndedEarly { number: 3, end: 200, length: 500 });
    }

    #[test]
    fn pieces_of_other_logs_and_places_are_left_aside() {
        let log = content(500);
        let mut fetch = LogFetch::new(3, 90, 500);
        assert_eq!(fetch.hear(&piece(&log, 0)), Ok(false));
        assert_eq!(fetch.hear(&piece(&log, 100)), Ok(false));
        assert_eq!(fetch.hear(&piece(&log, 900)), Ok(false));
        assert_eq!(LogFetch::new(4, 90, 500).hear(&piece(&log, 90)), Ok(false));
    }

    proptest! {
        #[test]
        fn any_loss_order_and_repetition_gives_the_log(
            length in 1..25_000_u32,
            fates in proptest::collection::vec((0..3_u8, any::<proptest::sample::Index>()), 50),
        ) {
            let log = content(length);
            let mut fetch = LogFetch::new(3, 0, length);
            let mut got = Vec::new();
            let mut fates = fates.into_iter().cycle();
            let mut requests = 0;
            while let Some((offset, count)) = fetch.request() {
                requests += 1;
                prop_assert!(requests < 3000);
                let mut pieces: Vec<_> = (offset..offset + count).step_by(90).map(|at| piece(&log, at)).collect();
                for _ in 0..=(pieces.len() / 3) {
                    let (fate, at) = fates.next().unwrap();
                    if pieces.len() < 2 { break }
                    let at = at.index(pieces.len());
                    match fate {
                        0 => { pieces.remove(at); }
                        1 => pieces.swap(0, at),
                        _ => pieces.push(pieces[at].clone()),
                    }
                }
                for piece in &pieces {
                    fetch.hear(piece).unwrap();
                    got.extend(fetch.take());
                }
            }
            prop_assert_eq!(got, log);
        }
    }
}
