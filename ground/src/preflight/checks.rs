//! The checks: what was found, judged. No waiting, no asking.

use adit_geometry::profile::ProfileSpec;
use adit_protocol::beams::Beam;
use adit_protocol::mavlink::{Autopilot, ModeWords, Value};
use adit_protocol::mission::Mission;
use adit_protocol::parameters::{CaptureWiring, Parameters};
use adit_protocol::record::{Failure, Header};
use adit_protocol::telemetry::Enforcement;

use super::watch::Watch;
use super::{Preflight, Subject, Verdict};
use crate::link::{
    Board, ClockReading, LogEntry, Parameter, Shown, figures, fingerprint, gathered, log_name, same_value,
};
use crate::plan::plan;

/// A crystal is good to a ten-thousandth; without it the board's clock is off by a hundredth.
const CLOCK_SHARE: f64 = 0.005;
/// Differences that are listed.
const LISTED: usize = 4;
/// `ArduPilot` from which on speeds below [`COARSE_MPS`] are taken.
const FINE_VERSION: [u8; 2] = [4, 7];
const COARSE_MPS: f64 = 0.1;

/// Same major and minor version: what differs there may differ on the link.
pub(super) fn firmware(list: &mut Preflight, board: &Board) {
    let ours = [env!("CARGO_PKG_VERSION_MAJOR"), env!("CARGO_PKG_VERSION_MINOR")];
    let Some([major, minor, patch, _]) = board.version else {
        return list.note(Subject::Firmware, Verdict::Unknown, "the board does not tell its version");
    };
    let words = format!("{major}.{minor}.{patch}, this program is {}", env!("CARGO_PKG_VERSION"));
    if [major, minor].map(|part| part.to_string()) == ours {
        list.note(Subject::Firmware, Verdict::Yes, words);
    } else {
        list.note(Subject::Firmware, Verdict::No, format!("{words}: flash the board with `cargo xtask flash`"));
    }
}

/// The autopilot's kind, version and mode. `version` as far as it tells.
pub(super) fn autopilot(list: &mut Preflight, watch: &Watch, version: Option<[u8; 4]>, mission: Option<&Mission>) {
    let Some(beat) = watch.vehicle else {
        let words = "not heard on this line; by a cable to the board it never is: see the speed limit below";
        return list.note(Subject::Autopilot, Verdict::Unknown, words);
    };
    let kind = Autopilot::from(beat.autopilot);
    if let Autopilot::Other(_) = kind {
        let words = format!("{kind} is none whose speed can be limited: keep it by hand");
        return list.note(Subject::Autopilot, Verdict::No, words);
    }
    let told = version.map_or("version not told".to_owned(), |[major, minor, ..]| format!("{major}.{minor}"));
    let armed = if beat.is_armed() { ", armed" } else { "" };
    let words = format!("{kind} {told}, {}{armed}", ModeWords(kind, beat.custom_mode));
    let is_coarse =
        kind == Autopilot::ArduPilot && version.is_some_and(|[major, minor, ..]| [major, minor] < FINE_VERSION);
    let planned_mps = mission
        .filter(|_| is_coarse)
        .and_then(|mission| plan(mission).ok())
        .and_then(|plan| plan.flight)
        .map(|flight| flight.planned.speed_mps)
        .filter(|speed_mps| *speed_mps < COARSE_MPS);
    match planned_mps {
        Some(speed_mps) => {
            let words = format!(
                "{words}: before 4.7 it ignores speeds below {COARSE_MPS} m/s, and the plan flies {speed_mps:.3}; update it"
            );
            list.note(Subject::Autopilot, Verdict::No, words);
        }
        None => list.note(Subject::Autopilot, Verdict::Yes, words),
    }
}

/// The parameters that the board keeps, and the header of its newest log, which has those in force.
pub(super) fn parameters(list: &mut Preflight, told: &[Parameter], header: Option<&Header>, mission: Option<&Mission>) {
    if told.is_empty() {
        return list.note(Subject::Parameters, Verdict::No, "the board does not tell its parameters");
    }
    let in_force = header.map(|header| &header.parameters);
    if let Some(in_force) = in_force {
        let stale = differences(in_force, told);
        if !stale.is_empty() {
            let words = format!("changed, but not in force before `adit board restart`: {}", listed(&stale));
            return list.note(Subject::Parameters, Verdict::No, words);
        }
    }
    let Some(mission) = mission else {
        return list.note(Subject::Parameters, Verdict::Unknown, "no mission to compare them with (--mission)");
    };
    let wanted = mission.parameters();
    let mut wrong = differences(&wanted, told);
    // A chain of vertices is in no figure.
    if wrong.is_empty() && in_force.is_some_and(|in_force| in_force.profile != wanted.profile) {
        wrong.push("the section is another".to_owned());
    }
    if !wrong.is_empty() {
        let words = format!("not the mission's (`adit board load` sends them): {}", listed(&wrong));
        return list.note(Subject::Parameters, Verdict::No, words);
    }
    let hash = fingerprint(&wanted).map_or_else(|error| error.to_string(), |hash| format!("{hash:016x}"));
    match in_force {
        Some(_) => list.note(Subject::Parameters, Verdict::Yes, format!("the mission's, in force, hash {hash}")),
        None => list.note(
            Subject::Parameters,
            Verdict::Unknown,
            format!("the mission's, hash {hash}; no log tells whether in force"),
        ),
    }
}

/// Figures that are told otherwise than these parameters have them.
fn differences(parameters: &Parameters, told: &[Parameter]) -> Vec<String> {
    // Sizes that a section does not have wait for one that has them, and a chain of vertices has none.
    let section_differs = match gathered(told) {
        Ok(there) => there.profile != parameters.profile,
        Err(_) => !matches!(parameters.profile, ProfileSpec::Chain { .. }),
    };
    let differs = |(name, wanted): (&str, Value)| {
        let found = told.iter().find(|figure| figure.name == name)?;
        let counts = section_differs || !name.starts_with("TUN_");
        (counts && !same_value(wanted, found.value))
            .then(|| format!("{name} is {}, wanted {}", Shown(found.value), Shown(wanted)))
    };
    figures(parameters).into_iter().filter_map(differs).collect()
}

fn listed(differences: &[String]) -> String {
    let more = differences.len().saturating_sub(LISTED);
    let shown = differences.iter().take(LISTED).map(String::as_str).collect::<Vec<_>>().join("; ");
    if more > 0 { format!("{shown}; and {more} more") } else { shown }
}

/// The card: the board writes a log as soon as there is one.
pub(super) fn card(list: &mut Preflight, logs: Option<&[LogEntry]>, header: Option<&Header>) {
    match (logs, header) {
        (None, _) => list.note(Subject::Card, Verdict::No, "the board does not tell its logs"),
        (Some([]), _) => {
            list.note(Subject::Card, Verdict::No, "the board writes no log: no card in it, or not a FAT card");
        }
        (Some([.., last]), None) => {
            let words = format!("{} has no header: the card does not keep what is written", log_name(last.number));
            list.note(Subject::Card, Verdict::No, words);
        }
        (Some(logs @ [.., last]), Some(_)) => {
            let words = format!("{} logs, writes {}", logs.len(), log_name(last.number));
            list.note(Subject::Card, Verdict::Yes, words);
        }
    }
}

/// The clock, by two readings.
pub(super) fn clock(list: &mut Preflight, readings: Option<[ClockReading; 2]>) {
    let Some([first, second]) = readings else {
        return list.note(Subject::Clock, Verdict::No, "the board does not answer the question for its time");
    };
    let here_s = second.at.duration_since(first.at).as_secs_f64();
    let there_s = second.board.as_secs_f64() - first.board.as_secs_f64();
    let unsure_s = (first.within + second.within).as_secs_f64();
    if (there_s - here_s).abs() > here_s * CLOCK_SHARE + unsure_s {
        let words = format!(
            "the board's clock went on by {there_s:.3} s in {here_s:.3} s; its crystal is dead, or it restarted"
        );
        return list.note(Subject::Clock, Verdict::No, words);
    }
    list.note(Subject::Clock, Verdict::Yes, format!("runs with ours, within {:.0} ms", (unsure_s * 1000.0).max(1.0)));
}

/// The range sensors at rest. `told` says which are fitted.
pub(super) fn sensors(list: &mut Preflight, watch: &Watch, told: &[Parameter]) {
    if watch.telemetries == 0 {
        return list.note(Subject::Sensors, Verdict::No, "the board sends no telemetry");
    }
    let is_fitted = |name: &str| whole(told, name).is_none_or(|fitted| fitted != 0);
    let names = [
        (Beam::Up, "RNG_UP_FIT"),
        (Beam::Right, "RNG_RIGHT_FIT"),
        (Beam::Down, "RNG_DOWN_FIT"),
        (Beam::Left, "RNG_LEFT_FIT"),
    ];
    let silent: Vec<Beam> = names
        .into_iter()
        .zip(watch.readings)
        .filter(|((_, name), readings)| is_fitted(name) && *readings == 0)
        .map(|((beam, _), _)| beam)
        .collect();
    // A vehicle that stands has its floor nearer than the sensor measures, and the place does not depend on it.
    let across: Vec<String> =
        silent.iter().filter(|beam| **beam != Beam::Down).map(|beam| format!("{beam:?}").to_lowercase()).collect();
    if !across.is_empty() {
        let words = format!("no reading {}: unplugged, or nothing within its range there", across.join(", "));
        return list.note(Subject::Sensors, Verdict::No, words);
    }
    if watch.places == 0 {
        let words = "they give no place in the section: is the vehicle in the tunnel, and the section the right one?";
        return list.note(Subject::Sensors, Verdict::No, words);
    }
    let place = watch.telemetry.and_then(|telemetry| telemetry.offset_m).unwrap_or_default();
    let words = format!("{:+.2} m right and {:+.2} m down of the axis", place[0], place[1]);
    if silent.is_empty() {
        list.note(Subject::Sensors, Verdict::Yes, words);
    } else {
        let words =
            format!("{words}; no reading down, as on the ground: lift the vehicle to see whether that one works");
        list.note(Subject::Sensors, Verdict::Unknown, words);
    }
}

fn whole(told: &[Parameter], name: &str) -> Option<i32> {
    let value = told.iter().find(|figure| figure.name == name)?.value;
    Some(value.real() as i32)
}

/// The self-test's end.
pub(super) fn self_test(list: &mut Preflight, passed: bool, watch: &Watch) {
    if passed {
        return list.note(Subject::SelfTest, Verdict::Yes, "shaft, encoder, camera, place and log are good");
    }
    let warning = watch.warning.as_deref().map(|warning| format!(" ({warning})")).unwrap_or_default();
    let words = match watch.failure {
        Some(Failure::Parameters) => "the parameters allow no scan",
        Some(Failure::Centring) => "the place in the section cannot be found from the ranges",
        Some(Failure::Encoder) => "the shaft's encoder is silent",
        Some(Failure::Shaft) => "the shaft does not reach its angles: servo, its supply, or something holds it",
        Some(Failure::Camera) => "the camera says that it is busy and does not end",
        Some(Failure::Log) => "the log cannot be written: card",
        None => "it did not end in time",
    };
    list.note(Subject::SelfTest, Verdict::No, format!("{words}{warning}"));
}

/// The test photos.
pub(super) fn camera(list: &mut Preflight, watch: &Watch, told: &[Parameter]) {
    let wired = whole(told, "SHT_WIRING") != Some(CaptureWiring::None as i32);
    let (taken, missed) = (watch.taken, watch.missed);
    let (verdict, words) = if watch.failure == Some(Failure::Camera) || missed > 0 {
        (Verdict::No, format!("{missed} of {} test photos missed: on, in photo mode, card in, wires?", taken + missed))
    } else if taken == 0 {
        (Verdict::No, "no test photo was told of".to_owned())
    } else if wired {
        (Verdict::Yes, format!("{taken} test photos taken and confirmed"))
    } else {
        (Verdict::Unknown, format!("fired {taken} times; it is not wired to answer: look whether it took them"))
    };
    list.note(Subject::Camera, verdict, words);
}

/// Whether the autopilot takes the limit.
pub(super) fn enforcement(list: &mut Preflight, watch: &Watch) {
    let Some(telemetry) = watch.telemetry else {
        return list.note(Subject::Enforcement, Verdict::No, "the board sends no telemetry");
    };
    let limit = telemetry.limit_mps.map_or("no limit".to_owned(), |limit_mps| format!("{limit_mps:.3} m/s"));
    let because = watch.warning.as_deref().unwrap_or("the board does not say why");
    let (verdict, words) = match telemetry.enforcement {
        Enforcement::Requested if telemetry.speed_mps.is_none() => (
            Verdict::No,
            format!("{limit} asked for, but the vehicle's speed is not known, so nobody can tell whether it obeys"),
        ),
        Enforcement::Requested => {
            (Verdict::Yes, format!("{limit} asked for and not refused; the flight will show that it is obeyed"))
        }
        Enforcement::Enforced => (Verdict::Yes, format!("{limit} in force")),
        Enforcement::Ineffective => (Verdict::No, format!("{limit} is not obeyed: {because}")),
        Enforcement::NotPossible => (Verdict::No, format!("{limit} cannot be enforced: {because}")),
        Enforcement::Idle => (Verdict::No, "the board set no limit in its scan".to_owned()),
    };
    list.note(Subject::Enforcement, verdict, words);
}
