//! What moves: air, vehicle, autopilot, shaft and the camera's shutter.

pub mod autopilot;
pub mod camera;
pub mod servo;
pub mod vehicle;
pub mod wind;
