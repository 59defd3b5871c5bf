use std::path::{Path, PathBuf};

use proptest::prelude::*;

use super::*;

const SURVEY: &str = r#"format = 1
[tunnel]
profile = "circle"
radius_m = 3.0
[camera]
model = "brown-conrady"
width_px = 1000
height_px = 750
fx_px = 466.0
fy_px = 466.0
cx_px = 503.5
cy_px = 373.0
distortion = [-0.04, 0.006, 0.0, 0.0, 0.0]
[rig]
images_per_turn = 10
image_up = "forward"
lever_radial_m = 0.06
mount_rotvec_deg = [0.5, -1.0, 0.0]
"#;

const FLIGHT: &str = "[flight]\nlength_m = 10.0\n";

fn problems(text: &str) -> Vec<String> {
    match Mission::from_toml(text) {
        Ok(_) => Vec::new(),
        Err(error) => error.problems.iter().map(ToString::to_string).collect(),
    }
}

/// The one problem of a survey in which `from` is replaced by `to`.
fn only_problem(from: &str, to: &str) -> String {
    let text = SURVEY.replace(from, to);
    assert_ne!(text, SURVEY, "{from} does not occur");
    let error = SurveyConfig::from_toml(&text).expect_err("the wrong value was accepted");
    assert_eq!(error.problems.len(), 1, "{error}");
    error.to_string()
}

fn samples() -> Option<PathBuf> {
    let start = Path::new(env!("CARGO_MANIFEST_DIR"));
    start.ancestors().map(|folder| folder.join("shared/samples")).find(|folder| folder.is_dir())
}

#[test]
fn a_survey_reads_with_its_defaults() {
    let config = SurveyConfig::from_toml(SURVEY).unwrap();
    assert_eq!(config.profile, ProfileSpec::Circle { radius_m: 3.0 });
    assert_eq!(config.rig.images_per_turn, 10);
    assert!((config.rig.mount_rotvec_rad[1] + 1f64.to_radians()).abs() < 1e-15);
    assert_eq!(config.sigma, Sigma::default());
    assert!(!config.camera.refine);
}

#[test]
fn the_sample_surveys_read_and_write_back_the_same() {
    let Some(folder) = samples() else {
        eprintln!("skipped: no shared/samples above {}", env!("CARGO_MANIFEST_DIR"));
        return;
    };
    for name in ["cylinder-brick-spiral", "cylinder-concrete-spiral", "underpass-spiral"] {
        let text = std::fs::read_to_string(folder.join(name).join("survey.toml")).unwrap();
        let config = SurveyConfig::from_toml(&text).unwrap_or_else(|error| panic!("{name}: {error}"));
        let again = SurveyConfig::from_toml(&config.to_toml()).unwrap_or_else(|error| panic!("{name}: {error}"));
        assert_eq!(config.profile, again.profile, "{name}");
        assert_eq!(config.camera, again.camera, "{name}");
        assert_eq!(config.to_toml(), again.to_toml(), "{name}");
    }
}

#[test]
fn millimetres_are_recognised() {
    let message = only_problem("radius_m = 3.0", "radius_m = 3000");
    assert_eq!(
        message,
        "line 4: tunnel.radius_m: found 3000; expected 0.1 to 60 m; did you mean millimetres? then write 3"
    );
}

#[test]
fn a_focal_length_in_millimetres_is_refused() {
    let message = only_problem("fx_px = 466.0", "fx_px = 17.2");
    assert!(message.starts_with("line 9: camera.fx_px: found 17.2; expected 100 to 20000 px"), "{message}");
}

#[test]
fn a_unit_in_the_key_is_told_from_an_unknown_key() {
    let text = SURVEY.replace("radius_m = 3.0", "radius_mm = 3000");
    let error = SurveyConfig::from_toml(&text).unwrap_err();
    assert_eq!(
        error.to_string(),
        "line 2: tunnel.radius_m: found nothing; expected a number from 0.1 to 60 m\n\
         line 4: tunnel.radius_mm: found an unknown key; expected a known key; did you mean radius_m?"
    );
}

#[test]
fn every_violation_is_reported_in_the_order_of_the_lines() {
    let text = SURVEY
        .replace("radius_m = 3.0", "radius_m = -1")
        .replace("height_px = 750", "height_px = 750.5")
        .replace("image_up = \"forward\"", "image_up = \"up\"\ncolour = 1")
        .replace("format = 1", "format = 2");
    let found = problems(&text);
    let starts =
        ["line 4: tunnel.radius_m", "line 8: camera.height_px", "line 16: rig.image_up", "line 17: rig.colour"];
    for start in starts {
        assert!(found.iter().any(|problem| problem.starts_with(start)), "{start} is not in {found:#?}");
    }
    assert!(found.iter().any(|problem| problem.contains("format: found 2; expected 1")), "{found:#?}");
    assert!(found.iter().any(|problem| problem.contains("flight: found nothing")), "{found:#?}");
    assert_eq!(found.len(), 6, "{found:#?}");
}

#[test]
fn wrong_lists_types_and_sections_are_named() {
    let message = only_problem("0.006, 0.0, 0.0, 0.0]", "0.006]");
    assert!(message.contains("camera.distortion: found a list of 2; expected a list of 5 numbers"), "{message}");
    let found = problems(&format!("{SURVEY}{FLIGHT}").replace("[0.5, -1.0, 0.0]", "[0.5, \"x\", 90.0]"));
    assert_eq!(found.len(), 2, "{found:#?}");
    assert!(found[0].starts_with("line 18: rig.mount_rotvec_deg[1]: found \"x\"; expected"), "{found:#?}");
    assert!(found[1].starts_with("line 18: rig.mount_rotvec_deg[2]: found 90.0; expected"), "{found:#?}");
}

#[test]
fn a_lever_that_puts_the_camera_into_the_wall_is_refused() {
    let message = only_problem("radius_m = 3.0", "radius_m = 0.05");
    assert!(message.starts_with("line 4: tunnel.radius_m"), "{message}");
    let message = only_problem("lever_radial_m = 0.06", "lever_radial_m = 3.0");
    assert_eq!(
        message,
        "line 17: rig.lever_radial_m: found 3; expected less than the 3.000 m from the axis to the nearest wall"
    );
}

#[test]
fn broken_toml_names_the_line() {
    let error = SurveyConfig::from_toml("format = 1\n[tunnel\nradius_m = 3\n").unwrap_err();
    assert_eq!(error.problems[0].line, Some(2), "{error}");
}

#[test]
fn a_mission_reads_and_fills_the_parameters() {
    let text = format!(
        "{SURVEY}{FLIGHT}speed_bound = \"one-view\"\n[board.shutter]\nwiring = \"busy\"\n[board.shaft]\nslew_deg_per_s = \
         90\n[simulation]\nseed = 7\n"
    );
    let mission = Mission::from_toml(&text).unwrap_or_else(|error| panic!("{error}"));
    assert_eq!(mission.flight.length_m, 10.0);
    assert_eq!(mission.flight.speed_margin, 0.9);
    assert_eq!(mission.simulation.as_ref().unwrap()["seed"].as_integer(), Some(7));
    let parameters = mission.parameters();
    assert_eq!(parameters.speed.bound, crate::parameters::SpeedBound::OneView);
    assert_eq!(parameters.shutter.wiring, crate::parameters::CaptureWiring::Busy);
    assert!((parameters.shaft.slew_radps - 90f32.to_radians()).abs() < 1e-6);
    assert_eq!(parameters.ranges.sigma_m, 0.02);
    assert_eq!(parameters.profile, ProfileSpec::Circle { radius_m: 3.0 });
}

#[test]
fn the_offset_allowed_fits_the_tunnel() {
    let small = SURVEY.replace("radius_m = 3.0", "radius_m = 0.6");
    let mission = Mission::from_toml(&format!("{small}{FLIGHT}")).unwrap_or_else(|error| panic!("{error}"));
    assert!((mission.flight.offset_max_m - 0.2).abs() < 1e-12);
    let found = problems(&format!("{small}{FLIGHT}offset_max_m = 0.6\n"));
    assert_eq!(
        found,
        ["line 21: flight.offset_max_m: found 0.6; expected less than the 0.600 m from the axis to the nearest wall"]
    );
}

#[test]
fn an_unknown_table_and_a_wrong_board_key_are_refused() {
    let found = problems(&format!("{SURVEY}{FLIGHT}[bord]\nx = 1\n[board.shaft]\nslew_rad = 1\n"));
    assert_eq!(found.len(), 2, "{found:#?}");
    assert!(found[0].contains("bord: found an unknown key; expected a known key; did you mean board?"), "{found:#?}");
    assert!(found[1].contains("board.shaft.slew_rad: found an unknown key"), "{found:#?}");
}

#[test]
fn every_profile_writes_back_the_same() {
    let tunnels = [
        "profile = \"rectangle\"\nwidth_m = 4\nheight_m = 3\n",
        "profile = \"underpass\"\nwidth_m = 4\nwall_m = 2\nrise_m = 0.5\naxis_height_m = 1.2\n",
        "profile = \"horseshoe\"\nwidth_m = 4\nwall_m = 2\n",
        "profile = \"chain\"\npoints = [[2, -1], [2, 1.5], [-2, 1.5], [-2, -1]]\nbulges = [0, 0, 0, 0.5]\n",
        "profile = \"chain\"\npoints = [[2, -1], [2, 1], [-2, 1], [-2, -1]]\n",
    ];
    for tunnel in tunnels {
        let text = SURVEY.replace("profile = \"circle\"\nradius_m = 3.0\n", tunnel);
        let config = SurveyConfig::from_toml(&text).unwrap_or_else(|error| panic!("{tunnel}: {error}"));
        let again = SurveyConfig::from_toml(&config.to_toml()).unwrap();
        assert_eq!(config.profile, again.profile);
    }
}

#[test]
fn a_chain_that_runs_the_wrong_way_is_refused() {
    let chain = "profile = \"chain\"\npoints = [[-2, -1], [-2, 1], [2, 1], [2, -1]]\n";
    let message = only_problem("profile = \"circle\"\nradius_m = 3.0\n", chain);
    assert!(message.contains("tunnel.points") && message.contains("counter-clockwise"), "{message}");
}

#[test]
fn an_axis_above_the_ceiling_is_refused() {
    let tunnel = "profile = \"rectangle\"\nwidth_m = 4\nheight_m = 3\naxis_height_m = 3.5\n";
    let message = only_problem("profile = \"circle\"\nradius_m = 3.0\n", tunnel);
    assert!(message.contains("tunnel.axis_height_m"), "{message}");
}

proptest! {
    #[test]
    fn any_text_gives_an_answer(text in "\\PC{0,200}") {
        let _ = Mission::from_toml(&text);
        let _ = SurveyConfig::from_toml(&text);
    }

    #[test]
    fn any_number_anywhere_gives_an_answer_that_can_be_built(key in 0usize..16, value in proptest::num::f64::ANY) {
        let text = format!("{SURVEY}{FLIGHT}");
        let mut lines: Vec<String> = text.lines().map(str::to_owned).collect();
        let numeric: Vec<usize> =
            (0..lines.len()).filter(|&i| lines[i].contains(" = ") && !lines[i].contains('"')).collect();
        let line = numeric[key % numeric.len()];
        let name = lines[line].split(" = ").next().unwrap_or_default().to_owned();
        lines[line] = format!("{name} = {value:?}").replace("NaN", "nan");
        if let Ok(mission) = Mission::from_toml(&lines.join("\n")) {
            prop_assert!(mission.parameters().profile.build().is_ok());
        }
    }
}
