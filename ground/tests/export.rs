//! `adit export` on a small reconstruction: read back by programs that are not ours, stopped half-way, refused.

#[path = "support/finished.rs"]
mod finished;

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use serde_json::Value;
use tempfile::TempDir;

/// A Python with the readers: the one that `cargo xtask` installs, or that of this variable.
const PYTHON_VARIABLE: &str = "ADIT_PEERS_PYTHON";

/// A reconstruction to export from.
struct Folder(TempDir);

impl Folder {
    fn new() -> Self {
        let folder = Self(tempfile::tempdir().unwrap());
        finished::write(&folder.out());
        folder
    }

    fn out(&self) -> PathBuf {
        self.0.path().join("out")
    }

    fn exported(&self) -> PathBuf {
        self.0.path().join("exported")
    }

    fn command(&self, arguments: &[&str]) -> Vec<String> {
        let words = [env!("CARGO_BIN_EXE_adit"), "export"].map(str::to_owned);
        let folders = [self.out(), PathBuf::from("--out"), self.exported()];
        let folders = folders.into_iter().map(|path| path.to_str().unwrap().to_owned());
        words.into_iter().chain(folders).chain(arguments.iter().map(|&word| word.to_owned())).collect()
    }

    fn run(&self, arguments: &[&str]) -> Output {
        let command = self.command(arguments);
        Command::new(&command[0]).args(&command[1..]).output().unwrap()
    }

    /// Exports, expects success, returns the figures of the first file.
    fn export(&self, arguments: &[&str]) -> Value {
        let output = self.run(&[arguments, &["--json"]].concat());
        assert!(output.status.success(), "{}", said(&output));
        let figures: Value = serde_json::from_slice(&output.stdout).unwrap();
        figures["files"][0].clone()
    }

    /// Names in the folder that was exported to.
    fn names(&self) -> Vec<String> {
        let Ok(entries) = fs::read_dir(self.exported()) else { return Vec::new() };
        let mut names: Vec<String> =
            entries.map(|entry| entry.unwrap().file_name().to_str().unwrap().to_owned()).collect();
        names.sort();
        names
    }
}

fn said(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

fn peers() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../target/peers")
}

/// Exports and has a reader of another house compare the file with the painted wall. Skipped, by name, where it is missing.
fn read_back(test: &str, reader: &str, name: &str, arguments: &[&str]) {
    let python = std::env::var_os(PYTHON_VARIABLE).map_or_else(|| peers().join("bin/python"), PathBuf::from);
    if !python.exists() {
        eprintln!("skipped: {test} needs target/peers (cargo xtask setup) or {PYTHON_VARIABLE}");
        return;
    }
    let folder = Folder::new();
    folder.export(arguments);
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/peers/read_back.py");
    let output = Command::new(python)
        .arg(script)
        .arg(reader)
        .arg(folder.exported().join(name))
        .arg(folder.out().join("panorama/panorama.json"))
        .output()
        .unwrap();
    assert!(output.status.success(), "{}", said(&output));
    eprint!("{}", String::from_utf8_lossy(&output.stdout));
}

#[test]
fn trimesh_reads_the_ply() {
    read_back("trimesh_reads_the_ply", "ply", "points.ply", &["--format", "ply", "--point-step-mm", "4"]);
}

#[test]
fn laspy_reads_the_laz() {
    read_back("laspy_reads_the_laz", "laz", "points.laz", &["--format", "laz", "--point-step-mm", "4"]);
}

#[test]
fn libe57_reads_the_e57() {
    read_back("libe57_reads_the_e57", "e57", "points.e57", &["--format", "e57", "--point-step-mm", "4"]);
}

#[test]
fn trimesh_reads_the_glb_and_its_textures_lie_where_they_belong() {
    let arguments = ["--format", "glb", "--texture-px", "256"];
    read_back("trimesh_reads_the_glb_and_its_textures_lie_where_they_belong", "glb", "model.glb", &arguments);
}

#[test]
fn trimesh_reads_the_obj_and_its_textures_lie_where_they_belong() {
    let arguments = ["--format", "obj", "--texture-px", "256"];
    read_back("trimesh_reads_the_obj_and_its_textures_lie_where_they_belong", "obj", "obj", &arguments);
}

#[test]
fn tifffile_and_gdal_read_the_tiff() {
    read_back("tifffile_and_gdal_read_the_tiff", "tiff", "panorama.tif", &["--format", "tiff"]);
}

#[test]
fn gdal_reads_the_tiff_of_jpegs_with_its_mask() {
    let arguments = ["--format", "tiff", "--compression", "jpeg"];
    read_back("gdal_reads_the_tiff_of_jpegs_with_its_mask", "gdal", "panorama.tif", &arguments);
}

#[test]
fn colmap_reads_the_binary_model_as_it_would_write_it() {
    let arguments = ["--format", "colmap,colmap-bin"];
    read_back("colmap_reads_the_binary_model_as_it_would_write_it", "colmap", "colmap-bin", &arguments);
}

#[test]
fn khronos_validator_finds_no_fault_in_the_glb() {
    let modules = peers().join("node/node_modules");
    if !modules.join("gltf-validator").is_dir() {
        eprintln!("skipped: khronos_validator_finds_no_fault_in_the_glb needs target/peers/node (cargo xtask setup)");
        return;
    }
    let folder = Folder::new();
    folder.export(&["--format", "glb", "--texture-px", "256"]);
    let output = Command::new("node")
        .arg(Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/peers/validate_gltf.cjs"))
        .arg(folder.exported().join("model.glb"))
        .env("NODE_PATH", modules)
        .output()
        .unwrap();
    let report = String::from_utf8_lossy(&output.stdout);
    assert!(output.status.success(), "{report}{}", said(&output));
}

#[test]
fn poses_are_written_as_json_and_csv() {
    let folder = Folder::new();
    folder.export(&["--format", "poses-json,poses-csv"]);
    let poses: Value = serde_json::from_slice(&fs::read(folder.exported().join("poses.json")).unwrap()).unwrap();
    let photos = poses["photos"].as_array().unwrap();
    let table = adit_ground::poses::read_poses(&folder.exported().join("poses.csv")).unwrap();
    assert_eq!((photos.len(), table.len()), (3, 3));
    for (json, csv) in photos.iter().zip(&table) {
        let numbers = |value: &Value| -> Vec<f64> {
            value.as_array().unwrap().iter().map(|number| number.as_f64().unwrap()).collect()
        };
        assert_eq!(json["photo"], csv.photo.as_str());
        let centre = numbers(&json["tunnel_from_cam"]["position_m"]);
        let rotation = numbers(&json["tunnel_from_cam"]["quaternion_wxyz"]);
        let q = csv.tunnel_from_cam.rotation;
        for (found, expected) in centre.iter().zip(csv.tunnel_from_cam.translation.vector.iter()) {
            assert!((found - expected).abs() < 1e-8);
        }
        for (found, expected) in rotation.iter().zip([q.w, q.i, q.j, q.k]) {
            assert!((found - expected).abs() < 1e-8);
        }
    }
    assert_eq!((&photos[0]["status"], &photos[2]["status"]), (&"adjusted".into(), &"prior-only".into()));
    assert_eq!(poses["camera"]["fy_px"], 466.5);
    assert_eq!(poses["tunnel"]["radius_m"], 0.5);
}

#[test]
fn pixels_are_doubled_as_long_as_they_are_small_enough() {
    let folder = Folder::new();
    let pixel = |wanted: &str, format: &str| {
        let arguments = ["--format", format, "--mm-per-px", wanted, "--force"];
        folder.export(&arguments)["mm_per_px"].as_f64().unwrap()
    };
    for format in ["tiff", "glb"] {
        assert!((pixel("7.9", format) - 4.0).abs() < 0.01);
        assert!((pixel("9", format) - 8.0).abs() < 0.02);
    }
}

#[test]
fn all_formats_are_written_and_counted() {
    let folder = Folder::new();
    let output = folder.run(&["--all", "--json"]);
    assert!(output.status.success(), "{}", said(&output));
    let figures: Value = serde_json::from_slice(&output.stdout).unwrap();
    let files = figures["files"].as_array().unwrap();
    // No relief: this reconstruction has none.
    assert_eq!(files.len(), 11);
    for file in files {
        let path = Path::new(file["path"].as_str().unwrap());
        assert!(path.exists() && file["bytes"].as_u64().unwrap() > 0, "{file:#}");
    }
    assert!(folder.exported().join("tiles/panorama_files/10/3_1.png").is_file());
    assert_eq!(folder.names().len(), 11, "{:?}", folder.names());
}

#[test]
fn what_is_there_is_not_replaced_in_silence() {
    let folder = Folder::new();
    folder.export(&["--format", "ply"]);
    let output = folder.run(&["--format", "laz,ply"]);
    assert_eq!(output.status.code(), Some(2));
    assert!(said(&output).contains("points.ply") && said(&output).contains("--force"), "{}", said(&output));
    assert_eq!(folder.names(), ["points.ply"]);
    folder.export(&["--format", "laz,ply", "--force"]);
}

#[test]
fn a_missing_stage_is_named_with_what_to_do() {
    let refused = |remove: &str, format: &str, named: [&str; 2]| {
        let folder = Folder::new();
        let path = folder.out().join(remove);
        if path.exists() {
            fs::remove_file(path).unwrap();
        }
        let output = folder.run(&["--format", format]);
        let said = said(&output);
        assert_eq!(output.status.code(), Some(2), "{said}");
        assert!(named.iter().all(|name| said.contains(name)), "{said}");
        assert!(folder.names().is_empty(), "{:?}", folder.names());
    };
    refused("stages/adjust.bin", "colmap", ["adjust.bin", "adit reconstruct"]);
    refused("panorama/panorama.json", "laz", ["panorama.json", "adit reconstruct"]);
    refused("panorama/tiles/panorama_files/10/1_0.png", "tiff", ["1_0.png", "No such file"]);
    refused("relief.tif", "relief", ["relief.tif", "adit reconstruct"]);
}

#[test]
fn a_damaged_stage_is_named() {
    let folder = Folder::new();
    let path = folder.out().join("stages/adjust.bin");
    let content = fs::read(&path).unwrap();
    for damaged in [&content[..content.len() / 2], &[content.as_slice(), &[0]].concat(), b"short"] {
        fs::write(&path, damaged).unwrap();
        let output = folder.run(&["--format", "poses-json"]);
        assert_eq!(output.status.code(), Some(2));
        assert!(said(&output).contains("adjust.bin is damaged"), "{}", said(&output));
    }
}

/// Formats with their result and a number of blocks (of 512 bytes) of which the file system then has too few.
const LIMITS: [(&str, &str, u32); 8] = [
    ("ply", "points.ply", 64),
    ("laz", "points.laz", 64),
    ("e57", "points.e57", 64),
    ("glb", "model.glb", 16),
    ("obj", "obj", 16),
    ("tiff", "panorama.tif", 16),
    ("colmap-bin", "colmap-bin", 2),
    ("poses-json", "poses.json", 2),
];

/// Runs an export whose files may not grow beyond a limit: writing fails there, or the program is killed.
#[cfg(unix)]
fn limited(folder: &Folder, format: &str, blocks: u32, killed: bool) -> Output {
    let ignore = if killed { "" } else { "trap '' XFSZ;" };
    let script = format!("{ignore} ulimit -f {blocks}; exec \"$@\"");
    let command = folder.command(&["--format", format, "--point-step-mm", "4", "--texture-px", "256"]);
    Command::new("sh").args(["-c", &script, "sh"]).args(command).output().unwrap()
}

#[cfg(unix)]
#[test]
fn a_full_disk_is_said_and_leaves_nothing() {
    for (format, _, blocks) in LIMITS {
        let folder = Folder::new();
        let output = limited(&folder, format, blocks, false);
        let said = said(&output);
        assert_eq!(output.status.code(), Some(2), "{format}: {said}");
        assert!(said.contains("File too large") && !said.contains("panicked"), "{format}: {said}");
        assert!(folder.names().is_empty(), "{format}: {:?}", folder.names());
    }
}

#[cfg(unix)]
#[test]
fn a_killed_run_leaves_no_half_file_under_the_final_name_and_the_next_one_cleans_up() {
    use std::os::unix::process::ExitStatusExt as _;
    for (format, name, blocks) in LIMITS {
        let folder = Folder::new();
        let output = limited(&folder, format, blocks, true);
        assert!(output.status.signal().is_some(), "{format} was not killed: {}", said(&output));
        assert!(!folder.exported().join(name).exists(), "{format}");
        folder.export(&["--format", format]);
        assert_eq!(folder.names(), [name]);
    }
}
