//! MAVLink 2 signing, without clock, allocation or lock: who may command is who knows the key.
//!
//! A signature is 13 bytes behind a frame: link, time, the first 6 bytes of SHA-256 over key and frame
//! (mavlink.io, "Message Signing"). Times of one stream (system, component, link) only grow, which is what makes a frame
//! that is sent again worthless. A stream that was never heard before may lag behind the newest time known by a minute.
//!
//! A receiver without a calendar must outlive its power ([`Streams`] is plain data to be kept): what it last heard, it may
//! not hear again. The key is never printed.

use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};

use super::frame::{HASH_BYTES, RawFrame, SIGNATURE_BYTES, SIGNED};
use super::sender::OutFrame;

/// Units of a signature's time in a second.
pub const UNITS_PER_S: u64 = 100_000;
/// 2015-01-01 UTC, where a signature's time begins, in Unix seconds.
pub const EPOCH_UNIX_S: u64 = 1_420_070_400;
/// The latest time that a clock shows: a year before its 48 bits run over, in 2103. A later one would bar everybody after it.
pub const LATEST: u64 = (1 << 48) - 365 * 24 * 3600 * UNITS_PER_S;
/// How far a stream that was never heard before may lag.
const LAG_UNITS: u64 = 60 * UNITS_PER_S;
/// Streams that are remembered. A vehicle has an autopilot, two ground stations and a camera or so.
pub const MAX_STREAMS: usize = 12;
/// Place of the flags in a frame of version 2.
const INCOMPAT: usize = 2;

/// The secret that peers share.
#[derive(Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct Key(pub [u8; 32]);

impl core::fmt::Debug for Key {
    fn fmt(&self, formatter: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        formatter.write_str("Key(secret)")
    }
}

impl Key {
    /// The hash that a signature carries for these bytes.
    fn hash(&self, covered: &[&[u8]]) -> [u8; HASH_BYTES] {
        let mut hasher = Sha256::new();
        hasher.update(self.0);
        for bytes in covered {
            hasher.update(bytes);
        }
        let [h0, h1, h2, h3, h4, h5, ..] = <[u8; 32]>::from(hasher.finalize());
        [h0, h1, h2, h3, h4, h5]
    }
}

/// Signs the frames of one link.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Signer {
    /// The secret.
    pub key: Key,
    /// Our number for the link.
    pub link: u8,
    /// When the last frame was signed; to be set to the time now before a frame, and never back.
    pub time: u64,
}

impl Signer {
    /// Moves the clock on.
    pub fn set_time(&mut self, now: u64) {
        self.time = self.time.max(now);
    }

    /// Marks a frame, whose CRC has yet to be computed, as signed.
    pub(super) fn mark(frame: &mut OutFrame) {
        if let Some(incompat) = frame.get_mut(INCOMPAT) {
            *incompat |= SIGNED;
        }
    }

    /// Puts the signature behind a marked frame with its CRC.
    pub(super) fn seal(&mut self, frame: &mut OutFrame) {
        self.time += 1;
        let [t0, t1, t2, t3, t4, t5, ..] = self.time.to_le_bytes();
        let head = [self.link, t0, t1, t2, t3, t4, t5];
        let hash = self.key.hash(&[frame, &head]);
        // There is room: the longest frame has it.
        let _ = frame.extend_from_slice(&head);
        let _ = frame.extend_from_slice(&hash);
    }
}

/// Why a frame is not believed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum SignatureError {
    /// There is no signature.
    #[error("the message is not signed")]
    Unsigned,
    /// It was made with another key, or the frame was changed.
    #[error("the signature does not fit the key")]
    Wrong,
    /// Its stream was heard at this time or later.
    #[error("the message was sent before: its time does not grow")]
    Replayed,
    /// A new stream that lags by more than a minute.
    #[error("the sender's clock is more than a minute behind")]
    Late,
    /// A time that no clock shows.
    #[error("the sender's clock shows the next century")]
    Beyond,
}

/// One sender on one link, and when it was heard last.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Stream {
    /// The sender.
    pub system: u8,
    /// Which part of it.
    pub component: u8,
    /// Its link.
    pub link: u8,
    /// The time of its last frame.
    pub time: u64,
}

/// What was heard, as far as it must not be heard again.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Streams {
    /// The newest time known.
    pub newest: u64,
    streams: heapless::Vec<Stream, MAX_STREAMS>,
}

impl Streams {
    /// Nothing heard yet, at this time.
    pub fn starting_at(newest: u64) -> Self {
        Self { newest, streams: heapless::Vec::new() }
    }

    /// Moves everything on by the time that may have passed since this was kept, so that nothing heard since is heard again.
    pub fn skip(&mut self, units: u64) {
        self.newest = self.newest.saturating_add(units);
        for stream in &mut self.streams {
            stream.time = stream.time.saturating_add(units);
        }
    }

    /// Believes a frame, or says why not. What is not believed changes nothing.
    ///
    /// When more streams come than there are places, the one that was heard the longest ago is forgotten; its frames are then
    /// held to the rule for new streams, against the newest time known.
    ///
    /// # Errors
    /// [`SignatureError`].
    pub fn accept(&mut self, key: &Key, frame: &RawFrame) -> Result<(), SignatureError> {
        let (seal, covered) = frame.seal().ok_or(SignatureError::Unsigned)?;
        // The comparison takes as long for any wrong hash.
        let expected = key.hash(&[covered]);
        let differing = expected.iter().zip(seal.hash).fold(0, |all, (one, other)| all | (one ^ other));
        if differing != 0 {
            return Err(SignatureError::Wrong);
        }
        if seal.time > LATEST {
            return Err(SignatureError::Beyond);
        }
        let known = self.streams.iter_mut().find(|stream| {
            (stream.system, stream.component, stream.link) == (frame.system, frame.component, seal.link)
        });
        match known {
            Some(stream) if seal.time <= stream.time => return Err(SignatureError::Replayed),
            Some(stream) => stream.time = seal.time,
            None if seal.time.saturating_add(LAG_UNITS) < self.newest => return Err(SignatureError::Late),
            None => {
                self.add(Stream { system: frame.system, component: frame.component, link: seal.link, time: seal.time });
            }
        }
        self.newest = self.newest.max(seal.time);
        Ok(())
    }

    fn add(&mut self, stream: Stream) {
        if self.streams.is_full()
            && let Some(oldest) =
                (0..self.streams.len()).min_by_key(|at| self.streams.get(*at).map(|stream| stream.time))
        {
            self.streams.swap_remove(oldest);
        }
        // There is a place now.
        let _ = self.streams.push(stream);
    }
}

const _: () = assert!(SIGNATURE_BYTES == 7 + HASH_BYTES);

#[cfg(test)]
mod tests {
    use super::super::{FrameDecoder, Mode, Sender};
    use super::*;

    const KEY: Key = Key([7; 32]);

    fn frame(time: u64, link: u8) -> RawFrame {
        signed_by(KEY, time, link)
    }

    fn signed_by(key: Key, time: u64, link: u8) -> RawFrame {
        let mut sender = Sender::new(1, 191);
        sender.signer = Some(Signer { key, link, time });
        decoded(&sender.heartbeat(Mode::Idle))
    }

    fn decoded(bytes: &[u8]) -> RawFrame {
        let mut decoder = FrameDecoder::default();
        bytes.iter().find_map(|byte| decoder.push(*byte)).unwrap()
    }

    #[test]
    fn times_of_a_stream_must_grow_and_each_stream_has_its_own() {
        let mut streams = Streams::default();
        assert_eq!(streams.accept(&KEY, &frame(1000, 0)), Ok(()));
        assert_eq!(streams.accept(&KEY, &frame(1000, 0)), Err(SignatureError::Replayed));
        assert_eq!(streams.accept(&KEY, &frame(999, 0)), Err(SignatureError::Replayed));
        assert_eq!(streams.accept(&KEY, &frame(500, 1)), Ok(()));
        assert_eq!(streams.accept(&KEY, &frame(1001, 0)), Ok(()));
    }

    #[test]
    fn a_new_stream_may_lag_by_a_minute() {
        let mut streams = Streams::default();
        let now = 10 * LAG_UNITS;
        assert_eq!(streams.accept(&KEY, &frame(now, 0)), Ok(()));
        assert_eq!(streams.accept(&KEY, &frame(now - LAG_UNITS - 10, 1)), Err(SignatureError::Late));
        assert_eq!(streams.accept(&KEY, &frame(now - LAG_UNITS + 10, 1)), Ok(()));
    }

    #[test]
    fn a_time_that_no_clock_shows_bars_nobody() {
        let mut streams = Streams::default();
        assert_eq!(streams.accept(&KEY, &frame((1 << 48) - 2, 0)), Err(SignatureError::Beyond));
        assert_eq!(streams.accept(&KEY, &frame(1000, 1)), Ok(()));
    }

    #[test]
    fn another_key_and_a_changed_byte_are_found_out() {
        let mut streams = Streams::default();
        assert_eq!(streams.accept(&KEY, &signed_by(Key([8; 32]), 5, 0)), Err(SignatureError::Wrong));
        let unsigned = decoded(&Sender::new(1, 191).heartbeat(Mode::Idle));
        assert_eq!(streams.accept(&KEY, &unsigned), Err(SignatureError::Unsigned));
        assert_eq!(streams, Streams::default(), "what is not believed changes nothing");
    }

    #[test]
    fn what_was_kept_before_a_restart_bars_what_came_after_it() {
        let mut streams = Streams::default();
        assert_eq!(streams.accept(&KEY, &frame(1000, 0)), Ok(()));
        let kept = streams.clone();
        assert_eq!(streams.accept(&KEY, &frame(1050, 0)), Ok(()));
        let mut again = kept;
        again.skip(100);
        assert_eq!(again.accept(&KEY, &frame(1050, 0)), Err(SignatureError::Replayed));
        assert_eq!(again.accept(&KEY, &frame(1200, 0)), Ok(()));
    }

    #[test]
    fn more_streams_than_places_forget_the_oldest() {
        let mut streams = Streams::default();
        for link in 0..=MAX_STREAMS as u8 {
            assert_eq!(streams.accept(&KEY, &frame(1000 + u64::from(link), link)), Ok(()));
        }
        assert_eq!(streams.streams.len(), MAX_STREAMS);
        assert_eq!(streams.accept(&KEY, &frame(1001, 1)), Err(SignatureError::Replayed));
    }

    #[test]
    fn a_key_is_never_printed() {
        assert!(!format!("{KEY:?}").contains('7'));
    }
}
