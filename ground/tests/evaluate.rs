//! `adit evaluate` as a program: exit codes, figures, messages.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

fn adit(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_adit")).args(arguments).output().unwrap()
}

fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}

fn sample(name: &str) -> Option<PathBuf> {
    let start = Path::new(env!("CARGO_MANIFEST_DIR"));
    let folder =
        start.ancestors().map(|folder| folder.join("shared/samples").join(name)).find(|folder| folder.is_dir());
    if folder.is_none() {
        eprintln!("skipped: no shared/samples/{name} above this crate");
    }
    folder
}

/// A folder with the sample's true poses as a result, the first moved by `slip_m` and the last `lost` left out.
fn result_like_truth(survey: &Path, slip_m: f64, lost: usize) -> tempfile::TempDir {
    let out = tempfile::tempdir().unwrap();
    let truth = fs::read_to_string(survey.join("truth/poses.csv")).unwrap();
    let lines: Vec<&str> = truth.lines().collect();
    let mut rows: Vec<String> = lines[..lines.len() - lost].iter().map(|line| (*line).to_owned()).collect();
    let (head, z_m) = rows[1].rsplit_once(',').unwrap();
    rows[1] = format!("{head},{}", z_m.parse::<f64>().unwrap() + slip_m);
    fs::write(out.path().join("poses.csv"), rows.join("\n")).unwrap();
    out
}

#[test]
fn the_truth_itself_has_no_error() {
    let Some(survey) = sample("cylinder-concrete-spiral") else { return };
    let out = result_like_truth(&survey, 0.0, 0);
    let run = adit(&["evaluate", text(&survey), "--out", text(out.path()), "--json", "--max-absolute-mm", "0.001"]);
    assert_eq!(run.status.code(), Some(0), "{}", String::from_utf8_lossy(&run.stderr));
    let figures: serde_json::Value = serde_json::from_slice(&run.stdout).unwrap();
    assert_eq!(figures["poses"]["registered"], 50);
    assert!(figures["poses"]["aligned"]["position_mm"]["max"].as_f64().unwrap() < 1e-6);
    assert!(figures["panorama"].is_null());
}

#[test]
fn a_slip_or_a_lost_photo_is_answered_with_no() {
    let Some(survey) = sample("cylinder-concrete-spiral") else { return };
    let out = result_like_truth(&survey, 0.1, 0);
    let limit = ["evaluate", text(&survey), "--out", text(out.path()), "--max-absolute-mm", "5"];
    let run = adit(&limit);
    assert_eq!(run.status.code(), Some(1));
    let talk = String::from_utf8_lossy(&run.stderr);
    // 100 mm at one of 50 photos.
    assert!(talk.contains("RMSE of absolute positions in mm is 14.142, asked for at most 5"), "{talk}");
    assert!(String::from_utf8_lossy(&run.stdout).contains("worst photo       GOPR0001.JPG"));
    let out = result_like_truth(&survey, 0.0, 3);
    let run = adit(&["evaluate", text(&survey), "--out", text(out.path())]);
    assert_eq!(run.status.code(), Some(1));
    assert!(String::from_utf8_lossy(&run.stderr).contains("3 of 50 photos are not registered"));
}

#[test]
fn a_survey_without_truth_or_result_could_not_be_evaluated() {
    let survey = tempfile::tempdir().unwrap();
    let run = adit(&["evaluate", text(survey.path())]);
    assert_eq!(run.status.code(), Some(2));
    assert!(String::from_utf8_lossy(&run.stderr).contains("truth/poses.csv"));
    fs::create_dir(survey.path().join("truth")).unwrap();
    fs::write(survey.path().join("truth/poses.csv"), "photo,qw,qx,qy,qz,x_m,y_m,z_m\n").unwrap();
    let run = adit(&["evaluate", text(survey.path())]);
    assert_eq!(run.status.code(), Some(2));
    assert!(String::from_utf8_lossy(&run.stderr).contains("adit reconstruct"));
}

/// The truth's texture as our panorama, moved by whole pixels along the axis and with a quarter missing.
#[test]
fn a_panorama_that_is_the_true_texture_shifted_is_measured_so() {
    let Some(survey) = sample("cylinder-brick-spiral") else { return };
    let out = result_like_truth(&survey, 0.0, 0);
    let folder = out.path().join("panorama");
    fs::create_dir(&folder).unwrap();
    let json = fs::read_to_string(survey.join("truth/texture.json")).unwrap();
    let mut grid: serde_json::Value = serde_json::from_str(&json).unwrap();
    let mm_per_px = grid["mm_per_px"].as_f64().unwrap();
    grid["x0_m"] = (grid["x0_m"].as_f64().unwrap() + 3.0 * mm_per_px / 1000.0).into();
    fs::write(folder.join("panorama.json"), grid.to_string()).unwrap();
    let jpeg = fs::read(survey.join("truth/texture.jpg")).unwrap();
    let mut decoder = zune_jpeg::JpegDecoder::new(std::io::Cursor::new(jpeg));
    let rgb = decoder.decode().unwrap();
    let info = decoder.info().unwrap();
    let width = usize::from(info.width);
    let rgba: Vec<u8> = rgb
        .chunks_exact(3)
        .enumerate()
        .flat_map(|(i, p)| [p[0], p[1], p[2], if i % width < width / 4 { 0 } else { 255 }])
        .collect();
    let file = fs::File::create(folder.join("panorama.png")).unwrap();
    let mut encoder = png::Encoder::new(file, u32::from(info.width), u32::from(info.height));
    encoder.set_color(png::ColorType::Rgba);
    encoder.set_compression(png::Compression::Fast);
    encoder.write_header().unwrap().write_image_data(&rgba).unwrap();
    let run = adit(&["evaluate", text(&survey), "--out", text(out.path()), "--json"]);
    assert_eq!(run.status.code(), Some(0), "{}", String::from_utf8_lossy(&run.stderr));
    let figures: serde_json::Value = serde_json::from_slice(&run.stdout).unwrap();
    let shift = &figures["panorama"];
    assert!(shift["matched"] == shift["patches"] && shift["patches"].as_u64().unwrap() > 80, "{shift}");
    assert!((shift["common_x_mm"].as_f64().unwrap() - 3.0 * mm_per_px).abs() < 0.02, "{shift}");
    assert!(shift["relative_mm"]["max"].as_f64().unwrap() < 0.05, "{shift}");
    let coloured = figures["coverage"]["coloured_percent"].as_f64().unwrap();
    assert!((coloured - 75.0).abs() < 3.0, "{coloured}");
}
