//! One photo of a board: what each pixel sees of it, the lens's blur, noise.
//!
//! A pixel that one square fills has its brightness; any other is the mean of 8 x 8 samples, between which the board's
//! coordinates are interpolated (they bend by less than a thousandth of a pixel within one). Blur acts on light, before the sRGB curve.

use adit_geometry::camera::Camera;
use adit_geometry::charuco::{Dictionary, marker_in};
use nalgebra::{Isometry3, Vector2};

use super::{CORNERS, SQUARE_M};
use crate::render::RgbImage;
use crate::scene::noise;
use crate::scene::paint::srgb_of_linear;

/// Samples per pixel and axis where edges are.
const SAMPLES: usize = 8;
/// Light from dark squares, from paper, and from the wall behind.
const DARK: f32 = 0.05;
const PAPER: f32 = 0.75;
const WALL: f32 = 0.35;
/// White around the squares, in squares.
const RIM: f64 = 0.8;
/// Side of a marker with its frame, in squares.
const MARKER: f64 = 0.75;
/// Light at the photo's left border against the right one's, as a share.
const FALL_OFF: f32 = 0.35;

pub(super) struct PictureOptions {
    pub(super) blur_px: f32,
    pub(super) noise_levels: f32,
    pub(super) seed: u64,
}

pub(super) fn photo(
    camera: &Camera<f64>,
    cam_from_board: &Isometry3<f64>,
    charuco: Option<Dictionary>,
    options: &PictureOptions,
) -> RgbImage {
    let (width, height) = (camera.width_px as usize, camera.height_px as usize);
    let places = places(camera, cam_from_board);
    let mut light = vec![0.0; width * height];
    for (row, line) in light.chunks_exact_mut(width).enumerate() {
        for (column, value) in line.iter_mut().enumerate() {
            let at = |c: usize, r: usize| places[(row + r) * (width + 1) + column + c];
            let lamp = 1.0 - FALL_OFF * column as f32 / width as f32;
            *value = lamp * seen([at(0, 0), at(1, 0), at(0, 1), at(1, 1)], charuco);
        }
    }
    blur(&mut light, width, options.blur_px);
    let mut data = Vec::with_capacity(3 * light.len());
    for (place, value) in light.iter().enumerate() {
        let noise = options.noise_levels * normal(options.seed, place as u64);
        let level = (srgb_of_linear(*value) * 255.0 + noise).round().clamp(0.0, 255.0) as u8;
        data.extend([level; 3]);
    }
    RgbImage { width, height, data }
}

/// Where the rays of all pixel corners meet the board's plane, in squares from the outer corner of the first square.
fn places(camera: &Camera<f64>, cam_from_board: &Isometry3<f64>) -> Vec<Option<Vector2<f64>>> {
    let board_from_cam = cam_from_board.inverse();
    let origin = board_from_cam.translation.vector;
    let pixels = (0..=camera.height_px).flat_map(|row| (0..=camera.width_px).map(move |column| (column, row)));
    let meet = |(column, row): (u32, u32)| {
        let ray = board_from_cam.rotation * camera.unproject(&Vector2::new(f64::from(column), f64::from(row)))?;
        let distance = -origin.z / ray.z;
        (distance > 0.0).then(|| (origin + ray * distance).xy() / SQUARE_M + Vector2::repeat(1.0))
    };
    pixels.map(meet).collect()
}

/// Mean light of a pixel whose corners see these places.
fn seen(corners: [Option<Vector2<f64>>; 4], charuco: Option<Dictionary>) -> f32 {
    let [Some(a), Some(b), Some(c), Some(d)] = corners else { return WALL };
    let cells = [a, b, c, d].map(|place| cell(place, charuco));
    if cells.iter().all(|other| *other == cells[0]) {
        return light_of(cells[0], charuco);
    }
    let share = |index: usize| (index as f64 + 0.5) / SAMPLES as f64;
    let mut sum = 0.0;
    for row in 0..SAMPLES {
        let (left, right) = (a.lerp(&c, share(row)), b.lerp(&d, share(row)));
        for column in 0..SAMPLES {
            sum += light_of(cell(left.lerp(&right, share(column)), charuco), charuco);
        }
    }
    sum / (SAMPLES * SAMPLES) as f32
}

/// What is of one brightness.
#[derive(Clone, Copy, PartialEq, Eq)]
struct Cell {
    /// Column and row; -1 and one beyond the last are the rim, the least number is the wall.
    square: [i64; 2],
    /// Column and row of the marker's cell, its frame at 0; -1 and below or beyond the frame for the white around it.
    in_marker: [i64; 2],
}

fn cell(place: Vector2<f64>, charuco: Option<Dictionary>) -> Cell {
    let across = |value: f64, squares: usize| {
        let squares = squares as f64;
        if value < -RIM || value > squares + RIM { i64::MIN } else { value.clamp(-1.0, squares).floor() as i64 }
    };
    let in_marker = charuco.map_or([0; 2], |dictionary| {
        let cells = (dictionary.side() + 2) as f64;
        let across = |value: f64| ((value.rem_euclid(1.0) - 0.5) / MARKER + 0.5) * cells;
        [place.x, place.y].map(|value| across(value).clamp(-1.0, cells).floor() as i64)
    });
    Cell { square: [across(place.x, CORNERS[0] + 1), across(place.y, CORNERS[1] + 1)], in_marker }
}

fn light_of(Cell { square: [column, row], in_marker }: Cell, charuco: Option<Dictionary>) -> f32 {
    if column == i64::MIN || row == i64::MIN {
        return WALL;
    }
    let on_squares = (0..=CORNERS[0] as i64).contains(&column) && (0..=CORNERS[1] as i64).contains(&row);
    let is_dark = || (column + row) % 2 == 0 || is_dark_in_marker([column, row], in_marker, charuco);
    if on_squares && is_dark() { DARK } else { PAPER }
}

fn is_dark_in_marker([column, row]: [i64; 2], [x, y]: [i64; 2], charuco: Option<Dictionary>) -> bool {
    let code = |dictionary: Dictionary| dictionary.code(marker_in(column as usize, row as usize, CORNERS[0] + 1)?);
    let Some((dictionary, code)) = charuco.and_then(|dictionary| Some((dictionary, code(dictionary)?))) else {
        return false;
    };
    let side = dictionary.side() as i64;
    let on_marker = [x, y].iter().all(|place| (0..side + 2).contains(place));
    let on_frame = [x, y].iter().any(|place| *place == 0 || *place == side + 1);
    on_marker && (on_frame || code >> (side * side - 1 - ((y - 1) * side + x - 1)) & 1 == 0)
}

/// Gaussian blur, the border repeated.
fn blur(light: &mut [f32], width: usize, sigma_px: f32) {
    if sigma_px <= 0.0 {
        return;
    }
    let reach = (4.0 * sigma_px).ceil() as usize;
    let taps: Vec<f32> =
        (0..=2 * reach).map(|tap| (-0.5 * ((tap as f32 - reach as f32) / sigma_px).powi(2)).exp()).collect();
    let sum: f32 = taps.iter().sum();
    let height = light.len() / width;
    let lines = |light: &mut [f32], count: usize, length: usize, start: usize, step: usize| {
        let mut line = vec![0.0; length];
        for index in 0..count {
            for (at, value) in line.iter_mut().enumerate() {
                *value = light[index * start + at * step];
            }
            for at in 0..length {
                let tapped = taps.iter().enumerate().map(|(tap, weight)| {
                    let from = (at + tap).saturating_sub(reach).min(length - 1);
                    weight * line[from]
                });
                light[index * start + at * step] = tapped.sum::<f32>() / sum;
            }
        }
    };
    lines(light, height, width, width, 1);
    lines(light, width, height, 1, width);
}

/// A normal draw that belongs to a place (Box and Muller, 1958).
fn normal(seed: u64, place: u64) -> f32 {
    let uniform = |stream: u64| noise::unit(noise::mix(noise::derive_seed(seed, stream) ^ noise::mix(place)));
    let radius = (-2.0 * (1.0 - uniform(1)).ln()).sqrt();
    radius * (std::f32::consts::TAU * uniform(2)).cos()
}

#[cfg(test)]
mod tests {
    use adit_geometry::camera::Distortion;
    use nalgebra::Vector3;

    use super::*;

    #[test]
    fn a_corner_s_light_is_symmetric_about_its_exact_pixel() {
        let camera = Camera {
            width_px: 200,
            height_px: 150,
            focal_px: [90.0; 2],
            centre_px: [100.0, 75.0],
            distortion: Distortion::BrownConrady([0.0; 5]),
        };
        // The fifth corner of the third row at the centre of pixel (100, 75).
        let pose =
            Isometry3::new(Vector3::new(0.5 / 90.0 * 0.12 - 0.1, 0.5 / 90.0 * 0.12 - 0.05, 0.12), Vector3::zeros());
        let image = photo(&camera, &pose, None, &PictureOptions { blur_px: 0.8, noise_levels: 0.0, seed: 1 });
        let level = |column: usize, row: usize| i32::from(image.data[(row * 200 + column) * 3]);
        for (dx, dy) in [(3, 0), (2, 5), (4, 4), (1, 1), (6, 2)] {
            let (one, other) = (level(100 + dx, 75 + dy), level(100 - dx, 75 - dy));
            // But for the lamp's fall-off.
            assert!((one - other).abs() <= 8, "{dx} {dy}: {one} {other}");
        }
        assert!((level(104, 79) - level(104, 71)).abs() > 80);
    }

    #[test]
    fn a_marker_is_drawn_in_its_square_within_its_frame() {
        let dictionary = Some(Dictionary::Side4);
        let light = |x: f64, y: f64| light_of(cell(Vector2::new(x, y), dictionary), dictionary);
        // The second square of the first row holds marker 0, whose first row is 1011.
        let middle = |place: u32| 0.5 + MARKER * ((f64::from(place) + 0.5) / 6.0 - 0.5);
        let first_row: Vec<f32> = (0..6).map(|column| light(1.0 + middle(column), middle(1))).collect();
        assert_eq!(first_row, [DARK, PAPER, DARK, PAPER, PAPER, DARK]);
        assert_eq!([light(1.05, 0.5), light(0.5, 0.5), light(-0.5, 0.5), light(-2.0, 0.5)], [PAPER, DARK, PAPER, WALL]);
    }

    #[test]
    fn noise_has_the_spread_asked_for() {
        let draws: Vec<f32> = (0..20_000).map(|place| normal(7, place)).collect();
        let mean = draws.iter().sum::<f32>() / 20_000.0;
        let spread = (draws.iter().map(|draw| (draw - mean).powi(2)).sum::<f32>() / 20_000.0).sqrt();
        assert!(mean.abs() < 0.03 && (spread - 1.0).abs() < 0.03, "{mean} {spread}");
    }
}
