//! Where the vehicle is in the section, from its range sensors.
//!
//! [`paper`] is the paper's own form: a circle, a level vehicle, three ranges, six residuals. [`general`] takes any
//! profile, any beams, any attitude, tells which beams it used and how sure it is. Both agree on a circle (a property test).
//!
//! # The mirror ambiguity
//! Two horizontal ranges cannot tell whether the vehicle is above or below the widest part of the section: both places
//! give the same readings. The upward range decides. Without it, only a previous position can; so the general form takes
//! one as a hint and otherwise says [`general::Centring::Ambiguous`].
//!
//! The downward sensor takes no part: it measures water or sludge. [`general::expected_range_m`] gives the range that it
//! would measure on a dry floor; the difference is the water level.

pub mod general;
pub mod paper;
