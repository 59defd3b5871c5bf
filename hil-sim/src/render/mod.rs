//! The simulated camera: what it sees of the tunnel, the files it writes, and the truth beside them.
//!
//! Per pixel: ray through the lens model, first surface, mean albedo of the patch, lamp, then exposure, vignetting,
//! noise, sRGB, JPEG with EXIF. Every number is a function of seed, photo and place, so the same flight gives the same
//! bytes on any number of threads. Model limits: no shadows, no indirect light but a constant share and the mirror image
//! in water, no depth of field.

pub mod card;
mod cell;
mod config;
mod exif;
mod light;
mod photo;
mod rays;
pub(crate) mod relief;
mod sensor;
pub mod truth;
mod vehicle;
mod view;

pub use config::{LightConfig, LightMount, RenderConfig, RenderError, SensorConfig, VehiclePartConfig};
pub use exif::ExifTime;
pub use photo::{PhotoRenderer, RenderedPhoto, RgbImage, Shot};
