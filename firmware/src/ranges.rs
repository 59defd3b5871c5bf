//! Is a range sensor to be believed? One monitor per sensor turns samples into usable ranges and named faults.
//!
//! Model: a sensor is faulty while it is silent, frozen, stuck at zero, jumping or talking nonsense, and until a run of
//! good samples has cleared it. "Too close", "too far" and "cannot measure" are no faults and no ranges. A run of samples
//! that decode from raw zero is a fault all the same: a bus that is dead reads zeros with a valid CRC.

use adit_protocol::parameters::{RangeFamily, RangeParameters};
use adit_protocol::record::RangeFault;

use crate::io::{RangeReading, RangeSample};
use crate::time::has_passed;

/// What changed with a sensor in one step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum RangeChange {
    /// It became faulty, or faulty in another way.
    Faulty(RangeFault),
    /// It recovered.
    Recovered,
}

/// Watches one range sensor.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct RangeMonitor {
    started: bool,
    count: u32,
    sample_us: u64,
    /// The last measured value, usable or not, and since when it has been exactly that.
    last_m: Option<f32>,
    unmoved_since_us: u64,
    zeros: u16,
    good: u16,
    fault: Option<RangeFault>,
    range_m: Option<f32>,
    /// Whether this step brought a sample.
    fresh: bool,
}

impl RangeMonitor {
    /// The range, if there is one to be believed.
    pub(crate) fn range_m(&self) -> Option<f32> {
        if self.fault.is_none() { self.range_m } else { None }
    }

    /// Whether this step brought a new sample.
    pub(crate) fn is_fresh(&self) -> bool {
        self.fresh
    }

    /// Whether the sensor is faulty.
    pub(crate) fn is_faulty(&self) -> bool {
        self.fault.is_some()
    }

    /// Takes this step's sample.
    pub(crate) fn update(
        &mut self,
        now_us: u64,
        sample: &RangeSample,
        parameters: &RangeParameters,
    ) -> Option<RangeChange> {
        if !self.started {
            *self = Self { started: true, count: sample.count, sample_us: now_us, ..Self::default() };
            self.unmoved_since_us = now_us;
        }
        self.fresh = sample.count != self.count;
        if self.fresh {
            self.count = sample.count;
            self.sample_us = now_us;
        }
        let found = if sample.reading == RangeReading::Disconnected && self.fresh
            || has_passed(self.sample_us, now_us, parameters.stale_s)
        {
            self.range_m = None;
            Some(RangeFault::Silent)
        } else if self.fresh {
            self.judge(now_us, sample.reading, parameters)
        } else {
            None
        };
        self.conclude(found, parameters)
    }

    /// Looks at a new reading; returns what is wrong with it.
    fn judge(&mut self, now_us: u64, reading: RangeReading, parameters: &RangeParameters) -> Option<RangeFault> {
        let zero = decodes_from_zero(reading, parameters.family);
        self.zeros = if zero { self.zeros.saturating_add(1) } else { 0 };
        self.range_m = None;
        if zero && self.zeros >= parameters.zero_run.max(1) {
            return Some(RangeFault::Zeros);
        }
        let RangeReading::Measured(value_m) = reading else { return None };
        if !value_m.is_finite() || value_m < 0.0 {
            return Some(RangeFault::Implausible);
        }
        let before_m = self.last_m.replace(value_m);
        let moved_m = before_m.map(|before_m| (value_m - before_m).abs());
        if moved_m != Some(0.0) {
            self.unmoved_since_us = now_us;
        }
        if moved_m.is_some_and(|moved_m| moved_m > parameters.jump_m) {
            return Some(RangeFault::Jumping);
        }
        if parameters.frozen_s > 0.0 && has_passed(self.unmoved_since_us, now_us, parameters.frozen_s) {
            return Some(RangeFault::Frozen);
        }
        if value_m >= parameters.min_m && value_m <= parameters.max_m {
            self.range_m = Some(value_m);
        }
        None
    }

    fn conclude(&mut self, found: Option<RangeFault>, parameters: &RangeParameters) -> Option<RangeChange> {
        if let Some(fault) = found {
            self.good = 0;
            return (self.fault.replace(fault) != Some(fault)).then_some(RangeChange::Faulty(fault));
        }
        // Zeros before the run is long enough are not good samples either.
        if !self.fresh || self.fault.is_none() || self.zeros > 0 {
            return None;
        }
        self.good = self.good.saturating_add(1);
        if self.good < parameters.good_run {
            return None;
        }
        self.fault = None;
        self.good = 0;
        Some(RangeChange::Recovered)
    }
}

/// Tells whether the raw value was zero.
fn decodes_from_zero(reading: RangeReading, family: RangeFamily) -> bool {
    match reading {
        RangeReading::Measured(value_m) => value_m == 0.0,
        RangeReading::TooClose => family == RangeFamily::Evo,
        RangeReading::CannotMeasure => family == RangeFamily::One,
        RangeReading::TooFar => family == RangeFamily::OneHub,
        RangeReading::Disconnected => false,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Feeds readings at 100 Hz and returns the monitor and all changes.
    fn feed(readings: impl IntoIterator<Item = RangeReading>) -> (RangeMonitor, heapless::Vec<RangeChange, 16>) {
        let mut monitor = RangeMonitor::default();
        let mut changes = heapless::Vec::new();
        let parameters = RangeParameters::default();
        for (index, reading) in readings.into_iter().enumerate() {
            let sample = RangeSample { reading, count: index as u32 + 1 };
            if let Some(change) = monitor.update(index as u64 * 10_000, &sample, &parameters) {
                changes.push(change).unwrap();
            }
        }
        (monitor, changes)
    }

    /// A reading of about 3 m that moves by a millimetre.
    fn lively(index: u32) -> RangeReading {
        RangeReading::Measured(3.0 + (index % 2) as f32 * 0.001)
    }

    #[test]
    fn a_living_sensor_is_believed() {
        let (monitor, changes) = feed((0..500).map(lively));
        assert!(monitor.range_m().is_some_and(|range_m| (range_m - 3.0).abs() < 0.01));
        assert!(changes.is_empty());
    }

    #[test]
    fn what_cannot_be_measured_is_no_range_and_no_fault() {
        for reading in [RangeReading::TooFar, RangeReading::CannotMeasure] {
            let (monitor, changes) = feed((0..500).map(|_| reading));
            assert_eq!(monitor.range_m(), None);
            assert!(changes.is_empty(), "{reading:?}: {changes:?}");
        }
    }

    #[test]
    fn a_run_of_zeros_is_a_fault() {
        let (monitor, changes) = feed((0..60).map(|_| RangeReading::TooClose));
        assert!(monitor.is_faulty());
        assert_eq!(changes[..], [RangeChange::Faulty(RangeFault::Zeros)]);
        let (_, changes) = feed((0..20).map(|_| RangeReading::TooClose));
        assert!(changes.is_empty(), "a hand before the sensor is no fault");
    }

    #[test]
    fn a_frozen_value_is_a_fault_and_recovers_when_it_moves() {
        let frozen = (0..300).map(|_| RangeReading::Measured(2.5));
        let (monitor, changes) = feed(frozen.clone());
        assert!(monitor.is_faulty() && monitor.range_m().is_none());
        assert_eq!(changes[..], [RangeChange::Faulty(RangeFault::Frozen)]);
        let (monitor, changes) = feed(frozen.chain((0..50).map(lively)));
        assert!(monitor.range_m().is_some());
        assert_eq!(changes[..], [RangeChange::Faulty(RangeFault::Frozen), RangeChange::Recovered]);
    }

    #[test]
    fn a_jump_is_a_fault_until_a_run_of_good_samples() {
        let jumping = (0..50).map(|i| RangeReading::Measured(if i % 5 == 4 { 9.0 } else { 3.0 + i as f32 * 0.001 }));
        let (monitor, changes) = feed(jumping.chain((0..5).map(lively)));
        assert!(monitor.is_faulty());
        assert_eq!(changes[..], [RangeChange::Faulty(RangeFault::Jumping)]);
    }

    #[test]
    fn silence_is_a_fault_after_a_while_and_disconnection_at_once() {
        let mut monitor = RangeMonitor::default();
        let parameters = RangeParameters::default();
        let sample = RangeSample { reading: RangeReading::Measured(3.0), count: 1 };
        assert_eq!(monitor.update(0, &sample, &parameters), None);
        assert_eq!(monitor.update(400_000, &sample, &parameters), None);
        let silent = Some(RangeChange::Faulty(RangeFault::Silent));
        assert_eq!(monitor.update(500_000, &sample, &parameters), silent);
        let (_, changes) = feed([lively(0), lively(1), RangeReading::Disconnected]);
        assert_eq!(changes.first().copied(), silent);
    }

    #[test]
    fn nonsense_is_a_fault() {
        for value_m in [f32::NAN, f32::INFINITY, -1.0] {
            let (monitor, changes) = feed([lively(0), RangeReading::Measured(value_m)]);
            assert_eq!(changes[..], [RangeChange::Faulty(RangeFault::Implausible)]);
            assert_eq!(monitor.range_m(), None);
        }
    }
}
