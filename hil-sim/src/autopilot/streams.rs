//! What is said again and again, and how often.

/// One of them.
#[derive(Clone, Copy, Debug)]
pub(super) struct Stream {
    message: u32,
    /// As it leaves the factory.
    usual_s: f64,
    /// `None` is off.
    period_s: Option<f64>,
    due_s: f64,
}

impl Stream {
    const fn new(message: u32, usual_s: f64) -> Self {
        Self { message, usual_s, period_s: Some(usual_s), due_s: f64::NEG_INFINITY }
    }

    /// Whether it is time; then the next time is counted from now.
    pub(super) fn is_due(&mut self, now_s: f64) -> bool {
        let Some(period_s) = self.period_s else { return false };
        // Sums of steps are not exact.
        let due = now_s >= self.due_s - 1e-6;
        if due {
            self.due_s = if now_s > self.due_s + period_s { now_s } else { self.due_s } + period_s;
        }
        due
    }
}

/// All of them.
#[derive(Clone, Copy, Debug)]
pub(super) struct Streams {
    pub(super) heartbeat: Stream,
    pub(super) attitude: Stream,
    pub(super) place: Stream,
    pub(super) head_up: Stream,
}

impl Default for Streams {
    fn default() -> Self {
        Self {
            heartbeat: Stream::new(0, 1.0),
            attitude: Stream::new(30, 0.02),
            place: Stream::new(32, 0.05),
            head_up: Stream::new(74, 0.2),
        }
    }
}

impl Streams {
    /// `SET_MESSAGE_INTERVAL`: microseconds; 0 is the usual, below that is off. Returns whether there is such a stream.
    pub(super) fn set_interval(&mut self, message: f32, interval_us: f32) -> bool {
        let all = [&mut self.heartbeat, &mut self.attitude, &mut self.place, &mut self.head_up];
        let Some(stream) = all.into_iter().find(|stream| stream.message as f32 == message) else { return false };
        stream.period_s = match interval_us {
            interval_us if interval_us < 0.0 => None,
            0.0 => Some(stream.usual_s),
            _ => Some(f64::from(interval_us) * 1e-6),
        };
        stream.due_s = f64::NEG_INFINITY;
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_stream_comes_as_often_as_it_is_asked_for() {
        let mut streams = Streams::default();
        let count = |streams: &mut Streams, from: u32| {
            (from..from + 2000).filter(|step| streams.attitude.is_due(f64::from(*step) * 0.005)).count()
        };
        assert_eq!(count(&mut streams, 0), 500);
        assert!(streams.set_interval(30.0, 100_000.0) && !streams.set_interval(31.0, 100_000.0));
        assert_eq!(count(&mut streams, 2000), 100);
        assert!(streams.set_interval(30.0, -1.0));
        assert_eq!(count(&mut streams, 4000), 0);
        assert!(streams.set_interval(30.0, 0.0));
        assert_eq!(count(&mut streams, 6000), 500);
    }
}
