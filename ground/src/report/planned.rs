//! Plan against flight: what `adit plan` promised for the mission, beside what the tags and the photos' poses say happened.
//!
//! The mission file lies in the survey as `mission.toml`, where `adit ingest` put it. A survey without one has no such figures.

use std::path::Path;

use adit_protocol::mission::{Mission, MissionError};
use adit_protocol::tag::CaptureTag;
use serde::Serialize;

use super::ReportInput;
use crate::adjust::median;
use crate::plan::{Pace, PlanError, plan};
use crate::poses::PhotoPose;

/// Name of the mission file in a survey.
pub(crate) const MISSION_FILE: &str = "mission.toml";

/// One figure, as planned and as flown. Absent where nobody tells.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub(super) struct Row {
    what: &'static str,
    unit: &'static str,
    /// On the axis.
    planned: Option<f64>,
    /// Always at the worst place allowed.
    slowest: Option<f64>,
    flown: Option<f64>,
    /// Decimals that are shown.
    decimals: usize,
}

/// Plan and flight side by side.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub(super) struct PlannedFigures {
    /// Why there is no plan to compare with, although there is a mission file.
    trouble: Option<String>,
    rows: Vec<Row>,
}

/// Why a mission file in a survey cannot be planned again.
#[derive(Debug, thiserror::Error)]
enum PlannedError {
    /// It cannot be read.
    #[error(transparent)]
    Io(#[from] std::io::Error),
    /// It is wrong.
    #[error(transparent)]
    Mission(#[from] MissionError),
    /// It can no longer be planned.
    #[error(transparent)]
    Plan(#[from] PlanError),
}

/// What happened.
struct Flown {
    length_m: f64,
    /// Photos with a tag.
    photos: usize,
    /// Captures between the first and the last photo that have none.
    without_photo: usize,
    time_s: f64,
    step_m: Option<f64>,
    period_s: Option<f64>,
    speed_mps: Option<f64>,
    offset_m: f64,
}

impl PlannedFigures {
    /// `None` if the survey has no mission file.
    pub(super) fn new(input: &ReportInput<'_>) -> Option<Self> {
        let path = input.survey.folder.join(MISSION_FILE);
        if !path.exists() {
            return None;
        }
        let tagged = input.survey.photos.iter().zip(&input.reconstruction.poses);
        let tagged: Vec<(CaptureTag, &PhotoPose)> =
            tagged.filter_map(|(photo, pose)| Some((photo.tag?, pose))).collect();
        let lever_m = input.survey.config.rig.lever_radial_m;
        let compared = mission(&path).and_then(|mission| rows(&mission, input, &Flown::new(&tagged, lever_m)));
        Some(match compared {
            Ok(rows) => Self { trouble: None, rows },
            Err(error) => Self { trouble: Some(format!("{MISSION_FILE}: {error}")), rows: Vec::new() },
        })
    }
}

fn mission(path: &Path) -> Result<Mission, PlannedError> {
    Ok(Mission::from_toml(&std::fs::read_to_string(path)?)?)
}

fn rows(mission: &Mission, input: &ReportInput<'_>, flown: &Flown) -> Result<Vec<Row>, PlannedError> {
    let plan = plan(mission)?;
    let planned = plan.flight.as_ref().map(|flight| &flight.planned);
    let slowest = plan.flight.as_ref().and_then(|flight| flight.slowest.as_ref());
    let row = |what, unit, decimals, [planned, slowest, flown]: [Option<f64>; 3]| Row {
        what,
        unit,
        planned,
        slowest,
        flown,
        decimals,
    };
    let pace = |what, unit, decimals, of: &dyn Fn(&Pace) -> f64, flown| {
        row(what, unit, decimals, [planned.map(of), slowest.map(of), flown])
    };
    let only = |what, unit, decimals, planned, flown| row(what, unit, decimals, [planned, None, flown]);
    let seen = |index: usize| {
        let planned = plan.between_ends.as_ref().map(|seen| seen.seen_share[index] * 100.0);
        [planned, None, Some(input.texture.coverage.seen_share[index] * 100.0)]
    };
    let native_mm = input.texture.native_mm_per_px;
    Ok(vec![
        only("Length", "m", 1, Some(mission.flight.length_m), Some(flown.length_m)),
        pace("Speed", "m/s", 3, &|pace| pace.speed_mps, flown.speed_mps),
        pace("Step from photo to photo", "mm", 0, &|pace| pace.step_m * 1e3, flown.step_m.map(|step_m| step_m * 1e3)),
        only("Time from photo to photo", "s", 2, Some(plan.asked.image_period_s), flown.period_s),
        pace("Photos", "", 0, &|pace| pace.photos as f64, Some(flown.photos as f64)),
        only("Captures without photo", "", 0, Some(0.0), Some(flown.without_photo as f64)),
        pace("Time from the first photo to the last", "s", 0, &|pace| pace.duration_s, Some(flown.time_s)),
        only(
            "Largest offset from the axis",
            "m",
            2,
            Some(mission.flight.offset_max_m * 2f64.sqrt()),
            Some(flown.offset_m),
        ),
        row("Wall seen by at least one photo", "%", 2, seen(0)),
        row("Wall seen by at least two photos", "%", 2, seen(1)),
        only(
            "Pixel on the wall (median)",
            "mm",
            2,
            plan.pixel.as_ref().map(|pixel| pixel.wall.median_mm),
            Some(native_mm),
        ),
    ])
}

impl Flown {
    /// `tagged`: in order of capture.
    fn new(tagged: &[(CaptureTag, &PhotoPose)], lever_m: f64) -> Self {
        let x_m = |pose: &PhotoPose| pose.tunnel_from_cam.translation.x;
        let (mut steps_m, mut periods_s, mut without_photo) = (Vec::new(), Vec::new(), 0);
        for ((before, from), (after, to)) in tagged.iter().zip(tagged.iter().skip(1)) {
            let apart = after.capture.saturating_sub(before.capture);
            without_photo += apart.saturating_sub(1) as usize;
            // A board that restarted counts its time anew.
            if apart == 1 && after.time_us > before.time_us {
                steps_m.push(x_m(to) - x_m(from));
                periods_s.push((after.time_us - before.time_us) as f64 * 1e-6);
            }
        }
        let speeds_mps: Vec<f64> = tagged.iter().filter_map(|(tag, _)| tag.speed_mps.map(f64::from)).collect();
        let known = |values: &[f64]| (!values.is_empty()).then(|| median(values));
        let places = || tagged.iter().map(|(_, pose)| x_m(pose));
        let body_m = |pose: &PhotoPose| {
            let outward = pose.tunnel_from_cam.rotation * nalgebra::Vector3::z() * lever_m;
            (pose.tunnel_from_cam.translation.vector - outward).yz().norm()
        };
        let length_m = places().fold(f64::NEG_INFINITY, f64::max) - places().fold(f64::INFINITY, f64::min);
        Self {
            length_m: length_m.max(0.0),
            photos: tagged.len(),
            without_photo,
            time_s: periods_s.iter().sum(),
            step_m: known(&steps_m),
            period_s: known(&periods_s),
            speed_mps: known(&speeds_mps),
            offset_m: tagged.iter().map(|(_, pose)| body_m(pose)).fold(0.0, f64::max),
        }
    }
}

#[cfg(test)]
mod tests {
    use adit_protocol::tag::{CaptureState, Ranges, TagFlags};
    use nalgebra::{Isometry3, Translation3};

    use super::*;
    use crate::poses::PoseStatus;

    fn tag(capture: u32, time_s: f64) -> CaptureTag {
        CaptureTag {
            capture,
            state: CaptureState::Confirmed,
            time_us: (time_s * 1e6) as u64,
            shaft_rad: 0.0,
            ranges: Ranges::default(),
            range_head_m: None,
            odometer_m: None,
            attitude_rad: None,
            offset_m: None,
            speed_mps: Some(0.1),
            speed_limit_mps: None,
            flags: TagFlags::default(),
        }
    }

    fn pose(x_m: f64, y_m: f64) -> PhotoPose {
        PhotoPose {
            photo: String::new(),
            tunnel_from_cam: Isometry3::from(Translation3::new(x_m, y_m, 0.06)),
            position_sigma_m: [0.0; 3],
            rotation_sigma_rad: [0.0; 3],
            status: PoseStatus::Adjusted,
            quality: crate::adjust::PhotoQuality::default(),
        }
    }

    #[test]
    fn a_missed_photo_is_counted_and_stretches_no_step() {
        let poses = [pose(1.0, 0.0), pose(1.1, 0.3), pose(1.3, 0.0), pose(1.4, 0.0)];
        // Capture 3 has no photo; the board restarted before capture 5.
        let tags = [tag(1, 10.0), tag(2, 11.0), tag(4, 13.0), tag(5, 2.0)];
        let tagged: Vec<_> = tags.into_iter().zip(&poses).collect();
        let flown = Flown::new(&tagged, 0.06);
        assert_eq!((flown.photos, flown.without_photo), (4, 1));
        assert!((flown.step_m.unwrap() - 0.1).abs() < 1e-9 && (flown.period_s.unwrap() - 1.0).abs() < 1e-9);
        assert!((flown.length_m - 0.4).abs() < 1e-9 && (flown.offset_m - 0.3).abs() < 1e-9);
        let none = Flown::new(&[], 0.06);
        assert_eq!((none.length_m, none.step_m), (0.0, None));
    }
}
