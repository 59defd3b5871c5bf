//! What a flight leaves: the board's log and the camera's card as a team copies them, and the truth beside them.
//!
//! ```text
//! OUT/board.log
//! OUT/DCIM/100GOPRO/GOPRnnnn.JPG
//! OUT/truth/poses.csv texture.jpg texture.json relief.f32 relief.json photos.csv flight.csv masks/
//! OUT/mission.toml            the mission as it was given
//! OUT/flight.json             seed, versions, files, figures, the resolved simulation
//! ```
//! Photos are named below `DCIM`, as `100GOPRO/GOPR0001.JPG`, in every table.

mod log;
mod truth;

use std::path::Path;
use std::sync::Arc;

use adit_protocol::log::EncodeError;
use adit_protocol::mission::Mission;
use rayon::prelude::*;
use serde::Serialize;

pub use log::log_bytes;

use crate::check::Report;
use crate::config::{CardConfig, Simulation};
use crate::flight::Flight;
use crate::render::card::{CardPlace, write_file, write_mask, write_photo};
use crate::render::relief::write_relief;
use crate::render::truth::{TextureGeometry, write_poses, write_texture};
use crate::render::{ExifTime, PhotoRenderer, RenderError, Shot};
use crate::scene::paint::LiningPaint;
use crate::world::Exposure;

/// Everything that a card is made from.
#[derive(Clone, Copy, Debug)]
pub struct CardSource<'f> {
    /// Name and version of the program that flew it.
    pub program: &'f str,
    /// The flight.
    pub flight: &'f Flight,
    /// Its log.
    pub log: &'f [u8],
    /// The mission.
    pub mission: &'f Mission,
    /// The simulation.
    pub simulation: &'f Simulation,
    /// The mission's text, to be kept beside the results.
    pub mission_text: &'f str,
    /// Folder that the mission's paths are relative to.
    pub mission_folder: &'f Path,
    /// The checker's report.
    pub report: &'f Report,
}

/// Why a card could not be written.
#[derive(Debug, thiserror::Error)]
pub enum CardError {
    /// A photo, the truth or another file.
    #[error(transparent)]
    Render(#[from] RenderError),
    /// The log.
    #[error("board.log: {0}")]
    Log(#[from] EncodeError),
}

/// `flight.json`.
#[derive(Serialize)]
struct FlightJson<'f> {
    format: u32,
    program: &'f str,
    seed: u64,
    mission: &'static str,
    log: &'static str,
    photos: Vec<String>,
    truth: Vec<&'static str>,
    violations: &'f [crate::check::Violation],
    figures: &'f crate::check::Figures,
    simulation: &'f Simulation,
}

/// Names of the photos below `DCIM`, in the order of the exposures.
pub fn photo_places(flight: &Flight, config: &CardConfig) -> Vec<CardPlace> {
    (0..flight.exposures.len() as u32).map(|index| CardPlace::new(config.first_file, index)).collect()
}

/// What the camera's clock shows `time_s` after the board's start.
pub fn camera_clock(config: &CardConfig, time_s: f64) -> ExifTime {
    ExifTime((config.clock_start_s + time_s * (1.0 + config.clock_drift_ppm * 1e-6)).floor() as i64)
}

/// Folder and name of a photo, joined by `/`.
pub fn photo_name(place: &CardPlace) -> String {
    format!("{}/{}", place.folder, place.name)
}

/// Writes log, truth and `flight.json`; photos and the true texture are left out unless `photos` is given, which is
/// called after each photo.
///
/// # Errors
/// [`CardError`] with the file.
pub fn write_card(out: &Path, source: &CardSource<'_>, photos: Option<&(dyn Fn() + Sync)>) -> Result<(), CardError> {
    let CardSource { flight, simulation, .. } = source;
    write_file(&out.join("board.log"), source.log)?;
    write_file(&out.join("mission.toml"), source.mission_text.as_bytes())?;
    let places = photo_places(flight, &simulation.card);
    let names: Vec<String> = places.iter().map(photo_name).collect();
    let truth = out.join("truth");
    let poses = names.iter().zip(&flight.exposures).map(|(name, exposure)| (name.as_str(), &exposure.tunnel_from_cam));
    write_poses(&truth.join("poses.csv"), poses)?;
    write_file(&truth.join("photos.csv"), truth::photos_csv(flight, &names).as_bytes())?;
    write_file(&truth.join("flight.csv"), truth::flight_csv(flight).as_bytes())?;
    let mut truth_files = vec!["truth/poses.csv", "truth/photos.csv", "truth/flight.csv"];
    if let Some(after_each) = photos {
        write_photos(out, source, &places, after_each)?;
        truth_files.extend(["truth/texture.jpg", "truth/texture.json", "truth/relief.f32", "truth/relief.json"]);
    }
    let json = FlightJson {
        format: 1,
        program: source.program,
        seed: flight.seed,
        mission: "mission.toml",
        log: "board.log",
        photos: if photos.is_some() { names.iter().map(|name| format!("DCIM/{name}")).collect() } else { Vec::new() },
        truth: truth_files,
        violations: &source.report.violations,
        figures: &source.report.figures,
        simulation,
    };
    let text = serde_json::to_string_pretty(&json)
        .map_err(|error| RenderError::Write { file: out.join("flight.json"), source: error.into() })?;
    Ok(write_file(&out.join("flight.json"), text.as_bytes())?)
}

fn write_photos(
    out: &Path,
    source: &CardSource<'_>,
    places: &[CardPlace],
    after_each: &(dyn Fn() + Sync),
) -> Result<(), CardError> {
    let CardSource { flight, mission, simulation, .. } = source;
    let paint = LiningPaint::new(flight.wall.profile(), &simulation.texture, source.mission_folder, flight.seed)
        .map_err(RenderError::from)?;
    let paint = Arc::new(paint);
    let camera = mission.survey.camera;
    let renderer = PhotoRenderer::new(
        camera.camera,
        camera.rolling_shutter_s,
        Arc::new(flight.wall.clone()),
        paint.clone(),
        &simulation.render,
        flight.seed,
    )?;
    let render = &simulation.render;
    let masks = out.join("truth/masks");
    places.par_iter().zip(&flight.exposures).enumerate().try_for_each(|(index, (place, exposure))| {
        let photo = renderer.render(&shot(index as u32, exposure));
        let taken = camera_clock(&simulation.card, exposure.time_s);
        write_photo(out, place, &photo, render.jpeg_quality, render.sensor.exposure_s, taken)?;
        write_mask(&masks.join(&place.folder), place, &photo)?;
        after_each();
        Ok::<(), RenderError>(())
    })?;

    let stations_m = flight.exposures.iter().map(|exposure| exposure.tunnel_from_cam.translation.x);
    let stations_m = stations_m.chain([simulation.pilot.start_x_m]);
    let geometry = TextureGeometry::around(flight.wall.profile(), stations_m, render.truth_mm_per_px);
    write_texture(&out.join("truth"), &geometry, paint.as_ref())?;
    write_relief(&out.join("truth"), flight.wall.profile(), &flight.wall, &geometry)?;
    Ok(())
}

fn shot(index: u32, exposure: &Exposure) -> Shot {
    Shot {
        index,
        tunnel_from_cam: exposure.tunnel_from_cam,
        tunnel_from_body: exposure.tunnel_from_body,
        velocity_mps: exposure.velocity_mps,
        angular_velocity_rad_per_s: exposure.angular_velocity_rad_per_s,
        light_level: exposure.light_level,
        gain_factors: [1.0; 3],
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_fast_clock_gains_its_drift_and_shows_whole_seconds() {
        let config = CardConfig { clock_start_s: 0.9, clock_drift_ppm: 1000.0, ..CardConfig::default() };
        assert_eq!(camera_clock(&config, 0.0), ExifTime(0));
        assert_eq!(camera_clock(&config, 0.2), ExifTime(1));
        assert_eq!(camera_clock(&config, 1000.0), ExifTime(1001));
    }
}
