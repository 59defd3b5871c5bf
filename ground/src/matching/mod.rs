//! Guided matching: where does each photo see what another one saw, given roughly known poses and the section.
//!
//! # Method
//! Each photo is laid once per round onto a common grid of the wall, (arc length s, distance x), with the best poses so
//! far. There all photos look alike up to a small displacement: no scale, hardly any rotation or perspective is left, so
//! a plain template search finds it. Of the grey image's logarithm (exposure becomes an offset) a band is kept and
//! its local contrast made even. In each cell of the wall every photo chooses its best corner as reference point; the
//! template around it is searched, in both directions, in every photo whose footprint overlaps enough. The peak's place
//! comes from a quadratic through nine correlations. What survives is that which agrees with one small motion of the
//! pair's two cameras. Every match goes back to pixels of the original photos through the pose it was
//! rectified with and the exact camera model, so nothing of the grid's approximations stays in the result.
//!
//! Two rounds with an adjustment after each: [`MatchConfig::wide`], then [`MatchConfig::fine`].
//!
//! # Parameters that matter, and why
//! - *Search window* at least 2.5 to 3 standard deviations of the prior's displacement: a window too small does not fail
//!   loudly, it finds the neighbouring brick and everything still fits.
//! - *Template* of about 25 cm, larger than a brick, so that grain, stains and brightness of single bricks decide among
//!   repetitions; smaller ones also lose accuracy (a third at 10 cm).
//! - *Both rounds*: re-rectifying with better poses at the photos' own resolution gains a factor of four.
//! - *Every overlapping pair*: neighbours of the next turn are worth a factor of five over consecutive photos alone.
//! - *Band*: low frequencies carry the lamp and the vignetting, which move with the camera; they mislead. In the fine round
//!   0.6 to 6 texels beats 1 to 12 (concrete: pose error 0.27 mm instead of 0.43).
//! - *Sub-pixel peak*: the quadratic is enough. Refining on grey values (Lucas and Kanade, three steps, cubic) was
//!   tried: poses came out 0.02 to 0.08 mm worse on the three sample sets.
//! - *Search after probes*: once a few points of a pair clearly agree on a motion, the others are searched for near it only;
//!   a third of the cost, and fewer strays.
//! - *Gate*: leaves room for parallax, since a real wall is not the nominal section: `baseline / distance * relief`.
//!
//! # Walls that repeat themselves
//! Among bricks that are all alike, the best place in a window of 2.5 standard deviations is any brick's. A photo is held for
//! such a wall if most of its templates are found a second time in the photo itself, with a correlation of 0.85 at 6 to 30 cm
//! (at most 44 % of a photo's templates in ordinary brick, concrete, tiles and the underpass; at least 74 % in identical bricks). Of such photos a second,
//! blurred level is kept, 5 cm a texel, in a band of 6 to 40 cm in which bricks vanish and stains are blobs: matched in the
//! same way with templates of a metre, it says where the pair is to some centimetres. The pair's points are then searched for
//! no farther from their prediction than half a repetition, starting where the blurred matches predict within a fifth of it,
//! and growing from what is found. A pair whose blurred level says nothing clear is not searched at all but named as too
//! uncertain, until the poses are known to less than half a repetition; matches that contradict the blurred ones are dropped.
//! Two parameters decide: the *blur* must hide the repetition (a bond of bricks has nothing above 12.5 cm, tiles of 20 cm leave
//! a little), and the *floor of contrast* must be well above what lamp and vignetting leave in that band (0.004 of the logarithm on
//! a bare wall, 0.03 with stains), since they move with the camera.
//!
//! # Limits
//! Repetitions closer than 6 cm, or farther than 30 cm within the window, are not looked for. Occlusion is known only from
//! the section itself; whatever else stands in view belongs into the masks. A wall without any texture gives no reference
//! points. Relief bends the templates: beyond some `template * slope` matches thin out.
//!
//! # Memory and cost
//! About 1.3 bytes per texel for each photo held (the band is rounded to bytes, whose products are summed in whole numbers); a
//! photo is held from its own turn, which comes while the pairs before are searched, until its last partner's. Measured with two
//! threads on two cores of an EPYC (Zen 4), 50 photos of 0.75 megapixels with eight partners each, decoding and a first adjustment
//! included: 9 ms a photo in the coarse round, 9 ms in the fine one. What is wide or summed over boxes is worked out on averages of
//! 4 x 4 texels; wide windows are searched at half the resolution first, at a tenth of the cost. See `benches/ground.rs`.

mod coherence;
mod config;
mod filter;
mod level;
mod pairs;
mod patch;
mod rectify;
mod repeats;
mod round;
mod search;
mod texels;
mod wall;

use std::sync::Arc;

use nalgebra::{Isometry3, Point3};

pub use config::MatchConfig;
pub use round::match_round;

use crate::adjust::Tracks;
use crate::raster::{Luma, Mask};

/// A photo's pose as known before the round, with its uncertainty.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct ViewPose {
    /// The pose.
    pub tunnel_from_cam: Isometry3<f64>,
    /// One standard deviation of the optical centre along the tunnel's axes, metres: the photo's own part.
    pub position_sigma_m: [f64; 3],
    /// One standard deviation of the rotation about the tunnel's axes, radians.
    pub rotation_sigma_rad: [f64; 3],
    /// The part of x that is uncertain in common with the neighbours, such as an odometer's scale times the way gone: the
    /// difference between two photos is one more standard deviation of their distance along the axis.
    pub drift_m: f64,
}

impl ViewPose {
    /// Optical centre in the tunnel frame.
    pub(crate) fn centre(&self) -> Point3<f64> {
        Point3::from(self.tunnel_from_cam.translation.vector)
    }
}

/// A decoded photo, with what its mask hides; a copy shares its pixels.
#[derive(Clone, Debug)]
pub struct Pixels {
    grey: Arc<Luma>,
    masked: bool,
}

impl Pixels {
    /// Grey values 0 to 255 of a photo of the camera's size, all of them shown.
    pub fn new(grey: Luma) -> Self {
        Self { grey: Arc::new(grey), masked: false }
    }

    /// The same with a mask (of the photo's size, else `None`), which is laid into it: grey value 0 is what it hides, black
    /// becomes 1.
    pub fn with_mask(mut grey: Luma, mask: &Mask) -> Option<Self> {
        if (grey.width, grey.height) != (mask.width, mask.height) {
            return None;
        }
        for (grey, &mask) in grey.data.iter_mut().zip(&mask.data) {
            *grey = if mask < 128 { 0 } else { (*grey).max(1) };
        }
        Some(Self { grey: Arc::new(grey), masked: true })
    }

    /// Grey values; with a mask 0 is hidden.
    pub fn grey(&self) -> &Luma {
        &self.grey
    }

    /// Has a mask.
    pub fn is_masked(&self) -> bool {
        self.masked
    }
}

/// Where photos come from; asked once per photo and round, from several threads, roughly in order.
pub trait Photos: Sync {
    /// Returns photo number `photo`, or `None` if it cannot be read.
    fn load(&self, photo: usize) -> Option<Pixels>;
}

impl Photos for [Pixels] {
    fn load(&self, photo: usize) -> Option<Pixels> {
        self.get(photo).cloned()
    }
}

/// What became of a pair that should overlap.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct PairReport {
    /// The earlier photo.
    pub first: u32,
    /// The later photo.
    pub second: u32,
    /// Shared part of the smaller footprint, by the poses.
    pub overlap: f64,
    /// Reference points, of both, that the other should see.
    pub attempted: u32,
    /// Of these, found with enough correlation.
    pub matched: u32,
    /// Of these, in agreement with one motion of the pair.
    pub agreeing: u32,
    /// Enough agree: the matches were used.
    pub kept: bool,
    /// The search was repeated in a wider window.
    pub widened: bool,
    /// Median of what the agreeing matches say: place found by the second photo minus place in the first, `[s, x]` metres.
    pub shift_m: [f64; 2],
    /// Not searched at all: the poses are too uncertain against each other for the greatest window, or for a wall that repeats
    /// itself and shows nothing else.
    pub too_uncertain: bool,
}

impl PairReport {
    /// Should overlap, yet was not kept, or fewer than half of its matches agree: the mark of a photo that slipped.
    pub fn is_doubtful(&self) -> bool {
        !self.kept || 2 * self.agreeing < self.matched
    }
}

/// Result of a round.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct MatchRound {
    /// Reference points that another photo found, where they lie on the section by the round's poses. The first observation of
    /// each is the reference itself; then come the photos that found it.
    pub tracks: Tracks,
    /// Every pair that should overlap.
    pub pairs: Vec<PairReport>,
    /// Photos that took no part: unreadable, of another size than the camera's, or with no wall in view by their pose.
    pub unusable: Vec<u32>,
}
