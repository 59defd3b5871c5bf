//! Who may command, and how often: signatures, and a bucket of tokens for each kind of request.
//!
//! Without a key everybody may, as on any MAVLink link without one. With a key, on the autopilot's port (radio and ground
//! stations lie behind it), commands and changes of parameters must be signed; what is unsigned, signed with another key, sent
//! again or too old has no effect. The service port needs hands on the board: it is believed, and only there a key is given or
//! taken.
//!
//! A request costs a token only when it may have an effect, and questions have a bucket of their own: who may not command can
//! neither use up the tokens of those who may, nor can questions. A hash takes 0.1 ms on the chip, a quarter of its time at a
//! full line; control runs above the link.

use adit_protocol::mavlink::signing::{LATEST, UNITS_PER_S};
use adit_protocol::mavlink::{Key, RawFrame, SignatureError, Streams};

use super::Port;
use crate::time::seconds;

/// Commands and changes per second, and at once.
const COMMANDS: Rate = Rate { per_s: 50.0, burst: 30.0 };
/// Questions per second, and at once.
const QUESTIONS: Rate = Rate { per_s: 50.0, burst: 30.0 };

/// How often something may happen.
#[derive(Clone, Copy, Debug)]
struct Rate {
    per_s: f32,
    burst: f32,
}

/// Tokens that come back with time.
#[derive(Clone, Copy, Debug, Default)]
struct Bucket {
    spent: f32,
    at_us: u64,
}

impl Bucket {
    fn take(&mut self, now_us: u64, rate: Rate) -> bool {
        self.spent = (self.spent - seconds(self.at_us, now_us) * rate.per_s).max(0.0);
        self.at_us = now_us;
        let is_left = self.spent + 1.0 <= rate.burst;
        if is_left {
            self.spent += 1.0;
        }
        is_left
    }
}

/// Why a request has no effect.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Refused {
    /// Its signature.
    Signature(SignatureError),
    /// There are too many.
    Flood,
}

/// The guard.
#[derive(Clone, Debug)]
pub(super) struct Guard {
    key: Option<Key>,
    streams: Streams,
    /// The time of signatures at the board's start, as far as it is known: its clock goes on from there.
    base: u64,
    commands: Bucket,
    questions: Bucket,
}

impl Guard {
    /// With the key, and what was heard before the board lost its power.
    pub(super) fn new(key: Option<Key>, streams: Streams) -> Self {
        let base = streams.newest;
        Self { key, streams, base, commands: Bucket::default(), questions: Bucket::default() }
    }

    /// The key.
    pub(super) fn key(&self) -> Option<Key> {
        self.key
    }

    /// Takes another key, or none; what was signed with the old one is forgotten. A time that no clock shows is not adopted.
    pub(super) fn set_key(&mut self, key: Option<Key>, time: u64, now_us: u64) {
        self.key = key;
        if time <= LATEST {
            self.set_time(now_us, time);
        }
        self.streams = Streams::starting_at(self.time(now_us));
    }

    /// The time now for a signature: it goes on from the newest that was heard, and never back.
    pub(super) fn time(&self, now_us: u64) -> u64 {
        self.base + units(now_us)
    }

    /// Adopts a later time.
    pub(super) fn set_time(&mut self, now_us: u64, time: u64) {
        self.base = self.base.max(time.saturating_sub(units(now_us)));
    }

    /// What was heard, to be kept; with the time now, so that the next start begins there.
    pub(super) fn streams(&self, now_us: u64) -> Streams {
        let mut streams = self.streams.clone();
        streams.newest = self.time(now_us);
        streams
    }

    /// Whether there is time for another question.
    pub(super) fn has_room(&mut self, now_us: u64) -> bool {
        self.questions.take(now_us, QUESTIONS)
    }

    /// Whether a request of these credentials may have an effect now.
    pub(super) fn admits(&mut self, now_us: u64, credentials: Result<(), SignatureError>) -> Result<(), Refused> {
        credentials.map_err(Refused::Signature)?;
        if self.commands.take(now_us, COMMANDS) { Ok(()) } else { Err(Refused::Flood) }
    }

    /// Who sent a request: believed on the service port, by its signature on the autopilot's. To be asked once per frame, and of
    /// questions too, for a signature tells the time.
    pub(super) fn credentials(&mut self, now_us: u64, port: Port, frame: &RawFrame) -> Result<(), SignatureError> {
        if port == Port::Service { Ok(()) } else { self.check(now_us, frame) }
    }

    /// Whether what a frame tells is believed.
    pub(super) fn check(&mut self, now_us: u64, frame: &RawFrame) -> Result<(), SignatureError> {
        let Some(key) = self.key else { return Ok(()) };
        self.streams.newest = self.time(now_us);
        self.streams.accept(&key, frame)?;
        self.set_time(now_us, self.streams.newest);
        Ok(())
    }
}

/// The board's time in units of a signature's.
fn units(now_us: u64) -> u64 {
    now_us * UNITS_PER_S / 1_000_000
}
