//! Fits to corners of a known camera, exact or with normal errors.

use nalgebra::{Translation3, Vector2, Vector3};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution as _, Normal};

use super::super::Pattern;
use super::solver::tests::{cameras, exact};
use super::*;

const BOARD: Board = Board { columns: 8, rows: 6, square_m: 0.03, pattern: Pattern::Chessboard };

/// All corners of a board in their order.
fn numbered(pixels: impl Iterator<Item = Vector2<f64>>) -> Vec<Corner> {
    pixels.enumerate().map(|(number, pixel)| Corner { number, pixel }).collect()
}

fn photos(camera: Camera<f64>, noise_px: f64, seed: u64) -> Vec<Vec<Corner>> {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let normal = Normal::new(0.0, noise_px).unwrap();
    let (_, sightings) = exact(camera);
    let mut noisy = |pixel: &Vector2<f64>| pixel + Vector2::from_fn(|_, _| normal.sample(&mut random));
    sightings.iter().map(|sighting| numbered(sighting.pixels.iter().map(&mut noisy))).collect()
}

fn size(camera: &Camera<f64>) -> Size {
    Size { width_px: camera.width_px, height_px: camera.height_px }
}

fn fitted(camera: &Camera<f64>, photos: &[Vec<Corner>]) -> Fit {
    fit_camera(photos, &BOARD, size(camera), model_of(camera)).unwrap()
}

#[test]
fn exact_corners_give_the_exact_camera_from_nothing() {
    for camera in cameras() {
        let fit = fitted(&camera, &photos(camera, 0.0, 1));
        assert!(fit.rms_px < 1e-6, "{fit:?}");
        for (found, wanted) in values(&fit.camera).iter().zip(values(&camera)) {
            assert!((found - wanted).abs() < 1e-5 * (1.0 + wanted.abs()), "{:?}", fit.camera);
        }
    }
}

#[test]
fn a_long_lens_and_a_fisheye_of_170_degrees_are_found() {
    let [wide, fisheye] = cameras();
    let long =
        Camera { focal_px: [3000.0, 3010.0], distortion: Distortion::BrownConrady([0.1, -0.3, 0.0, 0.0, 0.0]), ..wide };
    // Its photos from farther away: the board fills the same part of the photo.
    let (mut estimate, mut sightings) = exact(wide);
    for (pose, sighting) in estimate.cam_from_board.iter_mut().zip(&mut sightings) {
        *pose = Translation3::new(0.0, 0.0, 1.0) * *pose;
        for (place, pixel) in sighting.board.iter().zip(&mut sighting.pixels) {
            *pixel = long.project(&(pose.rotation * place + pose.translation.vector)).unwrap();
        }
    }
    let corners: Vec<_> = sightings.into_iter().map(|sighting| numbered(sighting.pixels.into_iter())).collect();
    let fit = fitted(&long, &corners);
    assert!(fit.rms_px < 1e-4 && (fit.camera.focal_px[0] - 3000.0).abs() < 1.0, "{fit:?}");

    let wider =
        Camera { focal_px: [420.0; 2], distortion: Distortion::KannalaBrandt([-0.01, 0.004, 0.0, 0.0]), ..fisheye };
    let fit = fitted(&wider, &photos(wider, 0.0, 1));
    assert!(fit.rms_px < 1e-6 && (fit.camera.focal_px[0] - 420.0).abs() < 1e-3, "{fit:?}");
}

#[test]
fn formal_sigmas_are_what_the_camera_is_off_by() {
    for camera in cameras() {
        let (mut squares, mut count) = ([0.0; INTRINSICS], 0.0);
        for seed in 0..12 {
            let fit = fitted(&camera, &photos(camera, 0.2, seed));
            assert!((fit.rms_px / (0.2 * 2.0_f64.sqrt()) - 1.0).abs() < 0.15, "{}", fit.rms_px);
            let IntrinsicSigmas { focal_px, centre_px, distortion } = fit.sigmas.formal;
            let sigmas = [&focal_px[..], &centre_px, &distortion].concat();
            for index in 0..parameters(&camera) {
                squares[index] += ((values(&fit.camera)[index] - values(&camera)[index]) / sigmas[index]).powi(2);
            }
            count += 1.0;
        }
        // Mean square of 12 normal draws: 1 +- 0.41, with a long tail upwards.
        for (index, square) in squares.iter().take(parameters(&camera)).enumerate() {
            assert!((0.1..3.0).contains(&(square / count)), "{index}: {:?}", squares.map(|square| square / count));
        }
    }
}

#[test]
fn the_jackknife_agrees_with_the_formal_sigma_where_corners_err_on_their_own_and_shows_a_bent_board() {
    let [camera, _] = cameras();
    let ratio = |fit: &Fit| fit.sigmas.jackknife.focal_px[0] / fit.sigmas.formal.focal_px[0];
    let own = fitted(&camera, &photos(camera, 0.2, 5));
    assert!((0.5..2.0).contains(&ratio(&own)), "{own:?}");
    // Each photo has an error of its own that its corners share: a shift across the board.
    let mut bent = photos(camera, 0.02, 5);
    for (index, photo) in bent.iter_mut().enumerate() {
        for (corner, seen) in photo.iter_mut().enumerate() {
            seen.pixel.x += 0.5 * (index as f64).sin() * (corner as f64 % 8.0 - 3.5).powi(2) / 12.0;
        }
    }
    assert!(ratio(&fitted(&camera, &bent)) > 1.5, "{:?}", fitted(&camera, &bent).sigmas);
}

#[test]
fn a_photo_that_does_not_fit_the_others_is_left_out_and_named() {
    let [camera, _] = cameras();
    let mut corners = photos(camera, 0.1, 3);
    for (index, seen) in corners[4].iter_mut().enumerate() {
        seen.pixel.x += 9.0 * (index as f64).sin();
    }
    let fit = fitted(&camera, &corners);
    assert_eq!(fit.outliers.iter().map(|(index, _)| *index).collect::<Vec<_>>(), [4]);
    assert_eq!(fit.photos.len(), 11);
    assert!((fit.camera.focal_px[0] - 560.0).abs() < 1.0);
}

#[test]
fn two_photos_and_boards_that_are_never_tilted_give_no_camera_or_one_that_says_how_little_it_knows() {
    let [camera, _] = cameras();
    let corners = photos(camera, 0.1, 3);
    assert!(fit_camera(&corners[..2], &BOARD, size(&camera), Model::BrownConrady).is_none());
    let pinhole = Camera { distortion: Distortion::BrownConrady([0.0; 5]), ..camera };
    let flat = |index: u32| {
        let middle = Vector3::new(-0.1 + 0.01 * f64::from(index), -0.08, 0.3);
        numbered((0..48).map(|corner| pinhole.project(&(BOARD.place(corner) + middle)).unwrap()))
    };
    let flat: Vec<_> = (0..6).map(flat).collect();
    if let Some(fit) = fit_camera(&flat, &BOARD, size(&camera), Model::BrownConrady) {
        let [sigma_px, _] = fit.sigmas.formal.focal_px;
        assert!((fit.camera.focal_px[0] - 560.0).abs() < 4.0 * sigma_px + 1e-3, "{fit:?}");
    }
}

#[test]
fn a_corner_far_off_is_left_out_and_parts_of_boards_say_as_much_as_they_have_corners() {
    let [_, camera] = cameras();
    let mut corners = photos(camera, 0.05, 3);
    corners[2][17].pixel.y += 2.0;
    for (index, photo) in corners.iter_mut().enumerate() {
        photo.retain(|corner| (corner.number + index) % 3 != 0);
    }
    let fit = fitted(&camera, &corners);
    let counts: Vec<usize> = fit.photos.iter().map(|photo| photo.corners).collect();
    assert!(counts.iter().enumerate().all(|(index, count)| *count == if index == 2 { 31 } else { 32 }), "{counts:?}");
    assert!((fit.rms_px / (0.05 * 2.0_f64.sqrt()) - 1.0).abs() < 0.15, "{}", fit.rms_px);
    assert!((fit.camera.focal_px[0] - camera.focal_px[0]).abs() < 3.5 * fit.sigmas.formal.focal_px[0], "{fit:?}");
}

#[test]
fn where_only_the_other_model_has_a_camera_the_hint_is_to_take_that() {
    use super::super::coverage::hints;
    use super::super::{Coverage, Hint};
    let [_, fisheye] = cameras();
    let fit = fitted(&fisheye, &photos(fisheye, 0.1, 1));
    let coverage = Coverage { corners: [0; 9], reach: 0.0, photos: 0 };
    let found = hints(&coverage, None, Some(&fit));
    assert_eq!(found, [Hint::OnlyOtherModel { model: Model::KannalaBrandt, other_px: fit.rms_px }]);
    let text = found[0].to_string();
    assert!(text.starts_with("no brown-conrady camera") && text.contains("kannala-brandt does, to 0.1"), "{text}");
}
