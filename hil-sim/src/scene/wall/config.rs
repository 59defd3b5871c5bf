//! What the mission file says about the wall, and the checked relief and pipes made of it.

use adit_geometry::profile::{Piece, Profile};
use serde::{Deserialize, Serialize};

use super::pipe::Pipe;
use crate::scene::noise;
use crate::scene::relief::{Bulge, BulgeConfig, Relief, Rings, Undulation};

/// How the wall differs from its profile, as the mission file's `[simulation.wall]` says it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct WallConfig {
    /// Amplitude of the second harmonic around the section: positive presses the crown down and the sides out.
    pub ovality_mm: f64,
    /// Length of one ring of the lining.
    pub ring_length_m: f64,
    /// Each ring is set in or out by up to this much; 0 for no steps.
    pub ring_step_mm: f64,
    /// Amplitude of smooth irregularity.
    pub undulation_mm: f64,
    /// Length of one undulation.
    pub undulation_length_m: f64,
    /// Within this distance of a corner of the profile the relief fades to zero.
    pub corner_fade_m: f64,
    /// Bulges and hollows.
    pub bulges: Vec<BulgeConfig>,
    /// Pipes and cables along the wall.
    pub pipes: Vec<PipeConfig>,
    /// Water stands below this level (z in the tunnel frame, so positive is below the axis).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub water_z_m: Option<f64>,
}

impl Default for WallConfig {
    /// The profile exactly; lengths are those of a segmental lining, so that a step alone can be switched on.
    fn default() -> Self {
        Self {
            ovality_mm: 0.0,
            ring_length_m: 1.2,
            ring_step_mm: 0.0,
            undulation_mm: 0.0,
            undulation_length_m: 0.8,
            corner_fade_m: 0.1,
            bulges: Vec::new(),
            pipes: Vec::new(),
            water_z_m: None,
        }
    }
}

/// A straight pipe along the tunnel, round, with flat ends.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PipeConfig {
    /// Arc length of the wall point behind it.
    pub s_m: f64,
    /// Its radius.
    pub radius_mm: f64,
    /// Free space between it and the profile.
    #[serde(default)]
    pub standoff_mm: f64,
    /// Station where it starts.
    pub from_x_m: f64,
    /// Station where it ends.
    pub to_x_m: f64,
}

/// Why a wall cannot be built.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum WallError {
    /// A length must be positive.
    #[error("simulation.wall: {name} is {value}; expected a positive length")]
    NotPositive {
        /// Key of the value.
        name: &'static str,
        /// What was given.
        value: f64,
    },
    /// A number is not finite.
    #[error("simulation.wall: {name} is {value}; expected a finite number")]
    NotFinite {
        /// Key of the value.
        name: &'static str,
        /// What was given.
        value: f64,
    },
    /// The displacements together reach further than a tenth of the free space around the axis.
    #[error("simulation.wall: relief may reach {relief_m} m; expected at most {limit_m} m (a tenth of the clearance)")]
    TooDeep {
        /// Sum of all amplitudes.
        relief_m: f64,
        /// The largest sum that is accepted.
        limit_m: f64,
    },
}

pub(super) fn build_relief(profile: &Profile<f64>, config: &WallConfig, seed: u64) -> Result<Relief, WallError> {
    for (name, value) in [
        ("ovality_mm", config.ovality_mm),
        ("ring_step_mm", config.ring_step_mm),
        ("undulation_mm", config.undulation_mm),
    ] {
        finite(name, value)?;
    }
    for (name, value) in [
        ("ring_length_m", config.ring_length_m),
        ("undulation_length_m", config.undulation_length_m),
        ("corner_fade_m", config.corner_fade_m),
    ] {
        positive(name, value)?;
    }
    let perimeter_m = profile.perimeter_m();
    let mut bulges = Vec::with_capacity(config.bulges.len());
    for bulge in &config.bulges {
        finite("bulges.s_m", bulge.s_m)?;
        finite("bulges.x_m", bulge.x_m)?;
        finite("bulges.height_mm", bulge.height_mm)?;
        let sigma_m = positive("bulges.sigma_m", bulge.sigma_m)?;
        bulges.push(Bulge { s_m: bulge.s_m, x_m: bulge.x_m, height_m: bulge.height_mm * 1e-3, sigma_m });
    }
    let cells = (perimeter_m / config.undulation_length_m).round().max(1.0);
    let undulation = Undulation {
        amplitude_m: config.undulation_mm * 1e-3,
        cells: cells as i64,
        cell_s_m: perimeter_m / cells,
        cell_x_m: config.undulation_length_m,
        seed: noise::derive_seed(seed, 2),
    };
    let ring =
        Rings { length_m: config.ring_length_m, step_m: config.ring_step_mm * 1e-3, seed: noise::derive_seed(seed, 1) };
    Ok(Relief {
        perimeter_m,
        ovality_m: config.ovality_mm * 1e-3,
        ring: (config.ring_step_mm != 0.0).then_some(ring),
        undulation: (config.undulation_mm != 0.0).then_some(undulation),
        bulges,
        corners_s_m: corners(profile),
        corner_fade_m: config.corner_fade_m,
    })
}

/// Arc lengths at which the normal jumps.
fn corners(profile: &Profile<f64>) -> Vec<f64> {
    let sliver_m = 1e-6 * profile.perimeter_m();
    let starts = profile.pieces().iter().map(Piece::start_s_m);
    starts
        .filter(|s_m| {
            let normals = profile.at(s_m - sliver_m).zip(profile.at(s_m + sliver_m));
            normals.is_some_and(|(before, after)| before.normal.dot(&after.normal) < 0.9999)
        })
        .collect()
}

pub(super) fn build_pipe(profile: &Profile<f64>, config: &PipeConfig) -> Result<Pipe, WallError> {
    let radius_m = positive("pipes.radius_mm", config.radius_mm)? * 1e-3;
    let standoff_m = finite("pipes.standoff_mm", config.standoff_mm)? * 1e-3;
    let (from_x_m, to_x_m) = (finite("pipes.from_x_m", config.from_x_m)?, finite("pipes.to_x_m", config.to_x_m)?);
    positive("pipes.to_x_m - pipes.from_x_m", to_x_m - from_x_m)?;
    let not_finite = WallError::NotFinite { name: "pipes.s_m", value: config.s_m };
    let surface = profile.at(config.s_m).ok_or(not_finite)?;
    Ok(Pipe { centre: surface.point + surface.normal * (standoff_m + radius_m), radius_m, from_x_m, to_x_m })
}

fn positive(name: &'static str, value: f64) -> Result<f64, WallError> {
    if value > 0.0 && value < 1e6 { Ok(value) } else { Err(WallError::NotPositive { name, value }) }
}

pub(super) fn finite(name: &'static str, value: f64) -> Result<f64, WallError> {
    if value.is_finite() { Ok(value) } else { Err(WallError::NotFinite { name, value }) }
}
