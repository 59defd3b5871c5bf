//! What was said on a port, and whether anybody who may command has said it.

use adit_firmware::link::Port;
use adit_protocol::mavlink::{Counters, FrameDecoder, MAX_FRAME_BYTES, RawFrame};

use crate::census::count;
use crate::rig::Broken;
use crate::wire::signed_at;

/// A line that was silent for so long is given up on.
const SILENCE_US: u64 = 100_000;

/// A port's listener.
pub(crate) struct Ear {
    decoder: FrameDecoder,
    heard_us: u64,
    /// Bytes that came in, and that went out as frames.
    bytes: [usize; 2],
    /// Whoever speaks here may command, if nothing is asked of his words.
    is_open: bool,
    key: Option<[u8; 32]>,
    /// Frames of this operation that may command: how many, and those that are signed.
    count: usize,
    fresh: Vec<Vec<u8>>,
    /// Frames that have commanded.
    spent: Vec<Vec<u8>>,
    trusted: bool,
}

impl Ear {
    pub(crate) fn new(port: Port, key: Option<[u8; 32]>) -> Self {
        Self {
            decoder: FrameDecoder::default(),
            heard_us: 0,
            bytes: [0; 2],
            is_open: port == Port::Service || key.is_none(),
            key,
            count: 0,
            fresh: Vec::new(),
            spent: Vec::new(),
            trusted: false,
        }
    }

    /// Who may command here is not known any more.
    pub(crate) fn forget_key(&mut self) {
        (self.is_open, self.key) = (true, None);
    }

    /// What came in so far.
    pub(crate) fn counters(&self) -> Counters {
        self.decoder.counters()
    }

    /// Is there the beginning of a frame?
    pub(crate) fn is_waiting(&self) -> bool {
        self.decoder.pending_bytes() > 0
    }

    /// The frames that these bytes complete. No byte is lost: each is in a frame, dropped, or pending.
    pub(crate) fn hear(&mut self, now_us: u64, bytes: &[u8]) -> Result<Vec<RawFrame>, Broken> {
        let mut frames = Vec::new();
        let silent = now_us - self.heard_us >= SILENCE_US;
        if !bytes.is_empty() {
            self.heard_us = now_us;
        }
        while silent && let Some(frame) = self.decoder.resynchronise() {
            frames.push(frame);
        }
        frames.extend(bytes.iter().filter_map(|byte| self.decoder.push(*byte)));
        self.bytes[0] += bytes.len();
        self.bytes[1] += frames.iter().map(|frame| frame.wire().len()).sum::<usize>();
        let (pending, dropped) = (self.decoder.pending_bytes(), self.decoder.counters().dropped_bytes as usize);
        if self.bytes[0] != self.bytes[1] + dropped + pending || pending >= MAX_FRAME_BYTES {
            return Err(format!("{:?} bytes in and out, {dropped} dropped, {pending} pending", self.bytes));
        }
        for frame in &frames {
            let wire = frame.wire();
            let signed = self.key.is_some_and(|key| signed_at(&key, wire).is_some());
            let is_fresh = signed && !self.spent.iter().any(|spent| spent == wire);
            self.count += usize::from(self.is_open || is_fresh);
            if is_fresh {
                self.fresh.push(wire.to_vec());
            }
        }
        Ok(frames)
    }

    /// May what came in with this operation command?
    pub(crate) fn may_command(&self) -> bool {
        self.count > 0
    }

    /// The operation is over, with or without effect; was there ever one who might have had an effect?
    pub(crate) fn settle(&mut self, has_effect: bool) -> bool {
        self.trusted |= self.count > 0;
        // Of several it is not known which it was.
        if has_effect && self.count == 1 && self.fresh.len() == 1 {
            count("did: command that was signed");
            self.spent.append(&mut self.fresh);
        }
        self.fresh.clear();
        self.count = 0;
        self.trusted
    }
}
