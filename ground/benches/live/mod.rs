//! Messages of a live view: what one of them costs, and a photo's tag in the strip.

use std::f32::consts::TAU;
use std::time::{Duration, SystemTime};

use adit_ground::link::{Heard, Trust};
use adit_ground::live::{Setting, State};
use adit_protocol::beams::Beam;
use adit_protocol::mavlink::{FrameDecoder, Incoming, OutFrame, RangeReport, Sender};
use adit_protocol::mission::Mission;
use adit_protocol::tag::{CaptureState, CaptureTag, Ranges, TagFlags};
use adit_protocol::telemetry::{TAG_KIND, tunnelled};

const MISSION: &str = include_str!("../../../hil-sim/missions/demo.toml");

pub(crate) fn state() -> State {
    let mission = Mission::from_toml(MISSION).expect("the demo's mission is sound");
    let mut state = State::new(None);
    state.set(Setting::of_mission(&mission).expect("it can be flown")).expect("it can be shown");
    state
}

fn heard(frame: &OutFrame) -> Heard {
    let mut decoder = FrameDecoder::default();
    let frame = frame.iter().find_map(|byte| decoder.push(*byte)).expect("a frame of ours");
    let incoming = Incoming::read(&frame);
    Heard { at: SystemTime::UNIX_EPOCH, frame, incoming, trust: Trust::Unchecked }
}

/// A second of a flood: 10,000 ranges and figures.
pub(crate) fn flood() -> Vec<(Duration, Heard)> {
    let mut board = Sender::new(1, 191);
    let mut next = |count: u32| {
        let report = RangeReport { beam: Beam::Up, range_m: 1.5, limits_m: [0.2, 14.0] };
        let frame = if count.is_multiple_of(2) { board.range(0, &report) } else { board.named_value(0, "speed", 0.1) };
        (Duration::from_micros(u64::from(count) * 100), heard(&frame))
    };
    (0..10_000).map(&mut next).collect()
}

/// The tags of ten metres of flight.
pub(crate) fn tags() -> Vec<Heard> {
    let mut board = Sender::new(1, 191);
    let tag = |capture: u32| CaptureTag {
        capture,
        state: CaptureState::Commanded,
        time_us: 0,
        shaft_rad: capture as f32 * TAU / 10.0,
        ranges: Ranges::default(),
        range_head_m: None,
        odometer_m: Some(capture as f32 * 0.08),
        attitude_rad: Some([0.0; 3]),
        offset_m: Some([0.0; 2]),
        speed_mps: None,
        speed_limit_mps: None,
        flags: TagFlags::default(),
    };
    (1..=125)
        .map(|capture| {
            let payload = tunnelled(&tag(capture)).expect("a tag fits");
            heard(&board.tunnel([0, 0], TAG_KIND, &payload))
        })
        .collect()
}
