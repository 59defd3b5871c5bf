//! A flight for tests: a board, a camera and an autopilot that say what one tells them to, without a link.

use std::f64::consts::TAU;
use std::time::{Duration, SystemTime};

use adit_protocol::beams::Beam;
use adit_protocol::mavlink::{
    CaptureReport, FrameDecoder, Incoming, OutFrame, RangeReport, Sender, Severity, VehicleBeat,
};
use adit_protocol::mission::Mission;
use adit_protocol::record::Mode;
use adit_protocol::tag::{CaptureState, CaptureTag, Ranges, TagFlags};
use adit_protocol::telemetry::{Enforcement, TAG_KIND, TELEMETRY_KIND, Telemetry, tunnelled};

use super::setting::Setting;
use super::state::State;
use crate::link::{Heard, Trust};

/// A pipe 3 m across, ten photos a turn, two views of everything.
const MISSION: &str = include_str!("../../../hil-sim/missions/demo.toml");
/// Below the bound for two views.
pub(super) const STEP_M: f64 = 0.08;

/// Photos without which a place is seen by too few: less than three neighbours over three turns is made up for by others.
pub(super) const MISSING: [u32; 9] = [31, 32, 33, 41, 42, 43, 51, 52, 53];

pub(super) fn setting() -> Setting {
    Setting::of_mission(&Mission::from_toml(MISSION).unwrap()).unwrap()
}

pub(super) fn heard(frame: &OutFrame) -> Heard {
    let mut decoder = FrameDecoder::default();
    let frame = frame.iter().find_map(|byte| decoder.push(*byte)).unwrap();
    let incoming = Incoming::read(&frame);
    Heard { at: SystemTime::UNIX_EPOCH, frame, incoming, trust: Trust::Unchecked }
}

/// The tag of a photo of a steady flight along the axis.
pub(super) fn tag(capture: u32) -> CaptureTag {
    CaptureTag {
        capture,
        state: CaptureState::Commanded,
        time_us: u64::from(capture) * 1_000_000,
        shaft_rad: (f64::from(capture) * TAU / 10.0) as f32,
        ranges: Ranges::default(),
        range_head_m: None,
        odometer_m: Some((f64::from(capture) * STEP_M) as f32),
        attitude_rad: Some([0.0; 3]),
        offset_m: Some([0.0; 2]),
        speed_mps: None,
        speed_limit_mps: None,
        flags: TagFlags::default(),
    }
}

pub(super) struct Flight {
    pub(super) state: State,
    pub(super) now: Duration,
    pub(super) telemetry: Telemetry,
    board: Sender,
    camera: Sender,
    autopilot: Sender,
}

impl Flight {
    pub(super) fn new() -> Self {
        let mut state = State::new(None);
        state.set(setting()).unwrap();
        state.line(Ok("/dev/ttyUSB0 at 57600 baud".to_owned()), adit_protocol::mavlink::Counters::default());
        let telemetry = Telemetry {
            mode: Mode::Scanning,
            offset_m: Some([-0.12, 0.06]),
            sigma_m: Some([0.02, 0.04]),
            ranges_m: [Some(1.56), Some(1.61), Some(1.35), Some(1.38)],
            odometer_m: Some(0.0),
            speed_mps: Some(0.07),
            limit_mps: Some(0.09),
            enforcement: Enforcement::Enforced,
            water_level_m: Some(0.08),
            ..Telemetry::default()
        };
        Self {
            state,
            now: Duration::ZERO,
            telemetry,
            board: Sender::new(1, 191),
            camera: Sender::new(1, 100),
            autopilot: Sender::new(1, 1),
        }
    }

    pub(super) fn wait_s(&mut self, seconds: f64) {
        self.now += Duration::from_secs_f64(seconds);
    }

    pub(super) fn hear(&mut self, frame: &OutFrame) {
        self.state.hear(self.now, &heard(frame));
    }

    /// The board tells everything.
    pub(super) fn tell(&mut self) {
        self.telemetry.time_us = self.now.as_micros() as u64;
        let frame = self.board.tunnel([0, 0], TELEMETRY_KIND, &tunnelled(&self.telemetry).unwrap());
        self.hear(&frame);
    }

    pub(super) fn range(&mut self, beam: Beam, range_m: f32) {
        let frame = self.board.range(0, &RangeReport { beam, range_m, limits_m: [0.2, 14.0] });
        self.hear(&frame);
    }

    pub(super) fn say(&mut self, severity: Severity, text: &str) {
        let frame = self.board.text(severity, &text.try_into().unwrap());
        self.hear(&frame);
    }

    pub(super) fn figure(&mut self, name: &str, value: f32) {
        let frame = self.board.named_value(0, name, value);
        self.hear(&frame);
    }

    pub(super) fn vehicle(&mut self) {
        let beat = VehicleBeat { autopilot: 3, base_mode: 0x81, custom_mode: 3 };
        let frames = [self.autopilot.vehicle_heartbeat(beat), self.autopilot.battery(15.2, 0.63)];
        for frame in &frames {
            self.hear(frame);
        }
    }

    /// A photo of a steady flight, and what became of it.
    pub(super) fn photo(&mut self, capture: u32, is_taken: bool) {
        self.tagged(&tag(capture));
        self.report(capture, is_taken);
        self.telemetry.captures = capture;
        self.telemetry.missed += u32::from(!is_taken);
        self.telemetry.odometer_m = tag(capture).odometer_m;
        self.telemetry.shaft_rad = tag(capture).shaft_rad;
    }

    pub(super) fn tagged(&mut self, tag: &CaptureTag) {
        let frame = self.board.tunnel([0, 0], TAG_KIND, &tunnelled(tag).unwrap());
        self.hear(&frame);
    }

    pub(super) fn report(&mut self, capture: u32, taken: bool) {
        let report = CaptureReport { index: capture as i32 - 1, taken, ..CaptureReport::default() };
        let frame = self.camera.image_captured(&report);
        self.hear(&frame);
    }
}
