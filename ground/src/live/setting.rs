//! What must be known of a flight to show where it is: section, camera, rig, and what counts as seen.

use adit_geometry::camera::Camera;
use adit_geometry::coverage::{CoverageError, Footprint, FootprintError};
use adit_geometry::profile::{Profile, ProfileError, ProfileSpec};
use adit_geometry::rig::Rig;
use adit_protocol::beams::Beams;
use adit_protocol::mission::Mission;
use adit_protocol::parameters::{CaptureWiring, Parameters, SpeedBound};

/// Why nothing can be shown of a flight.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum SettingError {
    /// The section cannot be built.
    #[error("the section: {0}")]
    Profile(#[from] ProfileError),
    /// The camera does not see where the shaft points it.
    #[error("camera and rig: {0}")]
    Footprint(#[from] FootprintError),
    /// No coverage can be computed.
    #[error("the rig: {0}")]
    Coverage(#[from] CoverageError),
}

/// What is known of a flight beforehand.
#[derive(Clone, Debug)]
pub struct Setting {
    /// The section.
    pub profile: Profile<f64>,
    /// The camera.
    pub camera: Camera<f64>,
    /// How it sits on the shaft.
    pub rig: Rig<f64>,
    /// What it sees along the axis.
    pub(super) footprint: Footprint<f64>,
    /// What the board hears from the camera.
    pub wiring: CaptureWiring,
    /// Photos that must show a place.
    pub views: u8,
    /// Largest distance from the axis that is allowed, sideways and vertically.
    pub offset_max_m: f64,
    /// Which range sensors there are.
    pub fitted: Beams<bool>,
}

impl Setting {
    /// As a mission file has it.
    ///
    /// # Errors
    /// [`SettingError`]; a mission that can be planned has none.
    pub fn of_mission(mission: &Mission) -> Result<Self, SettingError> {
        let survey = &mission.survey;
        Self::new(&survey.profile, survey.camera.camera, survey.rig, &mission.parameters())
    }

    /// As the board has it.
    ///
    /// # Errors
    /// [`SettingError`]
    pub fn of_board(parameters: &Parameters) -> Result<Self, SettingError> {
        Self::new(&parameters.profile.cast(), parameters.camera.cast(), parameters.rig.cast(), parameters)
    }

    fn new(
        profile: &ProfileSpec<f64>,
        camera: Camera<f64>,
        rig: Rig<f64>,
        parameters: &Parameters,
    ) -> Result<Self, SettingError> {
        Ok(Self {
            profile: profile.build()?,
            footprint: Footprint::of_camera(&camera, &rig, 0.0)?,
            camera,
            rig,
            wiring: parameters.shutter.wiring,
            views: if parameters.speed.bound == SpeedBound::TwoViews { 2 } else { 1 },
            offset_max_m: f64::from(parameters.speed.offset_max_m),
            fitted: parameters.ranges.fitted,
        })
    }
}
