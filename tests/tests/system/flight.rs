//! From take-off to a textured tunnel.

use super::programs::{FLOWN, figures, text};

/// What `../shared/formats.md` promises of `out/`, as far as it is built.
const RESULTS: [&str; 14] = [
    "poses.csv",
    "colmap/cameras.txt",
    "colmap/images.txt",
    "colmap/points3D.txt",
    "panorama/panorama.json",
    "panorama/panorama.png",
    "panorama/tiles/panorama.dzi",
    "model.glb",
    "model.obj",
    "model.mtl",
    "points.ply",
    "coverage.json",
    "report.html",
    "report.json",
];

#[test]
fn a_simulated_flight_becomes_a_textured_tunnel_with_poses_of_millimetres() {
    let survey = FLOWN.copy();
    let folder = text(survey.path());
    let summary = figures("adit", &["reconstruct", folder]);
    assert_eq!(summary["registered"], summary["photos"], "{summary:#}");
    for file in RESULTS {
        let path = survey.path().join("out").join(file);
        assert!(path.metadata().is_ok_and(|about| about.len() > 0), "{file} is missing or empty");
    }
    let evaluation = figures("adit", &["evaluate", folder]);
    let rmse_mm = |frame: &str| evaluation["poses"][frame]["position_mm"]["rmse"].as_f64().expect("a number");
    // A pixel of this camera is 5 mm of wall.
    assert!(rmse_mm("aligned") < 2.0, "{evaluation:#}");
    assert!(rmse_mm("absolute") < 20.0, "{evaluation:#}");
    let coloured = evaluation["coverage"]["coloured_percent"].as_f64().expect("a number");
    // Of 6,543 cells at most three.
    assert!(coloured > 99.95, "{evaluation:#}");
}

#[test]
fn every_photo_of_a_flight_is_paired_or_named() {
    let survey = FLOWN.survey();
    let tags = std::fs::read_to_string(survey.join("tags.csv")).expect("ingest wrote tags.csv");
    let photos = std::fs::read_dir(FLOWN.flight().join("DCIM/100GOPRO")).expect("the card holds photos");
    for photo in photos {
        let name = photo.expect("the entry is read").file_name().into_string().expect("ASCII");
        assert!(tags.contains(&name), "{name} has no tag although nothing went wrong in this flight");
    }
}
