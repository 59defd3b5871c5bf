//! The world around the board: applies its outputs to the plant, goes on by one step, and answers with its inputs.
//!
//! Frames: `tunnel` and `body` as in [`adit_geometry`]. Time is virtual: the world reads no clock, and the only source
//! of chance is the seed. One step is: autopilot and air move the vehicle, the servo moves the shaft, the camera feels
//! its contact, exposures that fall into the step are taken with the pose at their very moment, sensors measure.

use adit_firmware::io::{CameraStatus, Command, Inputs, Outputs, RangeSample};
use adit_geometry::rig::{Rig, outward};
use adit_protocol::beams::{Beam, Beams};
use adit_protocol::parameters::{CaptureWiring, Parameters};
use nalgebra::{Isometry3, Point3, Translation3, Unit, UnitQuaternion, Vector3};

use crate::config::Simulation;
use crate::faults::{FaultKind, Faults};
use crate::plant::autopilot::{Autopilot, Wish};
use crate::plant::camera::{Shot, Shutter};
use crate::plant::servo::Servo;
use crate::plant::vehicle::{Vehicle, VehicleState};
use crate::plant::wind::Wind;
use crate::scene::Wall;
use crate::seed::{Random, Stream};
use crate::sensors::encoder::Encoder;
use crate::sensors::navigation::Navigation;
use crate::sensors::range::{RangeSensor, beam_in_body};

/// One photo as it was truly taken.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Exposure {
    /// Middle of the exposure, from the board's start.
    pub time_s: f64,
    /// Pose of the camera then.
    pub tunnel_from_cam: Isometry3<f64>,
    /// Pose of the body then.
    pub tunnel_from_body: Isometry3<f64>,
    /// Velocity of the optical centre in the tunnel frame.
    pub velocity_mps: Vector3<f64>,
    /// Angular velocity of the camera in the `cam` frame.
    pub angular_velocity_rad_per_s: Vector3<f64>,
    /// True section angle of the shaft in the body frame, over turns.
    pub shaft_rad: f64,
    /// Brightness of the board's light, 0 to 1.
    pub light_level: f64,
    /// Which closing of the shutter contact it answers, counted from 1.
    pub press: u32,
    /// Whether nobody asked for it.
    pub surplus: bool,
}

/// What a pilot does in one step.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PilotAction {
    /// A command to the board.
    pub command: Option<Command>,
    /// Wanted forward speed.
    pub cruise_mps: f64,
}

/// The world.
#[derive(Clone, Debug)]
pub struct World {
    /// The tunnel as it is.
    pub wall: Wall,
    /// All faults of this flight.
    pub faults: Faults,
    true_rig: Rig<f64>,
    parameters: Parameters,
    step_s: f64,
    steps: u64,
    vehicle: Vehicle,
    wind: Wind,
    autopilot: Autopilot,
    navigation: Navigation,
    ranges: [RangeSensor; 4],
    head: RangeSensor,
    servo: Servo,
    encoder: Encoder,
    shutter: Shutter,
    exposures: Vec<Exposure>,
}

impl World {
    /// The world at the board's start: the vehicle hovers on the axis, the shaft is where it was left.
    pub fn new(wall: Wall, rig: &Rig<f64>, parameters: &Parameters, simulation: &Simulation, seed: u64) -> Self {
        let start_x_m = simulation.pilot.start_x_m;
        let [hold_y_m, hold_z_m] = simulation.autopilot.hold_m;
        let start_m = Vector3::new(start_x_m, hold_y_m, hold_z_m);
        let family = parameters.ranges.family;
        let range = |index| RangeSensor::new(index, family, &simulation.ranges, seed);
        let mut faults = Faults(simulation.faults.clone());
        faults.draw(simulation.random_faults, FAULTS_WITHIN_S, seed);
        Self {
            wall,
            faults,
            true_rig: built(rig, simulation, seed),
            parameters: parameters.clone(),
            step_s: simulation.pilot.step_s,
            steps: 0,
            vehicle: Vehicle::new(start_m, &simulation.attitude, seed),
            wind: Wind::new(&simulation.wind, seed),
            autopilot: Autopilot::new(&simulation.autopilot, seed),
            navigation: Navigation::new(&simulation.navigation, start_x_m, seed),
            ranges: std::array::from_fn(range),
            head: range(4),
            servo: Servo::new(left_rad(parameters, seed), &parameters.shaft.servo, &simulation.servo, seed),
            encoder: Encoder::new(&simulation.encoder, seed),
            shutter: Shutter::new(&simulation.shutter, seed),
            exposures: Vec::new(),
        }
    }

    /// Time since the board's start.
    pub fn now_s(&self) -> f64 {
        self.steps as f64 * self.step_s
    }

    /// The vehicle as it truly is.
    pub fn vehicle(&self) -> &VehicleState {
        &self.vehicle.state
    }

    /// The shaft's true section angle.
    pub fn shaft_rad(&self) -> f64 {
        self.servo.angle_rad()
    }

    /// The rig as it was really built.
    pub fn true_rig(&self) -> &Rig<f64> {
        &self.true_rig
    }

    /// Takes the exposures since the last call, in order of time.
    pub fn take_exposures(&mut self) -> Vec<Exposure> {
        std::mem::take(&mut self.exposures)
    }

    /// Goes on by one step under the board's outputs and the pilot's wish; returns what the board sees next.
    pub fn step(&mut self, outputs: &Outputs, pilot: PilotAction) -> Inputs {
        let (now_s, dt_s) = (self.now_s(), self.step_s);
        let holds = |kind| self.faults.holds(kind, now_s);
        let (stalled, deaf, encoder_silent) =
            (holds(FaultKind::ServoStall), holds(FaultKind::CameraDeaf), holds(FaultKind::EncoderSilent));
        let navigation_silent = holds(FaultKind::NavigationSilent);
        let wish = Wish {
            cruise_mps: pilot.cruise_mps,
            limit_mps: outputs.speed_limit_mps.map(f64::from),
            ignores_limit: holds(FaultKind::LimitIgnored),
        };

        self.shutter.feel(now_s, outputs.shutter, deaf);
        for shot in self.shutter.take(now_s + dt_s) {
            let exposure = self.expose(&shot, shot.time_s - now_s, f64::from(outputs.light_level));
            self.exposures.push(exposure);
        }

        let wanted = self.autopilot.step(now_s, &self.vehicle.state, &wish, dt_s);
        let gust = self.wind.step(dt_s);
        self.vehicle.step(wanted, gust, dt_s);
        self.servo.step(outputs.servo_pulse_us.map(f64::from), stalled, dt_s);
        self.steps += 1;
        self.measure(pilot.command, encoder_silent, navigation_silent)
    }

    fn measure(&mut self, command: Option<Command>, encoder_silent: bool, navigation_silent: bool) -> Inputs {
        let now_s = self.now_s();
        let report = self.navigation.step(&self.vehicle.state, self.step_s);
        let encoder_rad = self.encoder.read(self.servo.angle_rad());
        let answer = self.shutter.answer(now_s);
        let wiring = self.parameters.shutter.wiring;
        Inputs {
            ranges: self.measure_ranges(now_s),
            head: self.measure_head(),
            shaft_encoder_rad: (self.parameters.shaft.encoder && !encoder_silent).then_some(encoder_rad as f32),
            attitude_rad: (!navigation_silent).then(|| report.attitude_rad.map(|angle| angle as f32)),
            odometer_m: (!navigation_silent).then_some(report.odometer_m as f32),
            speed_mps: (!navigation_silent).then_some(report.speed_mps as f32),
            camera: CameraStatus {
                busy: answer.busy && wiring != CaptureWiring::None,
                photos_stored: if wiring == CaptureWiring::Confirm { answer.photos_stored } else { 0 },
            },
            command,
            autopilot_alive: true,
            log_lost: false,
        }
    }

    fn measure_ranges(&mut self, now_s: f64) -> Beams<RangeSample> {
        let tunnel_from_body = self.vehicle.state.tunnel_from_body();
        let mut samples = Beams::default();
        for (beam, sensor) in Beam::ALL.into_iter().zip(&mut self.ranges) {
            if !self.parameters.ranges.fitted.get(beam) {
                continue;
            }
            let [lever_y_m, lever_z_m] = self.parameters.ranges.lever_m.get(beam).map(f64::from);
            let origin = tunnel_from_body * Point3::new(0.0, lever_y_m, lever_z_m);
            let direction = tunnel_from_body.rotation * beam_in_body(beam);
            let defect = self.faults.range_defect(beam, now_s);
            *samples.get_mut(beam) = sensor.step(&self.wall, &origin, &direction, defect, self.step_s);
        }
        samples
    }

    fn measure_head(&mut self) -> RangeSample {
        if !self.parameters.ranges.head_fitted {
            return RangeSample::default();
        }
        let shaft_rad = self.servo.angle_rad();
        let tunnel_from_body = self.vehicle.state.tunnel_from_body();
        let origin = tunnel_from_body * Point3::from(outward(shaft_rad) * self.true_rig.lever_radial_m);
        let direction = tunnel_from_body.rotation * Unit::new_normalize(outward(shaft_rad));
        self.head.step(&self.wall, &origin, &direction, None, self.step_s)
    }

    /// The exposure of a shot `ahead_s` after the present state, which is carried on at its present rates.
    fn expose(&self, shot: &Shot, ahead_s: f64, light_level: f64) -> Exposure {
        let state = self.vehicle.state;
        let turning_in_body = state.angular_velocity_in_body();
        let shaft_rate = self.servo.velocity_rad_per_s();
        let shaft_rad = self.servo.angle_rad() + shaft_rate * ahead_s;
        let body = state.tunnel_from_body();
        let tunnel_from_body = Isometry3::from_parts(
            Translation3::from(state.position_m + state.velocity_mps * ahead_s),
            body.rotation * UnitQuaternion::from_scaled_axis(turning_in_body * ahead_s),
        );
        let body_from_cam = self.true_rig.body_from_cam(shaft_rad);
        let cam_turning_in_body = turning_in_body + Vector3::x() * shaft_rate;
        let lever_in_body = body_from_cam.translation.vector;
        Exposure {
            time_s: shot.time_s,
            tunnel_from_cam: tunnel_from_body * body_from_cam,
            tunnel_from_body,
            velocity_mps: state.velocity_mps + tunnel_from_body.rotation * cam_turning_in_body.cross(&lever_in_body),
            angular_velocity_rad_per_s: body_from_cam.rotation.inverse() * cam_turning_in_body,
            shaft_rad,
            light_level,
            press: shot.press,
            surplus: shot.surplus,
        }
    }
}

/// Drawn faults begin within this time.
const FAULTS_WITHIN_S: f64 = 60.0;

/// Where the shaft was left: anywhere if an encoder finds it, else upright, for the pilot must see to it.
fn left_rad(parameters: &Parameters, seed: u64) -> f64 {
    let half_turn_rad = if parameters.shaft.encoder { std::f64::consts::PI } else { 0.0 };
    Random::numbered(seed, Stream::Build, 3).uniform(-half_turn_rad, half_turn_rad)
}

/// The rig with the errors of this very vehicle.
fn built(nominal: &Rig<f64>, simulation: &Simulation, seed: u64) -> Rig<f64> {
    let mut build = Random::numbered(seed, Stream::Build, 1);
    let mount_rotvec_rad = nominal.mount_rotvec_rad.map(|angle| angle + build.gauss(simulation.build.mount_sigma_rad));
    let lever_radial_m = nominal.lever_radial_m + build.gauss(simulation.build.lever_sigma_m);
    let lever_forward_m = nominal.lever_forward_m + build.gauss(simulation.build.lever_sigma_m);
    Rig { lever_radial_m, lever_forward_m, mount_rotvec_rad, ..*nominal }
}
