//! How fast the vehicle may go.
//!
//! Between two good photos it may advance by `margin * step`, where `step` is the table's bound at the worst place since
//! the last one. Two rules, the lower wins:
//! - speed: `margin * step / (period + answer + latency)`, with the longest of the last measured periods and answers, the
//!   answer being the time from an exposure to the camera's word that the photo is good;
//! - way left: what is left of `margin * step` since the last good photo, over the time until the next one should be known
//!   to be good, plus the latency. It brakes the vehicle when a photo is late or missed, down to standing.
//!
//! So even a photo that is found missing late, and then repeated, is no farther from the one before than the bound says.
//!
//! A gap (a missed photo that has neither been repeated nor been passed by a whole turn of good ones) halves both. Where
//! the position is unknown, the step is that of the worst place allowed.

use adit_protocol::parameters::SpeedParameters;

use crate::io::CentringStatus;
use crate::table::StepTable;
use crate::time::seconds;

/// As many measured periods are remembered; the longest counts.
const PERIODS: usize = 4;
/// Shortest time over which a way is turned into a speed.
const SHORTEST_S: f32 = 0.02;

/// What the limit is made of.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Limit {
    /// The limit.
    pub(crate) speed_mps: f32,
    /// The bound's step at the worst place since the last photo.
    pub(crate) step_m: f32,
    /// Time per image that was reckoned with.
    pub(crate) period_s: f32,
}

/// A photo, or the scan's start, and the way flown since.
#[derive(Clone, Copy, Debug)]
struct Anchor {
    time_us: u64,
    travelled_m: f32,
    is_photo: bool,
}

/// A missed photo.
#[derive(Clone, Copy, Debug)]
struct Gap {
    index: u32,
    /// Good photos until it is passed.
    to_pass: u16,
}

/// Keeps the books of way, time and gaps.
#[derive(Clone, Debug)]
pub(crate) struct SpeedLimiter {
    parameters: SpeedParameters,
    images_per_turn: u16,
    periods_s: heapless::HistoryBuf<f32, PERIODS>,
    answers_s: heapless::HistoryBuf<f32, PERIODS>,
    /// The last photo that is known to be good; the scan's start before the first.
    good: Option<Anchor>,
    /// A photo whose fate is open.
    open: Option<Anchor>,
    gap: Option<Gap>,
    /// The smallest step since the last photo.
    step_m: Option<f32>,
    last_us: u64,
    limit: Limit,
}

impl SpeedLimiter {
    pub(crate) fn new(parameters: SpeedParameters, images_per_turn: u16) -> Self {
        Self {
            parameters,
            images_per_turn,
            periods_s: heapless::HistoryBuf::new(),
            answers_s: heapless::HistoryBuf::new(),
            good: None,
            open: None,
            gap: None,
            step_m: None,
            last_us: 0,
            limit: Limit::default(),
        }
    }

    /// Forgets an earlier scan. The way counts from here, so that a camera that never takes a photo stops the vehicle.
    pub(crate) fn begin(&mut self, now_us: u64) {
        *self = Self::new(self.parameters, self.images_per_turn);
        self.last_us = now_us;
        self.good = Some(Anchor { time_us: now_us, travelled_m: 0.0, is_photo: false });
    }

    /// Whether a gap halves the limit.
    pub(crate) fn gap_is_open(&self) -> bool {
        self.gap.is_some()
    }

    /// A photo was exposed; its fate is open.
    pub(crate) fn photo_exposed(&mut self, time_us: u64) {
        self.open = Some(Anchor { time_us, travelled_m: 0.0, is_photo: true });
        self.step_m = None;
    }

    /// The open photo is good, as is known now.
    pub(crate) fn photo_good(&mut self, now_us: u64, index: u32) {
        let Some(open) = self.open.take() else { return };
        self.answers_s.write(seconds(open.time_us, now_us));
        if let Some(good) = self.good.filter(|anchor| anchor.is_photo) {
            self.periods_s.write(seconds(good.time_us, open.time_us));
        }
        self.good = Some(open);
        self.gap = self.gap.and_then(|gap| {
            let to_pass = gap.to_pass.saturating_sub(1);
            (gap.index != index && to_pass > 0).then_some(Gap { to_pass, ..gap })
        });
    }

    /// The open photo is missing.
    pub(crate) fn photo_missed(&mut self, index: u32) {
        self.open = None;
        self.gap = Some(Gap { index, to_pass: self.images_per_turn });
    }

    /// Returns the limit at this moment.
    pub(crate) fn update(
        &mut self,
        now_us: u64,
        table: &StepTable,
        position: Option<&CentringStatus>,
        speed_mps: Option<f32>,
    ) -> Limit {
        let elapsed_s = seconds(self.last_us, now_us);
        self.last_us = self.last_us.max(now_us);
        // Without a measured speed, what was allowed is what was flown.
        let way_m = speed_mps.unwrap_or(self.limit.speed_mps).max(0.0) * elapsed_s;
        for anchor in [&mut self.good, &mut self.open].into_iter().flatten() {
            anchor.travelled_m += way_m;
        }
        let here_m = position.map_or(table.worst_m(), |status| table.step_m(status.offset_m, status.sigma_m));
        let step_m = self.step_m.map_or(here_m, |before_m| before_m.min(here_m));
        self.step_m = Some(step_m);
        let longest = |measured_s: &heapless::HistoryBuf<f32, PERIODS>| measured_s.iter().copied().reduce(f32::max);
        let period_s = longest(&self.periods_s).unwrap_or(self.parameters.image_period_s).max(SHORTEST_S);
        let known_s = period_s + longest(&self.answers_s).unwrap_or_default();
        let speed_mps = self.speed_mps(now_us, step_m, known_s);
        self.limit = Limit { speed_mps, step_m, period_s };
        self.limit
    }

    /// `known_s`: time from one exposure to the word that the next one is good.
    fn speed_mps(&self, now_us: u64, step_m: f32, known_s: f32) -> f32 {
        let parameters = &self.parameters;
        let latency_s = parameters.latency_s.max(0.0);
        let share = if self.gap.is_some() { parameters.margin * 0.5 } else { parameters.margin };
        let way_m = step_m * share;
        let steady_mps = way_m / (known_s + latency_s);
        let left_mps = self.good.map_or(steady_mps, |anchor| {
            let due_s = (known_s - seconds(anchor.time_us, now_us)).max(0.0);
            (way_m - anchor.travelled_m) / (due_s + latency_s).max(SHORTEST_S)
        });
        let bounds_mps = [steady_mps, left_mps, parameters.max_speed_mps];
        // NaN compares false and becomes zero, as does everything negative.
        if bounds_mps.iter().all(|bound_mps| *bound_mps > 0.0) {
            bounds_mps.into_iter().reduce(f32::min).unwrap_or_default()
        } else {
            0.0
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const STEP_M: f32 = 0.2;

    fn limiter() -> SpeedLimiter {
        let parameters =
            SpeedParameters { latency_s: 0.5, margin: 0.9, image_period_s: 1.5, ..SpeedParameters::default() };
        SpeedLimiter::new(parameters, 4)
    }

    /// The limit at `now_s` with the vehicle at `speed_mps`.
    fn at(limiter: &mut SpeedLimiter, now_s: f32, speed_mps: f32) -> f32 {
        let table = StepTable::uniform(0.5, STEP_M);
        limiter.update((now_s * 1e6) as u64, &table, None, Some(speed_mps)).speed_mps
    }

    fn photo(limiter: &mut SpeedLimiter, time_s: f32, index: u32) {
        let time_us = (time_s * 1e6) as u64;
        limiter.photo_exposed(time_us);
        limiter.photo_good(time_us, index);
    }

    #[test]
    fn before_the_first_photo_the_expected_period_counts() {
        assert!((at(&mut limiter(), 0.0, 0.0) - 0.9 * STEP_M / 2.0).abs() < 1e-6);
    }

    #[test]
    fn without_a_first_photo_the_vehicle_stops_within_one_step() {
        let mut limiter = limiter();
        limiter.begin(0);
        let (mut speed_mps, mut way_m) = (0.0, 0.0);
        for tick in 0..600 {
            speed_mps = at(&mut limiter, tick as f32 * 0.05, speed_mps);
            way_m += speed_mps * 0.05;
        }
        assert!(way_m <= 0.9 * STEP_M * 1.05, "{way_m} m without a photo");
        assert!(speed_mps < 0.005, "still {speed_mps} m/s");
    }

    #[test]
    fn the_longest_measured_period_counts() {
        let mut limiter = limiter();
        for (index, time_s) in [0.0, 1.0, 3.0, 4.0].into_iter().enumerate() {
            photo(&mut limiter, time_s, index as u32);
        }
        assert!((at(&mut limiter, 4.0, 0.0) - 0.9 * STEP_M / 2.5).abs() < 1e-6);
    }

    #[test]
    fn a_camera_that_answers_late_is_flown_slower() {
        let mut limiter = limiter();
        for index in 0..3_u32 {
            let time_us = u64::from(index) * 1_000_000;
            limiter.photo_exposed(time_us);
            at(&mut limiter, index as f32 + 0.5, 0.0);
            limiter.photo_good(time_us + 500_000, index);
        }
        assert!((at(&mut limiter, 2.5, 0.0) - 0.9 * STEP_M / 2.0).abs() < 1e-6);
    }

    #[test]
    fn a_late_photo_brakes_the_vehicle_to_a_stop_within_the_step() {
        let mut limiter = limiter();
        photo(&mut limiter, 0.0, 0);
        let (mut way_m, mut speed_mps) = (0.0, 0.0);
        for tick in 0..4000 {
            speed_mps = at(&mut limiter, tick as f32 * 0.005, speed_mps);
            way_m += speed_mps * 0.005;
        }
        assert!(speed_mps < 1e-3, "still at {speed_mps} m/s after 20 s without a photo");
        assert!(way_m <= 0.9 * STEP_M * 1.001, "flew {way_m} m");
    }

    #[test]
    fn a_missed_photo_halves_the_limit_until_it_is_repeated() {
        let mut limiter = limiter();
        photo(&mut limiter, 0.0, 0);
        photo(&mut limiter, 1.5, 1);
        let before = at(&mut limiter, 1.5, 0.0);
        limiter.photo_exposed(3_000_000);
        limiter.photo_missed(2);
        assert!(limiter.gap_is_open());
        assert!(at(&mut limiter, 3.0, 0.0) <= before * 0.5001);
        photo(&mut limiter, 3.5, 2);
        assert!(!limiter.gap_is_open());
    }

    #[test]
    fn a_gap_that_is_not_repeated_is_passed_after_a_whole_turn() {
        let mut limiter = limiter();
        limiter.photo_exposed(0);
        limiter.photo_missed(0);
        for index in 1..4 {
            photo(&mut limiter, index as f32, index);
            assert!(limiter.gap_is_open(), "after photo {index}");
        }
        photo(&mut limiter, 4.0, 4);
        assert!(!limiter.gap_is_open());
    }

    #[test]
    fn whatever_is_no_number_gives_no_speed() {
        let parameters = SpeedParameters { margin: f32::NAN, ..SpeedParameters::default() };
        let mut limiter = SpeedLimiter::new(parameters, 10);
        assert_eq!(at(&mut limiter, 0.0, f32::NAN), 0.0);
        let table = StepTable::uniform(0.5, f32::NAN);
        assert_eq!(super::tests::limiter().update(0, &table, None, None).speed_mps, 0.0);
    }
}
