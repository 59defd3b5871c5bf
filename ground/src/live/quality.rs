//! How good the link is: what was lost, by the senders' own counts.

use std::collections::BTreeMap;
use std::time::Duration;

/// The figures are those of so many whole seconds.
const SECONDS: usize = 5;
/// More senders than a vehicle has; others are not counted.
const MOST_SENDERS: usize = 32;

#[derive(Clone, Copy, Debug, Default)]
struct Second {
    number: u64,
    heard: u32,
    lost: u32,
}

/// Counts frames.
#[derive(Clone, Debug, Default)]
pub(super) struct Quality {
    sequences: BTreeMap<(u8, u8), u8>,
    seconds: [Second; SECONDS],
}

impl Quality {
    /// A frame with this number of its sender was heard.
    pub(super) fn hear(&mut self, now: Duration, sender: (u8, u8), sequence: u8) {
        let before = self.sequences.get(&sender).copied();
        let skipped = before.map_or(0, |before| sequence.wrapping_sub(before).wrapping_sub(1));
        // A frame that was overtaken or repeated is no loss of a hundred others.
        let is_late = skipped >= 128;
        if !is_late && (before.is_some() || self.sequences.len() < MOST_SENDERS) {
            self.sequences.insert(sender, sequence);
        }
        let number = now.as_secs();
        let Some(second) = self.seconds.get_mut((number % SECONDS as u64) as usize) else { return };
        if second.number != number {
            *second = Second { number, ..Second::default() };
        }
        second.heard += 1;
        second.lost += if is_late { 0 } else { u32::from(skipped) };
    }

    /// Frames are missing here that were not lost on the link.
    pub(super) fn skip(&mut self) {
        self.sequences.clear();
    }

    /// Frames per second, and the share that was lost.
    pub(super) fn show(&self, now: Duration) -> (f64, Option<f64>) {
        // The second that is under way is not over.
        let past = now.as_secs().saturating_sub(SECONDS as u64 - 1)..now.as_secs();
        let of = |count: fn(&Second) -> u32| {
            let counts = self
                .seconds
                .iter()
                .filter(|second| past.contains(&second.number))
                .map(|second| u64::from(count(second)));
            counts.sum::<u64>() as f64
        };
        let (heard, lost) = (of(|second| second.heard), of(|second| second.lost));
        let seconds = (past.end - past.start).max(1) as f64;
        (heard / seconds, (heard > 0.0).then(|| lost / (heard + lost)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_of_four_frames_that_never_came_is_a_loss_of_a_quarter() {
        let mut quality = Quality::default();
        for count in (0_u16..400).filter(|count| count % 4 != 3) {
            let now = Duration::from_millis(u64::from(count) * 10);
            quality.hear(now, (1, 191), count as u8);
            // Another sender counts by itself.
            quality.hear(now, (1, 1), (count / 4 * 3 + count % 4) as u8);
        }
        let (rate_hz, lost) = quality.show(Duration::from_secs(4));
        assert!((rate_hz - 150.0).abs() < 3.0, "{rate_hz}");
        assert!((lost.unwrap() - 0.142).abs() < 0.01, "{lost:?}");
    }

    #[test]
    fn a_frame_that_comes_late_or_twice_is_no_loss() {
        let mut quality = Quality::default();
        for sequence in [250, 252, 251, 251, 253, 254, 255, 0] {
            quality.hear(Duration::ZERO, (1, 191), sequence);
        }
        let (_, lost) = quality.show(Duration::from_secs(1));
        assert!((lost.unwrap() - 1.0 / 9.0).abs() < 1e-9, "252 came before 251, which is counted once: {lost:?}");
    }

    #[test]
    fn silence_is_no_loss_and_strangers_take_no_memory() {
        let mut quality = Quality::default();
        for sender in 0..=255 {
            quality.hear(Duration::ZERO, (sender, 1), 0);
        }
        assert_eq!(quality.sequences.len(), MOST_SENDERS);
        assert_eq!(quality.show(Duration::from_mins(1)), (0.0, None));
    }
}
