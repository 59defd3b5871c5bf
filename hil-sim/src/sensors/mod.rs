//! What measures: ranges, attitude and odometry, the shaft's encoder.

pub mod encoder;
pub mod navigation;
pub mod range;
