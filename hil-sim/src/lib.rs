//! The simulated world around the rotator board: tunnel, vehicle, sensors, camera. It flies the board's own logic in
//! virtual time and leaves what a real flight leaves.
#![forbid(unsafe_code)]

pub mod scene;
