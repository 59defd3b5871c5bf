//! What the checker reports.

use serde::Serialize;

use crate::flight::Outcome;

/// Something that must not be.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Violation {
    /// A speed limit is not a number, negative, or above the mission's highest speed.
    LimitAbsurd {
        /// When.
        time_s: f64,
        /// The limit.
        limit_mps: f32,
    },
    /// A speed limit above zero stands outside a scan.
    LimitOutsideScan {
        /// When.
        time_s: f64,
        /// The limit.
        limit_mps: f32,
    },
    /// A vehicle that obeys the limit would leave a hole.
    LimitAboveBound {
        /// When.
        time_s: f64,
        /// The limit.
        limit_mps: f32,
        /// Time that one image takes.
        period_s: f64,
        /// Longest step per image at the true place.
        bound_m: f64,
    },
    /// The vehicle obeyed, yet two photos that follow each other lie farther apart than the bound allows.
    StepAboveBound {
        /// When the second was taken.
        time_s: f64,
        /// Way between them.
        way_m: f64,
        /// Longest step per image at the worse of the two places.
        bound_m: f64,
    },
    /// The numbers of captures do not run on.
    CaptureNumber {
        /// Number found.
        found: u32,
        /// Number expected.
        expected: u32,
    },
    /// A photo that was asked for has no tag.
    PhotoWithoutTag {
        /// Place on the card, from 0.
        photo: usize,
        /// When it was taken.
        time_s: f64,
    },
    /// A capture counts as confirmed, but there is no photo.
    ConfirmedWithoutPhoto {
        /// Its number.
        capture: u32,
    },
    /// The log holds damage that no power loss explains.
    LogDamaged {
        /// Number of damaged places.
        places: usize,
    },
}

/// Figures of a flight.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Figures {
    /// How it ended.
    pub outcome: Outcome,
    /// How long the board ran.
    pub duration_s: f64,
    /// How far the vehicle came.
    pub distance_m: f64,
    /// Times that the shutter contact was closed.
    pub presses: usize,
    /// Photos on the card.
    pub photos: usize,
    /// Those that nobody asked for.
    pub surplus: usize,
    /// Presses that brought no photo.
    pub missed: usize,
    /// Tags in the log.
    pub tags: usize,
    /// Those that are confirmed.
    pub confirmed: usize,
    /// Root mean square of the board's error about where it is in the section, while scanning.
    pub centring_error_mm: f64,
    /// Root mean square of the distance from the axis, while scanning.
    pub offset_mm: f64,
    /// Largest share of the bound (at the true place) that the limit reached.
    pub limit_use: f64,
    /// Longest way between two photos that follow each other, as a share of the bound at the worse of their places, where
    /// the vehicle obeyed the limit.
    pub longest_step: f64,
    /// Root mean square of the tags' error in time.
    pub tag_time_error_ms: f64,
    /// Root mean square of the tags' error in the shaft's angle.
    pub tag_shaft_error_deg: f64,
    /// Share of the wall seen at least once, in per cent, a turn and a photo's reach away from the ends.
    pub seen_once_percent: f64,
    /// Share of it seen at least twice.
    pub seen_twice_percent: f64,
}

/// What the checker found.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Report {
    /// Everything that must not be.
    pub violations: Vec<Violation>,
    /// Figures.
    pub figures: Figures,
}
