//! A board of a few lines, for tests of the world and of the checker.

use adit_firmware::io::{Command, Inputs, Outputs};
use adit_geometry::angles::wrap_half_turn;
use adit_protocol::record::Mode;

use super::Board;

/// Two metres of pipe.
pub(crate) const MISSION: &str = r#"
format = 1
[tunnel]
profile = "circle"
radius_m = 1.5
[camera]
model = "brown-conrady"
width_px = 1000
height_px = 750
fx_px = 466.0
fy_px = 466.0
cx_px = 503.5
cy_px = 373.0
distortion = [-0.04, 0.006, 0.0, 0.0, 0.0]
[rig]
images_per_turn = 10
image_up = "forward"
lever_radial_m = 0.06
[flight]
length_m = 2.0
"#;

/// Ten radians per second for each radian that the shaft is away.
const PULSE_US_PER_RAD: f32 = 1000.0;

/// Turns by a tenth and presses once a second; allows a constant speed.
#[derive(Default)]
pub(crate) struct Metronome {
    pub(crate) mode: Mode,
    pub(crate) limit_mps: f32,
}

impl Board for Metronome {
    fn step(&mut self, now_us: u64, inputs: &Inputs) -> Outputs {
        self.mode = match (self.mode, inputs.command) {
            (Mode::Boot, _) => Mode::Idle,
            (Mode::Idle, Some(Command::Arm)) | (Mode::Scanning, Some(Command::Stop)) => Mode::Ready,
            (Mode::Ready, Some(Command::Start)) => Mode::Scanning,
            (mode, _) => mode,
        };
        let scanning = self.mode == Mode::Scanning;
        let shaft_setpoint_rad = (now_us / 1_000_000) as f32 * 36_f32.to_radians();
        let away_rad = inputs.shaft_encoder_rad.map_or(0.0, |angle_rad| wrap_half_turn(shaft_setpoint_rad - angle_rad));
        Outputs {
            mode: self.mode,
            shaft_setpoint_rad,
            servo_pulse_us: Some(1500.0 + (PULSE_US_PER_RAD * away_rad).clamp(-500.0, 500.0)),
            shutter: scanning && now_us % 1_000_000 > 600_000 && now_us % 1_000_000 < 700_000,
            speed_limit_mps: scanning.then_some(self.limit_mps),
            ..Outputs::default()
        }
    }
}
