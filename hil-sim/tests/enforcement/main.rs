//! The speed limit against what autopilots really do: the board's own link at one end of a line, an autopilot by name at the
//! other, every mode, and what goes wrong on the way. The checker reads the true speed and does its own arithmetic.

mod board_side;
mod cell;
mod course;
mod facts;
mod judge;
mod matrix;
mod vehicle;
