//! Whole flights through the programs themselves: fly, ingest, reconstruct, evaluate; kills; bad input; independent samples.

mod agreement;
mod bad_input;
mod bench;
mod calibration;
mod flight;
mod killed;
#[cfg(unix)]
mod live;
mod preflight;
mod programs;
mod samples;
mod sets;
