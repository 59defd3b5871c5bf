//! What is shown, as plain numbers: the terminal draws them, the page gets them as JSON.

use adit_protocol::record::Mode;
use adit_protocol::telemetry::Enforcement;
use serde::Serialize;

use super::reading::Reading;
use crate::texture::Hole;

/// Everything that is shown at one moment, but the strip's cells.
#[derive(Clone, Debug, Default, Serialize)]
pub struct View {
    /// Since the beginning.
    pub time_s: f64,
    /// The board's own clock.
    pub board_s: Option<f64>,
    /// How the link is.
    pub link: LinkView,
    /// The board's mode.
    pub mode: Reading<Mode>,
    /// The autopilot: its kind, its mode, and whether it is armed.
    pub autopilot: Reading<AutopilotView>,
    /// Place `[y, z]` in the section: right, down.
    pub offset_m: Reading<[f64; 2]>,
    /// One standard deviation of it.
    pub sigma_m: Option<[f64; 2]>,
    /// Roll of the vehicle, clockwise looking forward.
    pub roll_rad: Reading<f64>,
    /// The four ranges: up, right, down, left.
    pub ranges: [RangeView; 4],
    /// Along the axis.
    pub odometer_m: Reading<f64>,
    /// Along the axis.
    pub speed_mps: Reading<f64>,
    /// The limit in force.
    pub limit_mps: Reading<f64>,
    /// How far it is.
    pub enforcement: Reading<Enforcement>,
    /// Above the limit?
    pub is_overspeed: bool,
    /// Where the shaft is, within one turn.
    pub shaft_rad: Reading<f64>,
    /// Photos commanded so far.
    pub captures: Reading<u32>,
    /// Of these, known to be stored; `None` where the camera cannot tell.
    pub confirmed: Option<u32>,
    /// Known to be missing.
    pub missed: Reading<u32>,
    /// Of water or sludge.
    pub water_level_m: Reading<f64>,
    /// The vehicle's battery.
    pub battery: Reading<BatteryView>,
    /// How much of the wall was photographed; `None` where the section is not known.
    pub wall: Option<WallView>,
    /// Gaps of the wall behind the vehicle, largest first.
    pub gaps: Vec<Hole>,
    /// What the board and the autopilot said last, newest first.
    pub notices: Vec<Notice>,
    /// What to mind, the worst first.
    pub warnings: Vec<Warning>,
    /// The record, if there is one.
    pub record: Option<RecordView>,
    /// The record that is shown in place of a flight.
    pub replay: Option<ReplayView>,
    /// The section once around, closed, `[y, z]`; empty if it is not known.
    #[serde(skip)]
    pub outline_m: Vec<[f64; 2]>,
}

/// The autopilot.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct AutopilotView {
    /// Whose program it is.
    pub name: &'static str,
    /// What it calls its mode; `None` where the mode has no name here.
    pub mode: Option<&'static str>,
    /// Do the motors turn?
    pub is_armed: bool,
}

/// The vehicle's battery.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct BatteryView {
    /// Its voltage.
    pub voltage_v: Option<f64>,
    /// Share that is left.
    pub remaining: Option<f64>,
}

/// The wall so far.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct WallView {
    /// Shown by enough photos.
    pub seen_m2: f64,
    /// Shown by too few, and left behind or meant to be shown by a photo that is missing.
    pub marked_m2: f64,
}

/// Is a range to be believed?
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum RangeState {
    /// It is.
    Valid,
    /// The sensor cannot measure, or is gone.
    Invalid,
    /// Nothing was heard of it for too long.
    Stale,
    /// Nothing was heard of it yet.
    #[default]
    Unknown,
    /// There is no such sensor.
    Unfitted,
}

/// A range.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct RangeView {
    /// Is it to be believed?
    pub state: RangeState,
    /// The reading, where it is.
    pub range_m: Option<f64>,
    /// How long ago it was heard.
    pub age_s: Option<f64>,
}

/// How the link is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum LinkStatus {
    /// The board was never heard.
    #[default]
    Waiting,
    /// It is heard.
    Up,
    /// It was, and is not any more.
    Lost,
}

/// The link.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct LinkView {
    /// How it is.
    pub status: LinkStatus,
    /// The peer, or what is wrong with the line.
    pub words: String,
    /// How long the board has been silent.
    pub silent_s: Option<f64>,
    /// Frames heard per second.
    pub rate_hz: f64,
    /// Share of frames that were lost.
    pub lost: Option<f64>,
    /// Damaged frames so far.
    pub damaged: u32,
    /// Frames that were not believed: not signed with the key.
    pub refused: u64,
    /// Messages that the display left out because they came too fast; the record has them.
    pub left_out: u64,
    /// A radio's signal and noise, as it counts them.
    pub radio: Reading<[Option<u8>; 3]>,
}

/// Words of the board or the autopilot.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Notice {
    /// When, since the beginning.
    pub at_s: f64,
    /// `MAV_SEVERITY`: 0 is an emergency, 4 a warning, 6 for information.
    pub severity: u8,
    /// Who: `board`, `autopilot` or a component's number.
    pub from: String,
    /// The words, as they came: to be escaped by whoever shows them.
    pub text: String,
}

/// How bad it is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Level {
    /// Good to know.
    Note,
    /// To be minded.
    Warning,
    /// To be acted on now.
    Alarm,
}

/// Something to mind.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Warning {
    /// How bad it is.
    pub level: Level,
    /// What.
    pub text: String,
}

/// The record.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct RecordView {
    /// The file.
    pub file: String,
    /// It could not go on.
    pub has_failed: bool,
}

/// A record that is shown.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct ReplayView {
    /// So many times as fast as it was.
    pub speed: f64,
    /// It has come to its end.
    pub is_over: bool,
}

impl View {
    /// Which way to the centre: metres to the right (negative: left) and downwards (negative: up).
    pub fn steer_m(&self) -> Option<[f64; 2]> {
        self.offset_m.fresh().map(|offset_m| offset_m.map(|along_m| -along_m))
    }
}
