//! Calibration of the 24 real photos of a `GoPro` HERO4 Silver, and of the rigs of the samples.

use std::path::{Path, PathBuf};

use adit_geometry::rig::nominal_rotation;
use adit_ground::calibrate::{Board, Fit, Model, Reason, Untold, calibrate, calibrate_rig};
use adit_ground::pipeline::Verbosity;
use adit_ground::survey::{Survey, load};
use nalgebra::{Quaternion, UnitQuaternion, Vector3};

/// `OpenCV` 5.0.0 on its own corners of the same photos (`cargo xtask bench-calibration`).
const OPENCV_BROWN: ([f64; 2], f64) = ([561.42, 562.44], 0.4993);
const OPENCV_FISHEYE: ([f64; 2], f64) = ([563.76, 564.87], 0.4570);

fn assert_near(fit: &Fit, (focal_px, rms_px): ([f64; 2], f64)) {
    for (found, expected) in fit.camera.focal_px.iter().zip(focal_px) {
        assert!((found / expected - 1.0).abs() < 0.005, "{found} {expected}");
    }
    assert!(fit.rms_px < rms_px + 0.001, "{}", fit.rms_px);
}

/// A folder of `shared/samples` above the checkout; `None`, and said, if there is none.
fn sample(name: &str) -> Option<PathBuf> {
    let above = Path::new(env!("CARGO_MANIFEST_DIR")).ancestors();
    let found = above.map(|folder| folder.join("shared/samples").join(name)).find(|folder| folder.is_dir());
    if found.is_none() {
        eprintln!("skipped: no shared/samples/{name}");
    }
    found
}

#[test]
fn a_hero4_is_calibrated_as_well_as_by_opencv() {
    let Some(folder) = sample("gopro-hero4-chessboard") else { return };
    let board = Board::parse("8x6", 0.025).expect("a board");
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

/// Mean rotation of a sample's cameras against their nominal mounting at the tags' shaft angles: what the rig must come out as, but
/// for the vehicle's attitudes, of which 50 photos leave 0.2 degrees.
fn true_mount_deg(folder: &Path, survey: &Survey) -> Vector3<f64> {
    let mut reader = csv::Reader::from_path(folder.join("truth/poses.csv")).expect("poses.csv");
    let mut sum = Vector3::zeros();
    for record in reader.records().map(|record| record.expect("a row")) {
        let number = |column: usize| record[column].parse::<f64>().expect("a number");
        let tunnel_from_cam =
            UnitQuaternion::from_quaternion(Quaternion::new(number(1), number(2), number(3), number(4)));
        let photo = survey.photos.iter().find(|photo| photo.name == record[0]).expect("a photo of this name");
        let shaft_rad = f64::from(photo.tag.expect("a tag").shaft_rad);
        let nominal = nominal_rotation(survey.config.rig.image_up, shaft_rad);
        sum += (nominal.inverse() * tunnel_from_cam).scaled_axis();
    }
    (sum / survey.photos.len() as f64).map(f64::to_degrees)
}

#[test]
fn rigs_of_the_samples_are_found_and_the_roll_on_a_circle_is_said_to_be_unknown() {
    for (name, circle) in [("underpass-spiral", false), ("cylinder-brick-spiral", true)] {
        let Some(folder) = sample(name) else { continue };
        let survey = load(&folder).expect("the sample");
        let rig = calibrate_rig(&survey, Verbosity::Quiet).expect("a rig");
        let truth = true_mount_deg(&folder, &survey);
        eprintln!("{name}: truth {truth:.3?}\n{rig}");
        // The photos' up is forward: the shaft lies along the camera's -y.
        let [x, _, z] = rig.mount_rotvec_deg;
        for (what, found, truth) in [("x", x, truth.x), ("z", z, truth.z), ("zero", rig.shaft_zero_deg, -truth.y)] {
            let off = (found.value - truth) / found.sigma;
            // On a circle nothing but the tags tells the shaft's zero, and its sigma says so.
            let told = found.sigma < 0.5;
            assert!(off.abs() < 3.0 && told != (circle && what == "zero"), "{name}, {what}: {found:?}, truth {truth}");
        }
        let lever = rig.lever_radial_m;
        assert!((lever.value - 0.06).abs() < 3.0 * lever.sigma && lever.sigma < 0.02, "{name}: {lever:?}");
        assert!(rig.untold.contains(&Untold::LeverForward), "{:?}", rig.untold);
        assert_eq!(rig.untold.contains(&Untold::RollOnCircle), circle, "{name}: {:?}", rig.untold);
        assert!(!rig.untold.contains(&Untold::Mount) && !rig.untold.contains(&Untold::LessThanATurn));
    }
}
