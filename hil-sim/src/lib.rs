//! The simulated world around the rotator board: tunnel, vehicle, sensors, camera. It flies the board's own logic in
//! virtual time and leaves what a real flight leaves.
#![forbid(unsafe_code)]

pub mod autopilot;
pub mod board;
pub mod card;
pub mod check;
pub mod command;
pub mod config;
pub mod faults;
pub mod flight;
pub mod peer;
pub mod plant;
pub mod render;
pub mod scene;
pub mod seed;
pub mod sensors;
pub mod serial_board;
pub mod survey;
pub mod tunnel;
pub mod world;
