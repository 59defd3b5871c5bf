//! What the pilot and who helps should mind, the worst first.

use adit_protocol::record::Mode;
use adit_protocol::telemetry::Enforcement;

use super::setting::Setting;
use super::view::{Level, LinkStatus, RangeState, View, Warning};

/// Below this share of the battery it is time to turn around, and to land.
const BATTERY_LOW: f64 = 0.3;
const BATTERY_EMPTY: f64 = 0.15;
/// More lost frames than this make figures jump.
const LOST_MANY: f64 = 0.1;
/// A vehicle that holds its place moves by as much.
const OVERSPEED_MPS: f64 = 0.02;
/// The beams' names, in order.
const BEAMS: [&str; 4] = ["up", "right", "down", "left"];

/// What is known besides what is shown.
pub(super) struct Circumstances<'a> {
    pub(super) setting: Option<&'a Setting>,
    /// A photo is missing and the wall it should show is not passed yet.
    pub(super) is_gap_open: bool,
    /// Photos without a place on the strip.
    pub(super) unplaced: u64,
    /// The first capture that was heard of.
    pub(super) first_capture: Option<u32>,
}

pub(super) fn warnings(view: &View, circumstances: &Circumstances<'_>) -> Vec<Warning> {
    let mut all = Vec::new();
    link(view, &mut all);
    if view.link.status == LinkStatus::Up {
        flight(view, circumstances, &mut all);
        equipment(view, circumstances, &mut all);
    }
    wall(view, circumstances, &mut all);
    // Stable: within a level the order is that of the questions.
    all.sort_by_key(|warning| std::cmp::Reverse(warning.level));
    all
}

fn say(all: &mut Vec<Warning>, level: Level, text: impl Into<String>) {
    all.push(Warning { level, text: text.into() });
}

fn link(view: &View, all: &mut Vec<Warning>) {
    let link = &view.link;
    match (link.status, link.silent_s) {
        (LinkStatus::Lost, Some(silent_s)) => {
            say(all, Level::Alarm, format!("LINK LOST for {silent_s:.0} s; everything below is old. {}", link.words));
        }
        (LinkStatus::Waiting, _) => say(all, Level::Alarm, format!("No board heard yet. {}", link.words)),
        _ => {}
    }
    if let Some(lost) = link.lost.filter(|lost| *lost > LOST_MANY && link.status == LinkStatus::Up) {
        say(all, Level::Warning, format!("{:.0} % of the messages are lost on the link", lost * 100.0));
    }
    if link.refused > 0 {
        let refused = link.refused;
        say(all, Level::Warning, format!("{refused} messages not believed: not signed with the key given by --key"));
    }
    if link.left_out > 0 {
        let left_out = link.left_out;
        say(all, Level::Note, format!("{left_out} messages came too fast to be shown; the record has them"));
    }
    if let Some(record) = view.record.as_ref().filter(|record| record.has_failed) {
        say(all, Level::Alarm, format!("NOT RECORDING: {} cannot be written (disk full?)", record.file));
    }
}

fn flight(view: &View, circumstances: &Circumstances<'_>, all: &mut Vec<Warning>) {
    match view.mode.fresh() {
        Some(Mode::Fault) => {
            say(all, Level::Alarm, "BOARD FAULT: no photos are taken");
        }
        Some(Mode::Degraded) => {
            say(all, Level::Warning, "board degraded: position, encoder, autopilot or log is missing");
        }
        _ => {}
    }
    let (speed, limit) = (view.speed_mps.fresh(), view.limit_mps.fresh());
    if let (Some(speed_mps), Some(limit_mps), true) = (speed, limit, view.is_overspeed)
        && speed_mps > limit_mps + OVERSPEED_MPS
    {
        say(all, Level::Alarm, format!("TOO FAST: {speed_mps:.2} m/s, limit {limit_mps:.2} m/s"));
    }
    match view.enforcement.fresh() {
        Some(Enforcement::Ineffective) => {
            say(all, Level::Warning, "the autopilot ignores the speed limit: slow down by hand");
        }
        Some(Enforcement::NotPossible) => {
            say(all, Level::Warning, "the speed limit cannot be enforced: keep below it by hand");
        }
        _ => {}
    }
    let most_m = circumstances.setting.map_or(f64::INFINITY, |setting| setting.offset_max_m);
    if view.offset_m.fresh().is_some_and(|offset_m| offset_m.iter().any(|along_m| along_m.abs() > most_m)) {
        say(all, Level::Alarm, format!("OFF CENTRE: more than {most_m:.2} m from the axis"));
    }
    if circumstances.is_gap_open {
        say(all, Level::Warning, "a photo is missing here: hold, or fly slowly, until it is taken again");
    }
}

fn equipment(view: &View, circumstances: &Circumstances<'_>, all: &mut Vec<Warning>) {
    for (range, beam) in view.ranges.iter().zip(BEAMS) {
        if matches!(range.state, RangeState::Invalid | RangeState::Stale) {
            say(all, Level::Warning, format!("range {beam}: no reading"));
        }
    }
    if let Some(remaining) = view.battery.fresh().and_then(|battery| battery.remaining) {
        let percent = remaining * 100.0;
        if remaining < BATTERY_EMPTY {
            say(all, Level::Alarm, format!("BATTERY {percent:.0} %: land"));
        } else if remaining < BATTERY_LOW {
            say(all, Level::Warning, format!("battery {percent:.0} %: turn around"));
        }
    }
    if let Some(first) = circumstances.first_capture.filter(|first| *first > 1) {
        say(all, Level::Note, format!("photos before no. {first} were not watched: their wall shows as a gap"));
    }
}

fn wall(view: &View, circumstances: &Circumstances<'_>, all: &mut Vec<Warning>) {
    if circumstances.setting.is_none() {
        say(all, Level::Note, "no section known: give --mission to see the tunnel and its coverage");
    }
    if circumstances.unplaced > 0 {
        let unplaced = circumstances.unplaced;
        say(
            all,
            Level::Warning,
            format!("{unplaced} photos have no place along the axis (no odometer): not in the strip"),
        );
    }
    if let Some(gap) = view.gaps.first() {
        let hours = |clock: f64| if clock < 0.5 { 12.0 } else { clock };
        let (from, to) = (hours(gap.clock_from), hours(gap.clock_to));
        let more = match view.gaps.len() - 1 {
            0 => String::new(),
            more => format!(" and {more} more"),
        };
        let clock = match (gap.clock_to - gap.clock_from, format!("{from:.0}"), format!("{to:.0}")) {
            (11.9.., ..) => "all around".to_owned(),
            (_, from, to) if from == to => format!("{from} o'clock"),
            (_, from, to) => format!("{from} to {to} o'clock"),
        };
        let (x_from_m, x_to_m) = (gap.x_from_m, gap.x_to_m);
        let text = format!("GAP behind: {x_from_m:.1} to {x_to_m:.1} m, {clock}{more}");
        say(all, Level::Alarm, text);
    }
}
