//! A run killed in any stage goes on where it was and ends as if nothing had happened.

use std::process::{Command, Stdio};

use super::programs::{FLOWN, figures, program, text};

/// Each stage and the file whose appearance shows that the stage before it is done.
const STAGES: [(&str, &str); 7] = [
    ("coarse", "stages/prior.bin"),
    ("match", "stages/coarse.bin"),
    ("adjust", "stages/match.bin"),
    ("surface", "stages/adjust.bin"),
    ("texture", "stages/surface.bin"),
    ("model", "stages/texture.bin"),
    ("report", "stages/model.bin"),
];

#[test]
fn a_run_killed_in_any_stage_keeps_what_was_done_and_ends_the_same() {
    let whole = FLOWN.copy();
    figures("adit", &["reconstruct", text(whole.path())]);
    let survey = FLOWN.copy();
    let out = survey.path().join("out");
    for (stage, done_before) in STAGES {
        let mut child = Command::new(program("adit"))
            .args(["reconstruct", text(survey.path())])
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .expect("adit starts");
        while !out.join(done_before).exists() && child.try_wait().expect("adit can be asked").is_none() {
            std::thread::yield_now();
        }
        child.kill().expect("adit is killed");
        child.wait().expect("adit has ended");
        assert!(out.join(done_before).exists(), "the stage before {stage} was never done");
    }
    let summary = figures("adit", &["reconstruct", text(survey.path())]);
    // Everything up to the adjustment was done in killed runs: the last one only takes it up.
    for name in ["prior", "coarse", "match", "adjust"] {
        let stages = summary["stages"].as_array().expect("stages are listed");
        let stage = stages.iter().find(|stage| stage["stage"] == name).expect("every stage is listed");
        assert!(stage["seconds"].is_null(), "{name} was run again: {stage}");
    }
    for file in [
        "poses.csv",
        "relief.tif",
        "panorama/panorama.json",
        "coverage.json",
        "model.glb",
        "points.ply",
        "colmap/points3D.txt",
    ] {
        let read =
            |survey: &std::path::Path| std::fs::read(survey.join("out").join(file)).expect("the result is there");
        assert!(read(whole.path()) == read(survey.path()), "{file} differs from that of a run in one go");
    }
}
