//! What the link takes from the autopilot.

use adit_protocol::mavlink::MAX_FRAME_BYTES;
use proptest::prelude::*;

use super::*;

/// A link that takes the axis from the vehicle when it is armed.
fn latching() -> Link {
    link_with(&Parameters::default(), Memory::default())
}

fn hear(link: &mut Link, now_us: u64, frame: &[u8]) {
    link.receive(now_us, Port::Autopilot, frame);
}

#[test]
fn the_autopilot_is_alive_while_its_heartbeat_comes() {
    let mut link = link();
    assert!(link.vehicle(2_000_000).alive);
    assert!(!link.vehicle(2_600_000).alive);
    // A camera's heartbeat says nothing of the autopilot, nor does another vehicle's.
    hear(&mut link, 2_600_000, &Sender::new(3, 100).camera_heartbeat(true));
    hear(&mut link, 2_600_000, &Sender::new(4, 1).vehicle_heartbeat(AUTO));
    assert!(!link.vehicle(2_600_000).alive);
}

#[test]
fn the_axis_is_where_the_nose_points_when_armed() {
    let (mut link, mut autopilot) = (latching(), autopilot());
    step(&mut link, 0, Mode::Idle, None);
    hear(&mut link, 0, &autopilot.attitude(0, [0.01, 0.02, 1.0]));
    hear(&mut link, 0, &autopilot.local_position(0, [10.0, 20.0, 0.0], [0.0; 3]));
    hear(&mut link, 0, &ground().command(BOARD, 400, 0, &[1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]));
    assert_eq!(link.take_command(), Some(Command::Arm));
    let (sin, cos) = 1.0_f32.sin_cos();
    hear(&mut link, 100_000, &autopilot.attitude(100, [0.01, 0.02, 1.1]));
    let (place_m, velocity_mps) = ([10.0 + 2.0 * cos, 20.0 + 2.0 * sin, 0.0], [0.3 * cos, 0.3 * sin, 0.0]);
    hear(&mut link, 100_000, &autopilot.local_position(100, place_m, velocity_mps));
    let vehicle = link.vehicle(100_000);
    assert!((vehicle.attitude_rad.unwrap()[2] - 0.1).abs() < 1e-5);
    assert!((vehicle.odometer_m.unwrap() - 2.0).abs() < 1e-4);
    assert!((vehicle.speed_mps.unwrap() - 0.3).abs() < 1e-5);
    assert_eq!(link.vehicle(2_000_000), VehicleView { alive: true, ..VehicleView::default() });
}

#[test]
fn yaw_against_the_axis_does_not_jump_at_the_south() {
    let mut parameters = Parameters::default();
    parameters.link.axis_yaw_rad = Some(3.1);
    let mut link = link_with(&parameters, Memory::default());
    hear(&mut link, 0, &autopilot().attitude(0, [0.0, 0.0, -3.1]));
    let yaw_rad = link.vehicle(0).attitude_rad.unwrap()[2];
    assert!((yaw_rad - (core::f32::consts::TAU - 6.2)).abs() < 1e-5, "{yaw_rad}");
}

#[test]
fn what_is_not_sent_is_wished_for_and_what_comes_is_not() {
    let (mut link, mut autopilot) = (link(), autopilot());
    let wishes = |link: &mut Link, now_us| {
        let wished = said(link, now_us).into_iter().filter_map(|said| match said {
            Incoming::Command { command: 511 | 512, parameters: [message, ..], .. } => Some(message as u32),
            _ => None,
        });
        wished.collect::<Vec<_>>()
    };
    step(&mut link, 0, Mode::Idle, None);
    assert_eq!(wishes(&mut link, 0), [148, 0, 30, 32, 74]);
    hear(&mut link, 5_000_000, &autopilot.vehicle_heartbeat(AUTO));
    hear(&mut link, 5_000_000, &autopilot.attitude(0, [0.0; 3]));
    hear(&mut link, 5_000_000, &autopilot.local_position(5_000, [0.0; 3], [0.0; 3]));
    step(&mut link, 5_000_000, Mode::Idle, None);
    // It had been silent for long, so the mode is wished for again, but nothing that comes.
    assert_eq!(wishes(&mut link, 5_000_000), [148, 0]);
    step(&mut link, 5_400_000, Mode::Idle, None);
    assert_eq!(wishes(&mut link, 5_400_000), []);
}

#[test]
fn a_frame_whose_end_does_not_come_costs_no_later_one() {
    let (mut link, mut autopilot) = (link(), autopilot());
    hear(&mut link, 3_000_000, &autopilot.vehicle_heartbeat(AUTO)[..7]);
    hear(&mut link, 3_200_000, &autopilot.vehicle_heartbeat(AUTO));
    assert!(link.vehicle(3_200_000).alive);
}

proptest! {
    #[test]
    fn any_bytes_leave_finite_inputs_and_the_next_heartbeat_is_heard(
        bytes in proptest::collection::vec(any::<u8>(), 0..2000),
        angles in proptest::array::uniform3(any::<f32>()),
    ) {
        let mut link = link();
        hear(&mut link, 1_000_000, &bytes);
        hear(&mut link, 1_000_000, &autopilot().attitude(0, angles));
        hear(&mut link, 9_000_000, &autopilot().vehicle_heartbeat(AUTO));
        hear(&mut link, 9_000_000, &[0; MAX_FRAME_BYTES]);
        let vehicle = link.vehicle(9_000_000);
        prop_assert!(vehicle.alive);
        let numbers = [vehicle.odometer_m, vehicle.speed_mps].into_iter().flatten();
        prop_assert!(numbers.chain(vehicle.attitude_rad.into_iter().flatten()).all(f32::is_finite));
    }
}
