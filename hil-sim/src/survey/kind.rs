//! The kinds of survey sets: one table, every kind a recipe for the same generator.

use adit_geometry::profile::{Part, ProfileSpec};
use clap::ValueEnum;
use serde::Serialize;

use crate::render::{SensorConfig, VehiclePartConfig};
use crate::scene::{PartTexture, Pattern, TextureConfig};

/// What a set is to show; the names of the command line.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum SetKind {
    /// Circle r = 3 m in brick: a spiral of 50 photos, 36 degrees and 10 cm each
    Brick,
    /// The same with a colourful picture on the wall
    Panorama,
    /// The same in concrete
    Concrete,
    /// The same in tiles, nearly alike
    Tiles,
    /// The paper's synthetic set in brick: 120 photos, 30 degrees and 15 cm each, both jittered
    Jitter,
    /// The paper's real sets, an underpass with a trolley in view: a spiral of 50 photos
    Spiral,
    /// The underpass turn by turn: 17 turns, the trolley stands still for each
    Cylindrical,
    /// The underpass in 230 photos over 22 m
    Trolley,
    /// The trolley's way ten times as long: 2,300 photos over 220 m
    Long,
    /// A circle that is none: oval, with bulges and a pipe, and 1 % larger than survey.toml says
    Imperfect,
    /// Bricks without any difference but a few stains
    IdenticalBricks,
    /// The underpass by a rolling shutter, the shaft still turning at 12 degrees per second
    UnsettledShaft,
    /// Brick with exposures and white balances that drift and jump
    ExposureDrift,
}

/// How a set is made.
#[derive(Clone, Debug)]
pub(super) struct Recipe {
    /// The section that survey.toml states.
    pub(super) nominal: ProfileSpec<f64>,
    /// The section as built.
    pub(super) built: ProfileSpec<f64>,
    /// Whether the wall differs from its section: ovality, bulges, a pipe.
    pub(super) imperfect: bool,
    pub(super) texture: TextureConfig,
    pub(super) vehicle_parts: Vec<VehiclePartConfig>,
    /// Photos where the command line gives no number.
    pub(super) photos: u32,
    pub(super) images_per_turn: u16,
    /// Way per photo, or per turn where the vehicle stands for each.
    pub(super) advance_m: f64,
    /// The vehicle stands still for a whole turn, then moves.
    pub(super) stands: bool,
    pub(super) scatter: Scatter,
    /// Speed of the shaft while a photo is read out, clockwise looking forward.
    pub(super) shaft_deg_per_s: f64,
    /// Between the first and the last row's exposure.
    pub(super) rolling_shutter_s: f64,
    pub(super) sensor: SensorConfig,
    /// Exposure and white balance drift from photo to photo ([`super::exposure`]).
    pub(super) drifts: bool,
}

/// How far true poses stray from the plan, one standard deviation.
#[derive(Clone, Copy, Debug)]
pub(super) struct Scatter {
    /// Along the tunnel.
    pub(super) along_m: f64,
    /// Across it, both ways.
    pub(super) across_m: f64,
    /// Over so many photos it lasts; 0: drawn anew for each.
    pub(super) memory_photos: f64,
    /// The shaft's angle.
    pub(super) shaft_deg: f64,
}

/// As in the samples: centimetres along, some more across, slowly changing.
const FLOWN: Scatter = Scatter { along_m: 0.01, across_m: 0.04, memory_photos: 3.0, shaft_deg: 0.5 };
/// The paper's synthetic set: "variance [2,1,2]" over its axes (across, along, across), the unit taken as cm^2, and 2
/// degrees, drawn anew for each image.
const PAPER: Scatter =
    Scatter { along_m: 0.01, across_m: std::f64::consts::SQRT_2 * 0.01, memory_photos: 0.0, shaft_deg: 2.0 };

impl SetKind {
    /// The table of kinds.
    pub(super) fn recipe(self) -> Recipe {
        let circle = |pattern| Recipe {
            nominal: ProfileSpec::Circle { radius_m: 3.0 },
            built: ProfileSpec::Circle { radius_m: 3.0 },
            imperfect: false,
            texture: TextureConfig { pattern, ..TextureConfig::default() },
            vehicle_parts: landing_gear(),
            photos: 50,
            images_per_turn: 10,
            advance_m: 0.1,
            stands: false,
            scatter: FLOWN,
            shaft_deg_per_s: 0.0,
            rolling_shutter_s: 0.0,
            sensor: SensorConfig::default(),
            drifts: false,
        };
        let underpass = Recipe {
            nominal: UNDERPASS,
            built: UNDERPASS,
            texture: underpass_texture(),
            vehicle_parts: trolley(),
            ..circle(Pattern::Concrete)
        };
        match self {
            Self::Brick => circle(Pattern::Brick),
            Self::Panorama => circle(Pattern::Panorama),
            Self::Concrete => circle(Pattern::Concrete),
            Self::Tiles => circle(Pattern::Tiles),
            Self::IdenticalBricks => circle(Pattern::IdenticalBrick),
            Self::Jitter => {
                Recipe { photos: 120, images_per_turn: 12, advance_m: 0.15, scatter: PAPER, ..circle(Pattern::Brick) }
            }
            Self::Spiral => underpass,
            // The readout is that of a HERO4 Black: 6 px of skew at the samples' resolution.
            Self::UnsettledShaft => Recipe { shaft_deg_per_s: 12.0, rolling_shutter_s: 0.03, ..underpass },
            Self::Cylindrical => Recipe { photos: 170, advance_m: 1.0, stands: true, ..underpass },
            Self::Trolley => Recipe { photos: 230, advance_m: 22.0 / 230.0, ..underpass },
            Self::Long => Recipe { photos: 2300, advance_m: 22.0 / 230.0, ..underpass },
            Self::ExposureDrift => Recipe {
                sensor: SensorConfig { auto_exposure: 1.0, vignetting: 0.5, ..SensorConfig::default() },
                drifts: true,
                ..circle(Pattern::Brick)
            },
            Self::Imperfect => {
                Recipe { built: ProfileSpec::Circle { radius_m: 3.03 }, imperfect: true, ..circle(Pattern::Brick) }
            }
        }
    }
}

/// The samples' pedestrian underpass.
const UNDERPASS: ProfileSpec<f64> =
    ProfileSpec::Underpass { width_m: 4.0, wall_m: 2.5, rise_m: 1.0, axis_height_m: 1.4 };

/// As in the samples: floor tiled, one wall brick, one with pictures, ceiling concrete.
fn underpass_texture() -> TextureConfig {
    let parts = [
        (Part::Floor, Pattern::Tiles),
        (Part::LeftWall, Pattern::Brick),
        (Part::RightWall, Pattern::Panorama),
        (Part::Ceiling, Pattern::Concrete),
    ];
    TextureConfig {
        pattern: Pattern::Concrete,
        parts: parts.map(|(part, pattern)| PartTexture { part, pattern }).to_vec(),
        ..TextureConfig::default()
    }
}

fn rod(from_m: [f64; 3], to_m: [f64; 3], radius_mm: f64) -> VehiclePartConfig {
    VehiclePartConfig { from_m, to_m, radius_mm }
}

/// Two legs and their skids.
fn landing_gear() -> Vec<VehiclePartConfig> {
    [-1.0, 1.0]
        .into_iter()
        .flat_map(|side: f64| {
            let (hip, foot) = ([0.15, 0.2 * side, 0.1], [0.3, 0.4 * side, 0.5]);
            [rod(hip, foot, 12.0), rod([0.0, 0.4 * side, 0.5], [0.5, 0.4 * side, 0.5], 10.0)]
        })
        .collect()
}

/// A deck of planks half a metre below the camera, four legs to the floor, and the handle that pushes it.
fn trolley() -> Vec<VehiclePartConfig> {
    let planks = (-2..=2).map(|plank| {
        let y_m = 0.13 * f64::from(plank);
        rod([-0.35, y_m, 0.55], [0.35, y_m, 0.55], 55.0)
    });
    let corners = [[-0.3, -0.25], [-0.3, 0.25], [0.3, -0.25], [0.3, 0.25]];
    let legs = corners.map(|[x_m, y_m]| rod([x_m, y_m, 0.6], [1.2 * x_m, 1.2 * y_m, 1.36], 20.0));
    let handle = [
        rod([-0.35, -0.25, 0.55], [-0.75, -0.25, 0.3], 15.0),
        rod([-0.35, 0.25, 0.55], [-0.75, 0.25, 0.3], 15.0),
        rod([-0.75, -0.25, 0.3], [-0.75, 0.25, 0.3], 15.0),
    ];
    // The lowest first: what is drawn later hides what is behind it.
    legs.into_iter().chain(planks).chain(handle).collect()
}
