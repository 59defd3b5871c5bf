//! Boards drawn through a homography, so that every corner is known exactly.

use nalgebra::{Matrix3, Vector2};

use super::*;

const BOARD: Board = Board { columns: 7, rows: 5, square_m: 0.025 };

/// A board of squares of 24 pixels, its first inner corner at (60, 60) before it is turned and tilted; dark squares at 40,
/// light ones at 200, drawn with 8 x 8 samples per pixel and blurred as by a good lens. Also the exact pixels of its corners.
fn drawn(turn_rad: f64, tilt: [f64; 2]) -> (Luma, Vec<Vector2<f64>>) {
    let (sin, cos) = turn_rad.sin_cos();
    // About the board's middle, then shown in the middle of 320 x 260 pixels.
    let pixel_from_board = Matrix3::new(1.0, 0.0, 160.3, 0.0, 1.0, 130.6, 0.0, 0.0, 1.0)
        * Matrix3::new(24.0 * cos, -24.0 * sin, 0.0, 24.0 * sin, 24.0 * cos, 0.0, tilt[0], tilt[1], 1.0)
        * Matrix3::new(1.0, 0.0, -3.0, 0.0, 1.0, -2.0, 0.0, 0.0, 1.0);
    let board_from_pixel = pixel_from_board.try_inverse().unwrap();
    let place = |h: &Matrix3<f64>, at: Vector2<f64>| {
        let p = h * at.push(1.0);
        p.xy() / p.z
    };
    let is_dark = |at: Vector2<f64>| {
        let (column, row) = ((at.x + 1.0).floor() as i32, (at.y + 1.0).floor() as i32);
        (0..8).contains(&column) && (0..6).contains(&row) && (column + row) % 2 == 0
    };
    let mut sharp = Grey::new(320, 260);
    for row in 0..260 {
        for column in 0..320 {
            let offset = |step: i32| (f64::from(step) + 0.5) / 8.0;
            let samples = (0..64).map(|s| Vector2::new(column as f64 + offset(s % 8), row as f64 + offset(s / 8)));
            let dark = samples.filter(|at| is_dark(place(&board_from_pixel, *at))).count();
            sharp.set(column, row, [200.0 - 2.5 * dark as f32]);
        }
    }
    let data = blurred(&sharp, 0.7).data.iter().map(|value| value.round() as u8).collect();
    let photo = Luma { width: 320, height: 260, data };
    let corners =
        (0..35).map(|index| place(&pixel_from_board, Vector2::new(f64::from(index % 7), f64::from(index / 7))));
    (photo, corners.collect())
}

fn worst_px(found: &[Vector2<f64>], truth: &[Vector2<f64>]) -> f64 {
    assert_eq!(found.len(), truth.len());
    found.iter().zip(truth).map(|(found, truth)| (found - truth).norm()).fold(0.0, f64::max)
}

#[test]
fn corners_of_a_turned_and_tilted_board_are_found_in_order() {
    for (turn_rad, tilt) in [(0.0, [0.0, 0.0]), (0.4, [0.04, -0.03]), (-0.7, [-0.05, 0.02]), (1.2, [0.0, 0.05])] {
        let (photo, truth) = drawn(turn_rad, tilt);
        let found = find_corners(&photo, &BOARD).unwrap();
        // Level edges are drawn to an eighth of a pixel only: 0.12 px at a turn of 0.
        assert!(worst_px(&found, &truth) < 0.2, "turn {turn_rad}: {}", worst_px(&found, &truth));
    }
}

#[test]
fn a_board_upside_down_starts_at_its_other_end() {
    let (photo, mut truth) = drawn(3.0, [0.02, 0.03]);
    truth.reverse();
    assert!(worst_px(&find_corners(&photo, &BOARD).unwrap(), &truth) < 0.1);
}

#[test]
fn a_board_asked_for_lying_on_its_side_is_found_too() {
    let (photo, _) = drawn(0.1, [0.0, 0.0]);
    let upright = Board { columns: 5, rows: 7, ..BOARD };
    let corners = find_corners(&photo, &upright).unwrap();
    let (along, down) = (corners[1] - corners[0], corners[5] - corners[0]);
    assert!(along.perp(&down) > 0.0, "{along} {down}");
    assert!((along.norm() - 24.0).abs() < 0.5);
}

#[test]
fn another_number_of_corners_is_said() {
    let (photo, _) = drawn(0.2, [0.0, 0.0]);
    let larger = Board { columns: 8, ..BOARD };
    let expected = NoBoard::OtherSize { corners: 35, columns: 7, rows: 5, wanted_columns: 8, wanted_rows: 5 };
    assert_eq!(find_corners(&photo, &larger), Err(expected));
    // Fewer: which ones of the 7 x 5 would be meant?
    assert!(matches!(find_corners(&photo, &Board { columns: 6, ..BOARD }), Err(NoBoard::OtherSize { .. })));
}

#[test]
fn a_board_half_covered_is_not_taken_for_a_whole_one() {
    let (mut photo, _) = drawn(0.1, [0.0, 0.0]);
    for row in 100..260 {
        for column in 200..320 {
            photo.set(column, row, [120]);
        }
    }
    assert!(matches!(find_corners(&photo, &BOARD), Err(NoBoard::OtherSize { .. })));
}

#[test]
fn a_grey_wall_and_noise_show_no_board() {
    let mut noise = Luma::new(320, 260);
    let mut state = 1_u32;
    for value in &mut noise.data {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        *value = (state >> 24) as u8;
    }
    for photo in [Luma { data: vec![128; 320 * 260], ..Luma::new(320, 260) }, noise, Luma::new(8, 8)] {
        assert!(matches!(find_corners(&photo, &BOARD), Err(NoBoard::NotFound { .. })));
    }
}
