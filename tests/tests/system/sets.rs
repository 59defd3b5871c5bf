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
