//! Features: distinct points of a photo with descriptors, for matching photos of which nothing is known.
//!
//! Two classes. [`sift()`]: extrema of differences of Gaussians with gradient histograms, invariant to scale, brightness
//! and (if asked) rotation; after Otero and Delbracio, "Anatomy of the SIFT Method", IPOL 4 (2014). [`orb()`]: corners by
//! the segment test with binary descriptors, an order of magnitude cheaper; after Rublee et al., "ORB", ICCV 2011.
//! [`nearest`] finds each descriptor's nearest neighbours in another photo.
//!
//! # What a rotating rig gains
//! Its photos all stand the same way up ([`Orientation::Upright`]): no orientation to estimate means fewer wrong ones,
//! more distinctive descriptors and less time. Masked pixels (the vehicle itself, static in every photo) are kept out of
//! a feature's whole support, not of its centre alone: a descriptor half of which shows the vehicle matches the vehicle.

mod brief;
mod describe;
mod fast;
mod integral;
mod nearest;
mod orb;
mod scale_space;
mod sift;
mod spread;
#[cfg(test)]
mod tests;

pub use nearest::{Descriptor, Neighbour, nearest};
pub use orb::{OrbOptions, orb};
pub(crate) use scale_space::{blurred, halved};
pub use sift::{SiftOptions, sift};

/// A gradient histogram, square root of its L1 normalisation ("`RootSIFT`", Arandjelovic and Zisserman, CVPR 2012), times 512.
pub type SiftDescriptor = [u8; 128];

/// 256 comparisons of brightness.
pub type BriefDescriptor = [u64; 4];

/// Whether descriptors turn with the picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Orientation {
    /// All photos stand the same way up, within some 15 degrees.
    Upright,
    /// Any roll: each feature gets the direction (or directions) of its surroundings.
    Free,
}

/// Where a feature is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Keypoint {
    /// Pixel, (0.5, 0.5) = centre of the first pixel.
    pub pixel: [f64; 2],
    /// Standard deviation of the blur at which it stands out, pixels.
    pub scale_px: f32,
    /// Direction, clockwise from the pixel's x axis; 0 if upright.
    pub angle_rad: f32,
    /// How much it stands out; comparable within one photo and class only.
    pub response: f32,
}

/// The features of one photo; keypoints and descriptors by the same index.
#[derive(Clone, Debug, PartialEq)]
pub struct Features<D> {
    /// Where they are, strongest of each part of the photo first.
    pub keypoints: Vec<Keypoint>,
    /// What they look like.
    pub descriptors: Vec<D>,
}
