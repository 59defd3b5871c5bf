//! The mission file's `[simulation]` table: typed, unknown keys refused, values checked, all violations at once.
//!
//! Keys carry the file's units (degrees, millimetres), fields SI. An empty or absent table is a decent realistic flight.

mod autopilot;
mod check;
mod plant;
mod units;

use serde::{Deserialize, Serialize};

pub use autopilot::{AutopilotKind, ModeName};
pub use check::Violation;
pub use plant::{
    AttitudeConfig, AutopilotConfig, BuildConfig, CardConfig, EncoderConfig, NavigationConfig, PilotConfig,
    RangeConfig, ServoConfig, ShutterConfig, WindConfig,
};

use crate::faults::Fault;
use crate::render::RenderConfig;
use crate::scene::{TextureConfig, WallConfig};

/// The `[simulation]` table.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Simulation {
    /// The seed, where the command line gives none.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub seed: Option<u64>,
    /// Who flies, and the world's clock.
    pub pilot: PilotConfig,
    /// How this vehicle differs from its drawing.
    pub build: BuildConfig,
    /// Gusts.
    pub wind: WindConfig,
    /// How the body wobbles.
    pub attitude: AttitudeConfig,
    /// How well the autopilot flies.
    pub autopilot: AutopilotConfig,
    /// What the vehicle's estimator reports.
    pub navigation: NavigationConfig,
    /// Range sensors.
    pub ranges: RangeConfig,
    /// The servo on the shaft.
    pub servo: ServoConfig,
    /// The shaft's encoder.
    pub encoder: EncoderConfig,
    /// How the camera answers its trigger.
    pub shutter: ShutterConfig,
    /// The camera's clock and file numbers.
    pub card: CardConfig,
    /// How the real wall differs from the profile.
    pub wall: WallConfig,
    /// What is painted on it.
    pub texture: TextureConfig,
    /// How photos are taken and written.
    pub render: RenderConfig,
    /// Faults with their times.
    pub faults: Vec<Fault>,
    /// This many more faults are drawn from the seed.
    pub random_faults: u32,
}

/// Why a `[simulation]` table was refused.
#[derive(Debug, thiserror::Error)]
pub enum SimulationError {
    /// Not TOML, an unknown key, or a value of the wrong type; the message shows line and key.
    #[error("{0}")]
    Syntax(#[from] toml::de::Error),
    /// Values out of range, all of them.
    #[error("{}", .0.iter().map(ToString::to_string).collect::<Vec<_>>().join("\n"))]
    Values(Vec<Violation>),
}

impl Simulation {
    /// Reads the `[simulation]` table out of a mission file's text; everything outside it is left to others.
    ///
    /// # Errors
    /// [`SimulationError`] with line and key, or with all values that are out of range.
    pub fn from_mission(text: &str) -> Result<Self, SimulationError> {
        #[derive(Deserialize)]
        struct File {
            #[serde(default)]
            simulation: Simulation,
        }
        let File { simulation } = toml::from_str(text)?;
        let violations = simulation.violations();
        if violations.is_empty() { Ok(simulation) } else { Err(SimulationError::Values(violations)) }
    }

    /// Returns every value that cannot be.
    pub fn violations(&self) -> Vec<Violation> {
        let mut to = check::Checker::default();
        to.table("pilot", |to| self.pilot.check(to));
        to.table("build", |to| self.build.check(to));
        to.table("wind", |to| self.wind.check(to));
        to.table("attitude", |to| self.attitude.check(to));
        to.table("autopilot", |to| self.autopilot.check(to));
        to.table("navigation", |to| self.navigation.check(to));
        to.table("ranges", |to| self.ranges.check(to));
        to.table("servo", |to| self.servo.check(to));
        to.table("encoder", |to| self.encoder.check(to));
        to.table("shutter", |to| self.shutter.check(to));
        to.table("card", |to| self.card.check(to));
        to.table("faults", |to| {
            for fault in &self.faults {
                to.within("at_s", fault.at_s, 0.0, 1e5);
                to.within("for_s", fault.for_s.unwrap_or(0.0), 0.0, 1e5);
            }
        });
        to.within("random_faults", f64::from(self.random_faults), 0.0, 100.0);
        to.found
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::faults::{BeamName, FaultKind};
    use crate::sensors::range::RangeDefect;

    #[test]
    fn the_defaults_break_no_rule_and_survive_a_round_trip_through_a_file() {
        let simulation = Simulation::default();
        assert!(simulation.violations().is_empty());
        let text = toml::to_string(&toml::Table::from_iter([(
            "simulation".to_owned(),
            toml::Value::try_from(&simulation).expect("serialises"),
        )]))
        .expect("serialises");
        let again = Simulation::from_mission(&text).expect("parses");
        assert!((again.servo.slew_rad_per_s - simulation.servo.slew_rad_per_s).abs() < 1e-9);
        assert_eq!(again.pilot, simulation.pilot);
    }

    #[test]
    fn degrees_and_millimetres_become_radians_and_metres() {
        let text = "[simulation.servo]\nslew_deg_per_s = 180.0\n[simulation.ranges]\nbias_sigma_mm = 20.0";
        let simulation = Simulation::from_mission(text).expect("parses");
        assert!((simulation.servo.slew_rad_per_s - std::f64::consts::PI).abs() < 1e-12);
        assert!((simulation.ranges.bias_sigma_m - 0.02).abs() < 1e-12);
    }

    #[test]
    fn an_unknown_key_is_named_with_its_line() {
        let error = Simulation::from_mission("[simulation.wind]\ngust_sigma = 3").expect_err("unknown key");
        let message = error.to_string();
        assert!(message.contains("line 2") && message.contains("gust_sigma"), "{message}");
    }

    #[test]
    fn all_values_out_of_range_are_named_with_their_path() {
        let text = "[simulation.shutter]\nmissed_share = 1.5\n[simulation.pilot]\nstep_s = -1.0";
        let message = Simulation::from_mission(text).expect_err("bad values").to_string();
        assert!(message.contains("simulation.shutter.missed_share is 1.5"), "{message}");
        assert!(message.contains("simulation.pilot.step_s is -1"), "{message}");
    }

    #[test]
    fn a_fault_is_read_with_its_beam_and_time() {
        let text = "[[simulation.faults]]\nkind = \"range-dead\"\nbeam = \"up\"\nat_s = 5.0";
        let simulation = Simulation::from_mission(text).expect("parses");
        let dead = FaultKind::Range { beam: BeamName::Up, defect: RangeDefect::Dead };
        assert_eq!(simulation.faults, [Fault { kind: dead, at_s: 5.0, for_s: None }]);
    }

    #[test]
    fn the_example_missions_are_read_without_complaint() {
        let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("missions");
        let mut read = 0;
        for entry in std::fs::read_dir(folder).expect("missions/") {
            let path = entry.expect("an entry").path();
            let text = std::fs::read_to_string(&path).expect("a file");
            let mission = adit_protocol::mission::Mission::from_toml(&text);
            assert!(mission.is_ok(), "{}: {}", path.display(), mission.unwrap_err());
            let simulation = Simulation::from_mission(&text);
            assert!(simulation.is_ok(), "{}: {}", path.display(), simulation.unwrap_err());
            read += 1;
        }
        assert!(read >= 3, "{read} missions");
    }

    #[test]
    fn a_misspelt_key_of_a_fault_is_refused() {
        let text = "[[simulation.faults]]\nkind = \"servo-stall\"\nat_s = 5.0\nfor_seconds = 3";
        assert!(Simulation::from_mission(text).is_err());
    }
}
