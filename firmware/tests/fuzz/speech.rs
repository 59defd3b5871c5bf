//! What peers may say to the board: every message that the link reads, with fields that lie near the ones that matter.

use adit_protocol::mavlink::{CommandResult, Key, OutFrame, RawValue, Sender, Value, VehicleBeat, command};
use adit_protocol::mavlink::{Encoding, Target};
use adit_protocol::parameters::ParameterTable;
use adit_protocol::record::Mode;
use adit_protocol::telemetry::{TAG_KIND, TELEMETRY_KIND, Telemetry, tunnelled};

use crate::dice::Dice;
use crate::wire::{MESSAGES, taken_apart};

/// The vehicle's number in most cases.
pub(crate) const SYSTEM: u8 = 3;
/// Modes with a row of their own in either autopilot's table, and some without.
const CUSTOM_MODES: [u32; 12] =
    [3, 4, 5, 6, 16, 27, 4 << 16 | 3 << 24, 4 << 16 | 4 << 24, 3 << 16, 3 << 16 | 2 << 24, 6 << 16, u32::MAX];
const COMMANDS: [u16; 14] = [
    command::ARM_DISARM,
    command::ARM_DISARM,
    command::START_CAPTURE,
    command::STOP_CAPTURE,
    command::READDRESS,
    command::READDRESS,
    command::REBOOT,
    command::REQUEST_MESSAGE,
    command::REQUEST_CAPABILITIES,
    command::REQUEST_CAMERA_INFORMATION,
    command::REQUEST_CAMERA_SETTINGS,
    command::REQUEST_STORAGE_INFORMATION,
    command::REQUEST_CAPTURE_STATUS,
    command::CHANGE_SPEED,
];
const LIMIT_PARAMETERS: [&str; 3] = ["LOIT_SPEED", "LOIT_SPEED_MS", "MPC_VEL_MANUAL"];

/// A message's number and payload.
pub(crate) type Message = (u32, Vec<u8>);

/// One of the autopilot's.
pub(crate) fn of_autopilot(dice: &mut Dice) -> Message {
    let sender = &mut Sender::new(SYSTEM, 1);
    let three = |dice: &mut Dice, most: f32| core::array::from_fn(|_| dice.real(-most, most));
    let frame = match dice.below(13) {
        0..3 => heartbeat(sender, dice),
        3 => sender.attitude(dice.whole(), three(dice, 3.2)),
        4 => {
            let (position_m, velocity_mps) = (three(dice, 100.0), three(dice, 1.0));
            sender.local_position(dice.whole(), position_m, velocity_mps)
        }
        5 => sender.head_up(dice.real(0.0, 1.5)),
        6 => return (331, odometry(dice)),
        7..10 => {
            let name = dice.pick(&LIMIT_PARAMETERS);
            let value = Value::Real(if dice.percent(50) { dice.real(0.1, 20.0) } else { dice.real(10.0, 2000.0) });
            sender.parameter_value(name, value.write(Encoding::Cast), [dice.whole() as u16, 900])
        }
        10 => {
            let result = [CommandResult::Accepted, CommandResult::TemporarilyRejected, CommandResult::Denied];
            let (number, result) = (dice.pick(&[178, 178, 511, 512]), dice.pick(&result));
            let to = dice.pick(&[[0, 0], [SYSTEM, 191], [1, 191], [255, 190]]);
            sender.command_ack(number, result, to)
        }
        11 => return (148, with_version(dice)),
        _ => return any(dice),
    };
    taken_apart(&frame)
}

/// One of a ground station's.
pub(crate) fn of_ground(dice: &mut Dice) -> Message {
    let sender = &mut Sender::new(255, 190);
    let to = target(dice);
    let frame = match dice.below(16) {
        0..5 => order(sender, dice, to),
        5..8 => {
            let rows = ParameterTable::rows();
            let row = &rows[dice.below(rows.len())];
            sender.parameter_set(to, row.name, raw_value(dice, row.least, row.most))
        }
        8 => sender.parameter_list(to),
        9 => {
            let rows = ParameterTable::rows();
            if dice.percent(50) {
                sender.parameter_read_at(to, dice.below(rows.len() + 5) as u16)
            } else {
                sender.parameter_read(to, rows[dice.below(rows.len())].name)
            }
        }
        10 => sender.log_list(to),
        11 => sender.log_request(to, dice.whole() as u16, dice.whole(), dice.whole()),
        12 => sender.log_end(to),
        13 => {
            let key = if dice.percent(30) { [0; 32] } else { [dice.byte(); 32] };
            let time = if dice.percent(20) { u64::MAX } else { dice.word() >> dice.pick(&[0, 16, 18, 40]) };
            sender.setup_signing(to, &Key(key), time)
        }
        14 => sender.time_sync(i64::from(dice.below(2) as u8), dice.word().cast_signed()),
        _ => return any(dice),
    };
    taken_apart(&frame)
}

fn heartbeat(sender: &mut Sender, dice: &mut Dice) -> OutFrame {
    let autopilot = if dice.percent(90) { dice.pick(&[3, 12]) } else { dice.byte() };
    let custom_mode = if dice.percent(95) { dice.pick(&CUSTOM_MODES) } else { dice.whole() };
    sender.vehicle_heartbeat(VehicleBeat { autopilot, base_mode: dice.byte(), custom_mode })
}

fn order(sender: &mut Sender, dice: &mut Dice, to: Target) -> OutFrame {
    let number = if dice.percent(95) { dice.pick(&COMMANDS) } else { dice.whole() as u16 };
    let mut parameters: [f32; 7] = core::array::from_fn(|_| dice.pick(&[0.0, 0.0, 1.0, 1.0, 2.0]));
    if number == command::READDRESS {
        (parameters[0], parameters[1]) = (dice.real(7.0, 121.0).round(), dice.real(7.0, 121.0).round());
    }
    if number == command::REQUEST_MESSAGE {
        (parameters[0], parameters[1]) =
            (dice.pick(&[148.0, 259.0, 260.0, 261.0, 262.0, 263.0]), dice.real(-1.0, 20.0));
    }
    if dice.percent(10) {
        let place = dice.below(7);
        parameters[place] = dice.real(-10.0, 10.0);
    }
    sender.command(to, number, dice.pick(&[0, 0, 0, 1, 255]), &parameters)
}

fn raw_value(dice: &mut Dice, least: f32, most: f32) -> RawValue {
    let real = dice.real(least, most);
    let value = if dice.percent(50) { Value::Real(real) } else { Value::Whole(real as i32) };
    let mut raw = value.write(dice.pick(&[Encoding::Cast, Encoding::Bytewise]));
    if dice.percent(10) {
        raw.kind = dice.byte() % 12;
    }
    raw
}

fn target(dice: &mut Dice) -> Target {
    if dice.percent(10) {
        return [dice.byte(), dice.byte()];
    }
    dice.pick(&[
        [SYSTEM, 191],
        [SYSTEM, 191],
        [SYSTEM, 191],
        [SYSTEM, 100],
        [SYSTEM, 100],
        [1, 191],
        [1, 100],
        [SYSTEM, 0],
        [0, 0],
    ])
}

fn with_version(dice: &mut Dice) -> Vec<u8> {
    let mut payload = vec![0; 78];
    payload[16..20].copy_from_slice(&dice.pick(&[[255, 0, 6, 4], [255, 0, 7, 4], [1, 2, 3, 4]]));
    payload
}

fn odometry(dice: &mut Dice) -> Vec<u8> {
    let mut payload = vec![0; 233];
    for place in 0..10 {
        payload[8 + place * 4..][..4].copy_from_slice(&dice.real(-1.0, 1.0).to_le_bytes());
    }
    payload[228] = dice.pick(&[1, 1, 0, 8]);
    payload[229] = dice.pick(&[1, 8, 12, 0]);
    payload[230] = dice.below(2) as u8;
    payload[232] = dice.pick(&[0, 50, 100, 255]);
    payload
}

/// Any message that is known, with any payload, or one of the board's own kind.
fn any(dice: &mut Dice) -> Message {
    let sender = &mut Sender::new(SYSTEM, 191);
    match dice.below(4) {
        0 => {
            let telemetry = tunnelled(&Telemetry { mode: Mode::Scanning, ..Telemetry::default() }).unwrap_or_default();
            taken_apart(&sender.tunnel([0, 0], dice.pick(&[TELEMETRY_KIND, TAG_KIND, 7]), &telemetry))
        }
        1 => {
            let noise = dice.bytes(128);
            taken_apart(&sender.tunnel([0, 0], dice.pick(&[TELEMETRY_KIND, TAG_KIND]), &noise))
        }
        _ => {
            let (number, _, length) = dice.pick(&MESSAGES);
            let mut payload = dice.bytes(256);
            payload.resize(length, dice.byte());
            (number, payload)
        }
    }
}
