//! The exact bound for places in the section, computed when first asked for.

use std::collections::HashMap;

use adit_geometry::camera::Camera;
use adit_geometry::profile::{Profile, ProfileError};
use adit_geometry::rig::Rig;
use adit_protocol::mission::Mission;
use adit_protocol::parameters::SpeedBound;

use super::bound::Footprints;

/// Places in the section are rounded to this for the table of bounds.
const PLACE_GRID_M: f64 = 0.025;

/// Bounds on the step for places in the section, computed when first asked for.
#[derive(Clone, Debug)]
pub struct BoundTable {
    pub(super) profile: Profile<f64>,
    pub(super) camera: Camera<f64>,
    pub(super) rig: Rig<f64>,
    views: usize,
    steps_m: HashMap<(i32, i32), f64>,
}

impl BoundTable {
    /// An empty table for a mission.
    ///
    /// # Errors
    /// [`ProfileError`] if the profile cannot be built.
    pub fn new(mission: &Mission) -> Result<Self, ProfileError> {
        let views = match mission.flight.speed_bound {
            SpeedBound::TwoViews => 2,
            SpeedBound::OneView | SpeedBound::Paper => 1,
        };
        Ok(Self {
            profile: mission.survey.profile.build()?,
            camera: mission.survey.camera.camera,
            rig: mission.survey.rig,
            views,
            steps_m: HashMap::new(),
        })
    }

    /// Computes all places within `reach_m` of the axis, so that clones of the table share them.
    pub fn fill(&mut self, reach_m: f64) {
        let most = (reach_m / PLACE_GRID_M).ceil() as i32;
        for y in -most..=most {
            for z in -most..=most {
                self.step_m([f64::from(y) * PLACE_GRID_M, f64::from(z) * PLACE_GRID_M]);
            }
        }
    }

    /// The longest step per image from about this place.
    pub fn step_m(&mut self, offset_m: [f64; 2]) -> f64 {
        let place = offset_m.map(|offset| (offset / PLACE_GRID_M).round() as i32);
        let Self { profile, camera, rig, views, steps_m } = self;
        *steps_m.entry((place[0], place[1])).or_insert_with(|| {
            let offset_m = place.map(|index| f64::from(index) * PLACE_GRID_M);
            Footprints::new(profile, camera, rig, offset_m).longest_step_m(*views)
        })
    }
}
