//! The messages that the board listens to, read field by field at their offsets on the wire.
//!
//! Fields lie on the wire by falling size (mavlink.io, "Field Reordering"); offsets below follow from `common.xml`.

use super::RawFrame;

/// What a peer says, as far as the board cares.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Incoming {
    /// Somebody lives.
    Heartbeat {
        /// `MAV_AUTOPILOT`; [`super::NO_AUTOPILOT`] for what is none.
        autopilot: u8,
        /// The autopilot's own number of its mode.
        custom_mode: u32,
    },
    /// Attitude of the vehicle.
    Attitude {
        /// Roll, pitch, yaw.
        angles_rad: [f32; 3],
    },
    /// Place and velocity of the vehicle against its start.
    LocalPosition {
        /// North, east, down.
        position_m: [f32; 3],
        /// North, east, down.
        velocity_mps: [f32; 3],
    },
    /// Somebody wants something.
    Command {
        /// Whom it is for; 0 is everybody.
        target: [u8; 2],
        /// What, as a plain number.
        command: u16,
        /// How often it was repeated.
        confirmation: u8,
        /// The seven parameters.
        parameters: [f32; 7],
    },
    /// The answer to a command.
    CommandAck {
        /// Which.
        command: u16,
        /// `MAV_RESULT`, as a plain number.
        result: u8,
    },
}

impl Incoming {
    /// Reads a frame; `None` if the board has no use for its message.
    pub fn read(frame: &RawFrame) -> Option<Self> {
        let three = |offset: usize| [frame.f32(offset), frame.f32(offset + 4), frame.f32(offset + 8)];
        let byte = |offset: usize| frame.bytes::<1>(offset);
        Some(match frame.message {
            // HEARTBEAT: custom_mode, type, autopilot, ...
            0 => Self::Heartbeat {
                custom_mode: u32::from_le_bytes(frame.bytes(0)),
                autopilot: u8::from_le_bytes(byte(5)),
            },
            // ATTITUDE: time, roll, pitch, yaw, ...
            30 => Self::Attitude { angles_rad: three(4) },
            // LOCAL_POSITION_NED: time, x, y, z, vx, vy, vz.
            32 => Self::LocalPosition { position_m: three(4), velocity_mps: three(16) },
            // COMMAND_LONG: seven parameters, command, target system and component, confirmation.
            76 => Self::Command {
                parameters: core::array::from_fn(|index| frame.f32(index * 4)),
                command: u16::from_le_bytes(frame.bytes(28)),
                target: frame.bytes(30),
                confirmation: u8::from_le_bytes(byte(32)),
            },
            // COMMAND_ACK: command, result, ...
            77 => Self::CommandAck { command: u16::from_le_bytes(frame.bytes(0)), result: u8::from_le_bytes(byte(2)) },
            _ => return None,
        })
    }
}
