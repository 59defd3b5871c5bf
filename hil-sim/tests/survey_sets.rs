//! `adit-sim survey`: bytes, help, and whether truth and tags of a set tell the same story.

use std::collections::BTreeMap;
use std::path::Path;
use std::process::{Command, Output};

use adit_hil_sim::survey::{SetKind, SetOptions, make_set};

fn survey(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_adit-sim")).arg("survey").args(arguments).output().expect("adit-sim runs")
}

/// Every file of a set with its bytes.
fn files(folder: &Path) -> BTreeMap<String, Vec<u8>> {
    let mut found = BTreeMap::new();
    for part in ["", "photos", "masks", "truth"] {
        for entry in std::fs::read_dir(folder.join(part)).expect("a folder") {
            let path = entry.expect("an entry").path();
            if path.is_file() {
                let name = path.strip_prefix(folder).expect("below").to_string_lossy().into_owned();
                found.insert(name, std::fs::read(&path).expect("a file"));
            }
        }
    }
    found
}

/// Numbers of one column of a CSV file; `None` for an empty cell.
fn column(file: &Path, name: &str) -> Vec<Option<f64>> {
    let text = std::fs::read_to_string(file).expect("readable");
    let mut lines = text.lines();
    let place = lines.next().expect("a header").split(',').position(|cell| cell == name).expect("the column");
    lines.map(|line| line.split(',').nth(place).expect("a cell").parse().ok()).collect()
}

/// A set of tiny photos without the true texture.
fn small(kind: SetKind, photos: u32, seed: u64) -> tempfile::TempDir {
    flown(kind, photos, seed, None)
}

fn flown(kind: SetKind, photos: u32, seed: u64, later: Option<u64>) -> tempfile::TempDir {
    let folder = tempfile::tempdir().expect("a folder");
    let options = SetOptions { kind, seed, later, photos: Some(photos), width_px: 40, texture: false };
    make_set(folder.path(), &options, &|_| {}).expect("the set is made");
    folder
}

fn rms(errors: &[f64]) -> f64 {
    (errors.iter().map(|error| error * error).sum::<f64>() / errors.len() as f64).sqrt()
}

#[test]
fn the_same_seed_leaves_the_same_set() {
    let folder = tempfile::tempdir().expect("a folder");
    let made = |name: &str, more: &[&str]| {
        let out = folder.path().join(name);
        let small =
            ["spiral", "--photos", "4", "--width-px", "48", "--no-texture", "--out", out.to_str().expect("UTF-8")];
        let output = survey(&[&small[..], more].concat());
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        files(&out)
    };
    let one = made("one", &["--seed", "5", "--threads", "1"]);
    let two = made("two", &["--seed", "5", "--threads", "3"]);
    assert!(one == two, "the same seed left other bytes");
    assert!(one.contains_key("masks/GOPR0001.JPG.png"), "the trolley is below the first photo");
    let other = made("other", &["--seed", "6"]);
    for name in ["photos/GOPR0002.JPG", "truth/poses.csv", "tags.csv"] {
        assert!(one[name] != other[name], "{name}");
    }
}

#[test]
fn a_set_replaces_another_only_if_asked() {
    let folder = small(SetKind::Brick, 3, 1);
    let out = folder.path().to_str().expect("UTF-8");
    let again = ["brick", "--photos", "1", "--width-px", "40", "--no-texture", "--out", out];
    let refused = survey(&again);
    assert_eq!(refused.status.code(), Some(2));
    assert!(String::from_utf8_lossy(&refused.stderr).contains("--force"));
    assert!(survey(&[&again[..], &["--force"]].concat()).status.success());
    assert!(!folder.path().join("photos/GOPR0003.JPG").exists());
}

#[test]
fn tags_stray_from_the_truth_as_far_as_they_say() {
    // Enough photos for the spread of a standard deviation to be 5 %; on a circle the head's range says how far the
    // camera is from the wall.
    let folder = small(SetKind::Concrete, 200, 3);
    let tags = folder.path().join("tags.csv");
    let poses = folder.path().join("truth/poses.csv");
    let [qw, qx, qy, qz] = ["qw", "qx", "qy", "qz"].map(|name| column(&poses, name));
    let [x_m, y_m, z_m] = ["x_m", "y_m", "z_m"].map(|name| column(&poses, name));
    let (shaft_deg, head_m) = (column(&tags, "shaft_deg"), column(&tags, "range_head_m"));
    let odometer_m = column(&tags, "odometer_m");
    let (mut angle_errors_deg, mut range_errors_m, mut ratios) = (Vec::new(), Vec::new(), Vec::new());
    for photo in 0..shaft_deg.len() {
        let number = |column: &[Option<f64>]| column[photo].expect("a number");
        let [w, x, y, z] = [&qw, &qx, &qy, &qz].map(|part| number(part));
        // The optical axis: third column of the rotation.
        let axis = [2.0 * (x * z + y * w), 2.0 * (y * z - x * w), 1.0 - 2.0 * (x * x + y * y)];
        let true_deg = axis[1].atan2(-axis[2]).to_degrees();
        angle_errors_deg.push((number(&shaft_deg) - true_deg + 180.0).rem_euclid(360.0) - 180.0);
        if let Some(measured_m) = head_m[photo] {
            // Along the axis of sight, which roll, pitch, yaw and mounting tilt by some degrees: second order.
            let (sin, cos) = (axis[1], axis[2]);
            let flat = sin.hypot(cos);
            let (py, pz) = (number(&y_m), number(&z_m));
            let along = (py * sin + pz * cos) / flat;
            let away_m = -along + (9.0 - (py * py + pz * pz - along * along)).sqrt();
            range_errors_m.push(measured_m - away_m);
        }
        ratios.push((number(&odometer_m), number(&x_m)));
    }
    // 1 degree of the shaft, 1.5 of the roll, and the constant mounting error about the tunnel's axis.
    let mean_deg = angle_errors_deg.iter().sum::<f64>() / 200.0;
    let spread_deg = rms(&angle_errors_deg.iter().map(|error| error - mean_deg).collect::<Vec<_>>());
    assert!(mean_deg.abs() < 3.0 && (1.2..2.4).contains(&spread_deg), "{mean_deg} {spread_deg}");
    let range_m = rms(&range_errors_m);
    assert!(range_errors_m.len() > 180 && (0.016..0.026).contains(&range_m), "{range_m}");
    let (first, last) = (ratios[0], ratios[199]);
    let scale_error = ((last.0 - first.0) / (last.1 - first.1) - 1.0).abs();
    // 1 to 2 % and 200 steps of 10 mm, added up.
    assert!((0.001..0.04).contains(&scale_error), "{scale_error}");
}

#[test]
fn a_trolley_that_stands_for_a_turn_moves_once_per_turn() {
    let folder = small(SetKind::Cylindrical, 30, 2);
    let odometer_m: Vec<f64> = column(&folder.path().join("tags.csv"), "odometer_m").into_iter().flatten().collect();
    let moves = odometer_m.windows(2).filter(|pair| (pair[1] - pair[0]).abs() > 1e-9).count();
    assert_eq!(moves, 2, "{odometer_m:?}");
}

#[test]
fn an_imperfect_tunnel_is_a_percent_larger_than_its_survey_says() {
    let folder = small(SetKind::Imperfect, 40, 2);
    let survey = std::fs::read_to_string(folder.path().join("survey.toml")).expect("survey.toml");
    assert!(survey.contains("radius_m = 3.0\n"), "{survey}");
    let tags = folder.path().join("tags.csv");
    let columns = ["range_up_m", "range_right_m", "range_down_m", "range_left_m"];
    let ranges_m: Vec<f64> = columns.iter().flat_map(|name| column(&tags, name)).flatten().collect();
    let mean_m = ranges_m.iter().sum::<f64>() / ranges_m.len() as f64;
    assert!((mean_m - 3.03).abs() < 0.015, "{mean_m}");
}

/// The truth's heights, millimetres, cell by cell.
fn true_heights_mm(folder: &Path) -> Vec<f32> {
    let bytes = std::fs::read(folder.join("truth/relief.f32")).expect("relief.f32");
    bytes.as_chunks::<4>().0.iter().map(|bytes| f32::from_le_bytes(*bytes) * 1e3).collect()
}

#[test]
fn a_later_flight_meets_the_same_tunnel_with_a_bulge_more() {
    let (first, later) = (flown(SetKind::Imperfect, 40, 2, None), flown(SetKind::Imperfect, 40, 2, Some(9)));
    let poses = |folder: &tempfile::TempDir| std::fs::read(folder.path().join("truth/poses.csv")).expect("poses");
    assert_ne!(poses(&first), poses(&later));
    let heights_mm = [&first, &later].map(|folder| true_heights_mm(folder.path()));
    let grown_mm: Vec<f32> = heights_mm[0].iter().zip(&heights_mm[1]).map(|(before, after)| after - before).collect();
    let most_mm = grown_mm.iter().copied().fold(0.0, f32::max);
    assert!((most_mm - 30.0).abs() < 1.5, "{most_mm}");
    let unchanged = grown_mm.iter().filter(|grown_mm| grown_mm.abs() < 0.5).count();
    assert!(unchanged as f64 > 0.9 * grown_mm.len() as f64, "{unchanged} of {}", grown_mm.len());
}

#[test]
fn the_help_lists_the_kinds() {
    insta::assert_snapshot!(String::from_utf8_lossy(&survey(&["--help"]).stdout));
}
