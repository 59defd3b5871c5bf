//! The board's clock against ours, by `TIMESYNC`.

use std::time::Duration;

use adit_protocol::mavlink::Incoming;
use tokio::time::Instant;

use super::error::{LinkError, Question};
use super::session::{Dialogue, Session, Step, Turn};
use super::version::Board;

/// What the board's clock said at some moment of ours.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ClockReading {
    /// The middle between question and answer.
    pub at: Instant,
    /// Half of the time between them: by so much the moment is unsure.
    pub within: Duration,
    /// Since the board's start.
    pub board: Duration,
}

struct ClockDialogue {
    began: Instant,
}

impl ClockDialogue {
    /// Never zero, which is no question's time.
    fn now_ns(&self) -> i64 {
        i64::try_from(self.began.elapsed().as_nanos()).unwrap_or(i64::MAX).max(1)
    }
}

impl Dialogue for ClockDialogue {
    type Answer = ClockReading;

    fn turn(&mut self, _attempt: u32) -> Turn<ClockReading> {
        let asked_ns = self.now_ns();
        Turn::Send(vec![Box::new(move |sender| sender.time_sync(0, asked_ns))])
    }

    fn hear(&mut self, incoming: &Incoming) -> Step<ClockReading> {
        let Incoming::TimeSync { answered_ns, asked_ns } = *incoming else { return Step::Nothing };
        let now_ns = self.now_ns();
        // Another station's question has another clock's time in it, most likely one that is not of this minute.
        if answered_ns == 0 || !(1..=now_ns).contains(&asked_ns) {
            return Step::Nothing;
        }
        let nanoseconds = |ns: i64| Duration::from_nanos(ns.unsigned_abs());
        Step::Done(ClockReading {
            at: self.began + nanoseconds(asked_ns.midpoint(now_ns)),
            within: nanoseconds((now_ns - asked_ns) / 2),
            board: nanoseconds(answered_ns),
        })
    }
}

impl Session {
    /// Reads the board's clock.
    ///
    /// # Errors
    /// [`LinkError::NoAnswer`], [`LinkError::Ended`].
    pub async fn clock(&self, board: &Board) -> Result<ClockReading, LinkError> {
        let mut dialogue = ClockDialogue { began: Instant::now() };
        self.lead(board.target, Question::Clock, &mut dialogue).await
    }
}
