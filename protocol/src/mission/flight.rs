//! The table `[flight]`.

use super::quantity::{Quantity, Unit};
use super::reader::Section;
use crate::parameters::{SpeedBound, SpeedParameters};

/// How the flight shall go. Defaults, where a key may be left out, are those of [`SpeedParameters`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FlightPlan {
    /// Length of the tunnel to survey, `length_m`.
    pub length_m: f64,
    /// The bound on the step per image, `speed_bound = "paper" | "one-view" | "two-views"`.
    pub speed_bound: SpeedBound,
    /// Share of the bound that is flown, `speed_margin`.
    pub speed_margin: f64,
    /// Never faster than this, `max_speed_mps`.
    pub max_speed_mps: f64,
    /// Time from a new limit to the vehicle flying it, `latency_s`.
    pub latency_s: f64,
    /// Largest allowed distance from the axis, sideways and vertically, `offset_max_m`; default 0.5 m, in small tunnels a
    /// third of the way from the axis to the nearest wall.
    pub offset_max_m: f64,
    /// Expected time between images, `image_period_s`.
    pub image_period_s: f64,
    /// Expected time from an exposure until a wired camera says that the photo is good, `answer_s`; default 0.4, as long as
    /// action cameras are busy with one. The plan reckons with it; the board measures it.
    pub answer_s: f64,
    /// Flying time of one battery, `battery_s`; without it the plan counts no batteries.
    pub battery_s: Option<f64>,
    /// Size of the camera's card, `card_gb`; without it the plan counts no cards.
    pub card_gb: Option<f64>,
    /// Size of one photo, `photo_mb`; default 5, an action camera's 12 MP photo.
    pub photo_mb: f64,
}

impl FlightPlan {
    /// The board's share of it.
    pub(super) fn speed_parameters(&self) -> SpeedParameters {
        SpeedParameters {
            bound: self.speed_bound,
            margin: self.speed_margin as f32,
            latency_s: self.latency_s as f32,
            max_speed_mps: self.max_speed_mps as f32,
            offset_max_m: self.offset_max_m as f32,
            image_period_s: self.image_period_s as f32,
        }
    }
}

/// Reads the table. `clearance_m`: from the axis to the nearest wall, where the tunnel is known.
pub(super) fn read(mut section: Section<'_>, clearance_m: Option<f64>) -> Option<FlightPlan> {
    let default = SpeedParameters::default();
    // Widened by way of decimal digits, so that 0.9 stays 0.9.
    let wide = |value: f32| (f64::from(value) * 1e6).round() / 1e6;
    let seconds = |low, high| Quantity::new(Unit::Second, low, high);
    let length_m = section.number("length_m", Quantity::new(Unit::Metre, 0.1, 100_000.0));
    let bounds = [("paper", SpeedBound::Paper), ("one-view", SpeedBound::OneView), ("two-views", SpeedBound::TwoViews)];
    let plan = FlightPlan {
        length_m: length_m.unwrap_or_default(),
        speed_bound: section.choice_or("speed_bound", &bounds, default.bound),
        speed_margin: section.number_or("speed_margin", Quantity::new(Unit::Ratio, 0.1, 1.0), wide(default.margin)),
        max_speed_mps: section.number_or(
            "max_speed_mps",
            Quantity::new(Unit::MetrePerSecond, 0.01, 5.0),
            wide(default.max_speed_mps),
        ),
        latency_s: section.number_or("latency_s", seconds(0.0, 10.0), wide(default.latency_s)),
        offset_max_m: section.number_or(
            "offset_max_m",
            Quantity::new(Unit::Metre, 0.0, 10.0),
            clearance_m.map_or(f64::INFINITY, |clearance_m| clearance_m / 3.0).min(wide(default.offset_max_m)),
        ),
        image_period_s: section.number_or("image_period_s", seconds(0.05, 60.0), wide(default.image_period_s)),
        answer_s: section.number_or("answer_s", seconds(0.0, 60.0), 0.4),
        battery_s: section.maybe_number("battery_s", seconds(30.0, 36_000.0)),
        card_gb: section.maybe_number("card_gb", Quantity::new(Unit::Plain, 0.1, 10_000.0)),
        photo_mb: section.number_or("photo_mb", Quantity::new(Unit::Plain, 0.05, 500.0), 5.0),
    };
    if let Some(clearance_m) = clearance_m.filter(|clearance_m| plan.offset_max_m >= *clearance_m) {
        let expected = format!("less than the {clearance_m:.3} m from the axis to the nearest wall");
        section.complain("offset_max_m", plan.offset_max_m.to_string(), expected);
    }
    section.finish();
    length_m.map(|_| plan)
}
