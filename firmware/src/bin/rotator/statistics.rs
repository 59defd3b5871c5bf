//! How long things take, measured where they happen.

use core::sync::atomic::{AtomicU32, Ordering};

use adit_protocol::record::Mode;
use embassy_time::Duration;

/// Longest times of the controller's step.
pub(crate) struct Step {
    booting_us: AtomicU32,
    flying_us: AtomicU32,
}

/// The controller's step.
pub(crate) static STEP: Step = Step { booting_us: AtomicU32::new(0), flying_us: AtomicU32::new(0) };

impl Step {
    /// Notes one step. Those that compute the table are booked apart.
    pub(crate) fn note(&self, mode: Mode, took: Duration) {
        let longest = if mode == Mode::Boot { &self.booting_us } else { &self.flying_us };
        longest.fetch_max(took.as_micros() as u32, Ordering::Relaxed);
    }

    /// The longest step since the start, booting left out.
    pub(crate) fn flying_us(&self) -> u32 {
        self.flying_us.load(Ordering::Relaxed)
    }
}
