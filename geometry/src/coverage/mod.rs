//! What a helix of images sees of the wall, and the largest advance per image that leaves no hole: the exact bound.
//!
//! # Model
//! The vehicle flies level along the axis at a fixed offset; the shaft turns by `2 pi / n` from one image to the next, and the
//! vehicle advances by `d`. Image `k` of turn `t` is taken at `x = (t n + k) d`. A line of the wall along the axis, at arc
//! length `s`, is seen by image `k` of every turn over one interval of x, which the [`Footprint`] gives; so along the line
//! coverage is a pattern of at most `n` intervals that repeats every `n d`. The number of views can fall only where an
//! interval ends; counting there tells exactly whether every point of the line has enough.
//! # Limits
//! Attitude errors, gusts between images and missed photos are the caller's margin. Parts of an image that a straight line
//! from its viewing direction along the axis does not reach (slivers beside a curved or tilted edge) count as unseen: the
//! bound is up to 2 % on the safe side there, and in exchange every smaller advance is known to be safe too.

mod footprint;
mod resolution;
mod step;

pub use footprint::{FOOTPRINT_SAMPLES, Footprint, FootprintError, FootprintSurvey};
pub use resolution::{Resolution, resolution};
pub use step::{StepBound, max_step};

use crate::profile::{Profile, SurfacePoint};
use crate::rig::Rig;
use crate::{Real, SectionVector, angles};

/// The most images per turn (5.6 degrees from one to the next).
pub const MAX_IMAGES_PER_TURN: usize = 64;

/// A flight whose coverage is asked for.
#[derive(Clone, Debug)]
pub struct Scene<'a, T: Real> {
    profile: &'a Profile<T>,
    footprint: &'a Footprint<T>,
    stations: heapless::Vec<Station<T>, MAX_IMAGES_PER_TURN>,
    convex: bool,
    /// Cosine of the widest angle around the section at which an image sees.
    least_cos: T,
}

/// One image of a turn: where its optical centre is in the section, and its viewing direction.
#[derive(Clone, Copy, Debug)]
struct Station<T> {
    centre_m: SectionVector<T>,
    outward: SectionVector<T>,
}

/// What cannot be computed.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum CoverageError {
    /// The shaft takes no image, or more than [`MAX_IMAGES_PER_TURN`].
    #[error("{given} images per turn; expected 1 to {MAX_IMAGES_PER_TURN}")]
    ImagesPerTurn {
        /// What was given.
        given: u16,
    },
    /// Zero views are no condition.
    #[error("0 views asked for; expected at least 1")]
    NoViews,
    /// A position or angle is not a number.
    #[error("the position or the shaft angle is not a number")]
    NotANumber,
}

/// The stretch of a wall line that one image of each turn sees.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct View<T> {
    /// Number of the image within its turn, from 0.
    pub image: u16,
    /// Where it begins, ahead of the image's optical centre; zero or negative.
    pub from_m: T,
    /// Where it ends, ahead of the image's optical centre; zero or positive.
    pub to_m: T,
}

/// A line of the wall along the axis, and the images of a turn that see it.
#[derive(Clone, Debug)]
pub struct WallLine<T> {
    /// The wall point the line runs through.
    pub surface: SurfacePoint<T>,
    /// One entry for each image of the turn that sees the line.
    pub views: heapless::Vec<View<T>, MAX_IMAGES_PER_TURN>,
    images_per_turn: u16,
}

impl<'a, T: Real> Scene<'a, T> {
    /// Describes a level flight at `offset_m` (body origin, `[y, z]`), image 0 of each turn at `first_shaft_rad`.
    ///
    /// # Errors
    /// [`CoverageError`] if the rig takes no or too many images per turn, or for NaN.
    pub fn new(
        profile: &'a Profile<T>,
        footprint: &'a Footprint<T>,
        rig: &Rig<T>,
        offset_m: SectionVector<T>,
        first_shaft_rad: T,
    ) -> Result<Self, CoverageError> {
        let given = rig.images_per_turn;
        if !(offset_m.norm().is_finite() && first_shaft_rad.is_finite() && rig.lever_radial_m.is_finite()) {
            return Err(CoverageError::NotANumber);
        }
        let mut stations = heapless::Vec::new();
        for image in 0..given {
            let (sin, cos) = angles::shaft_angle_rad(first_shaft_rad, u32::from(image), given).sin_cos();
            let outward = SectionVector::new(sin, -cos);
            let station = Station { centre_m: offset_m + outward * rig.lever_radial_m, outward };
            stations.push(station).map_err(|_| CoverageError::ImagesPerTurn { given })?;
        }
        if stations.is_empty() {
            return Err(CoverageError::ImagesPerTurn { given });
        }
        let [from_rad, to_rad] = footprint.around_rad();
        let least_cos = from_rad.abs().max(to_rad.abs()).cos() - T::of(1e-4);
        Ok(Self { profile, footprint, stations, convex: profile.is_convex(), least_cos })
    }

    /// Returns which images of a turn see the wall line at arc length `s_m`, and how much of it. `None` only for NaN.
    pub fn wall_line(&self, s_m: T) -> Option<WallLine<T>> {
        let surface = self.profile.at(s_m)?;
        let mut views = heapless::Vec::new();
        for (image, station) in self.stations.iter().enumerate() {
            if let Some([from_m, to_m]) = self.interval(station, &surface) {
                // As many places as there are stations.
                let _ = views.push(View { image: image as u16, from_m, to_m });
            }
        }
        Some(WallLine { surface, views, images_per_turn: self.images_per_turn() })
    }

    fn images_per_turn(&self) -> u16 {
        self.stations.len() as u16
    }

    /// The stretch of the wall line through `surface` that a station sees, ahead of its optical centre.
    fn interval(&self, station: &Station<T>, surface: &SurfacePoint<T>) -> Option<[T; 2]> {
        let to_wall = surface.point - station.centre_m;
        let distance_m = to_wall.norm();
        let ahead_m = station.outward.dot(&to_wall);
        // Most lines are beyond the image's sides: told without a trigonometric function.
        if ahead_m < self.least_cos * distance_m || to_wall.dot(&surface.normal) >= T::zero() {
            return None;
        }
        let around_rad = station.outward.perp(&to_wall).atan2(ahead_m);
        let [backward, forward] = self.footprint.slopes(around_rad)?;
        if !self.convex {
            let first = self.profile.ray_cast(station.centre_m, to_wall)?;
            if first.distance < T::one() - T::of(1e-3) {
                return None;
            }
        }
        Some([backward * distance_m, forward * distance_m])
    }
}

impl<T: Real> WallLine<T> {
    /// Returns how many images of an endless flight see the line's point at `x_m`, counted from image 0 of a turn.
    ///
    /// Zero if `step_m` is not positive.
    pub fn views_at(&self, step_m: T, x_m: T) -> u32 {
        self.views.iter().map(|view| self.turns(view, step_m, x_m, None)).sum()
    }

    /// Returns how many of the images `0..count` of a flight see the line's point at `x_m`, counted from image 0.
    ///
    /// Zero if `step_m` is not positive.
    pub fn views_at_within(&self, step_m: T, x_m: T, count: u32) -> u32 {
        self.views.iter().map(|view| self.turns(view, step_m, x_m, Some(count))).sum()
    }

    /// The number of turns whose image `view.image` sees `x_m`: `from <= x - (t n + k) d <= to`.
    fn turns(&self, view: &View<T>, step_m: T, x_m: T, count: Option<u32>) -> u32 {
        let period_m = step_m * T::count(u32::from(self.images_per_turn));
        if period_m <= T::zero() || !x_m.is_finite() {
            return 0;
        }
        let ahead_m = x_m - step_m * T::count(u32::from(view.image));
        let mut first = ((ahead_m - view.to_m) / period_m).ceil();
        let mut last = ((ahead_m - view.from_m) / period_m).floor();
        if let Some(count) = count {
            // Turns 0 .. of which image k exists: t n + k < count.
            let Some(left) = count.checked_sub(u32::from(view.image) + 1) else { return 0 };
            first = first.max(T::zero());
            last = last.min(T::count(left / u32::from(self.images_per_turn)));
        }
        (last - first + T::one()).to_index() as u32
    }
}
