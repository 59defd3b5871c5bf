//! The mathematics that board, simulator and ground share: section profiles, camera models, frames, centring,
//! the speed law and coverage. No clock, no I/O, no allocation; generic over `f32` (board) and `f64` (ground).
//!
//! # Frames
//! `tunnel`: x forward along the axis, y right, z down. `body`: front, right, down. `cam`: x right, y down, z forward.
//! The angle `phi` around the section is 0 at the crown and grows clockwise looking forward:
//! `y = r sin(phi)`, `z = -r cos(phi)`. Image coordinates: (0.5, 0.5) is the centre of the first pixel.
#![cfg_attr(not(test), no_std)]
#![forbid(unsafe_code)]

pub mod angles;
pub mod camera;
pub mod centring;
pub mod charuco;
pub mod coverage;
pub mod profile;
pub mod rig;
mod scalar;
pub mod single;
pub mod speed;

pub use scalar::Real;

/// A point or direction in the tunnel's section, `[y, z]` (right, down) in metres.
pub type SectionVector<T> = nalgebra::Vector2<T>;
