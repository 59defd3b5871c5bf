use std::fs;
use std::path::Path;

use adit_geometry::profile::ProfileSpec;
use tempfile::TempDir;

use super::*;
use crate::texture::{PanoramaGrid, write_tiles_for_tests};

const RADIUS_M: f64 = 0.5;

/// A wall without period, grey 40 to 210: bilinear noise of cells of 13 to 105 mm, around the section without a seam.
fn wall(seed: u32, s_m: f64, x_m: f64) -> f64 {
    let perimeter_m = std::f64::consts::TAU * RADIUS_M;
    let layer = |cells: i64| {
        let cell_m = perimeter_m / cells as f64;
        let (u, v) = (s_m / cell_m, x_m / cell_m);
        let (right, below) = (u - u.floor(), v - v.floor());
        let at = |du: i64, dv: i64| {
            let (column, row) = ((u.floor() as i64 + du).rem_euclid(cells) as u32, (v.floor() as i64 + dv) as u32);
            let mixed =
                (column ^ row.wrapping_mul(0x9E37_79B9) ^ seed.wrapping_mul(0x85EB_CA6B)).wrapping_mul(0xC2B2_AE35);
            let mixed = (mixed ^ (mixed >> 15)).wrapping_mul(0x27D4_EB2F);
            f64::from((mixed ^ (mixed >> 13)) & 0xFFFF) / 65535.0
        };
        let line = |dv: i64| at(0, dv) * (1.0 - right) + at(1, dv) * right;
        line(0) * (1.0 - below) + line(1) * below
    };
    40.0 + 170.0 * (layer(30) + layer(60) + layer(240)) / 3.0
}

/// A reconstruction of that wall over `x_m`, with what a place shows.
fn painted(x_m: [f64; 2], mm_per_px: f64, shade: impl Fn(f64, f64) -> Option<f64>) -> TempDir {
    let folder = tempfile::tempdir().expect("a folder");
    let spec = ProfileSpec::Circle { radius_m: RADIUS_M };
    let grid = PanoramaGrid::new(spec.build().expect("a circle").perimeter_m(), mm_per_px, x_m[0], x_m[1]);
    let mut rgba = Vec::new();
    for row in 0..grid.height_px {
        for column in 0..grid.width_px {
            let shade = shade(grid.s_m(column as f64 + 0.5), grid.x_m(row as f64 + 0.5));
            rgba.extend(shade.map_or([0; 4], |grey| [grey as u8, grey as u8, grey as u8, 255]));
        }
    }
    fs::create_dir(folder.path().join("panorama")).expect("a folder");
    let json = grid.to_json(&spec).to_string();
    fs::write(folder.path().join("panorama/panorama.json"), json).expect("a description");
    write_tiles_for_tests(&folder.path().join("panorama/tiles"), &grid, &rgba);
    folder
}

fn compared(a: &Path, b: &Path) -> Result<ChangeReport, ChangeError> {
    let out = tempfile::tempdir().expect("a folder");
    let report = compare([a, b], &CompareOptions::default(), out.path(), &|_, _| {})?;
    let page = fs::read_to_string(out.path().join("compare.html")).expect("a page");
    assert!(page.contains("data:image/jpeg") && out.path().join("compare.json").is_file());
    Ok(report)
}

#[test]
fn a_stain_and_a_crack_are_found_where_they_are_and_nothing_else_is() {
    let a = painted([-0.5, 4.5], 4.0, |s, x| Some(wall(1, s, x)));
    let (turned_m, moved_m) = (0.413, -0.287);
    let b = painted([0.0, 5.0], 3.0, |s, x| {
        // Another zero of odometer and roll, a darker exposure, a hole; and in A's places a stain and a crack.
        let (s, x) = ((s - turned_m).rem_euclid(std::f64::consts::TAU * RADIUS_M), x - moved_m);
        let stain = (s - 1.0).hypot(x - 2.0) < 0.06;
        let crack = (x - 3.2).abs() < 0.004 && (2.0..2.5).contains(&s);
        let hole = (s - 2.6).hypot(x - 1.2) < 0.1;
        let change = if stain {
            -60.0
        } else if crack {
            -90.0
        } else {
            0.0
        };
        (!hole).then(|| ((wall(1, s, x) + change) * 0.7 + 10.0).max(0.0))
    });
    let report = compared(a.path(), b.path()).expect("a comparison");
    assert!((report.offset_s_m - turned_m).abs() < 0.03 && (report.offset_x_m - moved_m).abs() < 0.03, "{report}");
    assert!(report.correlation > 0.9 && 2 * report.patches_found > report.patches, "{report}");
    let [stain, crack] = report.changes[..] else { panic!("two changes are expected: {report}") };
    let near = |value: f64, expected: f64| (value - expected).abs() < 0.015;
    assert!(near(stain.region.x_from_m, 1.94) && near(stain.region.x_to_m, 2.06), "{report}");
    assert!(near(stain.region.s_from_m, 0.94) && near(stain.region.s_to_m, 1.06) && stain.grey < 0.0, "{report}");
    assert!((stain.region.area_cm2 - 113.0).abs() < 25.0, "{report}");
    assert!(
        near(crack.region.s_from_m, 2.0) && near(crack.region.s_to_m, 2.5) && near(crack.region.x_from_m, 3.196),
        "{report}"
    );
}

#[test]
fn a_survey_has_not_changed_against_itself_with_noise_and_another_lamp() {
    let a = painted([0.0, 3.0], 4.0, |s, x| Some(wall(1, s, x)));
    let noise = |s: f64, x: f64| (((s * 7919.0).sin() + (x * 104_729.0).sin()) * 43_758.545).fract() * 6.0;
    let b = painted([0.0, 3.0], 4.0, |s, x| Some((wall(1, s, x) + noise(s, x)) * (0.8 + 0.1 * (x * 2.0).sin())));
    let report = compared(a.path(), b.path()).expect("a comparison");
    assert!(report.changes.is_empty(), "{report}");
}

#[test]
fn what_differs_at_the_edge_of_what_was_seen_is_no_change() {
    let a = painted([0.0, 3.0], 4.0, |s, x| Some(wall(1, s, x)));
    // Seen up to 2 m around; what darkens 4 cm there is the photos' own edge, but elsewhere it is damp.
    let dark = |from_m: f64| {
        painted([0.0, 3.0], 4.0, move |s, x| {
            let change = if (from_m..from_m + 0.04).contains(&s) && (1.0..1.4).contains(&x) { -60.0 } else { 0.0 };
            (s < 2.0).then(|| (wall(1, s, x) + change).max(0.0))
        })
    };
    let report = compared(a.path(), dark(1.96).path()).expect("a comparison");
    assert!(report.changes.is_empty(), "{report}");
    let report = compared(a.path(), dark(1.0).path()).expect("a comparison");
    assert_eq!(report.changes.len(), 1, "{report}");
}

#[test]
fn another_tunnel_is_refused() {
    let a = painted([0.0, 3.0], 4.0, |s, x| Some(wall(1, s, x)));
    let other = painted([0.0, 3.0], 4.0, |s, x| Some(wall(2, s, x)));
    assert!(matches!(compared(a.path(), other.path()), Err(ChangeError::NothingCommon { .. })));
    let missing = tempfile::tempdir().expect("a folder");
    let message = compared(a.path(), missing.path()).expect_err("nothing there").to_string();
    assert!(message.contains("adit reconstruct"), "{message}");
}
