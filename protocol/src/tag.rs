//! The tag of one capture: everything the board knew at the moment of the exposure.

use serde::{Deserialize, Serialize};

/// How far a capture is known to have gone.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum CaptureState {
    /// The shutter was commanded; nothing was heard from the camera.
    Commanded,
    /// The camera was seen busy after the command.
    Busy,
    /// The camera confirmed the photo.
    Confirmed,
}

/// Four body-fixed range readings in metres; `None` where the sensor could not measure.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Ranges {
    /// Body -z.
    pub up_m: Option<f32>,
    /// Body +y.
    pub right_m: Option<f32>,
    /// Body +z. Measures water or sludge where there is any.
    pub down_m: Option<f32>,
    /// Body -y.
    pub left_m: Option<f32>,
}

/// Circumstances that a reader of the tag must know; bit set.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct TagFlags(pub u16);

impl TagFlags {
    /// The measured speed was above the limit.
    pub const OVERSPEED: Self = Self(1);
    /// The shaft had not settled when the shutter was commanded.
    pub const SHAFT_MOVING: Self = Self(1 << 1);
    /// Position in the section is unknown or rests on a single good beam.
    pub const CENTRING_LOST: Self = Self(1 << 2);
    /// This capture repeats one that was missed at the same shaft angle.
    pub const RETRY: Self = Self(1 << 3);
    /// At least one range sensor is faulty.
    pub const SENSOR_FAULT: Self = Self(1 << 4);
    /// The shaft angle is the commanded one; no encoder was heard.
    pub const ANGLE_COMMANDED: Self = Self(1 << 5);

    /// Names and values of all flags, in order of their bits; the names are those of tags.csv.
    pub const NAMES: [(&'static str, Self); 6] = [
        ("overspeed", Self::OVERSPEED),
        ("shaft-moving", Self::SHAFT_MOVING),
        ("centring-lost", Self::CENTRING_LOST),
        ("retry", Self::RETRY),
        ("sensor-fault", Self::SENSOR_FAULT),
        ("angle-commanded", Self::ANGLE_COMMANDED),
    ];

    /// Tells whether all bits of `other` are set.
    pub fn contains(self, other: Self) -> bool {
        self.0 & other.0 == other.0
    }

    /// Returns both sets joined.
    #[must_use]
    pub fn with(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }
}

/// The tag of one capture.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct CaptureTag {
    /// Counts from 1 and never repeats within a flight.
    pub capture: u32,
    /// How far the capture is known to have gone.
    pub state: CaptureState,
    /// Best-known time of the exposure since the board's start.
    pub time_us: u64,
    /// Section angle of the optical axis in the body frame, 0 up, clockwise looking forward; grows over turns.
    pub shaft_rad: f32,
    /// Body-fixed range readings.
    pub ranges: Ranges,
    /// Range sensor on the rotating head, along the optical axis.
    pub range_head_m: Option<f32>,
    /// Distance along the axis from any source, drift allowed.
    pub odometer_m: Option<f32>,
    /// Roll, pitch, yaw of the body against the tunnel.
    pub attitude_rad: Option<[f32; 3]>,
    /// Solved position `[y, z]` in the section.
    pub offset_m: Option<[f32; 2]>,
    /// Measured speed along the tunnel.
    pub speed_mps: Option<f32>,
    /// Speed limit in force.
    pub speed_limit_mps: Option<f32>,
    /// Circumstances.
    pub flags: TagFlags,
}
