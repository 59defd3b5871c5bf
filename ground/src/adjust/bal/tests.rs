//! The camera model's derivatives, the file format, and the reference problem where it lies beside the checkout.

use super::file::{parse_bal, to_text};
use super::*;

/// Two cameras that see three points, slightly off.
fn small() -> BalProblem {
    let camera = |x: f64, turn: f64| BalCamera {
        rotation: UnitQuaternion::from_scaled_axis(Vector3::new(0.02, turn, -0.01)),
        translation: Vector3::new(x, 0.1, -0.3),
        focal_px: 500.0,
        radial: [-0.05, 0.01],
    };
    let cameras = vec![camera(0.0, 0.1), camera(-1.0, -0.1)];
    let mut tracks = Tracks::default();
    for point in [Point3::new(0.3, 0.2, -5.0), Point3::new(-0.5, 0.1, -4.0), Point3::new(0.8, -0.6, -6.0)] {
        tracks.push(point, [0, 1].map(|photo| Observation { photo, pixel: [3.5, -2.25] }));
    }
    BalProblem { cameras, tracks }
}

#[test]
fn derivatives_agree_with_differences() {
    const STEP: f64 = 1e-6;
    let problem = small();
    let model = BalModel { tracks: &problem.tracks, cameras: 2 };
    let layout = Layout::new(&problem.tracks, CAMERA, 2, 0, &[]);
    let lenses: Vec<Lens> = problem.cameras.iter().map(Lens::new).collect();
    for (position, seen) in problem.tracks.iter() {
        for seen in seen {
            let sight = model.sight(&lenses, position, seen).unwrap();
            let camera = layout.camera(seen.photo as usize);
            for unknown in 0..CAMERA {
                let at = |step: f64| {
                    let mut values = vec![0.0; 2 * CAMERA];
                    values[camera + unknown] = step;
                    let moved = model.stepped(&lenses, &Step { layout: &layout, values: &values });
                    model.residual(&moved, position, seen).unwrap()
                };
                let difference = (at(STEP) - at(-STEP)) / (2.0 * STEP);
                let error = (difference - sight.by_camera.column(unknown)).norm();
                assert!(error < 1e-6 * (1.0 + difference.norm()), "unknown {unknown}: {error}");
            }
            for axis in 0..3 {
                let at = |step: f64| {
                    let mut moved = *position;
                    moved[axis] += step;
                    model.residual(&lenses, &moved, seen).unwrap()
                };
                let difference = (at(STEP) - at(-STEP)) / (2.0 * STEP);
                assert!((difference - sight.by_point.column(axis)).norm() < 1e-6 * (1.0 + difference.norm()));
            }
        }
    }
}

#[test]
fn what_is_written_is_read_again() {
    let problem = small();
    let again = parse_bal(&to_text(&problem)).unwrap();
    assert_eq!(again.tracks, problem.tracks);
    for (one, other) in again.cameras.iter().zip(&problem.cameras) {
        assert!(one.rotation.angle_to(&other.rotation) < 1e-12);
        assert_eq!((one.translation, one.focal_px, one.radial), (other.translation, other.focal_px, other.radial));
    }
}

#[test]
fn bad_files_are_refused_by_line_and_expectation() {
    let good = to_text(&small());
    let message = |text: &str| parse_bal(text).unwrap_err().to_string();
    assert_eq!(message(""), "the file ends in line 0: expected the number of cameras in the first line");
    assert_eq!(
        message(&good.replacen("2 3 6", "2 -3 6", 1)),
        "line 1: found \"-3\", expected the number of points in the first line"
    );
    assert_eq!(
        message(&good.replacen("\n1 0 ", "\n2 0 ", 1)),
        "line 3: found \"2\", expected the index of a camera, from 0 to 1"
    );
    assert_eq!(
        message(&good.replacen("3.5e0", "NaN", 1)),
        "line 2: found \"NaN\", expected a finite number for a pixel of observation 0 of 6"
    );
    // One observation less than announced, and one more.
    let without = |skipped: usize| -> String {
        let lines = good.lines().enumerate().filter(|(line, _)| *line != skipped);
        lines.map(|(_, line)| line).collect::<Vec<_>>().join("\n")
    };
    let fewer = message(&without(4));
    assert!(
        fewer.starts_with("line 7: found ") && fewer.ends_with("expected the index of a camera, from 0 to 1"),
        "{fewer}"
    );
    assert_eq!(
        message(&good.replacen("2 3 6", "2 3 5", 1)),
        "line 7: found \"2\", expected the end of the line (do the counts of the first line agree?)"
    );
    let end = good.trim_end().rfind('\n').unwrap();
    assert_eq!(message(&good[..end]), "the file ends in line 33: expected a finite number for point 2 of 3");
    assert_eq!(message(&format!("{good}7\n")), "line 35: found \"7\", expected the end of the file");
}

#[test]
fn ladybug_49_reaches_the_reference_optimum() {
    let Some(samples) = crate::samples_folder() else {
        eprintln!("ladybug_49_reaches_the_reference_optimum: skipped, no samples beside the checkout");
        return;
    };
    let mut problem = read_bal(&samples.join("bal/ladybug-49-1800.txt")).unwrap();
    let report = problem.adjust(50).unwrap();
    // An independent NumPy implementation: facts/reconstruction.md 5.
    assert!((report.initial_cost / 234_519.799 - 1.0).abs() < 1e-6, "{report:?}");
    assert!((report.final_cost / 3_001.359 - 1.0).abs() < 1e-4, "{report:?}");
}
