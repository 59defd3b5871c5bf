//! Time as the controller sees it: microseconds since the board's start, handed in with every step.

/// Converts a duration parameter. NaN and negative durations count as none, very long ones as a year.
pub(crate) fn micros(duration_s: f32) -> u64 {
    // The cast saturates and takes NaN for zero.
    ((duration_s * 1e6) as u64).min(365 * 24 * 3600 * 1_000_000)
}

/// Seconds from `from_us` to `to_us`; zero if that is backwards.
pub(crate) fn seconds(from_us: u64, to_us: u64) -> f32 {
    to_us.saturating_sub(from_us) as f32 * 1e-6
}

/// Tells whether `duration_s` has passed since `from_us`.
pub(crate) fn has_passed(from_us: u64, now_us: u64, duration_s: f32) -> bool {
    now_us.saturating_sub(from_us) >= micros(duration_s)
}
