//! Photos, time, cards and batteries of the planned flight.

use adit_geometry::speed::SpeedError;
use adit_protocol::parameters::CaptureWiring;
use serde::Serialize;

use super::OffsetRow;
use super::bounds::Setting;

/// The length flown at one speed.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Pace {
    /// Speed.
    pub speed_mps: f64,
    /// Advance from one image to the next.
    pub step_m: f64,
    /// Photos, the first at the start.
    pub photos: u64,
    /// Turns of the shaft.
    pub turns: f64,
    /// Time from the first photo to the end of the length; neither approach nor way back.
    pub duration_s: f64,
    /// All photos.
    pub storage_gb: f64,
    /// Share of one card, where its size is known.
    pub card_share: Option<f64>,
    /// Share of one battery, where its flying time is known.
    pub battery_share: Option<f64>,
}

/// The flight.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct FlightFigures {
    /// On the axis, at the speed that the board allows there.
    pub planned: Pace,
    /// Always at the worst place allowed, and where the camera is wired its answer takes a whole image period: no slower
    /// unless photos are missed. `None` if the worst place allows no speed.
    pub slowest: Option<Pace>,
    /// The mission's largest speed decides, not the bound.
    pub capped: bool,
}

/// The flight's figures; `None` if it may not move on the axis.
pub(super) fn figures(setting: &Setting<'_>, offsets: &[OffsetRow]) -> Result<Option<FlightFigures>, SpeedError> {
    let (Some(centred), Some(worst)) = (offsets.first(), offsets.last()) else { return Ok(None) };
    let answer_s = match setting.mission.board.shutter.wiring {
        CaptureWiring::None => 0.0,
        CaptureWiring::Busy | CaptureWiring::Confirm => setting.period_s().max(setting.answer_s()),
    };
    let cautious_mps = setting.limit_mps(worst.allowed_step_m, answer_s)?;
    Ok(pace(setting, centred.flown.speed_mps).map(|planned| FlightFigures {
        planned,
        slowest: pace(setting, cautious_mps),
        capped: planned.speed_mps >= setting.mission.flight.max_speed_mps,
    }))
}

/// Number of photos over a length.
pub(super) fn photos(length_m: f64, step_m: f64) -> u64 {
    (length_m / step_m + 1e-9).floor() as u64 + 1
}

fn pace(setting: &Setting<'_>, speed_mps: f64) -> Option<Pace> {
    let mission = setting.mission;
    let flight = &mission.flight;
    if !(speed_mps > 0.0) {
        return None;
    }
    let step_m = speed_mps * setting.period_s();
    let photos = photos(flight.length_m, step_m);
    let duration_s = flight.length_m / speed_mps;
    let storage_gb = photos as f64 * flight.photo_mb / 1000.0;
    Some(Pace {
        speed_mps,
        step_m,
        photos,
        turns: photos as f64 / f64::from(mission.survey.rig.images_per_turn.max(1)),
        duration_s,
        storage_gb,
        card_share: flight.card_gb.map(|card_gb| storage_gb / card_gb),
        battery_share: flight.battery_s.map(|battery_s| duration_s / battery_s),
    })
}
