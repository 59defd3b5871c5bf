//! How much may go out on each port: a radio behind the autopilot carries a tenth of what its line does.

use adit_protocol::mavlink::OutFrame;

use crate::time::seconds;

/// Where a frame comes from or goes to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Port {
    /// TELEM1: the autopilot, and whoever talks through it.
    Autopilot,
    /// TELEM2: a cable in somebody's hand.
    Service,
}

/// Where a frame goes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ports {
    /// To one.
    One(Port),
    /// To both.
    Both,
}

impl Ports {
    /// Whether it goes there.
    pub fn contains(self, port: Port) -> bool {
        self == Self::Both || self == Self::One(port)
    }
}

/// Bytes per second on the autopilot's port at most: what a 57,600 baud radio carries.
const RADIO_BYTES_PER_S: f32 = 5_000.0;
/// Of a line's rate; ten bits per byte.
const SHARE_PER_BIT: f32 = 0.875 / 10.0;
/// What may be ahead of it, in seconds.
const BURST_S: f32 = 0.1;

/// The budget of one port.
#[derive(Clone, Copy, Debug)]
pub(super) struct Line {
    bytes_per_s: f32,
    ahead: f32,
    at_us: u64,
}

impl Line {
    /// A line of this rate.
    pub(super) fn new(port: Port, baud: u32) -> Self {
        let line = baud as f32 * SHARE_PER_BIT;
        let bytes_per_s = if port == Port::Autopilot { line.min(RADIO_BYTES_PER_S) } else { line };
        Self { bytes_per_s, ahead: 0.0, at_us: 0 }
    }

    /// Whether there is room for what can wait.
    pub(super) fn has_room(&mut self, now_us: u64) -> bool {
        self.ahead = (self.ahead - seconds(self.at_us, now_us) * self.bytes_per_s).max(0.0);
        self.at_us = self.at_us.max(now_us);
        self.ahead < self.bytes_per_s * BURST_S
    }

    /// A frame goes out, room or not.
    pub(super) fn take(&mut self, frame: &OutFrame) {
        self.ahead += frame.len() as f32;
    }
}
