//! Boards drawn through a homography, so that every corner is known exactly: plain ones by us, `ChArUco` ones by `OpenCV`.

use adit_geometry::charuco::{Dictionary, MARKERS};
use nalgebra::{Matrix3, Rotation2, Vector2};

use super::*;

const BOARD: Board = Board { columns: 7, rows: 5, square_m: 0.025, pattern: Pattern::Chessboard };

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

/// Corners may be missing; `truth` is by their numbers.
fn worst_px(found: &[Corner], truth: &[Vector2<f64>]) -> f64 {
    found.iter().map(|found| (found.pixel - truth[found.number]).norm()).fold(0.0, f64::max)
}

#[test]
fn corners_of_a_turned_and_tilted_board_are_found_in_order() {
    for (turn_rad, tilt) in [(0.0, [0.0, 0.0]), (0.4, [0.04, -0.03]), (-0.7, [-0.05, 0.02]), (1.2, [0.0, 0.05])] {
        let (photo, truth) = drawn(turn_rad, tilt);
        let found = find_corners(&photo, &BOARD).unwrap();
        assert_eq!(found.len(), 35);
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
    let way = |to: usize| corners[to].pixel - corners[0].pixel;
    let (along, down) = (way(1), way(5));
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

fn covered(photo: &mut Luma, columns: std::ops::Range<usize>, rows: std::ops::Range<usize>) {
    for row in rows {
        for column in columns.clone() {
            photo.set(column, row, [120]);
        }
    }
}

#[test]
fn of_a_board_half_covered_no_corner_is_named() {
    let (mut photo, _) = drawn(0.1, [0.0, 0.0]);
    covered(&mut photo, 200..320, 0..260);
    assert!(matches!(find_corners(&photo, &BOARD), Err(NoBoard::OtherSize { .. })));
}

#[test]
fn a_board_with_two_corners_hidden_is_used_without_them() {
    let (mut photo, truth) = drawn(0.3, [0.02, 0.0]);
    let [x, y] = [truth[17], truth[34]].map(|at| at.map(|value| value as usize)).map(Into::<[usize; 2]>::into);
    for [column, row] in [x, y] {
        covered(&mut photo, column - 7..column + 7, row - 7..row + 7);
    }
    let found = find_corners(&photo, &BOARD).unwrap();
    assert!(found.len() == 33 && found.iter().all(|corner| ![17, 34].contains(&corner.number)), "{found:?}");
    assert!(worst_px(&found, &truth) < 0.15, "{}", worst_px(&found, &truth));
}

/// Where a crossing of two parabolas is placed, off by how much: squares of 20 px, turned by 40 degrees, the lines bent by so many
/// pixels per square and square, and taken to be bent by as many as that.
fn off_px(bend: f64, taken: f64) -> Vector2<f64> {
    let corner = Vector2::new(30.37, 29.81);
    let turn = Rotation2::new(0.7);
    let mut sharp = Grey::new(61, 61);
    for row in 0..61 {
        for column in 0..61 {
            let dark = (0..256).filter(|sub| {
                let offset = |step: i32| (f64::from(step) + 0.5) / 16.0 - 0.5;
                let at = Vector2::new(column as f64 + offset(sub % 16), row as f64 + offset(sub / 16)) - corner;
                let at = turn.inverse() * at;
                let parabola = |along: f64| 0.5 * bend * (along / 20.0).powi(2);
                (at.y > parabola(at.x)) == (at.x > -parabola(at.y))
            });
            sharp.set(column, row, [200.0 - 0.625 * dark.count() as f32]);
        }
    }
    let bends = [turn * Vector2::new(0.0, taken), turn * Vector2::new(-taken, 0.0)];
    let around = Surroundings { steps: turn.matrix() * 20.0, bends };
    refined(&blurred(&sharp, 1.0), corner, &around, 0.3).unwrap() - corner
}

#[test]
fn lines_bent_by_a_lens_move_their_crossing_unless_that_is_taken_off() {
    let straight = off_px(0.0, 0.0);
    let (taken_off, left) = (off_px(0.9, 0.9) - straight, off_px(0.9, 0.0) - straight);
    assert!(straight.norm() < 0.02, "{straight}");
    assert!(taken_off.norm() < 0.007 && left.norm() > 0.012, "{} {}", taken_off.norm(), left.norm());
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

/// A picture drawn by opencv/draw.py.
fn png(bytes: &[u8]) -> Luma {
    let mut reader = png::Decoder::new(std::io::Cursor::new(bytes)).read_info().unwrap();
    let mut data = vec![0; reader.output_buffer_size().unwrap()];
    let info = reader.next_frame(&mut data).unwrap();
    Luma { width: info.width as usize, height: info.height as usize, data }
}

#[test]
fn dictionaries_are_those_that_opencv_draws() {
    let picture = png(include_bytes!("opencv/codes.png"));
    for (block, dictionary) in [Dictionary::Side4, Dictionary::Side5, Dictionary::Side6].into_iter().enumerate() {
        let side = dictionary.side();
        for marker in 0..MARKERS {
            let (left, top) = (marker % 25 * 8, (block * 4 + marker / 25) * 8);
            let cells = (0..side * side).map(|cell| picture.at(left + 1 + cell % side, top + 1 + cell / side)[0] > 127);
            let code = cells.fold(0, |code, white| code << 1 | u64::from(white));
            assert_eq!(dictionary.code(marker), Some(code), "{dictionary:?} {marker}");
        }
    }
}

#[test]
fn charuco_boards_drawn_by_opencv_are_found_whole_and_in_part() {
    let pixel_from_square = Matrix3::new(36.0, -9.0, 62.0, 10.0, 33.0, 18.0, 0.010, -0.012, 1.0);
    let truth: Vec<Vector2<f64>> = (0..30)
        .map(|corner| pixel_from_square * Vector2::new(f64::from(corner % 6 + 1), f64::from(corner / 6 + 1)).push(1.0))
        .map(|at| at.xy() / at.z)
        .collect();
    let pictures: [(&str, &[u8]); 2] = [
        ("charuco:6x5:DICT_4X4_50", include_bytes!("opencv/board-4x4.png")),
        ("charuco:6x5:DICT_5X5_100", include_bytes!("opencv/board-5x5.png")),
    ];
    for (name, picture) in pictures {
        let board = Board::parse(name, 0.025).unwrap();
        let mut photo = png(picture);
        let whole = find_corners(&photo, &board).unwrap();
        assert!(whole.len() == 30 && worst_px(&whole, &truth) < 0.1, "{name}: {} {whole:?}", worst_px(&whole, &truth));
        // Only its right half.
        covered(&mut photo, 0..170, 0..260);
        let part = find_corners(&photo, &board).unwrap();
        assert!((8..25).contains(&part.len()) && part.iter().all(|corner| corner.pixel.x > 165.0), "{name}: {part:?}");
        let beside: Vec<Corner> = part.into_iter().filter(|corner| corner.pixel.x > 182.0).collect();
        assert!(worst_px(&beside, &truth) < 0.1, "{name}: {beside:?}");
    }
}

#[test]
fn another_dictionary_and_a_plain_chessboard_have_no_marker_of_it() {
    let photo = png(include_bytes!("opencv/board-5x5.png"));
    let other = Board::parse("charuco:6x5:4x4", 0.025).unwrap();
    assert!(
        matches!(find_corners(&photo, &other), Err(NoBoard::NoMarkers { .. })),
        "{:?}",
        find_corners(&photo, &other)
    );
    let (plain, _) = drawn(0.1, [0.0, 0.0]);
    let board = Board::parse("charuco:7x5:4x4", 0.025).unwrap();
    assert_eq!(find_corners(&plain, &board), Err(NoBoard::NoMarkers { corners: 35 }));
}
