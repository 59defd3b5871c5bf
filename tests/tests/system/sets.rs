//! The simulator's survey sets are survey folders that the ground side reads without a complaint.

use super::programs::{figures, text};

#[test]
fn a_set_is_reconstructed_and_evaluated_as_any_survey() {
    let survey = tempfile::tempdir().expect("a temporary folder");
    let folder = text(survey.path());
    figures("adit-sim", &["survey", "brick", "--out", folder, "--photos", "24", "--width-px", "320", "--no-texture"]);
    let summary = figures("adit", &["reconstruct", folder, "--stop-after", "adjust"]);
    assert_eq!((&summary["photos"], &summary["registered"]), (&24.into(), &24.into()), "{summary:#}");
    assert_eq!(summary["losses"].as_array().map(Vec::len), Some(0), "{summary:#}");
    let evaluation = figures("adit", &["evaluate", folder]);
    let aligned = evaluation["poses"]["aligned"]["position_mm"]["rmse"].as_f64().expect("a number");
    // A third of the samples' resolution: 20 mm per pixel.
    assert!(aligned < 10.0, "{evaluation:#}");
}

#[test]
fn a_shaft_that_still_turns_while_photos_are_read_out_is_accounted_for() {
    let survey = tempfile::tempdir().expect("a temporary folder");
    let folder = text(survey.path());
    let size = ["--photos", "24", "--width-px", "500", "--no-texture"];
    figures("adit-sim", &[&["survey", "unsettled-shaft", "--out", folder], &size[..]].concat());
    let aligned_mm = || {
        figures("adit", &["reconstruct", folder, "--stop-after", "adjust", "--fresh"]);
        let evaluation = figures("adit", &["evaluate", folder]);
        assert_eq!(evaluation["poses"]["registered"], 24, "{evaluation:#}");
        evaluation["poses"]["aligned"]["position_mm"]["rmse"].as_f64().expect("a number")
    };
    let with_readout_mm = aligned_mm();
    let path = survey.path().join("survey.toml");
    let config = std::fs::read_to_string(&path).expect("survey.toml");
    assert!(config.contains("rolling_shutter_s = 0.03"), "{config}");
    std::fs::write(&path, config.replace("rolling_shutter_s = 0.03", "rolling_shutter_s = 0.0")).expect("survey.toml");
    let without_mm = aligned_mm();
    eprintln!("aligned {with_readout_mm:.3} mm with the readout, {without_mm:.3} mm without");
    assert!(with_readout_mm < 1.0 && with_readout_mm < 0.5 * without_mm, "{with_readout_mm} mm, {without_mm} mm");
}
