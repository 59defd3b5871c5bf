//! Whole flights through the programs themselves: fly, ingest, reconstruct, evaluate; kills; bad input; independent samples.

mod bad_input;
mod flight;
mod killed;
#[cfg(unix)]
mod live;
mod programs;
mod samples;
mod sets;
