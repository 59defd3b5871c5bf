//! The parameters as a list of named figures, for editors that speak the MAVLink parameter protocol.
//!
//! One row per figure: name (at most 16 letters), bounds, meaning, place. Angles are in degrees, lengths in metres, times in
//! seconds. A section that is a chain of vertices has no figures here; it comes from the mission file by card.
//!
//! The section's sizes are kept beside it, so that its kind may change before its sizes do, in any order: a size that the
//! present kind does not have waits for one that has it.

use adit_geometry::camera::Distortion;
use adit_geometry::profile::ProfileSpec;

use super::Parameters;
use super::slot::{SectionFigure, Slot};
use crate::mavlink::Value;

/// Kinds of section, by number.
const CIRCLE: i32 = 0;
const RECTANGLE: i32 = 1;
const UNDERPASS: i32 = 2;
const HORSESHOE: i32 = 3;
const CHAIN: i32 = 4;

/// Radius, width, height, wall, rise, height of the axis.
type Sizes = [f32; 6];

/// A named figure.
#[derive(Clone, Copy)]
pub struct Row {
    /// Its name.
    pub name: &'static str,
    /// Its least value.
    pub least: f32,
    /// Its largest value.
    pub most: f32,
    /// What it is.
    #[cfg(feature = "std")]
    pub about: &'static str,
    slot: for<'a> fn(&'a mut Parameters) -> Slot<'a>,
}

/// Why a value was not taken.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum SetError {
    /// There is no such figure.
    #[error("there is no parameter of that name")]
    Unknown,
    /// It must be a whole number.
    #[error("{value} is not a whole number")]
    NotWhole {
        /// What was given.
        value: f32,
    },
    /// It lies outside.
    #[error("{value} is not within {least} to {most}")]
    OutOfRange {
        /// What was given.
        value: f32,
        /// The least allowed.
        least: f32,
        /// The most allowed.
        most: f32,
    },
    /// The section would be impossible.
    #[error("with {value} the section is impossible: a length is missing, or the axis would lie outside")]
    Section {
        /// What was given.
        value: f32,
    },
    /// The present choice leaves no room for it.
    #[error("{value} does not go with the other parameters (a chain comes by card; a model has its own coefficients)")]
    NotHere {
        /// What was given.
        value: f32,
    },
}

/// Parameters that may be read and changed by name.
#[derive(Clone, Debug, PartialEq)]
pub struct ParameterTable {
    parameters: Parameters,
    sizes: Sizes,
}

impl ParameterTable {
    /// A table of these parameters.
    pub fn new(parameters: Parameters) -> Self {
        let sizes = sizes(&parameters.profile);
        Self { parameters, sizes }
    }

    /// The parameters as they are now.
    pub fn parameters(&self) -> &Parameters {
        &self.parameters
    }

    /// All figures, in order.
    pub fn rows() -> &'static [Row] {
        &ROWS
    }

    /// The place of a figure.
    pub fn find(name: &str) -> Option<usize> {
        ROWS.iter().position(|row| row.name == name)
    }

    /// A figure's value.
    pub fn get(&mut self, index: usize) -> Option<Value> {
        let slot = (ROWS.get(index)?.slot)(&mut self.parameters);
        if let Slot::Section(figure) = slot {
            return Some(match figure {
                SectionFigure::Shape => Value::Whole(shape(&self.parameters.profile)),
                SectionFigure::Size(size) => Value::Real(self.sizes.get(size).copied()?),
            });
        }
        slot.get()
    }

    /// Changes a figure; nothing changes on an error.
    ///
    /// # Errors
    /// [`SetError`].
    pub fn set(&mut self, index: usize, value: Value) -> Result<(), SetError> {
        let row = ROWS.get(index).ok_or(SetError::Unknown)?;
        let real = value.real();
        if !(real >= row.least && real <= row.most) {
            return Err(SetError::OutOfRange { value: real, least: row.least, most: row.most });
        }
        let slot = (row.slot)(&mut self.parameters);
        if slot.is_whole() && value.whole().is_none() {
            return Err(SetError::NotWhole { value: real });
        }
        if let Slot::Section(figure) = slot {
            return self.set_section(figure, value);
        }
        if slot.set(value) { Ok(()) } else { Err(SetError::NotHere { value: real }) }
    }

    fn set_section(&mut self, figure: SectionFigure, value: Value) -> Result<(), SetError> {
        let real = value.real();
        let present = shape(&self.parameters.profile);
        let (mut wanted, mut sizes) = (present, self.sizes);
        match figure {
            SectionFigure::Shape => wanted = value.whole().unwrap_or(present),
            SectionFigure::Size(size) => {
                if let Some(place) = sizes.get_mut(size) {
                    *place = real;
                }
            }
        }
        let profile = match composed(wanted, sizes) {
            Some(profile) => profile,
            None if wanted == present => self.parameters.profile.clone(),
            None => return Err(SetError::NotHere { value: real }),
        };
        if profile.build().is_err() {
            return Err(SetError::Section { value: real });
        }
        (self.parameters.profile, self.sizes) = (profile, sizes);
        Ok(())
    }
}

fn shape(profile: &ProfileSpec<f32>) -> i32 {
    match profile {
        ProfileSpec::Circle { .. } => CIRCLE,
        ProfileSpec::Rectangle { .. } => RECTANGLE,
        ProfileSpec::Underpass { .. } => UNDERPASS,
        ProfileSpec::Horseshoe { .. } => HORSESHOE,
        ProfileSpec::Chain { .. } => CHAIN,
    }
}

/// The sizes of a section; those that it does not have are such that every other kind is possible with them.
fn sizes(profile: &ProfileSpec<f32>) -> Sizes {
    let like = |half_m: f32| [half_m, 2.0 * half_m, 2.0 * half_m, half_m, half_m, half_m];
    match *profile {
        ProfileSpec::Circle { radius_m } => like(radius_m),
        ProfileSpec::Rectangle { width_m, height_m, axis_height_m } => {
            let [radius_m, _, _, wall_m, rise_m, _] = like(height_m / 2.0);
            [radius_m, width_m, height_m, wall_m, rise_m, axis_height_m]
        }
        ProfileSpec::Underpass { width_m, wall_m, rise_m, axis_height_m } => {
            [width_m / 2.0, width_m, wall_m + rise_m, wall_m, rise_m, axis_height_m]
        }
        ProfileSpec::Horseshoe { width_m, wall_m, axis_height_m } => {
            [width_m / 2.0, width_m, wall_m + width_m / 2.0, wall_m, width_m / 2.0, axis_height_m]
        }
        ProfileSpec::Chain { .. } => like(1.5),
    }
}

/// The section of a kind with these sizes; `None` for a chain.
fn composed(
    shape: i32,
    [radius_m, width_m, height_m, wall_m, rise_m, axis_height_m]: Sizes,
) -> Option<ProfileSpec<f32>> {
    Some(match shape {
        CIRCLE => ProfileSpec::Circle { radius_m },
        RECTANGLE => ProfileSpec::Rectangle { width_m, height_m, axis_height_m },
        UNDERPASS => ProfileSpec::Underpass { width_m, wall_m, rise_m, axis_height_m },
        HORSESHOE => ProfileSpec::Horseshoe { width_m, wall_m, axis_height_m },
        _ => return None,
    })
}

/// The coefficient of this place, as far as the model has it.
fn coefficient(parameters: &mut Parameters, index: usize) -> Slot<'_> {
    let place = match &mut parameters.camera.distortion {
        Distortion::BrownConrady(coefficients) => coefficients.get_mut(index),
        Distortion::KannalaBrandt(coefficients) => coefficients.get_mut(index),
    };
    place.map_or(Slot::Absent, Slot::Real)
}

macro_rules! rows {
    ($($name:literal, $least:literal to $most:literal, $about:literal, $parameters:ident => $slot:expr;)+) => {
        [$(Row {
            name: $name,
            least: $least,
            most: $most,
            #[cfg(feature = "std")]
            about: $about,
            slot: |$parameters| $slot,
        }),+]
    };
}

/// All figures. A name keeps its meaning for ever; one that goes is not used again.
#[rustfmt::skip]
static ROWS: [Row; 90] = rows! {
    "TUN_SHAPE", 0.0 to 4.0, "section: 0 circle, 1 rectangle, 2 underpass, 3 horseshoe, 4 chain (by card only)", _p => Slot::Section(SectionFigure::Shape);
    "TUN_RADIUS_M", 0.2 to 50.0, "circle: radius", _p => Slot::Section(SectionFigure::Size(0));
    "TUN_WIDTH_M", 0.2 to 100.0, "other sections: width", _p => Slot::Section(SectionFigure::Size(1));
    "TUN_HEIGHT_M", 0.2 to 100.0, "rectangle: height", _p => Slot::Section(SectionFigure::Size(2));
    "TUN_WALL_M", 0.0 to 100.0, "underpass, horseshoe: height of the vertical walls", _p => Slot::Section(SectionFigure::Size(3));
    "TUN_RISE_M", 0.01 to 50.0, "underpass: rise of the ceiling above the walls", _p => Slot::Section(SectionFigure::Size(4));
    "TUN_AXIS_M", 0.01 to 100.0, "all but circle: height of the axis above the floor", _p => Slot::Section(SectionFigure::Size(5));
    "CAM_MODEL", 0.0 to 1.0, "distortion: 0 Brown-Conrady, 1 Kannala-Brandt", p => Slot::Choice(&mut p.camera.distortion);
    "CAM_WIDTH_PX", 16.0 to 20000.0, "columns of a photo", p => Slot::Word(&mut p.camera.width_px);
    "CAM_HEIGHT_PX", 16.0 to 20000.0, "rows of a photo", p => Slot::Word(&mut p.camera.height_px);
    "CAM_FX_PX", 1.0 to 100000.0, "focal length along columns", p => Slot::Real(&mut p.camera.focal_px[0]);
    "CAM_FY_PX", 1.0 to 100000.0, "focal length along rows", p => Slot::Real(&mut p.camera.focal_px[1]);
    "CAM_CX_PX", 0.0 to 20000.0, "principal point, column", p => Slot::Real(&mut p.camera.centre_px[0]);
    "CAM_CY_PX", 0.0 to 20000.0, "principal point, row", p => Slot::Real(&mut p.camera.centre_px[1]);
    "CAM_DIST1", -10.0 to 10.0, "distortion k1", p => coefficient(p, 0);
    "CAM_DIST2", -10.0 to 10.0, "distortion k2", p => coefficient(p, 1);
    "CAM_DIST3", -10.0 to 10.0, "distortion p1, or k3 of Kannala-Brandt", p => coefficient(p, 2);
    "CAM_DIST4", -10.0 to 10.0, "distortion p2, or k4 of Kannala-Brandt", p => coefficient(p, 3);
    "CAM_DIST5", -10.0 to 10.0, "distortion k3 of Brown-Conrady", p => coefficient(p, 4);
    "RIG_IMAGES", 3.0 to 360.0, "photos per turn of the shaft", p => Slot::Half(&mut p.rig.images_per_turn);
    "RIG_IMAGE_UP", 0.0 to 3.0, "up in the photo: 0 forward, 1 backward, 2 clockwise, 3 counter-clockwise", p => Slot::Choice(&mut p.rig.image_up);
    "RIG_LEVER_RAD_M", -5.0 to 5.0, "optical centre ahead of the shaft, along the view", p => Slot::Real(&mut p.rig.lever_radial_m);
    "RIG_LEVER_FWD_M", -5.0 to 5.0, "optical centre ahead of the body origin, along the shaft", p => Slot::Real(&mut p.rig.lever_forward_m);
    "RIG_MOUNT_X_DEG", -180.0 to 180.0, "mounting of the camera: rotation vector, x", p => Slot::Degrees(&mut p.rig.mount_rotvec_rad[0]);
    "RIG_MOUNT_Y_DEG", -180.0 to 180.0, "mounting of the camera: rotation vector, y", p => Slot::Degrees(&mut p.rig.mount_rotvec_rad[1]);
    "RIG_MOUNT_Z_DEG", -180.0 to 180.0, "mounting of the camera: rotation vector, z", p => Slot::Degrees(&mut p.rig.mount_rotvec_rad[2]);
    "SPD_BOUND", 0.0 to 2.0, "bound in force: 0 the paper's, 1 every point seen once, 2 seen twice", p => Slot::Choice(&mut p.speed.bound);
    "SPD_MARGIN", 0.01 to 1.0, "share of the bound that is asked for", p => Slot::Real(&mut p.speed.margin);
    "SPD_LATENCY_S", 0.0 to 10.0, "from a change of the limit to the vehicle flying it", p => Slot::Real(&mut p.speed.latency_s);
    "SPD_MAX_MPS", 0.01 to 10.0, "never faster than this", p => Slot::Real(&mut p.speed.max_speed_mps);
    "SPD_OFFSET_M", 0.0 to 50.0, "largest allowed distance from the axis", p => Slot::Real(&mut p.speed.offset_max_m);
    "SPD_PERIOD_S", 0.1 to 60.0, "time between two images before it is measured", p => Slot::Real(&mut p.speed.image_period_s);
    "SHF_ENCODER", 0.0 to 1.0, "is an encoder fitted?", p => Slot::Switch(&mut p.shaft.encoder);
    "SHF_NEUTRAL_US", 500.0 to 2500.0, "pulse at which the shaft stands", p => Slot::Real(&mut p.shaft.servo.neutral_us);
    "SHF_FULL_US", -1000.0 to 1000.0, "added to it for full speed", p => Slot::Real(&mut p.shaft.servo.full_us);
    "SHF_ACCEL_DPS2", 1.0 to 100000.0, "highest acceleration, degrees per second squared", p => Slot::Degrees(&mut p.shaft.servo.acceleration_radps2);
    "SHF_SLOW_DPS", 0.0 to 3600.0, "speed below which the servo does not move", p => Slot::Degrees(&mut p.shaft.servo.slowest_radps);
    "SHF_SLEW_DPS", 1.0 to 3600.0, "highest speed of the shaft", p => Slot::Degrees(&mut p.shaft.slew_radps);
    "SHF_SETTLE_DEG", 0.01 to 45.0, "the shaft is still within this of its angle", p => Slot::Degrees(&mut p.shaft.settle_tolerance_rad);
    "SHF_DWELL_S", 0.0 to 10.0, "how long it must be still", p => Slot::Real(&mut p.shaft.settle_dwell_s);
    "SHF_TIMEOUT_S", 0.1 to 60.0, "a turn is late after this", p => Slot::Real(&mut p.shaft.turn_timeout_s);
    "SHF_LATE_FAULT", 1.0 to 255.0, "late turns in a row to a fault", p => Slot::Byte(&mut p.shaft.late_turns_to_fault);
    "SHT_TRIGGER", 0.0 to 1.0, "how the camera is fired: 0 contact, 1 HeroBus", p => Slot::Choice(&mut p.shutter.trigger);
    "SHT_WIRING", 0.0 to 2.0, "what the camera tells: 0 nothing, 1 busy, 2 busy and stored", p => Slot::Choice(&mut p.shutter.wiring);
    "SHT_LATENCY_S", 0.0 to 10.0, "shutter to exposure, typical", p => Slot::Real(&mut p.shutter.trigger_latency_s);
    "SHT_LAT_MAX_S", 0.0 to 10.0, "shutter to exposure, longest", p => Slot::Real(&mut p.shutter.trigger_latency_max_s);
    "SHT_EXPOSURE_S", 0.0 to 10.0, "longest exposure", p => Slot::Real(&mut p.shutter.exposure_s);
    "SHT_PULSE_S", 0.01 to 5.0, "how long the shutter is held", p => Slot::Real(&mut p.shutter.pulse_s);
    "SHT_BUSY_MARKS", 0.0 to 1.0, "does busy begin with the exposure?", p => Slot::Switch(&mut p.shutter.busy_marks_exposure);
    "SHT_INTERVAL_S", 0.0 to 60.0, "shortest time between two photos", p => Slot::Real(&mut p.shutter.min_interval_s);
    "SHT_BUSY_MAX_S", 0.0 to 60.0, "longest the camera may be busy", p => Slot::Real(&mut p.shutter.busy_timeout_s);
    "SHT_CONFIRM_S", 0.0 to 60.0, "longest from shutter to stored", p => Slot::Real(&mut p.shutter.confirm_timeout_s);
    "SHT_GRACE_S", 0.0 to 60.0, "longest from not busy to stored", p => Slot::Real(&mut p.shutter.confirm_grace_s);
    "SHT_RETRIES", 0.0 to 255.0, "how often a missed photo is repeated", p => Slot::Byte(&mut p.shutter.retries);
    "SHT_MISS_FAULT", 1.0 to 255.0, "misses in a row to a fault", p => Slot::Byte(&mut p.shutter.misses_to_fault);
    "SHT_LIGHT", 0.0 to 1.0, "brightness of the light", p => Slot::Real(&mut p.shutter.light_level);
    "SHT_LIGHT_S", 0.0 to 10.0, "how long before the shutter the light goes on", p => Slot::Real(&mut p.shutter.light_lead_s);
    "RNG_FAMILY", 0.0 to 2.0, "sensors: 0 Evo, 1 One, 2 One on a Hub", p => Slot::Choice(&mut p.ranges.family);
    "RNG_BUS", 0.0 to 1.0, "how they are wired: 0 I2C, 1 Hub", p => Slot::Choice(&mut p.ranges.bus);
    "RNG_UP_FIT", 0.0 to 1.0, "is the upward sensor fitted?", p => Slot::Switch(&mut p.ranges.fitted.up);
    "RNG_RIGHT_FIT", 0.0 to 1.0, "is the right sensor fitted?", p => Slot::Switch(&mut p.ranges.fitted.right);
    "RNG_DOWN_FIT", 0.0 to 1.0, "is the downward sensor fitted?", p => Slot::Switch(&mut p.ranges.fitted.down);
    "RNG_LEFT_FIT", 0.0 to 1.0, "is the left sensor fitted?", p => Slot::Switch(&mut p.ranges.fitted.left);
    "RNG_HEAD_FIT", 0.0 to 1.0, "is a sensor fitted beside the camera?", p => Slot::Switch(&mut p.ranges.head_fitted);
    "RNG_UP_PORT", 0.0 to 127.0, "upward sensor: I2C address or Hub channel", p => Slot::Byte(&mut p.ranges.port.up);
    "RNG_RIGHT_PORT", 0.0 to 127.0, "right sensor: I2C address or Hub channel", p => Slot::Byte(&mut p.ranges.port.right);
    "RNG_DOWN_PORT", 0.0 to 127.0, "downward sensor: I2C address or Hub channel", p => Slot::Byte(&mut p.ranges.port.down);
    "RNG_LEFT_PORT", 0.0 to 127.0, "left sensor: I2C address or Hub channel", p => Slot::Byte(&mut p.ranges.port.left);
    "RNG_HEAD_PORT", 0.0 to 127.0, "sensor beside the camera: I2C address or Hub channel", p => Slot::Byte(&mut p.ranges.head_port);
    "RNG_UP_Y_M", -5.0 to 5.0, "upward sensor: place in the body, right", p => Slot::Real(&mut p.ranges.lever_m.up[0]);
    "RNG_UP_Z_M", -5.0 to 5.0, "upward sensor: place in the body, down", p => Slot::Real(&mut p.ranges.lever_m.up[1]);
    "RNG_RIGHT_Y_M", -5.0 to 5.0, "right sensor: place in the body, right", p => Slot::Real(&mut p.ranges.lever_m.right[0]);
    "RNG_RIGHT_Z_M", -5.0 to 5.0, "right sensor: place in the body, down", p => Slot::Real(&mut p.ranges.lever_m.right[1]);
    "RNG_DOWN_Y_M", -5.0 to 5.0, "downward sensor: place in the body, right", p => Slot::Real(&mut p.ranges.lever_m.down[0]);
    "RNG_DOWN_Z_M", -5.0 to 5.0, "downward sensor: place in the body, down", p => Slot::Real(&mut p.ranges.lever_m.down[1]);
    "RNG_LEFT_Y_M", -5.0 to 5.0, "left sensor: place in the body, right", p => Slot::Real(&mut p.ranges.lever_m.left[0]);
    "RNG_LEFT_Z_M", -5.0 to 5.0, "left sensor: place in the body, down", p => Slot::Real(&mut p.ranges.lever_m.left[1]);
    "RNG_MIN_M", 0.0 to 100.0, "shortest range that is believed", p => Slot::Real(&mut p.ranges.min_m);
    "RNG_MAX_M", 0.1 to 100.0, "longest range that is believed", p => Slot::Real(&mut p.ranges.max_m);
    "RNG_SIGMA_M", 0.0001 to 10.0, "one standard deviation of a reading", p => Slot::Real(&mut p.ranges.sigma_m);
    "RNG_STALE_S", 0.01 to 60.0, "a reading is stale after this", p => Slot::Real(&mut p.ranges.stale_s);
    "RNG_FROZEN_S", 0.0 to 600.0, "a sensor is frozen after this; 0 never", p => Slot::Real(&mut p.ranges.frozen_s);
    "RNG_ZERO_RUN", 1.0 to 65535.0, "zeros in a row to suspicion", p => Slot::Half(&mut p.ranges.zero_run);
    "RNG_JUMP_M", 0.01 to 100.0, "change between two samples that no vehicle makes", p => Slot::Real(&mut p.ranges.jump_m);
    "RNG_GOOD_RUN", 1.0 to 65535.0, "good samples in a row that clear a fault", p => Slot::Half(&mut p.ranges.good_run);
    "LNK_BAUD", 1200.0 to 2625000.0, "rate of TELEM1", p => Slot::Word(&mut p.link.baud);
    "LNK_AXIS_DEG", -1.0 to 360.0, "yaw of the tunnel's axis; -1: the vehicle's yaw when it is armed", p => Slot::Yaw(&mut p.link.axis_yaw_rad);
    "LNK_SIGN_TELEM", 0.0 to 1.0, "with a key: must attitude, place and speed be signed too?", p => Slot::Switch(&mut p.link.signed_telemetry);
    "LNK_LEAD_MPS", 0.0 to 10.0, "speed at which the board leads in ArduPilot's Guided; 0 does not lead", p => Slot::Real(&mut p.link.lead_mps);
    "LOG_PERIOD_S", 0.01 to 60.0, "time between two samples in the log", p => Slot::Real(&mut p.log.sample_period_s);
};

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::mavlink::NAME_BYTES;

    fn index(name: &str) -> usize {
        ParameterTable::find(name).unwrap_or_else(|| panic!("no {name}"))
    }

    fn set(table: &mut ParameterTable, name: &str, value: f32) -> Result<(), SetError> {
        table.set(index(name), Value::Real(value))
    }

    #[test]
    fn names_fit_and_differ_and_defaults_lie_within_their_bounds() {
        let mut table = ParameterTable::new(Parameters::default());
        for (index, row) in ROWS.iter().enumerate() {
            assert!(row.name.len() <= NAME_BYTES, "{}", row.name);
            assert_eq!(ParameterTable::find(row.name), Some(index), "{} is there twice", row.name);
            let value = table.get(index).unwrap().real();
            assert!((row.least..=row.most).contains(&value), "{}: {value}", row.name);
        }
    }

    #[test]
    fn what_is_set_is_read_and_nothing_else_changes() {
        for (index, row) in ROWS.iter().enumerate() {
            let mut table = ParameterTable::new(Parameters::default());
            let before: Vec<_> = (0..ROWS.len()).map(|index| table.get(index)).collect();
            let value = Value::Real(row.least);
            if table.set(index, value).is_err() {
                continue;
            }
            assert!((table.get(index).unwrap().real() - row.least).abs() < 1e-3, "{}", row.name);
            for (other, before) in before.iter().enumerate().filter(|(other, _)| *other != index) {
                assert_eq!(table.get(other), *before, "{} changed {}", row.name, ROWS[other].name);
            }
        }
    }

    #[test]
    fn a_section_changes_kind_before_or_after_its_sizes() {
        let mut after = ParameterTable::new(Parameters::default());
        set(&mut after, "TUN_SHAPE", 1.0).unwrap();
        set(&mut after, "TUN_WIDTH_M", 4.0).unwrap();
        let mut before = ParameterTable::new(Parameters::default());
        set(&mut before, "TUN_WIDTH_M", 4.0).unwrap();
        set(&mut before, "TUN_SHAPE", 1.0).unwrap();
        assert_eq!(before, after);
        let expected = ProfileSpec::Rectangle { width_m: 4.0, height_m: 6.0, axis_height_m: 3.0 };
        assert_eq!(before.parameters().profile, expected);
    }

    #[test]
    fn impossible_values_are_refused_with_what_would_be_possible() {
        let mut table = ParameterTable::new(Parameters::default());
        set(&mut table, "TUN_SHAPE", 1.0).unwrap();
        assert_eq!(set(&mut table, "TUN_AXIS_M", 7.0), Err(SetError::Section { value: 7.0 }));
        assert_eq!(set(&mut table, "TUN_SHAPE", 4.0), Err(SetError::NotHere { value: 4.0 }));
        assert_eq!(set(&mut table, "RIG_IMAGES", 10.5), Err(SetError::NotWhole { value: 10.5 }));
        let range = SetError::OutOfRange { value: 2.0, least: 0.01, most: 1.0 };
        assert_eq!(set(&mut table, "SPD_MARGIN", 2.0), Err(range));
        assert!(set(&mut table, "SPD_MARGIN", f32::NAN).is_err());
    }

    #[test]
    fn angles_go_out_in_degrees_and_a_missing_yaw_is_minus_one() {
        let mut table = ParameterTable::new(Parameters::default());
        assert_eq!(table.get(index("LNK_AXIS_DEG")), Some(Value::Real(-1.0)));
        set(&mut table, "LNK_AXIS_DEG", 90.0).unwrap();
        assert!((table.parameters().link.axis_yaw_rad.unwrap() - std::f32::consts::FRAC_PI_2).abs() < 1e-6);
        set(&mut table, "RIG_MOUNT_Y_DEG", -45.0).unwrap();
        assert!((table.parameters().rig.mount_rotvec_rad[1] + std::f32::consts::FRAC_PI_4).abs() < 1e-6);
    }

    proptest! {
        #[test]
        fn whatever_is_set_the_section_stays_possible(
            changes in proptest::collection::vec((0..ROWS.len(), any::<f32>()), 1..50),
        ) {
            let mut table = ParameterTable::new(Parameters::default());
            for (index, value) in changes {
                let _ = table.set(index, Value::Real(value));
                prop_assert!(table.parameters().profile.build().is_ok());
            }
        }
    }
}
