//! What one image sees, as seen from the shaft: the camera's field of view in section angle and advance.

use nalgebra::{UnitQuaternion, Vector3};

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
    /// `margin_px` of the image's border are not counted. About 10,000 projections; on the board a [`FootprintSurvey`] spreads them.
    ///
    /// # Errors
    /// [`FootprintError::AxisNotSeen`] if the viewing direction itself is not in the image.
    pub fn of_camera(camera: &Camera<T>, rig: &Rig<T>, margin_px: T) -> Result<Self, FootprintError> {
        let mut survey = FootprintSurvey::new(camera, rig, margin_px)?;
        loop {
            if let Some(footprint) = survey.advance() {
                return Ok(footprint);
            }
        }
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
        let slopes = core::array::from_fn(|index| slopes_at(sample_rad(from_rad, to_rad, index)));
        Self { from_rad, to_rad, slopes }
    }
}

/// Angle of an entry of the table.
fn sample_rad<T: Real>(from_rad: T, to_rad: T, index: usize) -> T {
    let cells = T::count(FOOTPRINT_SAMPLES as u32 - 1);
    // The ends are the image's border itself, where rounding would decide: a hair inside.
    let share = (T::count(index as u32) / cells).max(T::of(1e-6)).min(T::one() - T::of(1e-6));
    from_rad + (to_rad - from_rad) * share
}

/// Entries that one [`FootprintSurvey::advance`] finds: 3 million instructions on the board.
const SAMPLES_AT_ONCE: usize = 12;

/// A footprint on its way: a piece at a time, for the board, where the whole takes a fifth of a second.
#[derive(Clone, Debug)]
pub struct FootprintSurvey<T: Real> {
    camera: Camera<T>,
    cam_from_body: UnitQuaternion<T>,
    margin_px: T,
    from_rad: T,
    to_rad: T,
    slopes: heapless::Vec<[T; 2], FOOTPRINT_SAMPLES>,
}

impl<T: Real> FootprintSurvey<T> {
    /// Begins; arguments and errors as for [`Footprint::of_camera`].
    ///
    /// # Errors
    /// [`FootprintError::AxisNotSeen`] if the viewing direction itself is not in the image.
    pub fn new(camera: &Camera<T>, rig: &Rig<T>, margin_px: T) -> Result<Self, FootprintError> {
        let mut survey = Self {
            camera: *camera,
            cam_from_body: rig.body_from_cam(T::zero()).rotation.inverse(),
            margin_px,
            from_rad: T::zero(),
            to_rad: T::zero(),
            slopes: heapless::Vec::new(),
        };
        if !survey.sees(T::zero(), T::zero()) {
            return Err(FootprintError::AxisNotSeen);
        }
        let most_around = T::pi() * T::of(0.999);
        survey.to_rad = last_true(most_around, |angle| survey.sees(angle, T::zero()));
        survey.from_rad = -last_true(most_around, |angle| survey.sees(-angle, T::zero()));
        Ok(survey)
    }

    /// Goes on by a few entries of the table; returns the footprint when it is complete.
    pub fn advance(&mut self) -> Option<Footprint<T>> {
        for _ in 0..SAMPLES_AT_ONCE {
            let around_rad = sample_rad(self.from_rad, self.to_rad, self.slopes.len());
            let most_along = T::of(MAX_ALONG_RAD);
            let forward = last_true(most_along, |angle| self.sees(around_rad, angle));
            let backward = last_true(most_along, |angle| self.sees(around_rad, -angle));
            if self.slopes.push([-backward.tan(), forward.tan()]).is_err() {
                break;
            }
        }
        let slopes = self.slopes.as_slice().try_into().ok()?;
        Some(Footprint { from_rad: self.from_rad, to_rad: self.to_rad, slopes })
    }

    fn sees(&self, around_rad: T, along_rad: T) -> bool {
        let (sin, cos) = around_rad.sin_cos();
        let direction_in_body = Vector3::new(along_rad.tan(), sin, -cos);
        let pixel = self.camera.project(&(self.cam_from_body * direction_in_body));
        pixel.is_some_and(|pixel| self.camera.contains(&pixel, self.margin_px))
    }
}

/// The last angle up to which `holds` is true, walking up from zero where it is.
fn last_true<T: Real>(most: T, holds: impl Fn(T) -> bool) -> T {
    let (mut low, step) = (T::zero(), T::of(COARSE_STEP_RAD));
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
