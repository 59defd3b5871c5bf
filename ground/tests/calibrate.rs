//! Calibration of the 24 real photos of a `GoPro` HERO4 Silver.

use std::path::Path;

use adit_ground::calibrate::{Board, Fit, Model, Reason, calibrate};

/// `OpenCV` 5.0.0 on its own corners of the same photos (`cargo xtask bench-calibration`).
const OPENCV_BROWN: ([f64; 2], f64) = ([561.42, 562.44], 0.4993);
const OPENCV_FISHEYE: ([f64; 2], f64) = ([563.76, 564.87], 0.4570);

fn assert_near(fit: &Fit, (focal_px, rms_px): ([f64; 2], f64)) {
    for (found, expected) in fit.camera.focal_px.iter().zip(focal_px) {
        assert!((found / expected - 1.0).abs() < 0.005, "{found} {expected}");
    }
    assert!(fit.rms_px < rms_px + 0.001, "{}", fit.rms_px);
}

#[test]
fn a_hero4_is_calibrated_as_well_as_by_opencv() {
    let above = Path::new(env!("CARGO_MANIFEST_DIR")).ancestors();
    let mut folders = above.map(|folder| folder.join("shared/samples/gopro-hero4-chessboard"));
    let Some(folder) = folders.find(|folder| folder.is_dir()) else {
        eprintln!("skipped: no shared/samples/gopro-hero4-chessboard");
        return;
    };
    let board = Board { columns: 8, rows: 6, square_m: 0.025 };
    let found = calibrate(&folder, board, Model::BrownConrady, &|_, _| {}).expect("photos");
    let (fit, other) = (found.fit.as_ref().expect("a camera"), found.other_fit.as_ref().expect("a camera"));
    assert_eq!((fit.photos.len(), other.photos.len()), (23, 23));
    assert_near(fit, OPENCV_BROWN);
    assert_near(other, OPENCV_FISHEYE);
    for (found, expected) in fit.camera.centre_px.iter().zip([651.81, 499.74]) {
        assert!((found - expected).abs() < 0.5, "{found} {expected}");
    }
    // One shows a part of the board only.
    let unused: Vec<_> = found.photos.iter().filter(|photo| photo.unused.is_some()).collect();
    assert_eq!(unused.len(), 1, "{unused:?}");
    assert!(unused[0].name == "GOPR0055.jpg" && matches!(unused[0].unused, Some(Reason::NoBoard(_))), "{unused:?}");
}
