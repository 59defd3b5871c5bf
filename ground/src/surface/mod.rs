//! The wall as it is: a height over the section's profile, measured from the photos.
//!
//! Coordinates stay those of `reconstruction.profile` (the panorama's grid): arc length s and station x. The wall point is
//! `profile.at(s)` moved inwards along the profile's normal by `height_m(s, x)`, which has two parts: what rings do as a
//! whole (radius, shift, ovality; offset and tilt of planar parts), and the relief, which is everything else.
//! Model limit: a single-valued height, so pipes and brackets before the wall are at best bumps of it; across a corner of
//! the section faces that moved may overlap or gape by what they moved.

mod error;
mod ring;
mod store;

pub use error::SurfaceError;
pub use ring::Rings;
pub use store::{SurfaceStore, SurfaceWindow, WallPlace};
