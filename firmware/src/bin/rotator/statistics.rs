//! How long things take, measured where they happen.

use core::sync::atomic::{AtomicU32, Ordering};

use embassy_time::Duration;

/// The longest time of something that is done again and again.
pub(crate) struct Longest {
    us: AtomicU32,
}

/// The controller's step.
pub(crate) static STEP: Longest = Longest { us: AtomicU32::new(0) };

impl Longest {
    /// Notes one time.
    pub(crate) fn note(&self, took: Duration) {
        self.us.fetch_max(took.as_micros() as u32, Ordering::Relaxed);
    }

    /// The longest so far.
    pub(crate) fn us(&self) -> u32 {
        self.us.load(Ordering::Relaxed)
    }
}
