//! The simulated tunnel as it is, not as the plan says: wall with relief, what is painted on it, water and pipes.
//!
//! Frame `tunnel` everywhere: x forward, y right, z down; metres. Arc length `s` as in [`adit_geometry::profile`].

pub mod noise;
pub mod relief;
pub mod wall;

pub use relief::{BulgeConfig, Relief};
pub use wall::{PipeConfig, Surface, Wall, WallConfig, WallError, WallHit};
