//! Before the flight: how fast, how many photos, how long, and what they will show.
//!
//! Everything follows from the mission file: the profile, the real camera's footprint, the bound the mission chose. The
//! speeds are the board's steady ones; what the board only knows in flight (its position's uncertainty, the camera's answer,
//! missed photos) makes it slower, which [`FlightFigures::slowest`] allows for.
//! # Limits
//! A level flight on a straight axis; nothing between camera and wall.

mod bounds;
mod finding;
mod flight;
mod output;
mod predict;
mod table;
#[cfg(test)]
mod tests;

use adit_geometry::coverage::{CoverageError, FootprintError};
use adit_geometry::profile::ProfileError;
use adit_geometry::speed::SpeedError;
use adit_protocol::mission::Mission;
use adit_protocol::parameters::SpeedBound;
use serde::Serialize;
use serde_json::Value;

pub use bounds::{Bound, OffsetRow, Standstill};
pub use finding::Finding;
pub use flight::{FlightFigures, Pace};
pub use output::{OutputError, write};
pub use predict::{PixelSize, PixelSizes};

use crate::texture::{Coverage, Rgba8, profile_json};
use bounds::Setting;
use predict::Flown;

/// Why a mission cannot be planned.
#[derive(Debug, thiserror::Error)]
pub enum PlanError {
    /// The section cannot be built.
    #[error("[tunnel]: {0}")]
    Profile(#[from] ProfileError),
    /// The camera does not see where the shaft points it.
    #[error("[camera] and [rig]: {0}")]
    Footprint(#[from] FootprintError),
    /// No coverage can be computed.
    #[error("[rig]: {0}")]
    Coverage(#[from] CoverageError),
    /// No speed can be computed.
    #[error("[flight] and [camera]: {0}")]
    Speed(#[from] SpeedError),
}

/// What the mission asks for, in SI.
#[derive(Clone, Debug, Serialize)]
pub struct Asked {
    /// The section, with the keys of `[tunnel]`.
    pub profile: Value,
    /// Once around the wall.
    pub perimeter_m: f64,
    /// From the axis to the nearest wall: the paper's radius.
    pub clearance_m: f64,
    /// Photos per turn of the shaft.
    pub images_per_turn: u16,
    /// The camera's angle of view around the section and along the axis, as the paper's law takes it.
    pub view_rad: [f64; 2],
    /// Length of the survey.
    pub length_m: f64,
    /// The bound on the step.
    pub speed_bound: SpeedBound,
    /// Share of it that is flown.
    pub speed_margin: f64,
    /// Never faster.
    pub max_speed_mps: f64,
    /// From a new limit to the vehicle flying it.
    pub latency_s: f64,
    /// Time between images.
    pub image_period_s: f64,
    /// Flying time of a battery.
    pub battery_s: Option<f64>,
    /// Size of a card.
    pub card_gb: Option<f64>,
    /// Size of a photo.
    pub photo_mb: f64,
}

/// The plan of a mission; its `Display` is the table for people.
#[derive(Clone, Debug, Serialize)]
pub struct Plan {
    /// Version of this layout.
    pub format: u32,
    /// Program and version.
    pub program: String,
    /// What was asked for.
    pub asked: Asked,
    /// The bounds over the offset from the axis.
    pub offsets: Vec<OffsetRow>,
    /// The flight on the axis; `None` where it may not move.
    pub flight: Option<FlightFigures>,
    /// Size of a pixel on the wall.
    pub pixel: Option<PixelSizes>,
    /// Coverage of one turn's advance in the middle of the flight.
    pub between_ends: Option<Coverage>,
    /// Coverage of the whole flight, both ends included. Of flights above 30 m one of that length; the middle repeats.
    pub coverage: Option<Coverage>,
    /// What to mind, what forbids the flight first.
    pub findings: Vec<Finding>,
    /// The predicted number of photos, columns around from the crown, rows along the axis.
    #[serde(skip)]
    pub picture: Option<Rgba8>,
}

impl Plan {
    /// Whether the mission can be flown as planned.
    pub fn is_flyable(&self) -> bool {
        !self.findings.iter().any(Finding::forbids)
    }
}

/// Plans a mission.
///
/// # Errors
/// [`PlanError`] if the camera cannot see the wall, or a figure is out of range.
pub fn plan(mission: &Mission) -> Result<Plan, PlanError> {
    let setting = Setting::new(mission)?;
    let offsets = setting.rows()?;
    let flight = flight::figures(mission, &offsets);
    let scene = setting.scene(predict::axis())?;
    let lever_forward_m = mission.survey.rig.lever_forward_m;
    let (mut pixel, mut between_ends, mut coverage, mut picture) = (None, None, None, None);
    if let Some(flight) = &flight {
        let step_m = flight.planned.step_m;
        let length_m = predict::counted_m(mission.flight.length_m);
        let photos = Some(flight::photos(length_m, step_m).min(u64::from(u32::MAX)) as u32);
        let whole = predict::coverage(&setting.profile, &scene, Flown { step_m, photos, lever_forward_m }, length_m);
        let turn_m = step_m * f64::from(mission.survey.rig.images_per_turn);
        let endless = Flown { step_m, photos: None, lever_forward_m };
        between_ends = Some(predict::coverage(&setting.profile, &scene, endless, turn_m).coverage);
        pixel = predict::pixel_sizes(&setting, &scene, step_m);
        (coverage, picture) = (Some(whole.coverage), Some(whole.picture));
    }
    let mut plan = Plan {
        format: 1,
        program: format!("adit {}", env!("CARGO_PKG_VERSION")),
        asked: asked(&setting),
        offsets,
        flight,
        pixel,
        between_ends,
        coverage,
        findings: Vec::new(),
        picture,
    };
    plan.findings = finding::findings(&plan, mission);
    Ok(plan)
}

fn asked(setting: &Setting<'_>) -> Asked {
    let (survey, flight) = (&setting.mission.survey, &setting.mission.flight);
    Asked {
        profile: profile_json(&survey.profile),
        perimeter_m: setting.profile.perimeter_m(),
        clearance_m: setting.radius_m,
        images_per_turn: survey.rig.images_per_turn,
        view_rad: [setting.view.around_rad, setting.view.along_rad],
        length_m: flight.length_m,
        speed_bound: flight.speed_bound,
        speed_margin: flight.speed_margin,
        max_speed_mps: flight.max_speed_mps,
        latency_s: flight.latency_s,
        image_period_s: flight.image_period_s,
        battery_s: flight.battery_s,
        card_gb: flight.card_gb,
        photo_mb: flight.photo_mb,
    }
}
