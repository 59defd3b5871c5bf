//! The same seed leaves the same bytes, photos included, on any number of threads; another seed leaves others.

use std::collections::BTreeMap;
use std::path::Path;
use std::process::Command;

/// A short flight with a small camera.
fn small_mission() -> String {
    crate::common::mission_text("demo.toml")
        .replace("length_m = 10.0", "length_m = 0.5")
        .replace("width_px = 1000", "width_px = 200")
        .replace("height_px = 750", "height_px = 150")
        .replace("x_px = 466.0", "x_px = 93.2")
        .replace("y_px = 466.0", "y_px = 93.2")
        .replace("cx_px = 503.5", "cx_px = 100.5")
        .replace("cy_px = 373.0", "cy_px = 74.5")
}

fn fly(mission: &Path, out: &Path, more: &[&str]) -> std::process::Output {
    Command::new(env!("CARGO_BIN_EXE_adit-sim"))
        .arg("fly")
        .arg(mission)
        .arg("--out")
        .arg(out)
        .args(more)
        .output()
        .expect("adit-sim runs")
}

/// Every file below a folder with its bytes.
fn files(folder: &Path) -> BTreeMap<String, Vec<u8>> {
    let mut found = BTreeMap::new();
    let mut open = vec![folder.to_path_buf()];
    while let Some(next) = open.pop() {
        for entry in std::fs::read_dir(&next).expect("a folder") {
            let path = entry.expect("an entry").path();
            if path.is_dir() {
                open.push(path);
            } else {
                let name = path.strip_prefix(folder).expect("below").to_string_lossy().into_owned();
                found.insert(name, std::fs::read(&path).expect("a file"));
            }
        }
    }
    found
}

#[test]
fn the_same_seed_leaves_the_same_bytes() {
    let folder = tempfile::tempdir().expect("a folder");
    let mission = folder.path().join("mission.toml");
    std::fs::write(&mission, small_mission()).expect("writable");
    let flown = |name: &str, more: &[&str]| {
        let out = folder.path().join(name);
        let output = fly(&mission, &out, more);
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        assert!(String::from_utf8_lossy(&output.stderr).starts_with("seed 5") || !more.contains(&"5"));
        files(&out)
    };
    let one = flown("one", &["--seed", "5", "--threads", "1"]);
    let two = flown("two", &["--seed", "5", "--threads", "3"]);
    let photos = one.keys().filter(|name| name.starts_with("DCIM/")).count();
    assert!(photos >= 3, "{photos} photos");
    assert_eq!(one.keys().collect::<Vec<_>>(), two.keys().collect::<Vec<_>>());
    for (name, bytes) in &one {
        assert!(bytes == &two[name], "{name} differs");
    }
    let other = flown("other", &["--seed", "6"]);
    assert_ne!(one["board.log"], other["board.log"]);
    assert_ne!(one["DCIM/100GOPRO/GOPR0001.JPG"], other["DCIM/100GOPRO/GOPR0001.JPG"]);
}

#[test]
fn a_folder_that_is_not_empty_is_refused_unless_forced() {
    let folder = tempfile::tempdir().expect("a folder");
    let mission = folder.path().join("mission.toml");
    std::fs::write(&mission, small_mission()).expect("writable");
    let out = folder.path().join("out");
    std::fs::create_dir_all(out.join("DCIM/100GOPRO")).expect("writable");
    std::fs::write(out.join("DCIM/100GOPRO/GOPR0777.JPG"), "an earlier flight's").expect("writable");
    let refused = fly(&mission, &out, &["--no-photos"]);
    assert_eq!(refused.status.code(), Some(2));
    assert!(String::from_utf8_lossy(&refused.stderr).contains("--force"));
    let forced = fly(&mission, &out, &["--no-photos", "--force"]);
    assert!(forced.status.success(), "{}", String::from_utf8_lossy(&forced.stderr));
    assert!(!out.join("DCIM/100GOPRO/GOPR0777.JPG").exists());
}

#[test]
fn errors_name_the_file_and_the_key() {
    let folder = tempfile::tempdir().expect("a folder");
    let mission = folder.path().join("mission.toml");
    let complaint = |text: String, name: &str| {
        std::fs::write(&mission, text).expect("writable");
        let output = fly(&mission, &folder.path().join(name), &[]);
        assert_eq!(output.status.code(), Some(2));
        String::from_utf8_lossy(&output.stderr).into_owned()
    };
    let unknown = complaint(small_mission() + "\n[simulation.weather]\nrain = 1\n", "a");
    assert!(unknown.contains("mission.toml") && unknown.contains("weather"), "{unknown}");
    let wild = complaint(small_mission() + "\n[simulation.shutter]\nmissed_share = 7.0\n", "b");
    assert!(wild.contains("simulation.shutter.missed_share is 7"), "{wild}");
    let missing = fly(&folder.path().join("nowhere.toml"), &folder.path().join("c"), &[]);
    assert_eq!(missing.status.code(), Some(2));
    assert!(String::from_utf8_lossy(&missing.stderr).contains("nowhere.toml"));
}

#[test]
fn the_help_says_what_the_reference_promises() {
    let output = Command::new(env!("CARGO_BIN_EXE_adit-sim")).args(["fly", "--help"]).output().expect("adit-sim runs");
    insta::assert_snapshot!(String::from_utf8_lossy(&output.stdout));
}
