//! Calibration: ours and OpenCV on the same photos in the same run.

use std::fmt::Write as _;
use std::fs;
use std::path::Path;
use std::process::Command;
use std::time::Instant;

use anyhow::{Context, Result};
use serde_json::{Value, json};

use super::peer::{self, python, script};
use super::sets::sample_path;
use super::{THREADS, program, text};
use crate::shell::{run, top};

/// The real photos, below `shared/samples`.
const SAMPLE: &str = "gopro-hero4-chessboard";
/// Simulated ones, where the true camera is known.
const MODELS: [&str; 2] = ["brown-conrady", "kannala-brandt"];
/// The boards: plain, and with markers, which are photographed in part.
const BOARD: &str = "8x6";
const CHARUCO: &str = "charuco:8x6:DICT_4X4_50";

/// `cargo xtask bench-calibration`.
pub(crate) fn bench_calibration(out: &Path) -> Result<()> {
    run("cargo", &["build", "--locked", "--release", "--package", "adit-ground", "--package", "adit-hil-sim"])?;
    peer::install()?;
    fs::create_dir_all(out).with_context(|| format!("cannot make {}", out.display()))?;
    let mut sets = Vec::new();
    match sample_path(SAMPLE) {
        Some(folder) => sets.push((SAMPLE.to_owned(), BOARD, folder, Value::Null)),
        None => eprintln!("xtask: {SAMPLE}: skipped, no shared/samples beside or above the checkout"),
    }
    for model in MODELS {
        for (board, more) in [(BOARD, &[][..]), (CHARUCO, &["--charuco", "4x4", "--in-view", "0.35"])] {
            let name = format!("{}-{model}", if board == BOARD { "board" } else { "charuco" });
            let folder = top().join("target/bench-sets").join(&name);
            run(
                &program("adit-sim"),
                &[&["board", "--model", model, "--out", &text(&folder), "--force"], more].concat(),
            )?;
            let truth = fs::read_to_string(folder.join("truth/board.json")).context("truth/board.json")?;
            sets.push((name, board, folder.join("DCIM"), serde_json::from_str(&truth)?));
        }
    }
    let mut table = String::from(HEADER);
    let mut figures = Vec::new();
    for (name, board, photos, truth) in sets {
        for (who, outcome) in [("ours", ours(&photos, board)?), ("OpenCV", peers(&photos, board)?)] {
            row(&mut table, &name, who, &outcome, &truth);
            figures.push(json!({ "set": name, "who": who, "figures": outcome }));
        }
    }
    for (name, content) in [("table.md", table.clone()), ("table.json", serde_json::to_string_pretty(&figures)?)] {
        fs::write(out.join(name), content).with_context(|| format!("cannot write {}", out.join(name).display()))?;
    }
    print!("{table}");
    Ok(())
}

const HEADER: &str = "\
| photos | who | boards | corners | brown-conrady px | fx | fy | off by sigma | kannala-brandt px | fx | fy | s |
|---|---|---|---|---|---|---|---|---|---|---|---|
";

/// Our figures under the peer's names; both models of one run.
fn ours(photos: &Path, board: &str) -> Result<Value> {
    let started = Instant::now();
    let found =
        output(&program("adit"), &["calibrate", &text(photos), "--board", board, "--json", "--threads", THREADS])?;
    let seconds = started.elapsed().as_secs_f64();
    let photos = found["photos"].as_array().into_iter().flatten();
    let corners: u64 = photos.filter_map(|photo| photo["corners_used"].as_u64()).sum();
    Ok(json!({
        "boards": found["camera"]["photos_used"],
        "photos": found["photos_found"],
        "corners": corners,
        "seconds": seconds,
        "brown-conrady": found["camera"],
        "kannala-brandt": found["other_model"],
    }))
}

fn peers(photos: &Path, board: &str) -> Result<Value> {
    output(&python(), &[&script("opencv.py"), &text(photos), board])
}

fn output(name: &str, arguments: &[&str]) -> Result<Value> {
    eprintln!("xtask: {name} {}", arguments.join(" "));
    let output = Command::new(name).args(arguments).output().with_context(|| format!("cannot run {name}"))?;
    let said = String::from_utf8_lossy(&output.stderr);
    serde_json::from_slice(&output.stdout).with_context(|| format!("{name} prints no JSON: {said}"))
}

fn row(table: &mut String, name: &str, who: &str, outcome: &Value, truth: &Value) {
    let number = |model: &str, key: &str, decimals: usize| {
        outcome[model][key].as_f64().map_or("n/a".to_owned(), |value| format!("{value:.decimals$}"))
    };
    // The formal standard deviation of fx: ours by name, OpenCV's first of a list.
    let off = truth["model"].as_str().and_then(|model| {
        let sigma = &outcome[model]["sigma"];
        let sigma = sigma["formal"]["focal_px"][0].as_f64().or(sigma[0].as_f64())?;
        Some((outcome[model]["fx_px"].as_f64()? - truth["intrinsics"][0].as_f64()?) / sigma)
    });
    // Writing to a string cannot fail.
    let _ = writeln!(
        table,
        "| {name} | {who} | {} of {} | {} | {} | {} | {} | {} | {} | {} | {} | {:.2} |",
        outcome["boards"].as_u64().unwrap_or(0),
        outcome["photos"],
        outcome["corners"],
        number("brown-conrady", "rms_px", 4),
        number("brown-conrady", "fx_px", 2),
        number("brown-conrady", "fy_px", 2),
        off.map_or("n/a".to_owned(), |off| format!("{off:+.2}")),
        number("kannala-brandt", "rms_px", 4),
        number("kannala-brandt", "fx_px", 2),
        number("kannala-brandt", "fy_px", 2),
        outcome["seconds"].as_f64().unwrap_or(f64::NAN),
    );
}
