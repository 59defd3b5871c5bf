//! Before the flight: how fast, how many photos, how long, and what they will show.
//!
//! Everything follows from the mission file: the profile, the real camera's footprint, the bound the mission chose. The
//! speeds are the board's steady ones; what the board only knows in flight (its position's uncertainty, the camera's answer,
//! missed photos) makes it slower, which [`FlightFigures::slowest`] allows for.
//! # Limits
//! A level flight on a straight axis; nothing between camera and wall.

mod bounds;
mod curves;
mod finding;
mod flight;
mod output;
mod overlap;
mod page;
mod pixels;
pub(crate) mod predict;
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
pub use overlap::Overlap;
pub use pixels::{PixelMap, PixelSize, PixelSizes};

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
    /// Time between images: the mission's, or what shaft and camera need if that is longer.
    pub image_period_s: f64,
    /// Time from an exposure until the board knows that the photo is good.
    pub answer_s: f64,
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
    /// What neighbouring photos share.
    pub overlap: Option<Overlap>,
    /// Coverage of one turn's advance in the middle of the flight.
    pub between_ends: Option<Coverage>,
    /// Coverage of the whole flight, both ends included. Of flights above 30 m one of that length; the middle repeats.
    pub coverage: Option<Coverage>,
    /// What to mind, what forbids the flight first.
    pub findings: Vec<Finding>,
    /// The predicted number of photos, columns around from the crown, rows along the axis.
    #[serde(skip)]
    pub picture: Option<Rgba8>,
    /// The predicted size of a pixel, laid out alike.
    #[serde(skip)]
    pub pixel_map: Option<PixelMap>,
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
    let flight = flight::figures(&setting, &offsets)?;
    let mut plan = Plan {
        format: 1,
        program: format!("adit {}", env!("CARGO_PKG_VERSION")),
        asked: asked(&setting),
        offsets,
        flight,
        pixel: None,
        overlap: None,
        between_ends: None,
        coverage: None,
        findings: Vec::new(),
        picture: None,
        pixel_map: None,
    };
    if let Some(flight) = &flight {
        show(&mut plan, &setting, flight.planned.step_m)?;
    }
    plan.findings = finding::findings(&plan, &setting);
    Ok(plan)
}

/// Predicts what a flight on the axis will show.
fn show(plan: &mut Plan, setting: &Setting<'_>, step_m: f64) -> Result<(), PlanError> {
    let scene = setting.scene(predict::axis())?;
    let rig = &setting.mission.survey.rig;
    let length_m = predict::counted_m(setting.mission.flight.length_m);
    let photos = Some(flight::photos(length_m, step_m).min(u64::from(u32::MAX)) as u32);
    let whole = Flown { step_m, photos, lever_forward_m: rig.lever_forward_m };
    let endless = Flown { photos: None, ..whole };
    let counted = predict::coverage(&setting.profile, &scene, whole, length_m);
    (plan.coverage, plan.picture) = (Some(counted.coverage), Some(counted.picture));
    let turn_m = step_m * f64::from(rig.images_per_turn);
    plan.between_ends = Some(predict::coverage(&setting.profile, &scene, endless, turn_m).coverage);
    plan.pixel = pixels::sizes(setting, &scene, endless);
    plan.pixel_map = pixels::map(setting, &scene, whole, length_m);
    plan.overlap = overlap::overlap(setting, &scene, step_m);
    Ok(())
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
        image_period_s: setting.period_s(),
        answer_s: setting.answer_s(),
        battery_s: flight.battery_s,
        card_gb: flight.card_gb,
        photo_mb: flight.photo_mb,
    }
}
