//! An emulated Pixracer that runs the rotator's flash image, byte for byte, in lockstep with the simulated world.
#![forbid(unsafe_code)]

mod machine;
