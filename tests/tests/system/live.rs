//! A simulated flight over a serial line, watched live: sensor, camera and line fail, and each is shown in time.
//!
//! Times are the board's own and those of `adit live`, so that a busy machine, on which the flight itself is late, does not
//! count: a picture every 0.2 s, so what is told by 0.8 s is shown within a second.

use std::io::{BufRead, BufReader, Read, Write};
use std::path::Path;
use std::process::{Child, ChildStdout, Command, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use serde_json::Value;
use serialport::{SerialPort, TTYPort};

use crate::programs::{program, text};

const MISSION: &str = include_str!("live.toml");
/// When the mission breaks sensor and camera.
const UNPLUGGED_S: f64 = 8.0;
const DEAF_S: f64 = 14.0;
/// Until a picture shows what is known.
const PICTURE_S: f64 = 0.2;

/// Ends with the test, however that ends.
struct Running(Child);

impl Drop for Running {
    fn drop(&mut self) {
        // It may have ended by itself.
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// Two serial ports, joined by a cable that can be cut.
struct Cable {
    ports: [String; 2],
    is_cut: Arc<AtomicBool>,
}

impl Cable {
    fn new() -> Self {
        let pairs = [TTYPort::pair(), TTYPort::pair()].map(|pair| pair.expect("a pseudo-terminal"));
        let ports = pairs.each_ref().map(|(_, port)| port.name().expect("it has a name"));
        let is_cut = Arc::new(AtomicBool::new(false));
        let [one, other] = pairs.map(|(end, _)| end);
        let carry = |from: &TTYPort, to: &TTYPort| {
            let (mut from, mut to) = (from.try_clone_native().expect("cloned"), to.try_clone_native().expect("cloned"));
            let is_cut = Arc::clone(&is_cut);
            std::thread::spawn(move || {
                let mut buffer = [0; 1024];
                loop {
                    // An end that nobody has opened yet cannot be read.
                    let Ok(count) = from.read(&mut buffer) else {
                        std::thread::sleep(Duration::from_millis(5));
                        continue;
                    };
                    if !is_cut.load(Ordering::Relaxed) {
                        // What an end does not take is lost, as on any line.
                        let _ = to.write_all(&buffer[..count]);
                    }
                }
            });
        };
        carry(&one, &other);
        carry(&other, &one);
        Self { ports, is_cut }
    }
}

/// What `adit live` shows, picture by picture.
struct Shown {
    lines: std::io::Lines<BufReader<ChildStdout>>,
    last: Value,
}

impl Shown {
    /// The first picture that is so; five pictures a second, so many of them at most.
    fn until(&mut self, what: &str, most: usize, is_so: impl Fn(&Value) -> bool) -> Value {
        for _ in 0..most {
            let line = self.lines.next().expect("a picture").expect("it can be read");
            self.last = serde_json::from_str(&line).expect("a picture is JSON");
            if is_so(&self.last) {
                return self.last.clone();
            }
        }
        panic!("not shown: {what}; last was {:#}", self.last);
    }
}

fn board_s(view: &Value) -> f64 {
    view["board_s"].as_f64().expect("the board was heard")
}

fn is_link(view: &Value, status: &str) -> bool {
    view["link"]["status"] == status
}

fn marked_m2(view: &Value) -> f64 {
    view["wall"]["marked_m2"].as_f64().expect("the section is known")
}

fn watch(arguments: &[&str]) -> (Running, Shown) {
    let mut command = Command::new(program("adit"));
    command.arg("live").args(arguments).arg("--json").stdout(Stdio::piped());
    let mut child = command.spawn().expect("adit starts");
    let lines = BufReader::new(child.stdout.take().expect("piped")).lines();
    (Running(child), Shown { lines, last: Value::Null })
}

fn fly(mission: &Path, out: &Path, port: &str) -> Running {
    let line = format!("serial:{port}:57600");
    let arguments = ["--autopilot", "ardupilot-4.7", "--realtime", "--no-photos", "--seed", "3", "--mavlink", &line];
    let mut command = Command::new(program("adit-sim"));
    command
        .args(["fly", text(mission), "--out", text(out)])
        .args(arguments)
        .stdout(Stdio::null())
        .stderr(Stdio::null());
    Running(command.spawn().expect("adit-sim starts"))
}

#[test]
fn what_goes_wrong_on_a_flight_is_shown_in_time_and_the_record_shows_it_again() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let (mission, record) = (folder.path().join("mission.toml"), folder.path().join("flight.tlog"));
    std::fs::write(&mission, MISSION).expect("the mission is written");
    let cable = Cable::new();
    let line = format!("serial:{}:57600", cable.ports[0]);
    let (live, mut shown) = watch(&[&line, "--mission", text(&mission), "--record", text(&record)]);
    shown.until("that nobody is heard", 50, |view| is_link(view, "waiting"));
    let _flight = fly(&mission, &folder.path().join("flight"), &cable.ports[1]);

    let ranges = |view: &Value, state: &str| (0..4).all(|beam| view["ranges"][beam]["state"] == state);
    shown.until("a scan with four ranges", 300, |view| {
        is_link(view, "up") && view["mode"]["value"] == "Scanning" && ranges(view, "valid")
    });
    let unplugged = shown.until("the unplugged sensor", 300, |view| view["ranges"][0]["state"] == "invalid");
    let after_s = board_s(&unplugged) - UNPLUGGED_S;
    assert!((0.0..=1.0 - PICTURE_S).contains(&after_s), "shown {after_s} s after it was unplugged");
    let before = shown.until("the sensor again", 300, |view| ranges(view, "valid"));
    assert_eq!(marked_m2(&before), 0.0, "no gap before the camera is deaf");

    let gap = shown.until("the gap", 300, |view| marked_m2(view) > 0.05);
    let after_s = board_s(&gap) - DEAF_S;
    assert!((0.0..=2.0 - PICTURE_S).contains(&after_s), "shown {after_s} s after the camera was deaf");

    cable.is_cut.store(true, Ordering::Relaxed);
    let lost = shown.until("the lost link", 50, |view| is_link(view, "lost"));
    assert!(lost["link"]["silent_s"].as_f64().is_some_and(|silent_s| silent_s <= 2.0), "{:#}", lost["link"]);
    shown.until("old figures", 50, |view| view["offset_m"]["is_stale"] == true);
    cable.is_cut.store(false, Ordering::Relaxed);
    shown.until("the link again", 50, |view| is_link(view, "up") && view["offset_m"]["is_stale"] == false);

    // Killed, not ended: the record is whole up to the last frame all the same.
    drop(live);
    let last = shown.lines.map_while(Result::ok).last().and_then(|line| serde_json::from_str(&line).ok());
    let last: Value = last.unwrap_or(shown.last);
    let (_replay, mut again) = watch(&["--replay", text(&record), "--mission", text(&mission), "--speed", "50"]);
    let end = again.until("the record's end", 300, |view| view["replay"]["is_over"] == true);
    for count in ["captures", "missed"] {
        let more = end[count]["value"].as_i64().zip(last[count]["value"].as_i64()).map(|(again, live)| again - live);
        assert!(matches!(more, Some(0 | 1)), "{count}: {} and then {}", last[count], end[count]);
    }
    assert!(marked_m2(&end) >= marked_m2(&gap), "no photo was taken that could show any of it");
}
