//! An emulated Pixracer that runs the rotator's flash image, byte for byte, in lockstep with the simulated world.
//!
//! [`EmulatedBoard`] is a [`Board`](adit_hil_sim::flight::Board) of the simulator: the loop that flies the board's logic
//! flies the image too. The microcontroller is the crate `rigless`'s STM32F427; the chips around it are [`machine`]'s. Time
//! is virtual and counts instructions: same image, same world, same seed give the same flight.
#![forbid(unsafe_code)]

mod board;
pub mod costs;
mod equipment;
mod faults;
mod flood;
mod hub;
mod log;
mod machine;
mod mend;
mod provision;
mod report;
mod run;
pub mod serve;
mod vehicle_link;
mod watched;

pub use board::{EmulatedBoard, EmulatorError, Setup};
pub use faults::{BoardFault, BoardFaultKind};
pub use log::{CardLog, log_of};
pub use machine::{BlockImage, BlockWrite, FRAM_BYTES, FramWrite, Pins, RangerMisuse, VolumeError};
pub use provision::{BeyondFram, keyed_fram, parameters_in, provisioned_fram};
pub use report::{Report, Restart, RestartCause};
pub use run::RunError;
pub use watched::Watched;
