//! How far and how fast the vehicle may move from one image to the next, over its offset from the axis.

use std::f64::consts::TAU;

use adit_geometry::coverage::{Footprint, Scene, max_step};
use adit_geometry::profile::Profile;
use adit_geometry::speed::{FieldOfView, SpeedError, paper_step, speed_mps};
use adit_geometry::{SectionVector, angles};
use adit_protocol::mission::Mission;
use adit_protocol::parameters::{CaptureWiring, SpeedBound};
use serde::Serialize;

use super::PlanError;
use crate::texture::clock_position;

/// The offsets of the table, in thirds of the largest one allowed: the board computes the bound at such places.
const THIRDS: [u32; 4] = [0, 1, 2, 3];
/// Places per offset, all around the square of that half side.
const PLACES: u32 = 16;

/// What every part of the plan is computed from.
pub(super) struct Setting<'a> {
    pub(super) mission: &'a Mission,
    pub(super) profile: Profile<f64>,
    pub(super) footprint: Footprint<f64>,
    /// The fields of view that the paper's law takes.
    pub(super) view: FieldOfView<f64>,
    /// Radius of the largest circle around the axis: the paper's radius.
    pub(super) radius_m: f64,
}

/// A bound on the step, and the speed that it allows at the mission's image period.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Bound {
    /// Advance from one image to the next.
    pub step_m: f64,
    /// Speed.
    pub speed_mps: f64,
}

/// Why nothing may be flown at an offset.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, thiserror::Error)]
#[serde(rename_all = "kebab-case", tag = "reason")]
pub enum Standstill {
    /// The wall is nearer than the camera's lever arm is long.
    #[error("{clearance_m:.2} m to the wall, the camera reaches {needed_m:.2} m")]
    Wall {
        /// From the body origin to the nearest wall; negative outside.
        clearance_m: f64,
        /// The lever arm's length.
        needed_m: f64,
    },
    /// Part of the wall is in too few images of a turn, however slowly one flies.
    #[error("the wall at {clock:.1} o'clock is in no image of a turn")]
    Unseen {
        /// Clock position of the wall line, looking forward.
        clock: f64,
    },
    /// The paper's law allows no step here.
    #[error("the paper's law allows no step")]
    Paper,
}

/// The bounds that hold as long as the vehicle keeps within an offset: each at its worst place.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct OffsetRow {
    /// Largest distance from the axis sideways, and largest vertically.
    pub offset_m: f64,
    /// The place `[y, z]` (right, down) where the mission's bound is lowest.
    pub worst_at_m: [f64; 2],
    /// The paper's law, as printed, for the largest circle around the axis.
    pub paper: Bound,
    /// Every wall point in at least one image.
    pub one_view: Bound,
    /// Every wall point in at least two images.
    pub two_views: Bound,
    /// The mission's bound, at the worst place that the board reckons with, times its margin.
    pub allowed_step_m: f64,
    /// What the board lets fly: the allowed step over period, answer and latency, at most the mission's largest speed; and the
    /// step that follows at the image period.
    pub flown: Bound,
    /// Why the speed is zero, where it is.
    pub standstill: Option<Standstill>,
}

/// The bounds in one place. Steps in metres.
#[derive(Clone, Copy, Debug, Default)]
struct Place {
    at_m: SectionVector<f64>,
    paper_m: f64,
    one_view_m: f64,
    two_views_m: f64,
    chosen_m: f64,
    standstill: Option<Standstill>,
}

impl<'a> Setting<'a> {
    pub(super) fn new(mission: &'a Mission) -> Result<Self, PlanError> {
        let survey = &mission.survey;
        let profile = survey.profile.build()?;
        let footprint = Footprint::of_camera(&survey.camera.camera, &survey.rig, 0.0)?;
        let radius_m = profile.nearest(SectionVector::zeros()).map_or(0.0, |nearest| nearest.clearance_m);
        let view = footprint.field_of_view().unwrap_or(FieldOfView { around_rad: 0.0, along_rad: 0.0 });
        Ok(Self { mission, profile, footprint, view, radius_m })
    }

    /// The flight at an offset; image 0 of each turn looks up, as the board has it.
    pub(super) fn scene(&self, offset_m: SectionVector<f64>) -> Result<Scene<'_, f64>, PlanError> {
        Ok(Scene::new(&self.profile, &self.footprint, &self.mission.survey.rig, offset_m, 0.0)?)
    }

    /// The table over the offsets.
    pub(super) fn rows(&self) -> Result<Vec<OffsetRow>, PlanError> {
        let flight = &self.mission.flight;
        let mut within = Vec::new();
        let mut worst: Option<Place> = None;
        for thirds in THIRDS {
            let offset_m = flight.offset_max_m * f64::from(thirds) / 3.0;
            let count = if thirds == 0 { 1 } else { PLACES };
            for index in 0..count {
                let place = self.place(around_square(offset_m, index))?;
                worst = Some(worst.map_or(place, |worst| worst.lower(&place)));
            }
            within.extend(worst.map(|worst| (offset_m, worst)));
            if flight.offset_max_m <= 0.0 {
                break;
            }
        }
        let next = within.iter().skip(1).chain(within.last());
        within.iter().zip(next).map(|((offset_m, worst), (_, next))| self.row(*offset_m, worst, next)).collect()
    }

    /// Shortest time between two images: the mission's, or what the board's settings need if that is longer. The turn from
    /// one image to the next, settling, the shutter's latest exposure; or the camera's shortest interval, or its answer; and
    /// then the light's lead.
    pub(super) fn needed_s(&self) -> f64 {
        let (shaft, shutter) = (&self.mission.board.shaft, &self.mission.board.shutter);
        let step_rad = angles::shaft_step_rad::<f64>(self.mission.survey.rig.images_per_turn);
        let turn_s = step_rad / f64::from(shaft.slew_radps) + f64::from(shaft.settle_dwell_s);
        let exposed_s = f64::from(shutter.trigger_latency_max_s + shutter.exposure_s);
        let stored_s = f64::from(shutter.trigger_latency_s) + self.answer_s();
        let waits_s = [exposed_s + turn_s, f64::from(shutter.min_interval_s), stored_s];
        f64::from(shutter.light_lead_s) + waits_s.into_iter().fold(0.0, f64::max)
    }

    /// Time from one image to the next.
    pub(super) fn period_s(&self) -> f64 {
        self.mission.flight.image_period_s.max(self.needed_s())
    }

    /// Time from an exposure until the board knows that the photo is good.
    pub(super) fn answer_s(&self) -> f64 {
        match self.mission.board.shutter.wiring {
            CaptureWiring::None => 0.0,
            CaptureWiring::Busy | CaptureWiring::Confirm => self.mission.flight.answer_s,
        }
    }

    /// The speed that the board allows where the bound is `chosen_m`, if a photo's fate is known after `answer_s`.
    pub(super) fn limit_mps(&self, allowed_step_m: f64, answer_s: f64) -> Result<f64, SpeedError> {
        let flight = &self.mission.flight;
        let known_s = self.period_s() + answer_s + flight.latency_s;
        Ok(speed_mps(allowed_step_m, known_s)?.min(flight.max_speed_mps))
    }

    /// `next`: the bounds one row on, which are those that the board reckons with, for its table has them at such places and
    /// it takes the lowest around its own.
    fn row(&self, offset_m: f64, worst: &Place, next: &Place) -> Result<OffsetRow, PlanError> {
        let period_s = self.period_s();
        let bound = |step_m| speed_mps(step_m, period_s).map(|speed_mps| Bound { step_m, speed_mps });
        let allowed_step_m = next.chosen_m * self.mission.flight.speed_margin;
        let limit_mps = self.limit_mps(allowed_step_m, self.answer_s())?;
        Ok(OffsetRow {
            offset_m,
            worst_at_m: worst.at_m.into(),
            paper: bound(worst.paper_m)?,
            one_view: bound(worst.one_view_m)?,
            two_views: bound(worst.two_views_m)?,
            allowed_step_m,
            flown: Bound { step_m: limit_mps * period_s, speed_mps: limit_mps },
            standstill: worst.standstill.or(next.standstill),
        })
    }

    fn place(&self, at_m: SectionVector<f64>) -> Result<Place, PlanError> {
        let rig = &self.mission.survey.rig;
        let clearance_m = self.profile.nearest(at_m).map_or(0.0, |nearest| nearest.clearance_m);
        let needed_m = rig.lever_radial_m.max(0.0);
        if clearance_m <= needed_m {
            return Ok(Place {
                at_m,
                standstill: Some(Standstill::Wall { clearance_m, needed_m }),
                ..Place::default()
            });
        }
        let scene = self.scene(at_m)?;
        let (one, two) = (max_step(&scene, 1)?, max_step(&scene, 2)?);
        let paper_m = paper_step(self.radius_m, at_m.norm(), self.view, rig.images_per_turn)?.per_image_m;
        let chosen_m = match self.mission.flight.speed_bound {
            // As the board has it: on no profile more than the exact bound.
            SpeedBound::Paper => paper_m.min(one.per_image_m),
            SpeedBound::OneView => one.per_image_m,
            SpeedBound::TwoViews => two.per_image_m,
        };
        let standstill = if chosen_m > 0.0 {
            None
        } else if one.per_image_m > 0.0 && self.mission.flight.speed_bound == SpeedBound::Paper {
            Some(Standstill::Paper)
        } else {
            Some(Standstill::Unseen { clock: clock_position(&self.profile, one.limiting_s_m) })
        };
        let (one_view_m, two_views_m) = (one.per_image_m, two.per_image_m);
        Ok(Place { at_m, paper_m, one_view_m, two_views_m, chosen_m, standstill })
    }
}

impl Place {
    /// The lower of each bound; the place of the lower mission's bound.
    fn lower(&self, other: &Self) -> Self {
        let lower = if other.chosen_m < self.chosen_m { other } else { self };
        Self {
            paper_m: self.paper_m.min(other.paper_m),
            one_view_m: self.one_view_m.min(other.one_view_m),
            two_views_m: self.two_views_m.min(other.two_views_m),
            ..*lower
        }
    }
}

/// One of [`PLACES`] places around the square of half side `half_m`; the corners are among them.
fn around_square(half_m: f64, index: u32) -> SectionVector<f64> {
    let (sin, cos) = (TAU * f64::from(index) / f64::from(PLACES)).sin_cos();
    let direction = SectionVector::new(sin, -cos);
    direction * (half_m / direction.amax())
}
