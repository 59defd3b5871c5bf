//! A board of a few lines, for tests of the world and of the checker.

use adit_firmware::io::{Command, Inputs, Outputs};
use adit_geometry::angles::wrap_half_turn;
use adit_protocol::record::Mode;

use super::{Board, BoardError};

/// Pipe, camera and rig of the demo over `length_m`, everything else by default; ends within its table `flight`.
pub(crate) fn mission(length_m: f64) -> String {
    let demo = include_str!("../../missions/demo.toml");
    let (nature, _) = demo.split_once("[sigma]").expect("the demo's sigmas come behind pipe, camera and rig");
    format!("{nature}[flight]\nlength_m = {length_m:?}\n")
}

/// Ten radians per second for each radian that the shaft is away.
const PULSE_US_PER_RAD: f32 = 1000.0;

/// Turns by a tenth and presses once a second; allows a constant speed.
#[derive(Default)]
pub(crate) struct Metronome {
    pub(crate) mode: Mode,
    pub(crate) limit_mps: f32,
}

impl Board for Metronome {
    fn step(&mut self, now_us: u64, inputs: &Inputs) -> Result<Outputs, BoardError> {
        self.mode = match (self.mode, inputs.command) {
            (Mode::Boot, _) => Mode::Idle,
            (Mode::Idle, Some(Command::Arm)) | (Mode::Scanning, Some(Command::Stop)) => Mode::Ready,
            (Mode::Ready, Some(Command::Start)) => Mode::Scanning,
            (mode, _) => mode,
        };
        let scanning = self.mode == Mode::Scanning;
        let shaft_setpoint_rad = (now_us / 1_000_000) as f32 * 36_f32.to_radians();
        let away_rad = inputs.shaft_encoder_rad.map_or(0.0, |angle_rad| wrap_half_turn(shaft_setpoint_rad - angle_rad));
        Ok(Outputs {
            mode: self.mode,
            shaft_setpoint_rad,
            servo_pulse_us: Some(1500.0 + (PULSE_US_PER_RAD * away_rad).clamp(-500.0, 500.0)),
            shutter: scanning && now_us % 1_000_000 > 600_000 && now_us % 1_000_000 < 700_000,
            speed_limit_mps: scanning.then_some(self.limit_mps),
            ..Outputs::default()
        })
    }
}
