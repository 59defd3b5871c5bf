//! What an autopilot says, for simulated ones.

use mavlink::MessageData;
use mavlink::dialects::common::{
    ATTITUDE_DATA, HEARTBEAT_DATA, LOCAL_POSITION_NED_DATA, SYS_STATUS_DATA, VFR_HUD_DATA,
};

use super::board::MAVLINK_VERSION;
use super::{OutFrame, Sender};

/// What an autopilot's heartbeat says.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct VehicleBeat {
    /// `MAV_AUTOPILOT`.
    pub autopilot: u8,
    /// `MAV_MODE_FLAG`.
    pub base_mode: u8,
    /// The autopilot's own number of its mode.
    pub custom_mode: u32,
}

impl VehicleBeat {
    /// Whether the motors may turn: `MAV_MODE_FLAG_SAFETY_ARMED`.
    pub fn is_armed(self) -> bool {
        self.base_mode & 0x80 != 0
    }
}

/// `MAV_TYPE_QUADROTOR`.
const QUADROTOR: u8 = 2;
/// `MAV_STATE_ACTIVE`.
const ACTIVE: u8 = 4;

impl Sender {
    /// The vehicle lives.
    pub fn vehicle_heartbeat(&mut self, beat: VehicleBeat) -> OutFrame {
        let [m0, m1, m2, m3] = beat.custom_mode.to_le_bytes();
        let rest = [QUADROTOR, beat.autopilot, beat.base_mode, ACTIVE, MAVLINK_VERSION];
        let [r0, r1, r2, r3, r4] = rest;
        self.wrap(HEARTBEAT_DATA::ID, &[m0, m1, m2, m3, r0, r1, r2, r3, r4])
    }

    /// How the vehicle lies: roll, pitch, yaw from north.
    pub fn attitude(&mut self, time_ms: u32, [roll, pitch, yaw]: [f32; 3]) -> OutFrame {
        self.frame(&ATTITUDE_DATA { time_boot_ms: time_ms, roll, pitch, yaw, ..ATTITUDE_DATA::DEFAULT })
    }

    /// Where the vehicle is and how it moves: north, east, down.
    pub fn local_position(&mut self, time_ms: u32, position_m: [f32; 3], velocity_mps: [f32; 3]) -> OutFrame {
        let ([x, y, z], [vx, vy, vz]) = (position_m, velocity_mps);
        self.frame(&LOCAL_POSITION_NED_DATA { time_boot_ms: time_ms, x, y, z, vx, vy, vz })
    }

    /// The head-up display's speed over ground.
    pub fn head_up(&mut self, ground_speed_mps: f32) -> OutFrame {
        self.frame(&VFR_HUD_DATA { groundspeed: ground_speed_mps, ..VFR_HUD_DATA::DEFAULT })
    }

    /// What is left in the battery: volts, and a share of its charge.
    pub fn battery(&mut self, voltage_v: f32, remaining: f32) -> OutFrame {
        self.frame(&SYS_STATUS_DATA {
            voltage_battery: (voltage_v * 1000.0 + 0.5) as u16,
            battery_remaining: (remaining * 100.0 + 0.5) as i8,
            ..SYS_STATUS_DATA::DEFAULT
        })
    }
}
