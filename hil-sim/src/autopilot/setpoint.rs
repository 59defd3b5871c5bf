//! `SET_POSITION_TARGET_LOCAL_NED`, as far as one dimension goes.
//!
//! Layout by falling size: time, x y z, vx vy vz, ax ay az, yaw, yaw rate, mask, target, frame.

use adit_protocol::mavlink::RawFrame;

/// `SET_POSITION_TARGET_LOCAL_NED`.
pub(super) const MESSAGE: u32 = 84;
/// `MAV_FRAME_LOCAL_NED`, `MAV_FRAME_LOCAL_OFFSET_NED`: velocities to north and east.
const EARTH: [u8; 2] = [1, 7];
/// `MAV_FRAME_BODY_NED`, `MAV_FRAME_BODY_OFFSET_NED`: velocities forward and right.
const BODY: [u8; 2] = [8, 9];
/// `POSITION_TARGET_TYPEMASK_X_IGNORE` to `Z_IGNORE`.
const NO_PLACE: u16 = 0b111;
/// `POSITION_TARGET_TYPEMASK_VX_IGNORE`, `VY_IGNORE`.
const NO_VELOCITY: u16 = 0b11_000;

/// What a companion wants of the vehicle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum SetPoint {
    /// Fly at this speed along the axis.
    Velocity(f64),
    /// Fly to a place.
    Place,
    /// It cannot be understood: a frame that nobody knows, or not a number.
    Nonsense,
}

/// Whom a setpoint is for.
pub(super) fn target(frame: &RawFrame) -> [u8; 2] {
    frame.bytes(50)
}

/// Reads one; velocities to north and east are taken along an axis at this yaw.
pub(super) fn read(frame: &RawFrame, axis_yaw_rad: f64) -> SetPoint {
    let [vx_mps, vy_mps] = [16, 20].map(|offset| f64::from(frame.f32(offset)));
    let (mask, coordinates) = (frame.u16(48), frame.u8(52));
    let (sin, cos) = axis_yaw_rad.sin_cos();
    let along_mps = match coordinates {
        coordinates if EARTH.contains(&coordinates) => vx_mps * cos + vy_mps * sin,
        coordinates if BODY.contains(&coordinates) => vx_mps,
        _ => f64::NAN,
    };
    if !along_mps.is_finite() {
        SetPoint::Nonsense
    } else if mask & NO_PLACE == NO_PLACE && mask & NO_VELOCITY == 0 {
        SetPoint::Velocity(along_mps)
    } else {
        SetPoint::Place
    }
}
