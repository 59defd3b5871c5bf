//! What the board tells programs of its own kind, in postcard, inside MAVLink's `TUNNEL`.
//!
//! A newer board may append fields; an older reader ignores them. Anything else takes a new number.

use serde::{Deserialize, Serialize};

use crate::mavlink::TUNNEL_BYTES;
use crate::record::Mode;
use crate::tag::CaptureTag;

/// Number of a [`Telemetry`] in a `TUNNEL`; numbers above 32767 are for private use.
pub const TELEMETRY_KIND: u16 = 44_001;
/// Number of a [`CaptureTag`].
pub const TAG_KIND: u16 = 44_002;

/// How far the speed limit is in force. The measured speed is the judge, not an answer.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Enforcement {
    /// No limit stands.
    #[default]
    Idle,
    /// The autopilot was asked; no flight has shown yet that it obeys.
    Requested,
    /// The vehicle has been seen to fly at the limit and not above it.
    Enforced,
    /// It was asked and the vehicle flies faster all the same, or it refuses.
    Ineffective,
    /// This autopilot takes no limit in this mode, or none so low.
    NotPossible,
}

/// The board at one moment.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Telemetry {
    /// Since the board's start.
    pub time_us: u64,
    /// Its mode.
    pub mode: Mode,
    /// Where the shaft is.
    pub shaft_rad: f32,
    /// Place `[y, z]` in the section.
    pub offset_m: Option<[f32; 2]>,
    /// One standard deviation of it.
    pub sigma_m: Option<[f32; 2]>,
    /// Readings up, right, down, left.
    pub ranges_m: [Option<f32>; 4],
    /// Along the axis.
    pub odometer_m: Option<f32>,
    /// Along the axis.
    pub speed_mps: Option<f32>,
    /// The limit in force.
    pub limit_mps: Option<f32>,
    /// How far it is.
    pub enforcement: Enforcement,
    /// Above the limit?
    pub overspeed: bool,
    /// A photo is missing and the wall it should show is not passed yet.
    pub gap_open: bool,
    /// Commanded so far.
    pub captures: u32,
    /// Known to be missing.
    pub missed: u32,
    /// Of water or sludge.
    pub water_level_m: Option<f32>,
}

/// What came through a tunnel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Tunnelled {
    /// The board.
    Telemetry(Telemetry),
    /// A capture.
    Tag(CaptureTag),
}

impl Tunnelled {
    /// Understands a tunnel's payload; `None` if it is none of ours, or damaged.
    pub fn read(kind: u16, payload: &[u8]) -> Option<Self> {
        match kind {
            TELEMETRY_KIND => postcard::from_bytes(payload).ok().map(Self::Telemetry),
            TAG_KIND => postcard::from_bytes(payload).ok().map(Self::Tag),
            _ => None,
        }
    }
}

/// A value in the encoding of a tunnel; `None` if it does not fit, which none of ours does.
pub fn tunnelled<T: Serialize>(value: &T) -> Option<heapless::Vec<u8, TUNNEL_BYTES>> {
    let mut buffer = [0; TUNNEL_BYTES];
    let used = postcard::to_slice(value, &mut buffer).ok()?;
    heapless::Vec::from_slice(used).ok()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tag::{CaptureState, Ranges, TagFlags};

    /// A tag that takes as many bytes as one can.
    fn fullest() -> CaptureTag {
        let some = Some(f32::MAX);
        CaptureTag {
            capture: u32::MAX,
            state: CaptureState::Confirmed,
            time_us: u64::MAX,
            shaft_rad: 1.0,
            ranges: Ranges { up_m: some, right_m: some, down_m: some, left_m: some },
            range_head_m: some,
            odometer_m: some,
            attitude_rad: Some([1.0; 3]),
            offset_m: Some([1.0; 2]),
            speed_mps: some,
            speed_limit_mps: some,
            flags: TagFlags(u16::MAX),
        }
    }

    #[test]
    fn the_fullest_of_each_goes_through() {
        let some = Some(1.0);
        let telemetry = Telemetry {
            time_us: u64::MAX,
            mode: Mode::Fault,
            offset_m: Some([1.0; 2]),
            sigma_m: Some([1.0; 2]),
            ranges_m: [some; 4],
            odometer_m: some,
            speed_mps: some,
            limit_mps: some,
            enforcement: Enforcement::NotPossible,
            captures: u32::MAX,
            missed: u32::MAX,
            water_level_m: some,
            ..Telemetry::default()
        };
        let bytes = tunnelled(&telemetry).unwrap();
        assert_eq!(Tunnelled::read(TELEMETRY_KIND, &bytes), Some(Tunnelled::Telemetry(telemetry)));
        let bytes = tunnelled(&fullest()).unwrap();
        assert_eq!(Tunnelled::read(TAG_KIND, &bytes), Some(Tunnelled::Tag(fullest())));
        assert_eq!(Tunnelled::read(7, &bytes), None);
        assert_eq!(Tunnelled::read(TAG_KIND, &bytes[..3]), None);
    }
}
