//! A vehicle's side of the link in a few lines: frames made with the same sender, with another number and component.

use adit_protocol::mavlink::MAX_FRAME_BYTES;
use mavlink_frames::*;
use proptest::prelude::*;

use super::*;

/// Frames of a vehicle, written by hand: the board's own sender only speaks for the board.
mod mavlink_frames {
    use crc::{CRC_16_MCRF4XX, Crc};

    const CRC: Crc<u16> = Crc::<u16>::new(&CRC_16_MCRF4XX);

    /// A frame of system 3 with this payload; `extra` is the byte that stands for the message's layout.
    pub(super) fn frame(component: u8, message: u8, payload: &[u8], extra: u8) -> Vec<u8> {
        let mut bytes = vec![0xFD, payload.len() as u8, 0, 0, 0, 3, component, message, 0, 0];
        bytes.extend_from_slice(payload);
        let mut digest = CRC.digest();
        digest.update(&bytes[1..]);
        digest.update(&[extra]);
        bytes.extend_from_slice(&digest.finalize().to_le_bytes());
        bytes
    }

    pub(super) fn floats(values: &[f32]) -> Vec<u8> {
        values.iter().flat_map(|value| value.to_le_bytes()).collect()
    }

    pub(super) fn heartbeat() -> Vec<u8> {
        frame(1, 0, &[0, 0, 0, 0, 2, 3, 0, 4, 3], 50)
    }

    pub(super) fn attitude(angles_rad: [f32; 3]) -> Vec<u8> {
        let [roll, pitch, yaw] = angles_rad;
        frame(1, 30, &floats(&[0.0, roll, pitch, yaw, 0.0, 0.0, 0.0]), 39)
    }

    pub(super) fn position(north_m: f32, east_m: f32, velocity_mps: [f32; 2]) -> Vec<u8> {
        frame(1, 32, &floats(&[0.0, north_m, east_m, 0.0, velocity_mps[0], velocity_mps[1], 0.0]), 185)
    }

    pub(super) fn command(number: u16, first: f32, target: [u8; 2], confirmation: u8) -> Vec<u8> {
        let mut payload = floats(&[first, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
        payload.extend_from_slice(&number.to_le_bytes());
        payload.extend_from_slice(&target);
        payload.push(confirmation);
        frame(255, 76, &payload, 152)
    }
}

fn link(axis_yaw_rad: Option<f32>) -> Link {
    let mut parameters = Parameters::default();
    parameters.link.axis_yaw_rad = axis_yaw_rad;
    let mut link = Link::new(&parameters);
    link.receive(0, &heartbeat());
    link
}

fn outputs(mode: Mode, limit_mps: Option<f32>) -> Outputs {
    Outputs { mode, speed_limit_mps: limit_mps, ..Outputs::default() }
}

/// Everything that is due at this moment.
fn frames(link: &mut Link, now_us: u64) -> Vec<OutFrame> {
    core::iter::from_fn(|| link.next_frame(now_us)).collect()
}

/// Kind of message of a frame.
fn kind(frame: &OutFrame) -> u8 {
    frame[7]
}

#[test]
fn the_autopilot_is_alive_while_its_heartbeat_comes() {
    let mut link = link(None);
    assert!(link.vehicle(2_000_000).alive);
    assert!(!link.vehicle(2_600_000).alive);
    // A camera's heartbeat says nothing of the autopilot.
    link.receive(2_600_000, &frame(100, 0, &[0, 0, 0, 0, 30, 8, 0, 4, 3], 50));
    assert!(!link.vehicle(2_600_000).alive);
}

#[test]
fn the_axis_is_where_the_nose_points_when_armed() {
    let mut link = link(None);
    link.receive(0, &attitude([0.01, 0.02, 1.0]));
    link.receive(0, &position(10.0, 20.0, [0.0, 0.0]));
    link.receive(0, &command(400, 1.0, [3, 191], 0));
    assert_eq!(link.take_command(), Some(Command::Arm));
    let (sin, cos) = 1.0_f32.sin_cos();
    link.receive(100_000, &attitude([0.01, 0.02, 1.1]));
    link.receive(100_000, &position(10.0 + 2.0 * cos, 20.0 + 2.0 * sin, [0.3 * cos, 0.3 * sin]));
    let vehicle = link.vehicle(100_000);
    assert!((vehicle.attitude_rad.unwrap()[2] - 0.1).abs() < 1e-5);
    assert!((vehicle.odometer_m.unwrap() - 2.0).abs() < 1e-4);
    assert!((vehicle.speed_mps.unwrap() - 0.3).abs() < 1e-5);
    assert_eq!(link.vehicle(2_000_000), VehicleView { alive: true, ..VehicleView::default() });
}

#[test]
fn yaw_against_the_axis_does_not_jump_at_the_south() {
    let mut link = link(Some(3.1));
    link.receive(0, &attitude([0.0, 0.0, -3.1]));
    let yaw_rad = link.vehicle(0).attitude_rad.unwrap()[2];
    assert!((yaw_rad - (core::f32::consts::TAU - 6.2)).abs() < 1e-5, "{yaw_rad}");
}

#[test]
fn commands_are_answered_each_time_and_given_once() {
    let mut link = link(Some(0.0));
    for confirmation in 0..3 {
        link.receive(u64::from(confirmation) * 100_000, &command(2000, 0.0, [3, 191], confirmation));
    }
    assert_eq!(link.take_command(), Some(Command::Start));
    assert_eq!(link.take_command(), None);
    assert_eq!(frames(&mut link, 300_000).iter().filter(|frame| kind(frame) == 77).count(), 3);
    // For everybody, for another component, for another vehicle, and one that nobody knows.
    for target in [[3, 0], [3, 1], [4, 191]] {
        link.receive(400_000, &command(400, 1.0, target, 0));
    }
    assert_eq!((link.take_command(), frames(&mut link, 400_000).len()), (None, 0));
    link.receive(400_000, &command(31_000, 1.0, [3, 191], 0));
    let answers = frames(&mut link, 400_000);
    assert_eq!((link.take_command(), answers[0][12]), (None, 3), "unsupported");
}

#[test]
fn a_sensor_gets_its_address_only_while_the_board_is_idle() {
    let mut link = link(Some(0.0));
    let wants = |first: f32, second: f32| {
        let mut payload = floats(&[first, second, 0.0, 0.0, 0.0, 0.0, 0.0]);
        payload.extend_from_slice(&31_010_u16.to_le_bytes());
        payload.extend_from_slice(&[3, 191, 0]);
        frame(255, 76, &payload, 152)
    };
    link.note(0, &outputs(Mode::Scanning, None), [None; 4], Diagnosis::default());
    link.receive(0, &wants(49.0, 50.0));
    assert_eq!(link.take_readdressing(), None);
    link.note(0, &outputs(Mode::Idle, None), [None; 4], Diagnosis::default());
    for nonsense in [[49.5, 50.0], [49.0, 300.0], [49.0, f32::NAN], [0.0, 50.0]] {
        link.receive(0, &wants(nonsense[0], nonsense[1]));
        assert_eq!(link.take_readdressing(), None, "{nonsense:?}");
    }
    link.receive(0, &wants(49.0, 50.0));
    assert_eq!(link.take_readdressing(), Some(Readdressing { from: 49, to: 50 }));
    assert_eq!(link.take_readdressing(), None);
}

#[test]
fn the_limit_is_repeated_and_told_soon_when_it_changes() {
    let mut link = link(Some(0.0));
    let mut sent = Vec::new();
    for tick in 0..600_u64 {
        let now_us = tick * 5_000;
        let limit_mps = if now_us < 1_500_000 { 0.3 } else { 0.1 };
        link.note(now_us, &outputs(Mode::Scanning, Some(limit_mps)), [None; 4], Diagnosis::default());
        for frame in frames(&mut link, now_us).iter().filter(|frame| kind(frame) == 76) {
            sent.push((now_us / 1000, f32::from_le_bytes(frame[14..18].try_into().unwrap())));
        }
    }
    assert_eq!(sent, [(0, 0.3), (1000, 0.3), (1500, 0.1), (2500, 0.1)]);
}

#[test]
fn a_stalled_controller_falls_silent() {
    let mut link = link(Some(0.0));
    link.note(0, &outputs(Mode::Scanning, Some(0.3)), [Some(1.0); 4], Diagnosis::default());
    let later: Vec<OutFrame> = (0..400_u64).flat_map(|tick| frames(&mut link, 1_100_000 + tick * 5_000)).collect();
    assert!(later.is_empty(), "{} frames", later.len());
}

#[test]
fn a_minute_fits_the_slowest_line() {
    let mut link = link(Some(0.0));
    let mut bytes = 0;
    for tick in 0..12_000_u64 {
        let now_us = tick * 5_000;
        let mode = if tick % 200 < 100 { Mode::Scanning } else { Mode::Degraded };
        let limit_mps = Some((tick % 7) as f32 * 0.1);
        link.note(now_us, &outputs(mode, limit_mps), [Some(1.5); 4], Diagnosis::default());
        bytes += frames(&mut link, now_us).iter().map(|frame| frame.len()).sum::<usize>();
    }
    // 57,600 baud carry 5,760 bytes a second.
    assert!((60 * 500..60 * 2_880).contains(&bytes), "{} bytes a second", bytes / 60);
}

proptest! {
    #[test]
    fn any_bytes_leave_finite_inputs_and_the_next_heartbeat_is_heard(
        bytes in proptest::collection::vec(any::<u8>(), 0..2000),
        angles in proptest::array::uniform3(any::<f32>()),
    ) {
        let mut link = link(Some(0.0));
        link.receive(1_000_000, &bytes);
        link.receive(1_000_000, &attitude(angles));
        link.receive(9_000_000, &heartbeat());
        link.receive(9_000_000, &[0; MAX_FRAME_BYTES]);
        let vehicle = link.vehicle(9_000_000);
        prop_assert!(vehicle.alive);
        let numbers = [vehicle.odometer_m, vehicle.speed_mps].into_iter().flatten();
        prop_assert!(numbers.chain(vehicle.attitude_rad.into_iter().flatten()).all(f32::is_finite));
    }
}
