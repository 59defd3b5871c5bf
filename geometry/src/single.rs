//! The board's arithmetic in single precision, as functions that are no longer generic.
//!
//! A generic function is compiled where it is used, for the flash image with its caller's wish to be small. These are compiled
//! here, with this crate's wish to be fast: 16,000 instructions for a centring instead of 26,000.

use nalgebra::UnitQuaternion;

use crate::SectionVector;
use crate::centring::general::{self, Beam, Centring, Search};
use crate::profile::Profile;

/// [`general::locate_near`].
#[inline(never)]
pub fn locate_near(
    profile: &Profile<f32>,
    beams: &[Beam<f32>],
    tunnel_from_body: &UnitQuaternion<f32>,
    hint_m: SectionVector<f32>,
) -> Option<Centring<f32>> {
    general::locate_near(profile, beams, tunnel_from_body, hint_m)
}

/// [`Search::advance`].
#[inline(never)]
pub fn advance(search: &mut Search<f32>, profile: &Profile<f32>) -> Option<Centring<f32>> {
    search.advance(profile)
}

/// [`general::expected_range_m`].
#[inline(never)]
pub fn expected_range_m(
    profile: &Profile<f32>,
    beam: &Beam<f32>,
    tunnel_from_body: &UnitQuaternion<f32>,
    offset_m: SectionVector<f32>,
) -> Option<f32> {
    general::expected_range_m(profile, beam, tunnel_from_body, offset_m)
}
