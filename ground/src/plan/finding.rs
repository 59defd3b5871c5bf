//! What a plan warns of, and what forbids the flight.

use serde::ser::SerializeStruct;
use serde::{Serialize, Serializer};

use super::bounds::Setting;
use super::{Pace, Plan, Standstill};

/// A photo is blurred by the vehicle's way during the exposure; more than this is seen.
const BLUR_PX: f64 = 1.0;
/// A period longer than the mission's by this share is worth a word; the plan reckons with it in any case.
const PERIOD_SHARE: f64 = 0.1;

/// Modes of autopilots that take no limit below a floor, in m/s: `ArduPilot` before 4.7 accepts lower ones and ignores them.
///
/// Source: `docs/link.md`, after ArduPilot 4.6.3 and 4.7 and PX4 of March 2026.
const FLOORS_MPS: [(&str, f64); 4] = [
    ("PX4's Position", 0.05),
    ("ArduPilot before 4.7 in Auto, Guided and RTL", 0.1),
    ("ArduPilot's Loiter", 0.2),
    ("PX4's Position Slow", 0.3),
];

/// One thing to mind. Serialised as its text and whether it forbids the flight.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum Finding {
    /// Not even on the axis may the vehicle move.
    #[error("no speed is allowed on the axis: {0}")]
    NoSpeed(Standstill),
    /// The photos do not fit onto the card.
    #[error("{photos} photos of flight.photo_mb need {storage_gb:.1} GB, flight.card_gb is {card_gb}")]
    Card {
        /// Photos of the flight.
        photos: u64,
        /// Space they need.
        storage_gb: f64,
        /// The card.
        card_gb: f64,
    },
    /// The battery is empty before the end.
    #[error("the flight takes {duration_s:.0} s, flight.battery_s is {battery_s}")]
    Battery {
        /// Time of the flight.
        duration_s: f64,
        /// The battery.
        battery_s: f64,
    },
    /// Part of the wall between the ends will be in no photo.
    #[error("{holes} holes per turn are predicted between the ends of the flight")]
    Holes {
        /// Their number.
        holes: usize,
    },
    /// The flight fails only if it goes badly.
    #[error(
        "at the worst place allowed (flight.offset_max_m = {offset_max_m}) and the camera's slowest answer the flight takes \
         {duration_s:.0} s and {storage_gb:.1} GB, more than a battery or a card"
    )]
    Reserve {
        /// Largest offset.
        offset_max_m: f64,
        /// Time of that flight.
        duration_s: f64,
        /// Space for its photos.
        storage_gb: f64,
    },
    /// Within the offsets allowed there are places where the vehicle must stand.
    #[error("within {offset_m:.2} m of the axis (flight.offset_max_m allows it) there is no speed: {standstill}")]
    Offset {
        /// Smallest offset of the table where it is so.
        offset_m: f64,
        /// Why.
        standstill: Standstill,
    },
    /// Shaft and camera are slower than the mission expects.
    #[error(
        "flight.image_period_s is {period_s}, but shaft and camera need {needed_s:.2} s (turn, settle, light, shutter, answer; \
         or board.shutter.min_interval_s and light); the plan reckons with that"
    )]
    Period {
        /// The mission's.
        period_s: f64,
        /// What the board's settings need.
        needed_s: f64,
    },
    /// The autopilot cannot be held to the limit.
    #[error(
        "{mode} can be held to no less than {floor_mps} m/s, and {limit_mps:.3} m/s is the limit {}: keep below it by the \
         display there", if *offset_m > 0.0 { format!("{offset_m:.2} m from the axis") } else { "even on the axis".to_owned() }
    )]
    Floor {
        /// Autopilot and mode.
        mode: &'static str,
        /// The lowest limit that it takes.
        floor_mps: f64,
        /// The limit at the offset.
        limit_mps: f64,
        /// Smallest offset of the table where the limit is lower than that.
        offset_m: f64,
    },
    /// The light is off.
    #[error("board.shutter.light_level is 0: the photos will show what other light there is in the tunnel")]
    Dark,
    /// Pixels are large somewhere.
    #[error("{percent:.1} % of the wall is shown at more than 5 mm per pixel, at worst {mm_per_px:.1} mm")]
    Coarse {
        /// Share of the wall in percent.
        percent: f64,
        /// The largest.
        mm_per_px: f64,
    },
    /// The vehicle's motion blurs the photos.
    #[error("{blur_px:.1} pixels of motion blur: {speed_mps:.2} m/s during board.shutter.exposure_s = {exposure_s}")]
    Blur {
        /// Way during the exposure, in the finest pixels.
        blur_px: f64,
        /// Planned speed.
        speed_mps: f64,
        /// Longest exposure.
        exposure_s: f64,
    },
}

impl Finding {
    /// Whether the mission cannot be flown as planned.
    pub fn forbids(&self) -> bool {
        matches!(self, Self::NoSpeed(_) | Self::Card { .. } | Self::Battery { .. })
    }
}

impl Serialize for Finding {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut finding = serializer.serialize_struct("Finding", 2)?;
        finding.serialize_field("text", &self.to_string())?;
        finding.serialize_field("forbids", &self.forbids())?;
        finding.end()
    }
}

/// Everything to mind, what forbids the flight first.
pub(super) fn findings(plan: &Plan, setting: &Setting<'_>) -> Vec<Finding> {
    let mission = setting.mission;
    let mut findings = Vec::new();
    if let (None, Some(row)) = (&plan.flight, plan.offsets.first()) {
        findings.extend(row.standstill.map(Finding::NoSpeed));
    }
    if let Some(flight) = &plan.flight {
        supplies(plan, &flight.planned, flight.slowest.as_ref(), &mut findings);
        if let Some(row) = plan.offsets.iter().find(|row| row.standstill.is_some())
            && let Some(standstill) = row.standstill
        {
            findings.push(Finding::Offset { offset_m: row.offset_m, standstill });
        }
    }
    if let Some(between) = plan.between_ends.as_ref().filter(|between| between.hole_count > 0) {
        findings.push(Finding::Holes { holes: between.hole_count });
    }
    let (period_s, needed_s) = (mission.flight.image_period_s, setting.needed_s());
    if needed_s > period_s * (1.0 + PERIOD_SHARE) {
        findings.push(Finding::Period { period_s, needed_s });
    }
    if mission.board.shutter.light_level <= 0.0 {
        findings.push(Finding::Dark);
    }
    if let Some(pixel) = &plan.pixel {
        if pixel.wall.coarse_share > 0.0 {
            let percent = pixel.wall.coarse_share * 100.0;
            findings.push(Finding::Coarse { percent, mm_per_px: pixel.wall.max_mm });
        }
        let speed_mps = plan.flight.map_or(0.0, |flight| flight.planned.speed_mps);
        let exposure_s = (f64::from(mission.board.shutter.exposure_s) * 1e6).round() / 1e6;
        let blur_px = speed_mps * exposure_s * 1000.0 / pixel.wall.min_mm;
        if blur_px > BLUR_PX {
            findings.push(Finding::Blur { blur_px, speed_mps, exposure_s });
        }
    }
    findings.extend(FLOORS_MPS.into_iter().filter_map(|(mode, floor_mps)| {
        let moves = plan.offsets.iter().filter(|row| row.flown.speed_mps > 0.0);
        let row = moves.into_iter().find(|row| row.flown.speed_mps < floor_mps)?;
        Some(Finding::Floor { mode, floor_mps, limit_mps: row.flown.speed_mps, offset_m: row.offset_m })
    }));
    findings
}

/// Cards and batteries.
fn supplies(plan: &Plan, planned: &Pace, slowest: Option<&Pace>, findings: &mut Vec<Finding>) {
    let asked = &plan.asked;
    if let Some(card_gb) = asked.card_gb.filter(|card_gb| planned.storage_gb > *card_gb) {
        findings.push(Finding::Card { photos: planned.photos, storage_gb: planned.storage_gb, card_gb });
    }
    if let Some(battery_s) = asked.battery_s.filter(|battery_s| planned.duration_s > *battery_s) {
        findings.push(Finding::Battery { duration_s: planned.duration_s, battery_s });
    }
    let too_much = |share: Option<f64>| share.is_some_and(|share| share > 1.0);
    if findings.is_empty()
        && let Some(slowest) = slowest.filter(|pace| too_much(pace.card_share) || too_much(pace.battery_share))
    {
        let offset_max_m = plan.offsets.last().map_or(0.0, |row| row.offset_m);
        let Pace { duration_s, storage_gb, .. } = *slowest;
        findings.push(Finding::Reserve { offset_max_m, duration_s, storage_gb });
    }
}
