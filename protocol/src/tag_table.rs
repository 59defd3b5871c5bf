//! The columns of tags.csv and a tag in them: what the ground writes after a flight and the simulator without one.

use crate::tag::{CaptureState, CaptureTag, TagFlags};

/// The headings, in order.
pub const COLUMNS: [&str; 19] = [
    "capture",
    "photo",
    "state",
    "time_s",
    "shaft_deg",
    "range_up_m",
    "range_right_m",
    "range_down_m",
    "range_left_m",
    "range_head_m",
    "odometer_m",
    "roll_deg",
    "pitch_deg",
    "yaw_deg",
    "offset_y_m",
    "offset_z_m",
    "speed_mps",
    "speed_limit_mps",
    "flags",
];

/// The cells of a row of tags.csv; the photo's cell is empty for `None`.
///
/// Angles get 4 decimals (1e-4 degrees), lengths 4 (0.1 mm), times 6.
pub fn cells(photo: Option<&str>, tag: &CaptureTag) -> [String; 19] {
    let number = |value: Option<f32>| value.map(|v| format!("{v:.4}")).unwrap_or_default();
    let degrees = |rad: f32| format!("{:.4}", f64::from(rad).to_degrees());
    let attitude = |i: usize| tag.attitude_rad.map(|angles| degrees(angles[i])).unwrap_or_default();
    let offset = |i: usize| number(tag.offset_m.map(|offset| offset[i]));
    let state = match tag.state {
        CaptureState::Commanded => "commanded",
        CaptureState::Busy => "busy",
        CaptureState::Confirmed => "confirmed",
    };
    let flags: Vec<&str> =
        TagFlags::NAMES.iter().filter(|(_, flag)| tag.flags.contains(*flag)).map(|(name, _)| *name).collect();
    [
        tag.capture.to_string(),
        photo.unwrap_or_default().to_owned(),
        state.to_owned(),
        format!("{}.{:06}", tag.time_us / 1_000_000, tag.time_us % 1_000_000),
        degrees(tag.shaft_rad),
        number(tag.ranges.up_m),
        number(tag.ranges.right_m),
        number(tag.ranges.down_m),
        number(tag.ranges.left_m),
        number(tag.range_head_m),
        number(tag.odometer_m),
        attitude(0),
        attitude(1),
        attitude(2),
        offset(0),
        offset(1),
        number(tag.speed_mps),
        number(tag.speed_limit_mps),
        flags.join("|"),
    ]
}
