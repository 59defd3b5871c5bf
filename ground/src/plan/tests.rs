use std::path::Path;

use adit_geometry::SectionVector;
use adit_geometry::profile::Part;
use adit_geometry::speed::paper_step;
use adit_protocol::mission::Mission;

use super::bounds::Setting;
use super::overlap::overlap;
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

/// Without the modes that cannot be held to the limit, of which there are some in every small tunnel.
fn minded(plan: &Plan) -> Vec<Finding> {
    plan.findings.iter().copied().filter(|finding| !matches!(finding, Finding::Floor { .. })).collect()
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
        // The underpass's corners are seen at a slant, and no small tunnel can be flown in every mode; nothing else is to
        // be minded.
        let corners = |finding: &Finding| matches!(finding, Finding::Coarse { percent, .. } if *percent < 15.0);
        let expected = |finding: &Finding| {
            matches!(finding, Finding::Floor { .. }) || name == "underpass.toml" && corners(finding)
        };
        assert!(plan.findings.iter().all(expected), "{:?}", plan.findings);
        let between = plan.between_ends.unwrap();
        assert_eq!(between.seen_share[..2], [1.0, 1.0], "{name}: two views are what the bound promises");
    }
}

#[test]
fn bounds_fall_with_the_offset_and_with_the_views() {
    for name in ["demo.toml", "underpass.toml"] {
        let plan = planned(&text(name));
        assert_eq!(plan.offsets.len(), 4);
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
    // The table's next row; the camera's shortest interval of 1 s and then 50 ms of light; its answer.
    let known_s = 1.05 + 0.4 + asked.latency_s;
    let steady_mps = plan.offsets[1].two_views.step_m * asked.speed_margin / known_s;
    assert!(plan.offsets[1].two_views.step_m < centred.two_views.step_m);
    assert!((flight.planned.speed_mps - steady_mps).abs() < 1e-6, "{} {steady_mps}", flight.planned.speed_mps);
    assert!((flight.planned.duration_s * flight.planned.speed_mps - 10.0).abs() < 1e-9);
    let slowest = flight.slowest.unwrap();
    assert!(slowest.speed_mps < flight.planned.speed_mps && slowest.photos > flight.planned.photos);
    let capped = planned(&text("demo.toml").replace("max_speed_mps = 0.5", "max_speed_mps = 0.02"));
    assert!(capped.flight.unwrap().capped);
    assert_eq!(capped.flight.unwrap().planned.photos, (10.0_f64 / (0.02 * 1.05)) as u64 + 1);
}

#[test]
fn a_short_battery_and_a_small_card_forbid_the_flight() {
    let short = planned(&text("demo.toml").replace("battery_s = 900.0", "battery_s = 40.0"));
    assert!(matches!(minded(&short)[..], [Finding::Battery { .. }]), "{:?}", short.findings);
    assert!(!short.is_flyable());
    let small = planned(
        &text("demo.toml").replace("photo_mb = 0.4", "photo_mb = 500").replace("card_gb = 32.0", "card_gb = 10.0"),
    );
    assert!(matches!(minded(&small)[..], [Finding::Card { .. }]), "{:?}", small.findings);
    assert!(!small.is_flyable());
    assert!(planned(&text("demo.toml")).is_flyable());
}

#[test]
fn what_only_a_bad_flight_exceeds_is_a_warning() {
    let duration_s = planned(&text("demo.toml")).flight.unwrap().planned.duration_s;
    let tight = text("demo.toml").replace("battery_s = 900.0", &format!("battery_s = {:.1}", duration_s + 1.0));
    let plan = planned(&tight);
    assert!(matches!(minded(&plan)[..], [Finding::Reserve { .. }]), "{:?}", plan.findings);
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
    assert_eq!([2, 3].map(|row| plan.offsets[row].flown), [Bound::default(); 2], "the board looks one row on");
    assert!(matches!(plan.offsets[3].standstill, Some(Standstill::Wall { .. })), "{:?}", plan.offsets[3]);
}

#[test]
fn slow_shafts_coarse_pixels_and_blur_are_warned_of() {
    let base = text("demo.toml");
    let slow = planned(&format!("{base}[board.shaft]\nslew_deg_per_s = 20\n"));
    assert!(matches!(minded(&slow)[..], [Finding::Period { .. }]), "{:?}", slow.findings);
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
        let allowed = [
            "\"flight\": null",
            "\"pixel\": null",
            "\"overlap\": null",
            "\"between_ends\": null",
            "\"coverage\": null",
        ];
        let optional = ["\"standstill\": null", "\"slowest\": null"];
        let nulls: Vec<String> = nulls(&plan)
            .into_iter()
            .filter(|line| !(allowed.contains(&line.as_str()) || optional.contains(&line.as_str())))
            .collect();
        assert_eq!(nulls, Vec::<String>::new());
        assert!(!format!("{plan}{}", curves::speed_svg(&plan)).contains("NaN"));
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
    for name in ["plan.json", "plan.html", "coverage.png", "pixels.png"] {
        assert!(folder.path().join("a/b").join(name).metadata().unwrap().len() > 500, "{name}");
    }
    let offered = std::fs::read(folder.path().join("a/b/PARAMS.ADT")).unwrap();
    let log = adit_protocol::log::FlightLog::from_bytes(&offered);
    assert_eq!(log.sessions[0].header.as_ref().unwrap().parameters, parameters);
    let error = write(&plan, &parameters, &folder.path().join("a/b/plan.json/c")).unwrap_err();
    assert!(error.to_string().contains("plan.json/c"), "{error}");
}

#[test]
fn modes_that_cannot_be_held_to_the_limit_are_named_with_where() {
    let floors = |plan: &Plan| -> Vec<String> {
        plan.findings
            .iter()
            .filter(|finding| matches!(finding, Finding::Floor { .. }))
            .map(ToString::to_string)
            .collect()
    };
    // About 0.1 m/s on the axis, less beside it.
    let words = floors(&planned(&text("demo.toml")));
    assert!(words.iter().any(|words| words.starts_with("ArduPilot before 4.7 in Auto")), "{words:?}");
    assert!(words.iter().any(|words| words.contains("Loiter") && words.contains("even on the axis")), "{words:?}");
    // In a wide tunnel every autopilot can be held to it.
    let wide = text("demo.toml")
        .replace("radius_m = 1.5", "radius_m = 8.0")
        .replace("max_speed_mps = 0.5", "max_speed_mps = 2.0");
    assert_eq!(floors(&planned(&wide)), Vec::<String>::new());
}

#[test]
fn a_dark_flight_is_warned_of() {
    let dark = planned(&text("demo.toml").replace("wiring = \"confirm\"", "wiring = \"confirm\"\nlight_level = 0.0"));
    assert!(matches!(minded(&dark)[..], [Finding::Dark]), "{:?}", dark.findings);
}

#[test]
fn photos_share_less_the_farther_they_are_apart() {
    let mission = mission(&text("demo.toml"));
    let setting = Setting::new(&mission).unwrap();
    let scene = setting.scene(SectionVector::zeros()).unwrap();
    let shared = |step_m| overlap(&setting, &scene, step_m).unwrap();
    // At rest only the shaft's step is between two photos, and a turn later the camera is where it was.
    let rest = shared(0.0);
    assert!((rest.next_turn - 1.0).abs() < 1e-12);
    // 96 degrees of view and steps of 36: a little under 60 of 96 degrees as the edges are shorter than the middle.
    assert!((0.5..0.7).contains(&rest.next_photo), "{rest:?}");
    assert!(shared(0.1).next_photo < rest.next_photo && shared(0.1).next_turn < 0.6, "{:?}", shared(0.1));
    assert!(shared(5.0).next_turn == 0.0);
}

#[test]
fn the_map_of_pixels_has_their_sizes_and_leaves_out_what_no_photo_shows() {
    let plan = planned(&text("demo.toml"));
    let (map, wall) = (plan.pixel_map.unwrap(), plan.pixel.unwrap().wall);
    assert!(map.ends_mm[0] <= wall.min_mm && map.ends_mm[1] >= wall.max_mm - 0.1, "{:?} {wall:?}", map.ends_mm);
    let alphas = || map.picture.data.chunks_exact(4).map(|pixel| pixel[3]);
    let unseen = alphas().filter(|alpha| *alpha == 0).count() as f64 / alphas().count() as f64;
    let predicted = 1.0 - plan.coverage.unwrap().seen_share[0];
    assert!((unseen - predicted).abs() < 3e-3, "{unseen} {predicted}");
    assert!(map.picture.width > 180 && map.picture.height > 190);
}
