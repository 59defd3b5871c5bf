//! What one image sees, as seen from the shaft: the camera's field of view in section angle and advance.

use nalgebra::Vector3;

use crate::Real;
use crate::camera::Camera;
use crate::rig::Rig;
use crate::speed::FieldOfView;

/// Entries of the footprint's table.
pub const FOOTPRINT_SAMPLES: usize = 129;
/// Steps of the search for the image's border; after that it is bisected.
const COARSE_STEP_RAD: f64 = 0.03;
/// No image reaches farther along the axis than this slope (85 degrees).
const MAX_ALONG_RAD: f64 = 1.4835;
/// Halvings of the coarse step: 0.03 rad / 2^16 is 0.5 microradians, finer than single precision sees.
const HALVINGS: u32 = 16;

/// The part of the wall that one image sees.
///
/// For each angle around the section, against the shaft's viewing direction and clockwise looking forward, the slopes
/// `[backward, forward]` between which it sees: metres along the axis per metre of distance in the section.
#[derive(Clone, Debug, PartialEq)]
pub struct Footprint<T> {
    from_rad: T,
    to_rad: T,
    slopes: [[T; 2]; FOOTPRINT_SAMPLES],
}

/// Why a camera has no footprint.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum FootprintError {
    /// The image does not show the point that the shaft points the camera at.
    #[error("the camera's image does not contain the shaft's viewing direction; check principal point and mounting")]
    AxisNotSeen,
    /// A field of view is not between 0 and 180 degrees.
    #[error("a field of view is not between 0 and pi")]
    FieldOfView,
}

impl<T: Real> Footprint<T> {
    /// The footprint of a camera without distortion and perfectly mounted.
    ///
    /// # Errors
    /// [`FootprintError::FieldOfView`] if an angle is not between 0 and pi.
    pub fn rectangular(view: FieldOfView<T>) -> Result<Self, FootprintError> {
        let valid = |angle: T| angle > T::zero() && angle < T::pi();
        if !valid(view.around_rad) || !valid(view.along_rad) {
            return Err(FootprintError::FieldOfView);
        }
        let half = T::of(0.5);
        let tangent = (view.along_rad * half).tan();
        Ok(Self::tabulate(-view.around_rad * half, view.around_rad * half, |around_rad| {
            let slope = tangent * around_rad.cos();
            [-slope, slope]
        }))
    }

    /// The footprint of a real camera on its rig: distortion, `image_up` and mounting error included.
    ///
    /// `margin_px` of the image's border are not counted. About 10,000 projections: once, not in a control loop.
    ///
    /// # Errors
    /// [`FootprintError::AxisNotSeen`] if the viewing direction itself is not in the image.
    pub fn of_camera(camera: &Camera<T>, rig: &Rig<T>, margin_px: T) -> Result<Self, FootprintError> {
        let cam_from_body = rig.body_from_cam(T::zero()).rotation.inverse();
        let sees = |around_rad: T, along_rad: T| {
            let (sin, cos) = around_rad.sin_cos();
            let direction_in_body = Vector3::new(along_rad.tan(), sin, -cos);
            let pixel = camera.project(&(cam_from_body * direction_in_body));
            pixel.is_some_and(|pixel| camera.contains(&pixel, margin_px))
        };
        if !sees(T::zero(), T::zero()) {
            return Err(FootprintError::AxisNotSeen);
        }
        let (step, most_around) = (T::of(COARSE_STEP_RAD), T::pi() * T::of(0.999));
        let to_rad = last_true(step, most_around, |angle| sees(angle, T::zero()));
        let from_rad = -last_true(step, most_around, |angle| sees(-angle, T::zero()));
        Ok(Self::tabulate(from_rad, to_rad, |around_rad| {
            let most_along = T::of(MAX_ALONG_RAD);
            let forward = last_true(step, most_along, |angle| sees(around_rad, angle));
            let backward = last_true(step, most_along, |angle| sees(around_rad, -angle));
            [-backward.tan(), forward.tan()]
        }))
    }

    /// Returns the angles around the section, against the viewing direction, between which the image sees.
    pub fn around_rad(&self) -> [T; 2] {
        [self.from_rad, self.to_rad]
    }

    /// Returns the fields of view that the paper's law takes: twice the smaller half, around the section and along the axis.
    ///
    /// `None` only for a footprint with NaN.
    pub fn field_of_view(&self) -> Option<FieldOfView<T>> {
        let two = T::of(2.0);
        let [backward, forward] = self.slopes(T::zero())?;
        Some(FieldOfView {
            around_rad: two * self.to_rad.min(-self.from_rad),
            along_rad: two * forward.min(-backward).atan(),
        })
    }

    /// Returns the slopes `[backward, forward]` between which the image sees at an angle around the section.
    ///
    /// `None` outside [`Self::around_rad`]. Backward is zero or negative, forward zero or positive.
    pub fn slopes(&self, around_rad: T) -> Option<[T; 2]> {
        // A rounding error at the very edge is not outside.
        let slack = T::default_epsilon() * T::of(8.0);
        if !(around_rad >= self.from_rad - slack && around_rad <= self.to_rad + slack) {
            return None;
        }
        let cells = T::count(FOOTPRINT_SAMPLES as u32 - 1);
        let place = ((around_rad - self.from_rad) / (self.to_rad - self.from_rad) * cells).max(T::zero()).min(cells);
        let cell = place.floor().min(cells - T::one());
        let share = place - cell;
        let index = cell.to_index();
        let (low, high) = (self.slopes.get(index)?, self.slopes.get(index + 1)?);
        Some([low[0] + (high[0] - low[0]) * share, low[1] + (high[1] - low[1]) * share])
    }

    fn tabulate(from_rad: T, to_rad: T, slopes_at: impl Fn(T) -> [T; 2]) -> Self {
        let cells = T::count(FOOTPRINT_SAMPLES as u32 - 1);
        let slopes = core::array::from_fn(|i| {
            // The ends are the image's border itself, where rounding would decide: a hair inside.
            let share = (T::count(i as u32) / cells).max(T::of(1e-6)).min(T::one() - T::of(1e-6));
            slopes_at(from_rad + (to_rad - from_rad) * share)
        });
        Self { from_rad, to_rad, slopes }
    }
}

/// The last angle up to which `holds` is true, walking up from zero where it is.
fn last_true<T: Real>(step: T, most: T, holds: impl Fn(T) -> bool) -> T {
    let mut low = T::zero();
    while low < most && holds(low + step) {
        low += step;
    }
    if low >= most {
        return most;
    }
    let mut width = step;
    for _ in 0..HALVINGS {
        width *= T::of(0.5);
        if holds(low + width) {
            low += width;
        }
    }
    low.min(most)
}
