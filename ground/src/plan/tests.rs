use std::path::Path;

use adit_geometry::SectionVector;
use adit_geometry::profile::Part;
use adit_geometry::speed::paper_step;
use adit_protocol::mission::Mission;

use super::bounds::Setting;
use super::predict::{self, Flown};
use super::*;

fn text(name: &str) -> String {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../hil-sim/missions").join(name);
    std::fs::read_to_string(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
}

fn mission(text: &str) -> Mission {
    Mission::from_toml(text).unwrap_or_else(|error| panic!("{error}"))
}

fn planned(text: &str) -> Plan {
    plan(&mission(text)).unwrap()
}

/// Every number of the JSON is a number; serde writes NaN and infinity as null.
fn nulls(plan: &Plan) -> Vec<String> {
    serde_json::to_string_pretty(plan)
        .unwrap()
        .lines()
        .filter(|line| line.contains("null"))
        .map(|line| line.trim().trim_end_matches(',').to_owned())
        .collect()
}

#[test]
fn the_missions_plan_without_a_wrong_warning() {
    for name in ["demo.toml", "underpass.toml"] {
        let plan = planned(&text(name));
        // The underpass's corners are seen at a slant; nothing else is to be minded.
        let corners = |finding: &Finding| matches!(finding, Finding::Coarse { percent, .. } if *percent < 15.0);
        assert!(
            plan.findings.iter().all(|finding| name == "underpass.toml" && corners(finding)),
            "{:?}",
            plan.findings
        );
        let between = plan.between_ends.unwrap();
        assert_eq!(between.seen_share[..2], [1.0, 1.0], "{name}: two views are what the bound promises");
    }
}

#[test]
fn bounds_fall_with_the_offset_and_with_the_views() {
    for name in ["demo.toml", "underpass.toml"] {
        let plan = planned(&text(name));
        assert_eq!(plan.offsets.len(), 5);
        for row in &plan.offsets {
            assert!(row.one_view.step_m >= row.two_views.step_m && row.two_views.step_m > 0.0, "{name}: {row:?}");
            assert!(row.flown.step_m < row.allowed_step_m && row.flown.step_m > 0.0, "{name}: {row:?}");
        }
        for (near, far) in plan.offsets.iter().zip(&plan.offsets[1..]) {
            assert!(far.paper.step_m < near.paper.step_m, "{name}");
            assert!(far.one_view.step_m < near.one_view.step_m, "{name}");
            assert!(far.two_views.step_m < near.two_views.step_m, "{name}");
        }
    }
}

#[test]
fn the_papers_row_is_its_law_for_the_largest_circle_around_the_axis() {
    let mission = mission(&text("underpass.toml"));
    let setting = Setting::new(&mission).unwrap();
    assert!((setting.radius_m - 1.4).abs() < 1e-9, "from the axis down to the floor");
    // The image is 1000 x 750 pixels with the top along the axis.
    assert!((setting.view.around_rad.to_degrees() - 95.0).abs() < 5.0, "{:?}", setting.view);
    assert!((setting.view.along_rad.to_degrees() - 78.0).abs() < 4.0, "{:?}", setting.view);
    for row in setting.rows().unwrap() {
        let corner_m = row.offset_m * 2f64.sqrt();
        let law = paper_step(1.4, corner_m, setting.view, 10).unwrap();
        assert!((row.paper.step_m - law.per_image_m).abs() < 1e-9, "{row:?}");
    }
}

#[test]
fn the_speed_is_the_boards_steady_one() {
    let asked = mission(&text("demo.toml")).flight;
    let plan = planned(&text("demo.toml"));
    let (centred, flight) = (plan.offsets[0], plan.flight.unwrap());
    let steady_mps = centred.two_views.step_m * asked.speed_margin / (asked.image_period_s + asked.latency_s);
    assert!((flight.planned.speed_mps - steady_mps).abs() < 1e-9);
    assert!((flight.planned.duration_s * flight.planned.speed_mps - 10.0).abs() < 1e-9);
    let slowest = flight.slowest.unwrap();
    assert!(slowest.speed_mps < flight.planned.speed_mps && slowest.photos > flight.planned.photos);
    let capped = planned(&text("demo.toml").replace("max_speed_mps = 0.5", "max_speed_mps = 0.02"));
    assert!(capped.flight.unwrap().capped);
    assert_eq!(capped.flight.unwrap().planned.photos, 501);
}

#[test]
fn a_short_battery_and_a_small_card_forbid_the_flight() {
    let short = planned(&text("demo.toml").replace("battery_s = 900.0", "battery_s = 40.0"));
    assert!(matches!(short.findings[..], [Finding::Battery { .. }]), "{:?}", short.findings);
    assert!(!short.is_flyable());
    let small = planned(
        &text("demo.toml").replace("photo_mb = 0.4", "photo_mb = 500").replace("card_gb = 32.0", "card_gb = 10.0"),
    );
    assert!(matches!(small.findings[..], [Finding::Card { .. }]), "{:?}", small.findings);
    assert!(!small.is_flyable());
    assert!(planned(&text("demo.toml")).is_flyable());
}

#[test]
fn what_only_a_bad_flight_exceeds_is_a_warning() {
    let duration_s = planned(&text("demo.toml")).flight.unwrap().planned.duration_s;
    let tight = text("demo.toml").replace("battery_s = 900.0", &format!("battery_s = {:.1}", duration_s + 1.0));
    let plan = planned(&tight);
    assert!(matches!(plan.findings[..], [Finding::Reserve { .. }]), "{:?}", plan.findings);
    assert!(plan.is_flyable());
}

#[test]
fn too_few_images_per_turn_allow_no_speed_and_say_why() {
    let plan = planned(&text("demo.toml").replace("images_per_turn = 10", "images_per_turn = 3"));
    assert!(plan.flight.is_none() && !plan.is_flyable());
    assert!(matches!(plan.findings[0], Finding::NoSpeed(Standstill::Unseen { .. })), "{:?}", plan.findings);
    assert!(plan.offsets.iter().all(|row| row.flown == Bound::default()));
    assert!(plan.to_string().contains("is in no image of a turn"), "{plan}");
}

#[test]
fn an_offset_at_the_wall_is_warned_of() {
    let plan = planned(&text("demo.toml").replace("max_speed_mps", "offset_max_m = 1.4\nmax_speed_mps"));
    assert!(plan.is_flyable() && plan.flight.unwrap().slowest.is_none());
    assert!(plan.findings.iter().any(|finding| matches!(finding, Finding::Offset { .. })), "{:?}", plan.findings);
    assert_eq!(plan.offsets[4].flown, Bound::default());
    assert!(matches!(plan.offsets[4].standstill, Some(Standstill::Wall { .. })), "{:?}", plan.offsets[4]);
}

#[test]
fn slow_shafts_coarse_pixels_and_blur_are_warned_of() {
    let base = text("demo.toml");
    let slow = planned(&format!("{base}[board.shaft]\nslew_deg_per_s = 20\n"));
    assert!(matches!(slow.findings[..], [Finding::Period { .. }]), "{:?}", slow.findings);
    let far = planned(&base.replace("radius_m = 1.5", "radius_m = 6.0"));
    assert!(far.findings.iter().any(|finding| matches!(finding, Finding::Coarse { .. })), "{:?}", far.findings);
    let blurred = planned(&base.replace("exposure_s = 0.005", "exposure_s = 0.2"));
    assert!(blurred.findings.iter().any(|finding| matches!(finding, Finding::Blur { .. })), "{:?}", blurred.findings);
}

#[test]
fn no_figure_is_nan() {
    let base = text("demo.toml");
    let missions = [
        base.replace("images_per_turn = 10", "images_per_turn = 3"),
        base.replace("max_speed_mps", "offset_max_m = 1.49\nmax_speed_mps"),
        base.replace("max_speed_mps", "offset_max_m = 0.0\nmax_speed_mps"),
        base.replace("length_m = 10.0", "length_m = 0.1"),
        base.replace("length_m = 10.0", "length_m = 100000"),
        base.replace("\"two-views\"", "\"paper\""),
    ];
    for text in missions {
        let plan = planned(&text);
        let allowed = ["\"flight\": null", "\"pixel\": null", "\"between_ends\": null", "\"coverage\": null"];
        let optional = ["\"standstill\": null", "\"slowest\": null"];
        let nulls: Vec<String> = nulls(&plan)
            .into_iter()
            .filter(|line| !(allowed.contains(&line.as_str()) || optional.contains(&line.as_str())))
            .collect();
        assert_eq!(nulls, Vec::<String>::new());
        assert!(!format!("{plan}{}", output::speed_svg(&plan)).contains("NaN"));
    }
}

#[test]
fn holes_vanish_at_the_planned_step_and_appear_above_the_exact_bound() {
    for name in ["demo.toml", "underpass.toml"] {
        let mission = mission(&text(name));
        let setting = Setting::new(&mission).unwrap();
        let scene = setting.scene(SectionVector::zeros()).unwrap();
        let row = setting.rows().unwrap()[0];
        let holes = |step_m: f64| {
            let flown = Flown { step_m, photos: None, lever_forward_m: 0.0 };
            predict::coverage(&setting.profile, &scene, flown, step_m * 10.0).coverage.hole_count
        };
        assert_eq!(holes(row.flown.step_m), 0, "{name}");
        assert_eq!(holes(row.one_view.step_m), 0, "{name}");
        assert!(holes(row.one_view.step_m * 1.15) > 0, "{name}");
    }
}

#[test]
fn the_wall_straight_ahead_is_as_fine_as_distance_over_focal_length() {
    let plan = planned(&text("demo.toml"));
    let wall = plan.pixel.unwrap().wall;
    // 1.5 m less the lever of 0.06 m, at 466 pixels: 3.09 mm where the axis meets the wall. Beside it the round wall is
    // less deep in the image, down to the cosine of half the view.
    assert!((wall.max_mm - 3.09).abs() < 0.1, "{wall:?}");
    assert!(wall.min_mm > 3.09 * 48f64.to_radians().cos() && wall.median_mm < wall.max_mm, "{wall:?}");
    let parts: Vec<Part> =
        planned(&text("underpass.toml")).pixel.unwrap().parts.iter().map(|(part, _)| *part).collect();
    assert_eq!(parts, [Part::Ceiling, Part::RightWall, Part::Floor, Part::LeftWall]);
}

#[test]
fn the_files_are_written_and_a_folder_that_cannot_be_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let plan = planned(&text("demo.toml"));
    let parameters = Mission::from_toml(&text("demo.toml")).unwrap().parameters();
    write(&plan, &parameters, &folder.path().join("a/b")).unwrap();
    for name in ["plan.json", "coverage.png", "speed.svg"] {
        assert!(folder.path().join("a/b").join(name).metadata().unwrap().len() > 500, "{name}");
    }
    let offered = std::fs::read(folder.path().join("a/b/PARAMS.ADT")).unwrap();
    let log = adit_protocol::log::FlightLog::from_bytes(&offered);
    assert_eq!(log.sessions[0].header.as_ref().unwrap().parameters, parameters);
    let error = write(&plan, &parameters, &folder.path().join("a/b/plan.json/c")).unwrap_err();
    assert!(error.to_string().contains("plan.json/c"), "{error}");
}
