//! Survey sets: finished survey folders with their truth, from a scripted way through a simulated tunnel.
//!
//! A flight (`adit-sim fly`) tests the board and everything after it; a set tests the ground alone, on exactly the way that a
//! comparison asks for. Wall, paint, photos and range sensors are those of the flights. Every number is a function of
//! kind, seeds and number of photos.

mod change;
mod exposure;
mod kind;
mod path;
mod tags;

use std::path::Path;
use std::sync::Arc;

use adit_geometry::camera::{Camera, Distortion};
use adit_geometry::profile::{ProfileError, ProfileSpec};
use adit_geometry::rig::{ImageUp, Rig};
use adit_protocol::mission::{CameraConfig, Sigma, SurveyConfig};
use adit_protocol::tag_table;
use rayon::prelude::*;
use serde::Serialize;

use change::Stained;
pub use change::{Changes, Stain};
pub use kind::SetKind;

use crate::render::card::{CardPlace, encode_photo, write_file, write_mask};
use crate::render::relief::write_relief;
use crate::render::truth::{TextureGeometry, write_exposures, write_poses, write_texture};
use crate::render::{ExifTime, PhotoRenderer, RenderConfig, RenderError, Shot};
use crate::scene::paint::{LiningPaint, Paint};
use crate::scene::{BulgeConfig, PipeConfig, Wall, WallConfig, WallError};
use crate::seed::{Random, Stream};
use kind::Recipe;
use path::Capture;

/// Width of the samples' photos.
pub const WIDTH_PX: u32 = 1000;
/// One standard deviation of the mounting error, per axis.
const MOUNT_SIGMA_DEG: f64 = 1.0;
/// When the camera says the first photo was taken: 17 May 2018, 10:20.
const FIRST_PHOTO: i64 = 1_526_552_400;
/// The folders of a set; another set must not mix with what one left there.
pub const SET_PARTS: [&str; 4] = ["photos", "masks", "truth", "out"];

/// What is asked for.
#[derive(Clone, Debug)]
pub struct SetOptions {
    /// The kind.
    pub kind: SetKind,
    /// Seed of everything that happens by chance.
    pub seed: u64,
    /// Seed of a later flight: through the tunnel of `seed`, which has changed since ([`Changes`]).
    pub later: Option<u64>,
    /// How many photos; the kind's own number by default.
    pub photos: Option<u32>,
    /// Width of the photos; the height and the lens follow.
    pub width_px: u32,
    /// Whether the wall as painted is left as truth/texture.jpg.
    pub texture: bool,
}

/// Why a set cannot be made.
#[derive(Debug, thiserror::Error)]
pub enum SetError {
    /// A photo, a mask or the truth.
    #[error(transparent)]
    Render(#[from] RenderError),
    /// The wall.
    #[error(transparent)]
    Wall(#[from] WallError),
    /// The section.
    #[error(transparent)]
    Profile(#[from] ProfileError),
    /// The truth about the set cannot be written as JSON.
    #[error("truth/set.json: {0}")]
    Json(#[from] serde_json::Error),
}

/// What was made: the command's figures, and `truth/set.json`.
#[derive(Clone, Debug, Serialize)]
pub struct SetFigures {
    /// Version of the format.
    pub format: u32,
    /// Name and version of the program.
    pub program: &'static str,
    /// The kind.
    pub kind: SetKind,
    /// The seed.
    pub seed: u64,
    /// Seed of a later flight, and what has changed since the first.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub later: Option<(u64, Changes)>,
    /// Photos.
    pub photos: usize,
    /// Way from the first to the last photo along the tunnel.
    pub length_m: f64,
    /// The section as built; survey.toml states the nominal one.
    pub built_profile: ProfileSpec<f64>,
    /// The true mounting error of the camera, which survey.toml states as zero.
    pub mount_rotvec_deg: [f64; 3],
    /// The relative error of the odometer.
    pub odometer_scale_error: f64,
    /// Speed of the shaft while a photo is read out, clockwise looking forward.
    pub shaft_deg_per_s: f64,
    /// How the wall differs from its section.
    pub wall: WallConfig,
    /// How the photos were taken.
    pub render: RenderConfig,
}

/// Everything that a set is, before a photo is rendered.
struct Set {
    survey: SurveyConfig,
    wall: Wall,
    paint: Arc<dyn Paint>,
    captures: Vec<Capture>,
    /// While a photo is read out.
    shaft_rad_per_s: f64,
    /// Factors on each photo's gains.
    gain_factors: Vec<[f64; 3]>,
    figures: SetFigures,
}

/// Makes a survey folder in `out`; `after_each` is called after each photo, with the number of all.
///
/// # Errors
/// [`SetError`] if a number of the recipe is refused or a file cannot be written.
pub fn make_set(out: &Path, options: &SetOptions, after_each: &(dyn Fn(usize) + Sync)) -> Result<SetFigures, SetError> {
    let set = Set::new(options)?;
    let places: Vec<CardPlace> = (0..set.captures.len() as u32).map(|index| CardPlace::new(1, index)).collect();
    let poses = places.iter().zip(&set.captures);
    write_poses(&out.join("truth/poses.csv"), poses.map(|(place, at)| (place.name.as_str(), &at.tunnel_from_cam)))?;
    write_file(&out.join("survey.toml"), set.survey.to_toml().as_bytes())?;
    write_file(&out.join("tags.csv"), set.tags_csv(&places, options.flight_seed()).as_bytes())?;
    write_file(&out.join("truth/set.json"), serde_json::to_string_pretty(&set.figures)?.as_bytes())?;
    set.write_photos(out, &places, options.flight_seed(), after_each)?;
    let stations_m = set.captures.iter().map(|capture| capture.tunnel_from_cam.translation.x);
    let geometry = TextureGeometry::around(set.wall.profile(), stations_m, set.figures.render.truth_mm_per_px);
    if options.texture {
        write_texture(&out.join("truth"), &geometry, set.paint.as_ref())?;
    }
    write_relief(&out.join("truth"), &set.survey.profile.build()?, &set.wall, &geometry)?;
    Ok(set.figures)
}

impl SetOptions {
    /// Seed of what the flight adds: way, tags, mounting, noise.
    fn flight_seed(&self) -> u64 {
        self.later.unwrap_or(self.seed)
    }
}

impl Set {
    fn new(options: &SetOptions) -> Result<Self, SetError> {
        let SetOptions { kind, seed, .. } = *options;
        let flight_seed = options.flight_seed();
        let recipe = kind.recipe();
        let photos = options.photos.unwrap_or(recipe.photos);
        let survey = survey_config(&recipe, options.width_px);
        let mut build = Random::new(flight_seed, Stream::Build);
        let mount_rotvec_deg = [(); 3].map(|()| build.gauss(MOUNT_SIGMA_DEG));
        let rig = Rig { mount_rotvec_rad: mount_rotvec_deg.map(f64::to_radians), ..survey.rig };
        let captures = path::captures(&recipe, &rig, photos, flight_seed);
        let along_m = |capture: &Capture| capture.tunnel_from_body.translation.x;
        let length_m = captures.last().map_or(0.0, along_m) - captures.first().map_or(0.0, along_m);
        let profile = recipe.built.build()?;
        // As long as planned: the flights of a pair differ by centimetres, the tunnel does not.
        let moves = if recipe.stands { photos / u32::from(recipe.images_per_turn) } else { photos };
        let planned_m = recipe.advance_m * f64::from(moves);
        let perimeter_m = profile.perimeter_m();
        let mut wall_config =
            if recipe.imperfect { imperfect_wall(perimeter_m, planned_m, seed) } else { WallConfig::default() };
        let lining = LiningPaint::new(&profile, &recipe.texture, Path::new("."), seed).map_err(RenderError::from)?;
        let later = options.later.map(|later| (later, Changes::new(perimeter_m, planned_m)));
        let paint: Arc<dyn Paint> = match &later {
            Some((_, Changes { bulge, stain })) => {
                wall_config.bulges.push(*bulge);
                Arc::new(Stained { lining, stain: *stain, perimeter_m })
            }
            None => Arc::new(lining),
        };
        let wall = Wall::new(profile, &wall_config, seed)?;
        let figures = SetFigures {
            format: 1,
            program: concat!("adit-sim ", env!("CARGO_PKG_VERSION")),
            kind,
            seed,
            later,
            photos: captures.len(),
            length_m,
            built_profile: recipe.built,
            mount_rotvec_deg,
            odometer_scale_error: tags::odometer_scale(flight_seed),
            shaft_deg_per_s: recipe.shaft_deg_per_s,
            wall: wall_config,
            render: RenderConfig {
                vehicle_parts: recipe.vehicle_parts,
                sensor: recipe.sensor,
                ..RenderConfig::default()
            },
        };
        let gain_factors =
            if recipe.drifts { exposure::drift(captures.len(), flight_seed) } else { vec![[1.0; 3]; captures.len()] };
        let shaft_rad_per_s = recipe.shaft_deg_per_s.to_radians();
        Ok(Self { survey, wall, paint, captures, shaft_rad_per_s, gain_factors, figures })
    }

    fn tags_csv(&self, places: &[CardPlace], seed: u64) -> String {
        let tags = tags::tags(&self.captures, &self.wall, &self.survey.rig, &self.survey.sigma, seed);
        let rows =
            tags.iter().zip(places).map(|(tag, place)| tag_table::cells(Some(&place.name), tag).join(",") + "\n");
        std::iter::once(tag_table::COLUMNS.join(",") + "\n").chain(rows).collect()
    }

    fn write_photos(
        &self,
        out: &Path,
        places: &[CardPlace],
        seed: u64,
        after_each: &(dyn Fn(usize) + Sync),
    ) -> Result<(), RenderError> {
        let render = &self.figures.render;
        let CameraConfig { camera, rolling_shutter_s: readout_s, .. } = self.survey.camera;
        let wall = Arc::new(self.wall.clone());
        let renderer = PhotoRenderer::new(camera, readout_s, wall, self.paint.clone(), render, seed)?;
        let shots = places.par_iter().zip(&self.captures).zip(&self.gain_factors).enumerate();
        let gains = shots.map(|(index, ((place, capture), &gain_factors))| {
            let shot = Shot { gain_factors, ..capture.shot(index as u32, self.shaft_rad_per_s) };
            let photo = renderer.render(&shot);
            let taken = ExifTime(FIRST_PHOTO + index as i64);
            let bytes = encode_photo(&photo.image, render.jpeg_quality, render.sensor.exposure_s, taken)?;
            write_file(&out.join("photos").join(&place.name), &bytes)?;
            write_mask(&out.join("masks"), place, &photo)?;
            after_each(places.len());
            Ok(photo.gains)
        });
        let gains = gains.collect::<Result<Vec<_>, RenderError>>()?;
        let photos = places.iter().map(|place| place.name.as_str()).zip(gains);
        write_exposures(&out.join("truth/exposure.csv"), photos)
    }
}

/// What survey.toml says: the samples' camera and uncertainties, mounting error unknown.
fn survey_config(recipe: &Recipe, width_px: u32) -> SurveyConfig {
    let scale = f64::from(width_px) / f64::from(WIDTH_PX);
    let camera = Camera {
        width_px,
        height_px: width_px * 3 / 4,
        focal_px: [466.0 * scale; 2],
        centre_px: [503.0 * scale, 373.0 * scale],
        distortion: Distortion::BrownConrady([-0.04, 0.006, 0.0, 0.0, 0.0]),
    };
    SurveyConfig {
        profile: recipe.nominal.clone(),
        camera: CameraConfig { camera, refine: false, rolling_shutter_s: recipe.rolling_shutter_s },
        rig: Rig {
            images_per_turn: recipe.images_per_turn,
            image_up: ImageUp::Forward,
            lever_radial_m: 0.06,
            lever_forward_m: 0.0,
            mount_rotvec_rad: [0.0; 3],
        },
        sigma: Sigma {
            shaft_rad: 1.0_f64.to_radians(),
            range_m: 0.02,
            odometer_m_per_m: 0.02,
            attitude_rad: 1.5_f64.to_radians(),
            mount_rad: MOUNT_SIGMA_DEG.to_radians(),
        },
    }
}

/// Ovality of 2 % (largest less smallest diameter over their mean), bulges and hollows of up to 50 mm, a pipe.
fn imperfect_wall(perimeter_m: f64, length_m: f64, seed: u64) -> WallConfig {
    let mut random = Random::new(seed, Stream::Wall);
    let radius_m = perimeter_m / std::f64::consts::TAU;
    // One in each field of 3 m around by 2 m along, so that no two pile up.
    let (columns, rows) = ((perimeter_m / 3.0) as u32, (length_m / 2.0).ceil() as u32 + 2);
    let mut bulges = Vec::new();
    for row in 0..rows {
        for column in 0..columns {
            let share = [random.uniform(0.2, 0.8), random.uniform(0.2, 0.8)];
            let size_mm = random.uniform(15.0, 50.0);
            bulges.push(BulgeConfig {
                s_m: (f64::from(column) + share[0]) * perimeter_m / f64::from(columns),
                x_m: (f64::from(row) + share[1] - 1.0) * 2.0,
                height_mm: if random.chance(0.5) { size_mm } else { -size_mm },
                sigma_m: random.uniform(0.15, 0.3),
            });
        }
    }
    let (from_x_m, to_x_m) = (-10.0, length_m + 10.0);
    WallConfig {
        ovality_mm: 0.02 * radius_m / 2.0 * 1e3,
        bulges,
        pipes: vec![PipeConfig { s_m: 0.3 * perimeter_m, radius_mm: 60.0, standoff_mm: 30.0, from_x_m, to_x_m }],
        ..WallConfig::default()
    }
}
