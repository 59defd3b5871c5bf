//! `adit ingest` as a program, on small flights written here: what it pairs, what it names, what it refuses.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use adit_protocol::log::{encode_entry, encode_header};
use adit_protocol::mission::Mission;
use adit_protocol::record::{Entry, Header, TagUpdate};
use adit_protocol::tag::{CaptureState, CaptureTag, Ranges, TagFlags};

const MISSION: &str = r#"format = 1
[tunnel]
profile = "circle"
radius_m = 3.0
[camera]
model = "brown-conrady"
width_px = 320
height_px = 240
fx_px = 150.0
fy_px = 150.0
cx_px = 160.0
cy_px = 120.0
distortion = [0.0, 0.0, 0.0, 0.0, 0.0]
[rig]
images_per_turn = 10
image_up = "forward"
lever_radial_m = 0.06
[flight]
length_m = 10.0
"#;

/// Camera time of the board's start: 2018-05-17 10:20:00.3.
const OFFSET_S: f64 = 1_526_552_400.3;

fn tag(capture: u32, time_s: f64) -> CaptureTag {
    CaptureTag {
        capture,
        state: CaptureState::Commanded,
        time_us: (time_s * 1e6) as u64,
        shaft_rad: capture as f32 * 0.628,
        ranges: Ranges { up_m: Some(3.0), right_m: Some(3.0), down_m: None, left_m: Some(3.0) },
        range_head_m: None,
        odometer_m: Some(capture as f32 * 0.1),
        attitude_rad: None,
        offset_m: None,
        speed_mps: None,
        speed_limit_mps: None,
        flags: TagFlags::default(),
    }
}

/// Capture times with a rhythm that no shift repeats.
fn times_s(count: u32) -> Vec<f64> {
    (0..count).map(|i| 20.0 + f64::from(i) * 1.53 + f64::from(i * i % 17) * 0.021).collect()
}

fn log_of(times_s: &[f64]) -> Vec<u8> {
    let mission = Mission::from_toml(MISSION).unwrap();
    let mut log = encode_header(&Header::new(&mission.parameters(), "test").unwrap()).unwrap().to_vec();
    for (i, &time_s) in times_s.iter().enumerate() {
        let capture = i as u32 + 1;
        log.extend_from_slice(&encode_entry(&Entry::Tag(tag(capture, time_s))).unwrap());
        let update = TagUpdate { capture, state: CaptureState::Busy, time_us: (time_s * 1e6) as u64 + 5000 };
        log.extend_from_slice(&encode_entry(&Entry::TagUpdate(update)).unwrap());
    }
    log
}

/// A TIFF block with `DateTimeOriginal` only.
fn exif(camera_s: f64) -> Vec<u8> {
    let seconds = (camera_s - 1_526_515_200.0).floor() as u64; // since 2018-05-17 00:00:00
    let text = format!("2018:05:17 {:02}:{:02}:{:02}\0", seconds / 3600, seconds / 60 % 60, seconds % 60);
    let mut block = b"MM\0\x2a\0\0\0\x08".to_vec();
    block.extend_from_slice(&[0, 1, 0x87, 0x69, 0, 4, 0, 0, 0, 1, 0, 0, 0, 26, 0, 0, 0, 0]); // IFD 0: Exif IFD at 26
    block.extend_from_slice(&[0, 1, 0x90, 0x03, 0, 2, 0, 0, 0, 20, 0, 0, 0, 44, 0, 0, 0, 0]);
    block.extend_from_slice(text.as_bytes());
    block
}

fn photo(camera_s: Option<f64>, shade: u8) -> Vec<u8> {
    let pixels = vec![shade; 320 * 240];
    let mut bytes = Vec::new();
    let mut encoder = jpeg_encoder::Encoder::new(&mut bytes, 60);
    if let Some(camera_s) = camera_s {
        encoder.add_exif_metadata(&exif(camera_s)).unwrap();
    }
    encoder.encode(&pixels, 320, 240, jpeg_encoder::ColorType::Luma).unwrap();
    bytes
}

struct Case(tempfile::TempDir);

impl Case {
    /// `count` captures, each with its photo; numbers from 9990, so that the folder steps after ten.
    fn new(count: u32) -> Self {
        let case = Self(tempfile::tempdir().unwrap());
        fs::write(case.path("mission.toml"), MISSION).unwrap();
        fs::write(case.path("board.log"), log_of(&times_s(count))).unwrap();
        for (i, time_s) in times_s(count).into_iter().enumerate() {
            case.put(i as u32, &photo(Some(OFFSET_S + time_s), i as u8));
        }
        case
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    fn card_name(index: u32) -> String {
        let place = 9989 + index;
        format!("{}GOPRO/GOPR{:04}.JPG", 100 + place / 9999, place % 9999 + 1)
    }

    fn put(&self, index: u32, bytes: &[u8]) {
        let path = self.path("DCIM").join(Self::card_name(index));
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(path, bytes).unwrap();
    }

    fn run(&self, out: &Path) -> Output {
        let (log, dcim, mission) = (self.path("board.log"), self.path("DCIM"), self.path("mission.toml"));
        Command::new(env!("CARGO_BIN_EXE_adit"))
            .args(["ingest", "--json", "--log"])
            .arg(log)
            .arg("--photos")
            .arg(dcim)
            .arg("--mission")
            .arg(mission)
            .arg("--out")
            .arg(out)
            .output()
            .unwrap()
    }

    fn figures(&self) -> serde_json::Value {
        let run = self.run(&self.path("survey"));
        assert_eq!(run.status.code(), Some(0), "{}", String::from_utf8_lossy(&run.stderr));
        serde_json::from_slice(&run.stdout).unwrap()
    }

    fn refusal(&self, out: &Path) -> String {
        let run = self.run(out);
        assert_eq!(run.status.code(), Some(2), "{}", String::from_utf8_lossy(&run.stdout));
        String::from_utf8_lossy(&run.stderr).into_owned()
    }
}

fn list(figures: &serde_json::Value, key: &str) -> Vec<String> {
    let items = figures[key].as_array().unwrap();
    items.iter().map(|item| format!("{}: {}", item["what"].as_str().unwrap(), item["why"].as_str().unwrap())).collect()
}

fn photo_of(figures: &serde_json::Value, capture: u32) -> Option<String> {
    let pairs = figures["pairs"].as_array().unwrap();
    let pair = pairs.iter().find(|pair| pair["capture"] == capture)?;
    Some(pair["on_card"].as_str().unwrap().to_owned())
}

#[test]
fn a_whole_flight_becomes_a_survey_that_loads_without_a_loss() {
    let case = Case::new(30);
    let figures = case.figures();
    assert_eq!(figures["pairs"].as_array().unwrap().len(), 30);
    for capture in 1..=30 {
        assert_eq!(photo_of(&figures, capture), Some(Case::card_name(capture - 1)));
    }
    let survey = adit_ground::survey::load(&case.path("survey")).unwrap();
    assert_eq!((survey.photos.len(), survey.losses.len()), (30, 0), "{:?}", survey.losses);
    assert_eq!(survey.photos[10].name, "GOPR0001.JPG");
    assert!(case.path("survey/log/board.log").is_file() && case.path("survey/ingest.json").is_file());
    assert!((figures["clocks"][0]["offset_s"].as_f64().unwrap() - OFFSET_S).abs() < 0.2);
}

#[test]
fn a_missed_a_double_and_an_early_photo_are_named_and_the_rest_is_paired() {
    let case = Case::new(0);
    let times = times_s(30);
    fs::write(case.path("board.log"), log_of(&times)).unwrap();
    let mut camera: Vec<f64> = times.iter().enumerate().filter(|(i, _)| *i != 11).map(|(_, t)| *t).collect();
    camera.insert(20, camera[19] + 0.7);
    camera.insert(0, 2.0);
    for (i, time_s) in camera.iter().enumerate() {
        case.put(i as u32, &photo(Some(OFFSET_S + time_s), i as u8));
    }
    let figures = case.figures();
    assert_eq!(list(&figures, "unmatched_captures").len(), 1);
    assert!(list(&figures, "unmatched_captures")[0].starts_with("capture 12: no photo at 3"));
    let photos = list(&figures, "unmatched_photos");
    assert_eq!(photos.len(), 2, "{photos:?}");
    assert!(photos[0].contains("GOPR9990.JPG: taken before the first capture"), "{photos:?}");
    assert!(photos[1].contains(&Case::card_name(21)) && photos[1].contains("double"), "{photos:?}");
    assert_eq!(photo_of(&figures, 30), Some(Case::card_name(30)));
    let tags = fs::read_to_string(case.path("survey/tags.csv")).unwrap();
    assert!(tags.lines().nth(12).unwrap().starts_with("12,,busy,"), "{tags}");
}

#[test]
fn photos_without_a_time_or_no_jpeg_at_all_are_paired_by_their_place_and_named() {
    let case = Case::new(30);
    case.put(7, &photo(None, 3));
    case.put(8, b"this was a photo once");
    let figures = case.figures();
    assert_eq!(photo_of(&figures, 8), Some(Case::card_name(7)));
    assert_eq!(photo_of(&figures, 9), Some(Case::card_name(8)));
    let notes = list(&figures, "notes");
    assert!(notes.iter().any(|note| note.contains(&Case::card_name(7)) && note.contains("EXIF")), "{notes:?}");
    let survey = adit_ground::survey::load(&case.path("survey")).unwrap();
    assert_eq!(survey.photos.len(), 29);
    assert!(survey.losses[0].why.contains("not a JPEG"), "{:?}", survey.losses);
}

#[test]
fn a_torn_log_gives_what_it_holds_and_says_what_it_lost() {
    let case = Case::new(30);
    let log = log_of(&times_s(30));
    fs::write(case.path("board.log"), &log[..log.len() - 5]).unwrap();
    let figures = case.figures();
    assert_eq!(figures["pairs"].as_array().unwrap().len(), 30);
    assert!(list(&figures, "notes")[0].contains("ends within a record"), "{figures}");
}

#[test]
fn what_cannot_be_ingested_is_refused_by_name() {
    let case = Case::new(5);
    let out = case.path("survey");
    fs::write(case.path("board.log"), vec![0xa5; 4000]).unwrap();
    assert!(case.refusal(&out).contains("board.log: no captures in it, but"), "{}", case.refusal(&out));
    fs::write(case.path("board.log"), b"").unwrap();
    assert!(case.refusal(&out).contains("board.log: no captures"), "{}", case.refusal(&out));
    fs::remove_file(case.path("board.log")).unwrap();
    assert!(case.refusal(&out).contains("board.log: the board log cannot be read"), "{}", case.refusal(&out));
    fs::write(case.path("board.log"), log_of(&times_s(5))).unwrap();
    fs::write(case.path("mission.toml"), MISSION.replace("radius_m = 3.0", "radius_m = 3000")).unwrap();
    assert!(
        case.refusal(&out).contains("mission.toml:\nline 4: tunnel.radius_m")
            || case.refusal(&out).contains("mission.toml: line 4: tunnel.radius_m"),
        "{}",
        case.refusal(&out)
    );
    fs::write(case.path("mission.toml"), MISSION).unwrap();
    fs::remove_dir_all(case.path("DCIM")).unwrap();
    assert!(case.refusal(&out).contains("DCIM: the photos cannot be listed"), "{}", case.refusal(&out));
    fs::create_dir(case.path("DCIM")).unwrap();
    assert!(case.refusal(&out).contains("DCIM: no photo"), "{}", case.refusal(&out));
    assert!(!out.join("tags.csv").exists());
}

#[test]
fn an_output_that_cannot_be_written_is_named_and_somebody_else_s_survey_is_left_alone() {
    let case = Case::new(5);
    let file = case.path("file");
    fs::write(&file, "").unwrap();
    let message = case.refusal(&file.join("survey"));
    assert!(message.contains("file/survey: cannot be written"), "{message}");
    let foreign = case.path("foreign");
    fs::create_dir(&foreign).unwrap();
    fs::write(foreign.join("tags.csv"), "by hand").unwrap();
    assert!(case.refusal(&foreign).contains("did not make"));
    assert_eq!(fs::read_to_string(foreign.join("tags.csv")).unwrap(), "by hand");
    assert!(case.refusal(&case.path("DCIM/survey")).contains("inside the folder that the photos come from"));
}

#[test]
fn a_stopped_ingest_is_taken_up_and_a_second_one_changes_nothing() {
    let case = Case::new(12);
    let first = case.figures();
    let survey = case.path("survey");
    let tags = fs::read(survey.join("tags.csv")).unwrap();
    // As a kill leaves it: photos half placed, no tags, the mark still there.
    for name in ["tags.csv", "survey.toml", "ingest.json", "photos/GOPR9993.JPG"] {
        fs::remove_file(survey.join(name)).unwrap();
    }
    fs::write(survey.join("ingest.json.partial"), "").unwrap();
    fs::write(survey.join("photos/GOPR9994.JPG.new"), "torn").unwrap();
    fs::remove_file(survey.join("photos/GOPR9994.JPG")).unwrap();
    assert_eq!(case.figures(), first);
    assert_eq!(fs::read(survey.join("tags.csv")).unwrap(), tags);
    assert!(!survey.join("photos/GOPR9994.JPG.new").exists());
    assert_eq!(case.figures(), first);
    let original = case.path("DCIM").join(Case::card_name(3));
    assert_eq!(fs::read(original).unwrap(), fs::read(survey.join("photos/GOPR9993.JPG")).unwrap());
}
