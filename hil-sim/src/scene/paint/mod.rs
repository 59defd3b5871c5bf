//! What is painted on the wall: albedo as a function of arc length and station.
//!
//! Every pattern is a function of seed and place alone, closed around the section (s wraps at the crown), and
//! band-limited: it gets the size of the patch it is asked for and leaves out or averages what is finer.
//! Albedo is linear RGB in `[0, 1]`.

mod brick;
mod concrete;
mod fittings;
mod lattice;
mod panorama;
mod photo;
mod tiles;

use std::path::Path;

use adit_geometry::profile::{Part, Profile};
use serde::{Deserialize, Serialize};

use super::noise;
use brick::Brick;
use concrete::Concrete;
pub(crate) use fittings::Fittings;
use panorama::Panorama;
use photo::PhotoTexture;
pub use photo::{PhotoTextureConfig, PhotoTextureError};
use tiles::Tiles;

/// Linear RGB.
pub type Rgb = [f32; 3];

/// A patch of wall.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Patch {
    /// Arc length of its centre.
    pub s_m: f64,
    /// Station of its centre.
    pub x_m: f64,
    /// Its size along the section.
    pub size_s_m: f32,
    /// Its size along the tunnel.
    pub size_x_m: f32,
}

impl Patch {
    /// The larger of its sizes.
    fn size_m(&self) -> f32 {
        self.size_s_m.max(self.size_x_m)
    }
}

/// Anything that can say what colour the wall has.
pub trait Paint: Send + Sync {
    /// Returns the mean albedo of `whole`, judged by equal samples in it.
    ///
    /// Edges and fine grain are taken at each of the samples, coarse tones once in the middle of `whole`.
    fn mean_albedo(&self, whole: &Patch, samples: &[Patch]) -> Rgb;

    /// Returns the mean albedo of a patch by a single sample.
    fn albedo(&self, patch: &Patch) -> Rgb {
        self.mean_albedo(patch, std::slice::from_ref(patch))
    }
}

/// Mean of a colour over samples.
fn mean(samples: &[Patch], colour: impl Fn(&Patch) -> Rgb) -> Rgb {
    let mut sum = [0.0; 3];
    for sample in samples {
        for (sum, value) in sum.iter_mut().zip(colour(sample)) {
            *sum += value.clamp(0.0, 1.0);
        }
    }
    sum.map(|value| value / samples.len() as f32)
}

/// Kinds of lining.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Pattern {
    /// Brick in half bond, courses along the tunnel.
    #[default]
    Brick,
    /// A colourful picture with structure at all scales, as when a panorama photo is hung on the wall.
    Panorama,
    /// Cast concrete: little texture, formwork joints, pores, cracks, stains.
    Concrete,
    /// Glazed tiles, nearly alike.
    Tiles,
    /// A picture file.
    Photo,
    /// Brick without any difference from one to the next but a few stains: the worst case of repeated structure.
    IdenticalBrick,
}

/// What the mission file's `[simulation.texture]` says.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct TextureConfig {
    /// Of the lining where `parts` says nothing.
    pub pattern: Pattern,
    /// The picture for `pattern = "photo"`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub photo: Option<PhotoTextureConfig>,
    /// Other patterns for named parts.
    pub parts: Vec<PartTexture>,
}

/// The pattern of one part of the lining.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PartTexture {
    /// Which part.
    pub part: Part,
    /// Its pattern.
    pub pattern: Pattern,
}

/// The paint of a whole lining, part by part.
pub struct LiningPaint {
    /// Start of each piece in arc length and the number of its paint, in order of arc length.
    pieces: Vec<(f64, usize)>,
    paints: Vec<Box<dyn Paint>>,
    perimeter_m: f64,
}

impl LiningPaint {
    /// Prepares the paint of a lining; photo paths are relative to `folder`.
    ///
    /// # Errors
    /// [`PhotoTextureError`] if a picture is asked for and cannot be read.
    pub fn new(
        profile: &Profile<f64>,
        config: &TextureConfig,
        folder: &Path,
        seed: u64,
    ) -> Result<Self, PhotoTextureError> {
        let perimeter_m = profile.perimeter_m();
        let mut patterns: Vec<Pattern> = Vec::new();
        let mut pieces = Vec::new();
        for piece in profile.pieces() {
            let special = config.parts.iter().find(|texture| texture.part == piece.part());
            let pattern = special.map_or(config.pattern, |texture| texture.pattern);
            let index = patterns.iter().position(|known| *known == pattern).unwrap_or_else(|| {
                patterns.push(pattern);
                patterns.len() - 1
            });
            pieces.push((piece.start_s_m(), index));
        }
        let paints = patterns
            .into_iter()
            .map(|pattern| paint(pattern, config, perimeter_m, folder, seed))
            .collect::<Result<_, _>>()?;
        Ok(Self { pieces, paints, perimeter_m })
    }
}

impl Paint for LiningPaint {
    fn mean_albedo(&self, whole: &Patch, samples: &[Patch]) -> Rgb {
        let index = if self.paints.len() == 1 {
            0
        } else {
            let s_m = whole.s_m.rem_euclid(self.perimeter_m);
            self.pieces.iter().rev().find(|(start_s_m, _)| *start_s_m <= s_m).map_or(0, |(_, index)| *index)
        };
        self.paints.get(index).map_or([0.5; 3], |paint| paint.mean_albedo(whole, samples))
    }
}

fn paint(
    pattern: Pattern,
    config: &TextureConfig,
    perimeter_m: f64,
    folder: &Path,
    seed: u64,
) -> Result<Box<dyn Paint>, PhotoTextureError> {
    let seed = noise::derive_seed(seed, 0x10 + pattern as u64);
    Ok(match pattern {
        Pattern::Brick => Box::new(Brick::new(perimeter_m, seed)),
        Pattern::IdenticalBrick => Box::new(Brick::identical(perimeter_m, seed)),
        Pattern::Panorama => Box::new(Panorama::new(perimeter_m, seed)),
        Pattern::Concrete => Box::new(Concrete::new(perimeter_m, seed)),
        Pattern::Tiles => Box::new(Tiles::new(perimeter_m, seed)),
        Pattern::Photo => {
            let photo = config.photo.as_ref().ok_or(PhotoTextureError::NotGiven)?;
            Box::new(PhotoTexture::open(photo, perimeter_m, folder)?)
        }
    })
}

/// A colour given by its 8-bit sRGB values, as linear RGB.
pub(crate) fn linear_of_srgb(srgb: [u8; 3]) -> Rgb {
    srgb.map(|value| {
        let share = f32::from(value) / 255.0;
        if share <= 0.04045 { share / 12.92 } else { ((share + 0.055) / 1.055).powf(2.4) }
    })
}

/// The sRGB value in `[0, 1]` of a linear intensity; clips.
pub(crate) fn srgb_of_linear(linear: f32) -> f32 {
    let linear = linear.clamp(0.0, 1.0);
    if linear <= 0.003_130_8 { linear * 12.92 } else { 1.055 * linear.powf(1.0 / 2.4) - 0.055 }
}

fn blend(from: Rgb, to: Rgb, share: f32) -> Rgb {
    std::array::from_fn(|channel| from[channel] + (to[channel] - from[channel]) * share)
}

fn scale(colour: Rgb, factor: f32) -> Rgb {
    colour.map(|value| value * factor)
}

#[cfg(test)]
mod tests;
