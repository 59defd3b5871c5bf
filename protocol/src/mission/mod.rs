//! The checked content of `survey.toml` and of mission files. Parsed once, in SI, into something that cannot be wrong.
//!
//! A survey file has `format = 1` and the tables `[tunnel]`, `[camera]`, `[rig]` and `[sigma]`. A mission file has the same
//! and `[flight]`, optionally `[board]` (what the board's [`Parameters`] hold
//! beyond the survey) and `[simulation]`, which only the simulator interprets. Every violation is reported at once, with
//! line, key, what was found and what was expected; values of implausible size are taken for a wrong unit.

mod board;
mod flight;
mod problem;
mod quantity;
mod reader;
mod survey;
mod write;

use adit_geometry::camera::Camera;
use adit_geometry::profile::ProfileSpec;
use adit_geometry::rig::Rig;
use toml::de::DeTable;

pub use flight::FlightPlan;
pub use problem::{MissionError, Problem};

use crate::parameters::{
    LinkParameters, LogParameters, Parameters, RangeParameters, ShaftParameters, ShutterParameters,
};
use reader::{Collector, Section};

/// The version of the files that is understood.
const FORMAT: u32 = 1;

/// What a survey folder's `survey.toml` says.
#[derive(Clone, Debug, PartialEq)]
pub struct SurveyConfig {
    /// The lining's nominal section.
    pub profile: ProfileSpec<f64>,
    /// The camera.
    pub camera: CameraConfig,
    /// How it sits on the shaft.
    pub rig: Rig<f64>,
    /// Uncertainty of what the tags claim.
    pub sigma: Sigma,
}

/// The camera and what the adjustment may do with it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CameraConfig {
    /// Size, intrinsics, distortion.
    pub camera: Camera<f64>,
    /// May the adjustment move the intrinsics?
    pub refine: bool,
    /// Time between the first and the last row's exposure.
    pub rolling_shutter_s: f64,
}

impl CameraConfig {
    /// The table `[camera]` of survey and mission files.
    pub fn to_toml(&self) -> String {
        write::camera(self)
    }
}

/// The table `[rig]` of survey and mission files.
pub fn rig_to_toml(rig: &Rig<f64>) -> String {
    write::rig(rig)
}

/// One standard deviation of what `tags.csv` claims.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sigma {
    /// Shaft angle.
    pub shaft_rad: f64,
    /// Range readings.
    pub range_m: f64,
    /// Odometer error per metre travelled.
    pub odometer_m_per_m: f64,
    /// Attitude (of the tags' attitude if present, else of "level and straight").
    pub attitude_rad: f64,
    /// Camera mounting, per axis.
    pub mount_rad: f64,
}

impl Default for Sigma {
    fn default() -> Self {
        Self {
            // Backlash of a geared servo and the encoder's mounting.
            shaft_rad: 1f64.to_radians(),
            // Sensor noise and an uneven lining.
            range_m: 0.02,
            // A visual or wheel odometer.
            odometer_m_per_m: 0.02,
            // A hovering vehicle's wander around level and straight.
            attitude_rad: 1f64.to_radians(),
            // A bracket set up by eye.
            mount_rad: 1f64.to_radians(),
        }
    }
}

/// What the board holds beyond the survey and the flight plan: the tables `[board.shaft]`, `[board.shutter]`,
/// `[board.ranges]`, `[board.link]` and `[board.log]`.
///
/// Keys are the fields of the parameters; angles are in degrees (`slew_deg_per_s`, `settle_tolerance_deg`). In
/// `[board.ranges]`, `up`, `right`, `down`, `left` and `head` say which sensors are fitted (default: the first four), and
/// `lever_up_m = [y, z]` and its like say where, `bus` and `port_up` and its like how they are wired; `sigma_m` is by default the survey's `range_m`.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct BoardPlan {
    /// The shaft's servo and encoder.
    pub shaft: ShaftParameters,
    /// Camera trigger, its answer, and the light.
    pub shutter: ShutterParameters,
    /// The range sensors.
    pub ranges: RangeParameters,
    /// The link to the autopilot.
    pub link: LinkParameters,
    /// What is logged besides tags and events.
    pub log: LogParameters,
}

/// A mission: the survey that it will make, the flight, the board's set-up.
#[derive(Clone, Debug, PartialEq)]
pub struct Mission {
    /// What the survey's `survey.toml` will say.
    pub survey: SurveyConfig,
    /// The flight.
    pub flight: FlightPlan,
    /// The board's set-up.
    pub board: BoardPlan,
    /// Table `[simulation]`, not interpreted here.
    pub simulation: Option<toml::Table>,
}

impl SurveyConfig {
    /// Reads the text of a `survey.toml`.
    ///
    /// # Errors
    /// [`MissionError`] with every violation.
    pub fn from_toml(text: &str) -> Result<Self, MissionError> {
        let document = parse(text)?;
        let collector = Collector::new(text);
        let mut root = Section::new(&collector, "", None, Some(document.get_ref()));
        check_format(&mut root);
        let config = survey::read(&mut root);
        root.finish();
        collector.conclude(config)
    }

    /// The text of a `survey.toml` that reads back as this, to the last digit but the 12th of angles.
    pub fn to_toml(&self) -> String {
        write::survey(self)
    }
}

impl Mission {
    /// Reads the text of a mission file.
    ///
    /// # Errors
    /// [`MissionError`] with every violation.
    pub fn from_toml(text: &str) -> Result<Self, MissionError> {
        let document = parse(text)?;
        let collector = Collector::new(text);
        let mut root = Section::new(&collector, "", None, Some(document.get_ref()));
        check_format(&mut root);
        let survey = survey::read(&mut root);
        let clearance_m = survey.as_ref().and_then(|survey| survey::clearance_m(&survey.profile));
        let flight = root.section("flight", true).and_then(|section| flight::read(section, clearance_m));
        let board = board::read(root.section_or_empty("board"), survey.as_ref());
        root.skip("simulation");
        root.finish();
        let simulation = match text.parse::<toml::Table>().ok().and_then(|mut table| table.remove("simulation")) {
            Some(toml::Value::Table(table)) => Some(table),
            Some(other) => {
                collector.add(None, "simulation", other.type_str(), "a table");
                None
            }
            None => None,
        };
        let mission = survey.zip(flight).map(|(survey, flight)| Self { survey, flight, board, simulation });
        collector.conclude(mission)
    }

    /// What the board must know to fly this mission.
    pub fn parameters(&self) -> Parameters {
        Parameters {
            profile: self.survey.profile.cast(),
            camera: self.survey.camera.camera.cast(),
            rig: self.survey.rig.cast(),
            speed: self.flight.speed_parameters(),
            shaft: self.board.shaft,
            shutter: self.board.shutter,
            ranges: self.board.ranges,
            link: self.board.link,
            log: self.board.log,
        }
    }
}

/// The tree of a TOML text, or its syntax errors.
fn parse(text: &str) -> Result<toml::Spanned<DeTable<'_>>, MissionError> {
    let (document, errors) = DeTable::parse_recoverable(text);
    if errors.is_empty() {
        return Ok(document);
    }
    let collector = Collector::new(text);
    for error in errors {
        let place = error.span().map(|span| span.start);
        collector.add(place, "", error.message().trim().replace('\n', ", "), "TOML 1.0");
    }
    collector.conclude(None)
}

fn check_format(root: &mut Section<'_>) {
    if let Some(format) = root.integer("format", 0, u32::MAX)
        && format != FORMAT
    {
        root.complain("format", format.to_string(), format!("{FORMAT}, the version this program reads"));
    }
}

#[cfg(test)]
mod tests;
