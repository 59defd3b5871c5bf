//! Whole flights through the programs themselves: fly, ingest, reconstruct, evaluate; kills; bad input; independent samples.

mod bad_input;
mod calibration;
mod flight;
mod killed;
mod programs;
mod samples;
mod sets;
