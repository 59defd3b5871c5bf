//! The paper's speed law: how far the vehicle may move per turn and per image before a circular lining shows gaps.
//!
//! # Source
//! Pahwa et al., "Dense 3D Reconstruction for Visual Tunnel Inspection using Unmanned Aerial Vehicle", IROS 2019, section
//! "Maximum Speed of UAV". Its symbols: `r` radius, `r1` distance from the centre, `Omega_h` and `Omega_v` fields of view.
//! `Omega_h` is read as the view *around* the section and `Omega_v` as the view *along* the axis; only so do the paper's
//! 101 and 60 degrees, r = 3 m and n = 12 give its 18 cm per image.
//! # Limits
//! One image and its edge decide; what the neighbouring images see counts for nothing. At the centre that is on the safe
//! side (exact bound there for the paper's camera: 0.299 m instead of 0.184 m). Off the centre the law looks at the image
//! that faces the nearest wall, whose edges are not the nearest wall; with four images per turn it allows up to 2 % more
//! than coverage does (a test shows it), from five on it held in every case tried. [`crate::coverage`] has the exact bound,
//! for any profile.

use crate::Real;

/// The angles under which the camera sees, edge to edge through the image centre.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct FieldOfView<T> {
    /// Around the section (the paper's `Omega_h`).
    pub around_rad: T,
    /// Along the axis (the paper's `Omega_v`).
    pub along_rad: T,
}

impl<T: Real> FieldOfView<T> {
    /// The paper's simulated camera: 101 degrees around, 60 along.
    pub fn paper() -> Self {
        let degree = T::pi() / T::of(180.0);
        Self { around_rad: degree * T::of(101.0), along_rad: degree * T::of(60.0) }
    }
}

/// What the paper's law allows at one offset.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PaperStep<T> {
    /// Angle at the tunnel's centre between the viewing direction and the edge of the image (the paper's `theta`).
    pub theta_rad: T,
    /// Largest advance per turn of the shaft (the paper's `d_max`). Zero: no forward motion is allowed here.
    pub per_turn_m: T,
    /// Largest advance from one image to the next (the paper's `d_hat_max`).
    pub per_image_m: T,
}

/// Why no speed can be computed.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum SpeedError {
    /// A quantity is zero, negative or not a number.
    #[error("{name} is {value}; expected a positive number")]
    NotPositive {
        /// Name with unit.
        name: &'static str,
        /// What was given.
        value: f64,
    },
    /// A field of view is not between 0 and 180 degrees.
    #[error("{name} is {value} rad; expected between 0 and pi")]
    FieldOfView {
        /// Name with unit.
        name: &'static str,
        /// What was given.
        value: f64,
    },
    /// The distance from the centre is negative or not a number.
    #[error("the distance from the tunnel's centre is {value} m; expected zero or more")]
    Offset {
        /// What was given.
        value: f64,
    },
    /// The shaft takes no image at all.
    #[error("images per turn is 0; expected at least 1")]
    NoImages,
}

/// Returns the largest advance per turn and per image by the paper's law, at `offset_m` from the centre of a circle.
///
/// # Method
/// `theta = Omega_h / 2 - asin(r1 / r sin(Omega_h / 2))`, `d_max = 2 tan(Omega_v / 2) (r cos(theta) - r1)`,
/// `d_hat_max = d_max / n`; the paper's equations for `theta`, `d_max` and `d_hat_max`, in this order.
/// # Errors
/// [`SpeedError`] for a radius that is not positive, a field of view outside (0, pi), a negative offset, no images, NaN.
/// At the wall or beyond it the answer is zero, not an error.
pub fn paper_step<T: Real>(
    radius_m: T,
    offset_m: T,
    view: FieldOfView<T>,
    images_per_turn: u16,
) -> Result<PaperStep<T>, SpeedError> {
    require_positive("radius_m", radius_m)?;
    require_view("around_rad", view.around_rad)?;
    require_view("along_rad", view.along_rad)?;
    if offset_m < T::zero() || !offset_m.is_finite() {
        return Err(SpeedError::Offset { value: offset_m.to_f64() });
    }
    if images_per_turn == 0 {
        return Err(SpeedError::NoImages);
    }
    let half = T::of(0.5);
    let half_view = view.around_rad * half;
    let share = (offset_m / radius_m).min(T::one());
    let theta_rad = half_view - (share * half_view.sin()).asin();
    let depth_m = (radius_m * theta_rad.cos() - offset_m).max(T::zero());
    let per_turn_m = T::of(2.0) * (view.along_rad * half).tan() * depth_m;
    let per_image_m = per_turn_m / T::count(u32::from(images_per_turn));
    Ok(PaperStep { theta_rad, per_turn_m, per_image_m })
}

/// Returns the speed at which the vehicle advances `step_m` from one image to the next.
///
/// # Errors
/// [`SpeedError::NotPositive`] if the period is not positive or the step is NaN. A step of zero or less gives zero.
pub fn speed_mps<T: Real>(step_m: T, image_period_s: T) -> Result<T, SpeedError> {
    require_positive("image_period_s", image_period_s)?;
    if !step_m.is_finite() {
        return Err(SpeedError::NotPositive { name: "step_m", value: step_m.to_f64() });
    }
    Ok(step_m.max(T::zero()) / image_period_s)
}

fn require_positive<T: Real>(name: &'static str, value: T) -> Result<(), SpeedError> {
    if value > T::zero() && value.is_finite() {
        Ok(())
    } else {
        Err(SpeedError::NotPositive { name, value: value.to_f64() })
    }
}

fn require_view<T: Real>(name: &'static str, value: T) -> Result<(), SpeedError> {
    if value > T::zero() && value < T::pi() {
        Ok(())
    } else {
        Err(SpeedError::FieldOfView { name, value: value.to_f64() })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(offset_m: f64) -> PaperStep<f64> {
        paper_step(3.0, offset_m, FieldOfView::paper(), 12).unwrap()
    }

    #[test]
    fn the_papers_camera_may_move_18_cm_per_image() {
        let step = at(0.0);
        assert!((step.per_image_m - 0.1836).abs() < 5e-5, "{}", step.per_image_m);
        assert!((step.per_turn_m - 2.203).abs() < 5e-4, "{}", step.per_turn_m);
        assert!((step.theta_rad.to_degrees() - 50.5).abs() < 1e-9);
        let single = paper_step(3.0_f32, 0.0, FieldOfView::paper(), 12).unwrap();
        assert!((single.per_image_m - 0.1836).abs() < 5e-5);
    }

    #[test]
    fn farther_from_the_centre_is_slower_down_to_zero_at_the_wall() {
        let mut last = f64::MAX;
        for i in 0..=30 {
            let step = at(f64::from(i) * 0.1).per_turn_m;
            assert!(step < last && step >= 0.0, "offset {i} dm: {step} after {last}");
            last = step;
        }
        assert!(at(3.0).per_turn_m < 1e-12);
        assert_eq!(at(3.5).per_turn_m, 0.0);
    }

    #[test]
    fn the_edge_ray_meets_the_circle_where_theta_says() {
        // The law of sines, checked by walking along the ray itself.
        for offset in [0.0, 0.4, 1.0, 2.0] {
            let half_view = FieldOfView::<f64>::paper().around_rad / 2.0;
            let theta = at(offset).theta_rad;
            let wall = (3.0 * theta.cos(), 3.0 * theta.sin());
            let ray = (wall.1 / (wall.0 - offset)).atan();
            assert!((ray - half_view).abs() < 1e-12, "offset {offset}");
        }
    }

    #[test]
    fn what_is_no_number_gives_no_speed() {
        let view = FieldOfView::<f32>::paper();
        assert!(matches!(paper_step(f32::NAN, 0.0, view, 12), Err(SpeedError::NotPositive { name: "radius_m", .. })));
        assert!(matches!(paper_step(3.0, f32::NAN, view, 12), Err(SpeedError::Offset { .. })));
        assert!(matches!(paper_step(3.0, -0.1, view, 12), Err(SpeedError::Offset { .. })));
        assert_eq!(paper_step(3.0, 0.0, view, 0), Err(SpeedError::NoImages));
        let wide = FieldOfView { along_rad: 4.0, ..view };
        assert!(matches!(paper_step(3.0, 0.0, wide, 12), Err(SpeedError::FieldOfView { name: "along_rad", .. })));
        assert!(speed_mps(f32::NAN, 1.0).is_err());
        assert!(speed_mps(0.1, 0.0_f32).is_err());
        assert_eq!(speed_mps(-0.1, 2.0_f32), Ok(0.0));
        assert_eq!(speed_mps(0.5, 2.0_f32), Ok(0.25));
    }
}
