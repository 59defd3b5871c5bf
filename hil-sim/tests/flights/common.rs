//! Missions for tests.

use std::path::PathBuf;

use adit_hil_sim::config::Simulation;
use adit_protocol::mission::Mission;

/// Text of an example mission.
pub(crate) fn mission_text(name: &str) -> String {
    let path = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("missions").join(name);
    std::fs::read_to_string(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
}

/// An example mission and its simulation.
pub(crate) fn mission(name: &str) -> (Mission, Simulation) {
    let text = mission_text(name);
    let mission = Mission::from_toml(&text).unwrap_or_else(|error| panic!("{name}: {error}"));
    let simulation = Simulation::from_mission(&text).unwrap_or_else(|error| panic!("{name}: {error}"));
    (mission, simulation)
}
