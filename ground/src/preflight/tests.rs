//! What is judged without a board; with one, whole lists are in `tests/tests/system/preflight.rs`.

use std::time::Duration;

use adit_geometry::profile::{ChainVertex, ProfileSpec};
use adit_protocol::mavlink::Encoding;
use adit_protocol::parameters::Parameters;
use adit_protocol::record::Header;
use tokio::time::Instant;

use super::*;
use crate::link::{Board, ClockReading, Parameter, figures};

fn board(version: Option<[u8; 4]>) -> Board {
    Board { target: [1, 191], mode: 1, encoding: Encoding::Bytewise, version, uid: None, autopilot: None }
}

fn only(list: &Preflight) -> (Verdict, &str) {
    let [check] = &list.checks[..] else { panic!("{list}") };
    (check.verdict, &check.words)
}

fn told(parameters: &Parameters) -> Vec<Parameter> {
    let figure = |(index, (name, value)): (u16, (&str, _))| Parameter { name: name.to_owned(), value, index };
    (0..).zip(figures(parameters)).map(figure).collect()
}

fn header(parameters: &Parameters) -> Header {
    Header::new(parameters, "tests").unwrap()
}

fn mission(more: &str) -> Mission {
    let text = include_str!("../../../hil-sim/missions/demo.toml");
    Mission::from_toml(&text.replace("profile = \"circle\"\nradius_m = 1.5", more)).unwrap()
}

#[test]
fn a_board_of_another_version_is_a_no_and_one_that_does_not_tell_unknown() {
    let judged = |version| {
        let mut list = Preflight::default();
        checks::firmware(&mut list, &board(version));
        only(&list).0
    };
    let part = |text: &str| text.parse::<u8>().unwrap();
    let (major, minor) = (part(env!("CARGO_PKG_VERSION_MAJOR")), part(env!("CARGO_PKG_VERSION_MINOR")));
    assert_eq!(judged(Some([major, minor, 200, 0])), Verdict::Yes);
    assert_eq!(judged(Some([major, minor + 1, 0, 0])), Verdict::No);
    assert_eq!(judged(None), Verdict::Unknown);
}

#[test]
fn a_clock_is_good_within_what_the_line_lets_tell() {
    let judged = |rate: f64, within_ms: u64| {
        let at = Instant::now();
        let reading = |s: f64| ClockReading {
            at: at + Duration::from_secs_f64(s),
            within: Duration::from_millis(within_ms),
            board: Duration::from_secs_f64(100.0 + s * rate),
        };
        let mut list = Preflight::default();
        checks::clock(&mut list, Some([reading(0.0), reading(10.0)]));
        only(&list).0
    };
    assert_eq!(judged(1.0001, 1), Verdict::Yes);
    assert_eq!(judged(0.99, 1), Verdict::No);
    assert_eq!(judged(0.99, 200), Verdict::Yes, "a slow line does not tell");
    assert_eq!(judged(0.0, 200), Verdict::No, "one that stands");
}

#[test]
fn parameters_that_were_changed_and_are_not_in_force_are_a_no() {
    let mission = mission("profile = \"circle\"\nradius_m = 1.5");
    let wanted = mission.parameters();
    let judged = |kept: &Parameters, in_force: Option<&Parameters>| {
        let mut list = Preflight::default();
        checks::parameters(&mut list, &told(kept), in_force.map(header).as_ref(), Some(&mission));
        let (verdict, words) = only(&list);
        (verdict, words.to_owned())
    };
    assert_eq!(judged(&wanted, Some(&wanted)).0, Verdict::Yes);
    let (verdict, words) = judged(&wanted, Some(&Parameters::default()));
    assert!(verdict == Verdict::No && words.contains("adit board restart"), "{words}");
    assert_eq!(judged(&wanted, None).0, Verdict::Unknown);
    let (verdict, words) = judged(&Parameters::default(), None);
    assert!(verdict == Verdict::No && words.contains("TUN_RADIUS_M is 3, wanted 1.5"), "{words}");
}

#[test]
fn a_chain_is_compared_by_what_is_in_force() {
    let chain = "profile = \"chain\"\npoints = [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]]";
    let mission = mission(chain);
    let wanted = mission.parameters();
    let mut other = wanted.clone();
    let ProfileSpec::Chain { vertices } = &mut other.profile else { panic!("{other:?}") };
    vertices[0] = ChainVertex { y_m: -1.2, ..vertices[0] };
    for (in_force, verdict) in [(&wanted, Verdict::Yes), (&other, Verdict::No)] {
        let mut list = Preflight::default();
        checks::parameters(&mut list, &told(in_force), Some(&header(in_force)), Some(&mission));
        assert_eq!(only(&list).0, verdict, "{list}");
    }
}

#[test]
fn the_list_is_as_reviewed() {
    let mut list = Preflight::default();
    list.note(Subject::Link, Verdict::Yes, "board 1/191 answers");
    list.note(Subject::CameraSupplies, Verdict::Unknown, "the board cannot know");
    insta::assert_snapshot!(list, @r"
    yes  link              board 1/191 answers
    ?    camera's supplies the board cannot know

    ready
    ");
    list.note(Subject::Card, Verdict::No, "no card");
    assert!(!list.is_ready() && list.to_string().ends_with("NOT READY: 1 reason\n"));
    let json = serde_json::to_value(&list).unwrap();
    assert_eq!((&json["ready"], &json["checks"][2]["verdict"]), (&false.into(), &"no".into()));
}
