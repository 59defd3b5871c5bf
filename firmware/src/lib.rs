//! The rotator board's logic: turns the camera shaft, fires the camera, knows where the vehicle is in the section and how
//! fast it may go, and tags every photo.
//!
//! Sans-I/O: [`Controller::step`](controller::Controller::step) is a function of (time, inputs, state). It reads no
//! clock, opens no port, allocates nothing and never panics. The board's tasks and the simulator call the same code.
#![cfg_attr(not(test), no_std)]
#![forbid(unsafe_code)]

pub mod attitude;
mod capture;
pub mod controller;
pub mod drivers;
pub mod health;
pub mod hil;
pub mod io;
pub mod journal;
mod limit;
mod modes;
mod moment;
mod position;
mod ranges;
pub mod recorder;
mod self_test;
mod servo;
mod shaft;
pub mod store;
pub mod table;
mod time;
