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
fn bulges_and_ovality_are_measured_to_millimetres() {
    let survey = tempfile::tempdir().expect("a temporary folder");
    let folder = text(survey.path());
    figures(
        "adit-sim",
        &["survey", "imperfect", "--out", folder, "--photos", "30", "--width-px", "500", "--no-texture"],
    );
    let summary = figures("adit", &["reconstruct", folder, "--stop-after", "surface"]);
    assert_eq!(summary["losses"].as_array().map(Vec::len), Some(0), "{summary:#}");
    let relief = &figures("adit", &["evaluate", folder])["relief"];
    let number = |of: &serde_json::Value| of.as_f64().unwrap_or_else(|| panic!("a number: {relief:#}"));
    // Bulges and ovality are there to be found, and are found at half the samples' resolution.
    assert!(number(&relief["true_relief_mm"]["rmse"]) > 15.0, "{relief:#}");
    assert!(number(&relief["shape_mm"]["rmse"]) < 5.0, "{relief:#}");
    assert!(number(&relief["known_percent"]) > 70.0, "{relief:#}");
    // The section's size comes from the ranges of thirty tags: 0.3 % of 3 m.
    assert!(number(&relief["constant_mm"]).abs() < 20.0, "{relief:#}");
    assert!(number(&relief["ovality_error_percent"]) < 0.2, "{relief:#}");
}
