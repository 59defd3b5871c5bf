//! Angles around the section and of the shaft. Radians; 0 at the crown, growing clockwise looking forward.

use crate::Real;

/// Returns `angle_rad` brought into `[0, 2 pi)`.
pub fn wrap_turn<T: Real>(angle_rad: T) -> T {
    let wrapped = angle_rad - (angle_rad / T::two_pi()).floor() * T::two_pi();
    if wrapped >= T::two_pi() { T::zero() } else { wrapped }
}

/// Returns `angle_rad` brought into `(-pi, pi]`.
pub fn wrap_half_turn<T: Real>(angle_rad: T) -> T {
    let wrapped = wrap_turn(angle_rad);
    if wrapped > T::pi() { wrapped - T::two_pi() } else { wrapped }
}

/// Returns the angle that equals `angle_rad` but for whole turns and lies within half a turn of `reference_rad`.
///
/// Makes a growing shaft angle out of an absolute encoder's reading and the angle that was commanded.
pub fn unwrap_near<T: Real>(angle_rad: T, reference_rad: T) -> T {
    reference_rad + wrap_half_turn(angle_rad - reference_rad)
}

/// Returns the turn of the shaft from one image to the next. Zero images per turn count as one.
pub fn shaft_step_rad<T: Real>(images_per_turn: u16) -> T {
    T::two_pi() / T::count(u32::from(images_per_turn.max(1)))
}

/// Returns the section angle of image `index` of a turn, counted from `first_rad`, in `[0, 2 pi)`.
///
/// The index is taken modulo `images_per_turn`, so that no rounding piles up over a long flight.
pub fn shaft_angle_rad<T: Real>(first_rad: T, index: u32, images_per_turn: u16) -> T {
    let within_turn = index % u32::from(images_per_turn.max(1));
    wrap_turn(first_rad + shaft_step_rad::<T>(images_per_turn) * T::count(within_turn))
}

/// Returns the clock position of a section angle looking forward, in `[0, 12)`: 0 (twelve o'clock) at the crown, 3 right.
pub fn clock_hours<T: Real>(phi_rad: T) -> T {
    wrap_turn(phi_rad) * T::of(12.0) / T::two_pi()
}

#[cfg(test)]
mod tests {
    use core::f64::consts::{FRAC_PI_2, PI, TAU};

    use super::*;

    #[test]
    fn wrapping_lands_in_its_interval_and_changes_whole_turns_only() {
        for i in -50..50 {
            let angle = f64::from(i) * 0.37;
            let (turn, half) = (wrap_turn(angle), wrap_half_turn(angle));
            assert!((0.0..TAU).contains(&turn));
            assert!(half > -PI && half <= PI);
            for wrapped in [turn, half] {
                let turns = (wrapped - angle) / TAU;
                assert!((turns - turns.round()).abs() < 1e-12);
            }
        }
        assert_eq!(wrap_turn(-1e-9_f32), 0.0, "a rounding error below zero is not a whole turn");
        assert_eq!(wrap_half_turn(PI), PI);
    }

    #[test]
    fn an_encoder_that_wraps_gives_a_growing_shaft_angle() {
        let mut shaft = 0.0;
        for i in 1..100 {
            let commanded = f64::from(i) * TAU / 10.0;
            let read = wrap_turn(commanded + 0.01);
            shaft = unwrap_near(read, shaft + TAU / 10.0);
            assert!((shaft - commanded - 0.01).abs() < 1e-9);
        }
    }

    #[test]
    fn image_angles_repeat_every_turn() {
        assert!((shaft_angle_rad(0.2_f32, 12_000_003, 12) - shaft_angle_rad(0.2, 3, 12)).abs() < 1e-6);
        assert!((shaft_step_rad::<f64>(12) - PI / 6.0).abs() < 1e-15);
        assert!(shaft_step_rad::<f32>(0).is_finite());
    }

    #[test]
    fn three_o_clock_is_right() {
        assert!((clock_hours(FRAC_PI_2) - 3.0).abs() < 1e-12);
        assert!((clock_hours(-FRAC_PI_2) - 9.0).abs() < 1e-12);
    }
}
