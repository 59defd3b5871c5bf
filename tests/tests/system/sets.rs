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

/// Columns of a CSV file by their names in the header.
fn table(path: &std::path::Path) -> Vec<Vec<String>> {
    let text = std::fs::read_to_string(path).expect("a table");
    text.lines().skip(1).map(|line| line.split(',').map(str::to_owned).collect()).collect()
}

#[test]
fn drifting_exposures_are_found_and_leave_no_seams() {
    let survey = tempfile::tempdir().expect("a temporary folder");
    let folder = text(survey.path());
    let set = ["survey", "exposure-drift", "--out", folder, "--photos", "30", "--width-px", "400", "--no-texture"];
    figures("adit-sim", &set);
    figures("adit", &["reconstruct", folder]);
    let report = std::fs::read_to_string(survey.path().join("out/report.json")).expect("a report");
    let report: serde_json::Value = serde_json::from_str(&report).expect("JSON");
    let texture = &report["texture"];
    let number = |value: &serde_json::Value| value.as_f64().expect("a number");
    let seams = |which: &str| number(&texture["seams"][which]);
    eprintln!("steps: {:#}", texture["seams"]);
    assert!(seams("step_before") > 8.0, "{texture:#}");
    assert!(seams("step_evened") < 4.0 && seams("step_blended") < 2.0, "{texture:#}");

    // Logarithms of the gains, less their mean: the wall's own brightness is not known.
    let truth = table(&survey.path().join("truth/exposure.csv"));
    let gains = texture["gains"].as_array().expect("gains");
    assert_eq!(gains.len(), truth.len());
    for channel in 0..3 {
        let errors: Vec<f64> = gains
            .iter()
            .zip(&truth)
            .map(|(found, truth)| {
                assert_eq!(found["photo"], truth[0].as_str());
                let truth: f64 = truth[channel + 1].parse().expect("a gain");
                number(&found["gain"][channel]).ln() - truth.ln()
            })
            .collect();
        let mean = errors.iter().sum::<f64>() / errors.len() as f64;
        let rms = (errors.iter().map(|error| (error - mean).powi(2)).sum::<f64>() / errors.len() as f64).sqrt();
        eprintln!("channel {channel}: gains within {:.1} % (RMS)", 100.0 * rms);
        assert!(rms < 0.08, "channel {channel}: {errors:?}");
    }
}

#[test]
fn a_shaft_that_still_turns_while_photos_are_read_out_is_accounted_for() {
    let survey = tempfile::tempdir().expect("a temporary folder");
    let folder = text(survey.path());
    let size = ["--photos", "24", "--no-texture"];
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
    assert!(number(&relief["shape_mm"]["rmse"]) < 3.0, "{relief:#}");
    assert!(number(&relief["known_percent"]) > 70.0, "{relief:#}");
    // The section's size comes from the ranges of thirty tags: 0.3 % of 3 m.
    assert!(number(&relief["constant_mm"]).abs() < 20.0, "{relief:#}");
    assert!(number(&relief["ovality_error_percent"]) < 0.2, "{relief:#}");
}

#[test]
fn a_stain_that_came_up_between_two_flights_is_found() {
    let folders = [(); 2].map(|()| tempfile::tempdir().expect("a temporary folder"));
    let [first, later] = [0, 1].map(|at| text(folders[at].path()));
    let set = ["--photos", "40", "--width-px", "400", "--no-texture", "--seed", "4"];
    figures("adit-sim", &[&["survey", "brick", "--out", first], &set[..]].concat());
    let truth = figures("adit-sim", &[&["survey", "brick", "--out", later, "--later", "8"], &set[..]].concat());
    for folder in [first, later] {
        figures("adit", &["reconstruct", folder, "--mm-per-px", "6"]);
    }
    let out = tempfile::tempdir().expect("a temporary folder");
    let report = figures("adit", &["compare", first, later, "--mm-per-px", "6", "--out", text(out.path())]);
    let number = |value: &serde_json::Value| value.as_f64().unwrap_or_else(|| panic!("no number in {report:#}"));
    let holds = |region: &serde_json::Value, place: &serde_json::Value| {
        let within = |from: &str, to: &str, at: &str| {
            (number(&region[from])..=number(&region[to])).contains(&number(&place[at]))
        };
        within("x_from_m", "x_to_m", "x_m") && within("s_from_m", "s_to_m", "s_m")
    };
    let stain = &truth["later"][1]["stain"];
    let looks = report["changes"].as_array().expect("a list");
    let found = looks.iter().find(|change| holds(change, stain));
    let found = found.unwrap_or_else(|| panic!("the stain is not among {report:#}"));
    assert!(number(&found["grey"]) < -10.0 && (300.0..650.0).contains(&number(&found["area_cm2"])), "{found:#}");
    // At the edges of what was seen two photos of the coarse set may differ.
    assert!(looks.len() <= 4, "{report:#}");
    let bulge = &truth["later"][1]["bulge"];
    let heights = report["relief"]["changes"].as_array().expect("a list");
    // At 16 mm per pixel the bulge's middle may stay unknown, but nothing else has moved.
    let of_bulge = |region: &serde_json::Value| {
        let middle = |from: &str, to: &str| 0.5 * (number(&region[from]) + number(&region[to]));
        let [s_m, x_m] = [middle("s_from_m", "s_to_m"), middle("x_from_m", "x_to_m")];
        let reach_m = 3.0 * number(&bulge["sigma_m"]);
        (s_m - number(&bulge["s_m"])).hypot(x_m - number(&bulge["x_m"])) < reach_m && number(&region["height_mm"]) > 6.0
    };
    assert!(heights.iter().all(of_bulge), "{bulge:#} {report:#}");
    assert!(number(&report["relief"]["compared_m2"]) > 50.0, "{report:#}");
}
