//! What the vehicle, its sensors and its actuators are like. The defaults are a decent realistic flight.

use serde::{Deserialize, Serialize};

use super::autopilot::{AutopilotKind, ModeName};
use super::check::Checker;
use super::units::{degrees, millimetres};

/// `[simulation.pilot]`: who flies, and the world's clock. How far is flown is the mission's `[flight]`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct PilotConfig {
    /// Where the vehicle starts, along the axis.
    pub start_x_m: f64,
    /// The pilot's forward speed where no limit holds it back.
    pub cruise_mps: f64,
    /// How often the pilot tries again after the board has gone into Fault.
    pub restarts: u32,
    /// How long the pilot waits before that.
    pub restart_wait_s: f64,
    /// Physics, sensors and controller go on by this.
    pub step_s: f64,
    /// The flight is broken off after this, whatever happens.
    pub most_s: f64,
}

impl Default for PilotConfig {
    fn default() -> Self {
        // 200 Hz is the rate of the board's own loop; twenty minutes is a battery.
        Self { start_x_m: 0.0, cruise_mps: 0.6, restarts: 3, restart_wait_s: 5.0, step_s: 0.005, most_s: 1200.0 }
    }
}

/// `[simulation.wind]`: gusts as accelerations.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct WindConfig {
    /// One standard deviation along x, y, z.
    pub gust_sigma_mps2: [f64; 3],
    /// How long a gust lasts.
    pub gust_time_s: f64,
    /// Steady draught along the tunnel.
    pub draught_mps2: f64,
}

impl Default for WindConfig {
    fn default() -> Self {
        // A vehicle's own wash, thrown back by the walls, moves it by some centimetres.
        Self { gust_sigma_mps2: [0.08, 0.12, 0.10], gust_time_s: 0.8, draught_mps2: 0.0 }
    }
}

/// `[simulation.attitude]`: how the body wobbles.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct AttitudeConfig {
    /// Wobble of roll and pitch around the tilt that flying asks for.
    #[serde(rename = "wobble_sigma_deg", with = "degrees")]
    pub wobble_sigma_rad: f64,
    /// Wandering of the heading around the axis.
    #[serde(rename = "yaw_sigma_deg", with = "degrees")]
    pub yaw_sigma_rad: f64,
}

impl Default for AttitudeConfig {
    fn default() -> Self {
        Self { wobble_sigma_rad: 0.4_f64.to_radians(), yaw_sigma_rad: 0.8_f64.to_radians() }
    }
}

/// `[simulation.autopilot]`: how well it flies.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct AutopilotConfig {
    /// Which one it is.
    #[serde(skip_serializing_if = "AutopilotKind::is_simple")]
    pub kind: AutopilotKind,
    /// Its mode; by default the one of missions.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub mode: Option<ModeName>,
    /// Error of its own idea of where it is in the section.
    pub position_sigma_m: f64,
    /// How slowly that error wanders.
    pub position_time_s: f64,
    /// Where in the section the pilot holds it, `[y, z]`.
    pub hold_m: [f64; 2],
    /// From the board's command to the simple autopilot.
    pub link_delay_s: f64,
    /// Time constant with which the speed target follows a new limit.
    pub speed_lag_s: f64,
    /// Share of the limit that the simple one flies.
    pub limit_use: f64,
    /// Strongest forward acceleration.
    pub most_acceleration_mps2: f64,
}

impl Default for AutopilotConfig {
    fn default() -> Self {
        Self {
            kind: AutopilotKind::Simple,
            mode: None,
            position_sigma_m: 0.05,
            position_time_s: 8.0,
            hold_m: [0.0, 0.0],
            link_delay_s: 0.1,
            speed_lag_s: 0.5,
            limit_use: 0.95,
            most_acceleration_mps2: 1.0,
        }
    }
}

/// `[simulation.navigation]`: what the vehicle's estimator reports.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct NavigationConfig {
    /// Slow error of roll and pitch.
    #[serde(rename = "tilt_sigma_deg", with = "degrees")]
    pub tilt_sigma_rad: f64,
    /// Slow error of yaw against the axis.
    #[serde(rename = "yaw_sigma_deg", with = "degrees")]
    pub yaw_sigma_rad: f64,
    /// White noise of all three.
    #[serde(rename = "attitude_noise_deg", with = "degrees")]
    pub attitude_noise_rad: f64,
    /// Scale error of the odometer, one standard deviation between flights.
    pub odometer_scale_sigma: f64,
    /// Random walk of the odometer.
    pub odometer_walk_m_per_sqrt_m: f64,
    /// White noise of the odometer.
    pub odometer_noise_m: f64,
    /// White noise of the speed.
    pub speed_noise_mps: f64,
}

impl Default for NavigationConfig {
    fn default() -> Self {
        // An optical-flow set and a small inertial unit.
        Self {
            tilt_sigma_rad: 0.4_f64.to_radians(),
            yaw_sigma_rad: 0.8_f64.to_radians(),
            attitude_noise_rad: 0.05_f64.to_radians(),
            odometer_scale_sigma: 0.01,
            odometer_walk_m_per_sqrt_m: 0.01,
            odometer_noise_m: 0.003,
            speed_noise_mps: 0.01,
        }
    }
}

/// `[simulation.ranges]`: quality of the range sensors; family and place are the board's parameters.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct RangeConfig {
    /// Time between two samples.
    pub period_s: f64,
    /// White noise at no distance.
    #[serde(rename = "noise_sigma_mm", with = "millimetres")]
    pub noise_sigma_m: f64,
    /// Growth of the noise with distance.
    pub noise_m_per_m: f64,
    /// Constant error, one standard deviation between sensors.
    #[serde(rename = "bias_sigma_mm", with = "millimetres")]
    pub bias_sigma_m: f64,
    /// Share of samples that cannot measure.
    pub dropout_share: f64,
    /// The same over water.
    pub water_dropout_share: f64,
}

impl Default for RangeConfig {
    fn default() -> Self {
        Self {
            period_s: 0.02,
            noise_sigma_m: 0.008,
            noise_m_per_m: 0.002,
            bias_sigma_m: 0.008,
            dropout_share: 0.005,
            water_dropout_share: 0.3,
        }
    }
}

/// `[simulation.servo]`: the servo on the shaft. What the board was told of it is `[board.shaft]`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ServoConfig {
    /// Speed at a full pulse, and the highest.
    #[serde(rename = "slew_deg_per_s", with = "degrees")]
    pub slew_rad_per_s: f64,
    /// Highest acceleration.
    #[serde(rename = "acceleration_deg_per_s2", with = "degrees")]
    pub acceleration_rad_per_s2: f64,
    /// Play between motor and shaft.
    #[serde(rename = "backlash_deg", with = "degrees")]
    pub backlash_rad: f64,
    /// Trembling of the shaft in that play.
    #[serde(rename = "tremble_sigma_deg", with = "degrees")]
    pub tremble_sigma_rad: f64,
    /// Error of the neutral that the board was told, one standard deviation between servos.
    pub neutral_sigma_us: f64,
    /// Error of the speed at a pulse, the same.
    pub gain_sigma: f64,
    /// So near to its neutral it hears nothing.
    pub dead_band_us: f64,
}

impl Default for ServoConfig {
    fn default() -> Self {
        // What the board is told by default, half a degree of play, a few per cent and microseconds off: a digital servo
        // with a light camera.
        Self {
            slew_rad_per_s: 5.0,
            acceleration_rad_per_s2: 2500_f64.to_radians(),
            backlash_rad: 0.5_f64.to_radians(),
            tremble_sigma_rad: 0.03_f64.to_radians(),
            neutral_sigma_us: 3.0,
            gain_sigma: 0.03,
            dead_band_us: 4.0,
        }
    }
}

/// `[simulation.encoder]`: the shaft's encoder.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct EncoderConfig {
    /// Error of its mounting, one standard deviation between vehicles.
    #[serde(rename = "offset_sigma_deg", with = "degrees")]
    pub offset_sigma_rad: f64,
    /// Amplitude of the once-per-turn error.
    #[serde(rename = "eccentricity_deg", with = "degrees")]
    pub eccentricity_rad: f64,
    /// White noise.
    #[serde(rename = "noise_sigma_deg", with = "degrees")]
    pub noise_sigma_rad: f64,
}

impl Default for EncoderConfig {
    fn default() -> Self {
        Self {
            offset_sigma_rad: 0.5_f64.to_radians(),
            eccentricity_rad: 0.3_f64.to_radians(),
            noise_sigma_rad: 0.04_f64.to_radians(),
        }
    }
}

/// `[simulation.shutter]`: how the camera answers its trigger.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ShutterConfig {
    /// Shortest time from the contact to the middle of the exposure.
    pub latency_s: f64,
    /// Typical time on top of it; the distribution is log-normal.
    pub latency_spread_s: f64,
    /// Typical time from the exposure until the camera is ready again.
    pub busy_s: f64,
    /// Share of presses that bring no photo.
    pub missed_share: f64,
    /// Share of presses that bring a second one.
    pub double_share: f64,
    /// Time between the photos of a double.
    pub double_gap_s: f64,
}

impl Default for ShutterConfig {
    fn default() -> Self {
        Self {
            latency_s: 0.16,
            latency_spread_s: 0.008,
            busy_s: 0.35,
            missed_share: 0.01,
            double_share: 0.005,
            double_gap_s: 0.25,
        }
    }
}

/// `[simulation.build]`: how this vehicle differs from its drawing; drawn from the seed.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct BuildConfig {
    /// Error of the camera's mounting, one standard deviation per axis.
    #[serde(rename = "mount_sigma_deg", with = "degrees")]
    pub mount_sigma_rad: f64,
    /// Error of the lever arms.
    #[serde(rename = "lever_sigma_mm", with = "millimetres")]
    pub lever_sigma_m: f64,
}

impl Default for BuildConfig {
    fn default() -> Self {
        // A bracket set up by eye, measured with a rule.
        Self { mount_sigma_rad: 0.7_f64.to_radians(), lever_sigma_m: 0.002 }
    }
}

/// `[simulation.card]`: the camera's clock and file numbers.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct CardConfig {
    /// Number of the first file, 1 to 9999; after 9999 comes 0001 in the next folder.
    pub first_file: u32,
    /// What the camera's clock shows when the board starts: seconds since 1970-01-01 00:00 of its own time.
    pub clock_start_s: f64,
    /// How much too fast the camera's clock runs, parts per million.
    pub clock_drift_ppm: f64,
}

impl Default for CardConfig {
    fn default() -> Self {
        // 2015-01-01 00:00:12, where a HERO4 starts whose battery was empty; a watch crystal's drift.
        Self { first_file: 1, clock_start_s: 1_420_070_412.3, clock_drift_ppm: 40.0 }
    }
}

impl PilotConfig {
    pub(super) fn check(&self, to: &mut Checker) {
        to.finite("start_x_m", self.start_x_m);
        to.within("cruise_mps", self.cruise_mps, 0.001, 20.0);
        to.within("restarts", f64::from(self.restarts), 0.0, 1000.0);
        to.within("restart_wait_s", self.restart_wait_s, 0.0, 600.0);
        to.within("step_s", self.step_s, 0.0005, 0.02);
        to.within("most_s", self.most_s, 1.0, 1e5);
    }
}

impl WindConfig {
    pub(super) fn check(&self, to: &mut Checker) {
        for sigma in self.gust_sigma_mps2 {
            to.within("gust_sigma_mps2", sigma, 0.0, 10.0);
        }
        to.within("gust_time_s", self.gust_time_s, 0.01, 100.0);
        to.within("draught_mps2", self.draught_mps2, -1.0, 1.0);
    }
}

impl AttitudeConfig {
    pub(super) fn check(&self, to: &mut Checker) {
        to.angle("wobble_sigma_deg", self.wobble_sigma_rad, 10.0);
        to.angle("yaw_sigma_deg", self.yaw_sigma_rad, 20.0);
    }
}

impl AutopilotConfig {
    pub(super) fn check(&self, to: &mut Checker) {
        to.within("position_sigma_m", self.position_sigma_m, 0.0, 10.0);
        to.within("position_time_s", self.position_time_s, 0.01, 1e4);
        for hold in self.hold_m {
            to.finite("hold_m", hold);
        }
        to.within("link_delay_s", self.link_delay_s, 0.0, 10.0);
        to.within("speed_lag_s", self.speed_lag_s, 0.01, 10.0);
        to.within("limit_use", self.limit_use, 0.01, 2.0);
        to.within("most_acceleration_mps2", self.most_acceleration_mps2, 0.01, 10.0);
    }
}

impl NavigationConfig {
    pub(super) fn check(&self, to: &mut Checker) {
        to.angle("tilt_sigma_deg", self.tilt_sigma_rad, 20.0);
        to.angle("yaw_sigma_deg", self.yaw_sigma_rad, 20.0);
        to.angle("attitude_noise_deg", self.attitude_noise_rad, 20.0);
        to.within("odometer_scale_sigma", self.odometer_scale_sigma, 0.0, 0.5);
        to.within("odometer_walk_m_per_sqrt_m", self.odometer_walk_m_per_sqrt_m, 0.0, 1.0);
        to.within("odometer_noise_m", self.odometer_noise_m, 0.0, 1.0);
        to.within("speed_noise_mps", self.speed_noise_mps, 0.0, 1.0);
    }
}

impl RangeConfig {
    pub(super) fn check(&self, to: &mut Checker) {
        to.within("period_s", self.period_s, 0.001, 1.0);
        to.within("noise_sigma_mm", self.noise_sigma_m * 1000.0, 0.0, 1000.0);
        to.within("noise_m_per_m", self.noise_m_per_m, 0.0, 0.5);
        to.within("bias_sigma_mm", self.bias_sigma_m * 1000.0, 0.0, 1000.0);
        to.share("dropout_share", self.dropout_share);
        to.share("water_dropout_share", self.water_dropout_share);
    }
}

impl ServoConfig {
    pub(super) fn check(&self, to: &mut Checker) {
        to.within("slew_deg_per_s", self.slew_rad_per_s.to_degrees(), 1.0, 5000.0);
        to.within("acceleration_deg_per_s2", self.acceleration_rad_per_s2.to_degrees(), 10.0, 1e6);
        to.angle("backlash_deg", self.backlash_rad, 20.0);
        to.angle("tremble_sigma_deg", self.tremble_sigma_rad, 5.0);
        to.within("neutral_sigma_us", self.neutral_sigma_us, 0.0, 100.0);
        to.within("gain_sigma", self.gain_sigma, 0.0, 0.5);
        to.within("dead_band_us", self.dead_band_us, 0.0, 100.0);
    }
}

impl EncoderConfig {
    pub(super) fn check(&self, to: &mut Checker) {
        to.angle("offset_sigma_deg", self.offset_sigma_rad, 45.0);
        to.angle("eccentricity_deg", self.eccentricity_rad, 45.0);
        to.angle("noise_sigma_deg", self.noise_sigma_rad, 45.0);
    }
}

impl ShutterConfig {
    pub(super) fn check(&self, to: &mut Checker) {
        to.within("latency_s", self.latency_s, 0.0, 5.0);
        to.within("latency_spread_s", self.latency_spread_s, 0.0, 1.0);
        to.within("busy_s", self.busy_s, 0.01, 30.0);
        to.share("missed_share", self.missed_share);
        to.share("double_share", self.double_share);
        to.within("double_gap_s", self.double_gap_s, 0.02, 5.0);
    }
}

impl BuildConfig {
    pub(super) fn check(&self, to: &mut Checker) {
        to.angle("mount_sigma_deg", self.mount_sigma_rad, 20.0);
        to.within("lever_sigma_mm", self.lever_sigma_m * 1000.0, 0.0, 100.0);
    }
}

impl CardConfig {
    pub(super) fn check(&self, to: &mut Checker) {
        to.within("first_file", f64::from(self.first_file), 1.0, 9999.0);
        to.within("clock_start_s", self.clock_start_s, 0.0, 4e9);
        to.within("clock_drift_ppm", self.clock_drift_ppm, -10_000.0, 10_000.0);
    }
}
