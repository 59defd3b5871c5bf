//! One flight from switching the board on to the last photo: the loop that joins world, board and pilot.
//!
//! The flight's record holds both what the board wrote and what truly happened; the SD card and the checker are made
//! from it.

mod linked;
mod pilot;
#[cfg(test)]
pub(crate) mod stand_in;
pub mod watcher;

use adit_firmware::controller::Controller;
use adit_firmware::io::{Inputs, Outputs};
use adit_geometry::rig::Rig;
use adit_protocol::mission::Mission;
use adit_protocol::parameters::Parameters;
use adit_protocol::record::{Entry, Mode};

use crate::config::Simulation;
use crate::faults::FaultKind;
use crate::plant::vehicle::VehicleState;
use crate::scene::{Wall, WallError};
use crate::tunnel::clearance_m;
use crate::world::{Exposure, PilotAction, World};
pub use linked::{Account, Linked};
use pilot::{Ending, Pilot};

/// After the board has lost its power the camera still stores what it was told to take.
const AFTER_POWER_LOSS_S: f64 = 3.0;
/// The vehicle's half width: nearer to the lining than this it has struck it.
const VEHICLE_HALF_WIDTH_M: f64 = 0.25;

/// Whatever runs the board's logic: the library, a flash image on an emulated chip, or a real board.
pub trait Board {
    /// Feels how the vehicle moves, as inertial units on the board do; comes before the step of the same moment.
    fn feel(&mut self, now_us: u64, vehicle: &VehicleState) {
        let _ = (now_us, vehicle);
    }

    /// Takes the inputs of this moment and returns what shall be done. `now_us` since the board's start.
    ///
    /// # Errors
    /// [`BoardError`] if the board is gone; the flight is then over.
    fn step(&mut self, now_us: u64, inputs: &Inputs) -> Result<Outputs, BoardError>;

    /// The forward speed that an autopilot by name steers for, where the pilot wants `wish_mps`; `None` where none is at the
    /// board's line, and the simple one takes the limit from the outputs.
    fn steer(&mut self, now_us: u64, wish_mps: f64) -> Option<f64> {
        let _ = (now_us, wish_mps);
        None
    }
}

impl Board for Controller {
    fn step(&mut self, now_us: u64, inputs: &Inputs) -> Result<Outputs, BoardError> {
        Ok(Self::step(self, now_us, inputs))
    }
}

/// Why a board that is no library cannot fly.
#[derive(Debug, thiserror::Error)]
pub enum BoardError {
    /// The port cannot be opened.
    #[error("cannot open serial port {port}: {source}; ports here: {known}")]
    Open {
        /// Which.
        port: String,
        /// Why.
        source: serialport::Error,
        /// Those that there are.
        known: String,
    },
    /// The line broke.
    #[error("the serial line to the board broke: {0}")]
    Line(#[source] std::io::Error),
    /// Nothing answers.
    #[error(
        "no answer from the board for {seconds} s; does it run the image of `cargo xtask flash --hil`, and is the line on \
         TELEM2?"
    )]
    Silent {
        /// How long.
        seconds: f64,
    },
    /// The peer that watches.
    #[error("the MAVLink connection broke: {0}")]
    Peer(#[source] std::io::Error),
    /// The board understood other parameters than it was given, or they do not fit a message.
    #[error("the board does not take the mission's parameters; its image may be of another version")]
    Parameters,
}

/// How a flight ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Outcome {
    /// The end of the tunnel was reached and the scan stopped.
    Completed,
    /// The board was in Fault, or would not arm, too often; the pilot flew back.
    GaveUp,
    /// The board lost its power.
    PowerLost,
    /// Time ran out.
    OutOfTime,
    /// The vehicle struck the wall.
    Struck,
}

/// What was true, and what the board commanded, at one step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Moment {
    /// From the board's start.
    pub time_s: f64,
    /// The vehicle as it truly was.
    pub vehicle: VehicleState,
    /// The shaft's true section angle.
    pub shaft_rad: f64,
    /// The board's mode.
    pub mode: Mode,
    /// The limit that the board commanded.
    pub limit_mps: Option<f32>,
    /// Where the board believed the vehicle to be in the section.
    pub estimate_m: Option<[f32; 2]>,
    /// Whether the board held its shutter contact closed.
    pub shutter: bool,
}

/// The record of one flight.
#[derive(Clone, Debug)]
pub struct Flight {
    /// The seed.
    pub seed: u64,
    /// How it ended.
    pub outcome: Outcome,
    /// The parameters the board flew with.
    pub parameters: Parameters,
    /// The rig as it was really built.
    pub true_rig: Rig<f64>,
    /// The tunnel as it was.
    pub wall: Wall,
    /// What the board wrote to its log.
    pub entries: Vec<Entry>,
    /// Times at which the board started again; its clock begins anew there.
    pub restarts_s: Vec<f64>,
    /// Every photo that was taken, in order of time.
    pub exposures: Vec<Exposure>,
    /// Times at which the shutter contact was closed.
    pub presses_s: Vec<f64>,
    /// Every step.
    pub moments: Vec<Moment>,
}

/// Builds the tunnel, flies the board's own logic through it and returns the record.
///
/// # Errors
/// [`FlightError`] if the wall cannot be built, or the autopilot has no such mode.
pub fn fly(mission: &Mission, simulation: &Simulation, seed: u64) -> Result<Flight, FlightError> {
    if let Some(kind) = simulation.autopilot.kind.named() {
        let mut board = Linked::new(kind, &mission.parameters(), simulation)?;
        return fly_board(&mut board, mission, simulation, seed);
    }
    let mut controller = Controller::new(mission.parameters());
    fly_board(&mut controller, mission, simulation, seed)
}

/// Why there was no flight, or no end of it.
#[derive(Debug, thiserror::Error)]
pub enum FlightError {
    /// The board.
    #[error(transparent)]
    Board(#[from] BoardError),
    /// The autopilot does not know the mode.
    #[error("{autopilot} has no mode {mode}; it has {known}")]
    Mode {
        /// Which autopilot.
        autopilot: &'static str,
        /// The mode.
        mode: &'static str,
        /// Those that it has.
        known: String,
    },
    /// The profile cannot be built.
    #[error("tunnel: {0}")]
    Profile(#[from] adit_geometry::profile::ProfileError),
    /// The wall cannot be built.
    #[error("{0}")]
    Wall(#[from] WallError),
}

/// As [`fly`], with any board.
///
/// # Errors
/// As [`fly`].
pub fn fly_board(
    board: &mut impl Board,
    mission: &Mission,
    simulation: &Simulation,
    seed: u64,
) -> Result<Flight, FlightError> {
    let parameters = mission.parameters();
    let wall = Wall::new(mission.survey.profile.build()?, &simulation.wall, seed)?;
    let mut world = World::new(wall.clone(), &mission.survey.rig, &parameters, simulation, seed);
    let mut flight = Flight {
        seed,
        outcome: Outcome::OutOfTime,
        parameters,
        true_rig: *world.true_rig(),
        wall,
        entries: Vec::new(),
        restarts_s: Vec::new(),
        exposures: Vec::new(),
        presses_s: Vec::new(),
        moments: Vec::new(),
    };
    let end_x_m = simulation.pilot.start_x_m + mission.flight.length_m;
    let mut pilot = Pilot::new(&simulation.pilot, end_x_m);
    let mut inputs = Inputs::default();
    while world.now_s() < simulation.pilot.most_s {
        if world.faults.holds(FaultKind::PowerLoss, world.now_s()) {
            flight.outcome = Outcome::PowerLost;
            break;
        }
        let now_us = (world.now_s() * 1e6).round() as u64;
        board.feel(now_us, world.vehicle());
        let mut outputs = board.step(now_us, &inputs)?;
        flight.note(&world, &outputs);
        let mut action = match pilot.decide(world.now_s(), outputs.mode, world.vehicle().position_m.x) {
            Ok(action) => action,
            Err(ending) => {
                flight.outcome = match ending {
                    Ending::Completed => Outcome::Completed,
                    Ending::GaveUp => Outcome::GaveUp,
                };
                break;
            }
        };
        if let Some(aim_mps) = board.steer(now_us, action.cruise_mps) {
            outputs.speed_limit_mps = None;
            if !world.faults.holds(FaultKind::LimitIgnored, world.now_s()) {
                action.cruise_mps = aim_mps;
            }
        }
        inputs = world.step(&outputs, action);
        if clearance_m(&world.wall, &world.vehicle().position_m) < VEHICLE_HALF_WIDTH_M {
            flight.outcome = Outcome::Struck;
            break;
        }
    }
    flight.finish(&mut world);
    Ok(flight)
}

impl Flight {
    /// How long the board ran.
    pub fn duration_s(&self) -> f64 {
        self.moments.last().map_or(0.0, |moment| moment.time_s)
    }

    fn note(&mut self, world: &World, outputs: &Outputs) {
        if outputs.shutter && !self.moments.last().is_some_and(|moment| moment.shutter) {
            self.presses_s.push(world.now_s());
        }
        self.entries.extend(outputs.entries.iter().copied());
        self.moments.push(Moment {
            time_s: world.now_s(),
            vehicle: *world.vehicle(),
            shaft_rad: world.shaft_rad(),
            mode: outputs.mode,
            limit_mps: outputs.speed_limit_mps,
            estimate_m: outputs.centring.map(|centring| centring.offset_m),
            shutter: outputs.shutter,
        });
    }

    /// Lets the camera take what it was told to take before the board fell silent.
    fn finish(&mut self, world: &mut World) {
        let until_s = world.now_s() + AFTER_POWER_LOSS_S;
        let dark = Outputs::default();
        while world.now_s() < until_s {
            world.step(&dark, PilotAction::default());
        }
        self.exposures = world.take_exposures();
    }
}

#[cfg(test)]
mod tests;
