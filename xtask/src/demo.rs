//! The main job end to end, on a simulated flight.

use std::fs;
use std::time::Instant;

use anyhow::{Context, Result};

use crate::shell::{run, top};

const MISSION: &str = "hil-sim/missions/demo.toml";

/// Builds, flies, ingests, reconstructs, evaluates.
fn steps(seed: u64) -> Result<()> {
    let seed = seed.to_string();
    let program = |name: &str| top().join("target/release").join(name).to_string_lossy().into_owned();
    let (sim, adit) = (program("adit-sim"), program("adit"));
    run(&sim, &["fly", MISSION, "--out", "demo/flight", "--seed", &seed, "--force"])?;
    run(
        &adit,
        &[
            "ingest",
            "--log",
            "demo/flight/board.log",
            "--photos",
            "demo/flight/DCIM",
            "--mission",
            MISSION,
            "--out",
            "demo/survey",
        ],
    )?;
    // The simulator's truth goes beside the survey, where `evaluate` looks for it.
    copy_folder("demo/flight/truth", "demo/survey/truth")?;
    run(&adit, &["plan", MISSION, "--out", "demo/plan"])?;
    run(&adit, &["reconstruct", "demo/survey"])?;
    run(&adit, &["evaluate", "demo/survey"])
}

/// `cargo xtask demo`.
pub(crate) fn demo(seed: u64) -> Result<()> {
    run("cargo", &["build", "--locked", "--release", "--package", "adit-ground", "--package", "adit-hil-sim"])?;
    let demo = top().join("demo");
    if demo.exists() {
        fs::remove_dir_all(&demo).with_context(|| format!("cannot empty {}", demo.display()))?;
    }
    let started = Instant::now();
    steps(seed)?;
    eprintln!("\nThe demo took {:.0} s. Look at:", started.elapsed().as_secs_f64());
    for (path, what) in [
        ("report.html", "what was measured, with pictures (open in a browser)"),
        ("panorama/panorama.png", "the wall, unrolled"),
        ("model.glb", "the textured tunnel (any glTF viewer, Blender, Unity)"),
        ("points.ply", "the dense point cloud"),
        ("colmap/", "cameras, images and points for COLMAP's tools"),
        ("poses.csv", "where every photo was taken"),
    ] {
        println!("demo/survey/out/{path:24} {what}");
    }
    Ok(())
}

fn copy_folder(from: &str, to: &str) -> Result<()> {
    let (from, to) = (top().join(from), top().join(to));
    fs::create_dir_all(&to).with_context(|| format!("cannot make {}", to.display()))?;
    for entry in fs::read_dir(&from).with_context(|| format!("cannot read {}", from.display()))? {
        let entry = entry?;
        fs::copy(entry.path(), to.join(entry.file_name()))
            .with_context(|| format!("cannot copy {}", entry.path().display()))?;
    }
    Ok(())
}
