//! The simulated tunnel as it is, not as the plan says: wall with relief, what is painted on it, water and pipes.
//!
//! Frame `tunnel` everywhere: x forward, y right, z down; metres. Arc length `s` as in [`adit_geometry::profile`].

pub mod noise;
pub mod paint;
pub mod relief;
pub mod wall;

pub use paint::{
    LiningPaint, Paint, PartTexture, Patch, Pattern, PhotoTextureConfig, PhotoTextureError, Rgb, TextureConfig,
};
pub use relief::{BulgeConfig, Relief};
pub use wall::{PipeConfig, Surface, Wall, WallConfig, WallError, WallHit};
