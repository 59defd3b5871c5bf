//! Photos, time, cards and batteries of the planned flight.

use adit_protocol::mission::Mission;
use adit_protocol::parameters::CaptureWiring;
use serde::Serialize;

use super::OffsetRow;

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
    /// On the axis, at the speed the board allows there.
    pub planned: Pace,
    /// Always at the worst place allowed, and where the camera is wired its answer takes a whole image period: no slower
    /// unless photos are missed. `None` if the worst place allows no speed.
    pub slowest: Option<Pace>,
    /// The mission's largest speed decides, not the bound.
    pub capped: bool,
}

/// The flight's figures; `None` if it may not move on the axis.
pub(super) fn figures(mission: &Mission, offsets: &[OffsetRow]) -> Option<FlightFigures> {
    let flight = &mission.flight;
    let (centred, worst) = (offsets.first()?, offsets.last()?);
    let answer_s = match mission.board.shutter.wiring {
        CaptureWiring::None => 0.0,
        CaptureWiring::Busy | CaptureWiring::Confirm => flight.image_period_s,
    };
    let cautious_mps = worst.allowed_step_m / (flight.image_period_s + answer_s + flight.latency_s);
    Some(FlightFigures {
        planned: pace(mission, centred.flown.speed_mps)?,
        slowest: pace(mission, cautious_mps.min(flight.max_speed_mps)),
        capped: centred.flown.speed_mps >= flight.max_speed_mps,
    })
}

/// Number of photos over a length.
pub(super) fn photos(length_m: f64, step_m: f64) -> u64 {
    (length_m / step_m + 1e-9).floor() as u64 + 1
}

fn pace(mission: &Mission, speed_mps: f64) -> Option<Pace> {
    let flight = &mission.flight;
    if !(speed_mps > 0.0) {
        return None;
    }
    let step_m = speed_mps * flight.image_period_s;
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
