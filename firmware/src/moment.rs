//! What is known at one moment, as far as a tag carries it.

use adit_protocol::tag::{CaptureState, CaptureTag, Ranges, TagFlags};

/// The state of the vehicle at one step.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Moment {
    pub(crate) now_us: u64,
    pub(crate) ranges: Ranges,
    pub(crate) range_head_m: Option<f32>,
    pub(crate) odometer_m: Option<f32>,
    pub(crate) attitude_rad: Option<[f32; 3]>,
    pub(crate) offset_m: Option<[f32; 2]>,
    pub(crate) speed_mps: Option<f32>,
    pub(crate) speed_limit_mps: Option<f32>,
    pub(crate) shaft_rad: f32,
    pub(crate) flags: TagFlags,
}

impl Moment {
    /// The tag of a capture that was exposed at `time_us`, which is now or has just been.
    pub(crate) fn tag(&self, capture: u32, state: CaptureState, time_us: u64, flags: TagFlags) -> CaptureTag {
        CaptureTag {
            capture,
            state,
            time_us,
            shaft_rad: self.shaft_rad,
            ranges: self.ranges,
            range_head_m: self.range_head_m,
            odometer_m: self.odometer_m,
            attitude_rad: self.attitude_rad,
            offset_m: self.offset_m,
            speed_mps: self.speed_mps,
            speed_limit_mps: self.speed_limit_mps,
            flags: self.flags.with(flags),
        }
    }
}
