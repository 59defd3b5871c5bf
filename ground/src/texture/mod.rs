//! The unrolled wall: every texel of the profile, at a chosen resolution, coloured from the photos.
//!
//! Two passes over the photos. The first measures what each photo shows of the wall (quality = photo pixels per metre
//! in the worse direction, lowered towards the border) and samples its colours, from which exposure and vignetting are
//! solved together (`tone`). The second makes the panorama in strips: per texel one of the best photos gives the detail, with
//! seams where photos differ least (`seams`), and all good photos together give the brightness (`blend`).
//!
//! Memory holds a strip and, of the photos around it, what seams may use, whatever the tunnel's length. Peak of the whole program
//! on two threads: 40 photos of 12 megapixels 1.50 GiB, 1,000 photos of 400 x 300 pixels (95 m) 1.18 GiB; with `--match none`, so
//! without matching and surface, 1.16 and 0.54 GiB. A photo is decoded twice, or once while all decoded photos fit into the cache; more often where the crops do not.

mod blend;
mod cache;
mod coverage;
mod description;
mod error;
mod fine;
mod gaps;
mod grid;
mod layer;
mod resolution;
mod sample;
mod scout;
mod seams;
mod sink;
mod steps;
mod strips;
mod tiles;
mod tone;
mod usable;
mod view;

use std::fs;
use std::path::Path;
use std::time::Instant;

use adit_geometry::profile::Profile;
use serde::{Deserialize, Serialize};

pub(crate) use coverage::{COVERAGE_COLOURS, measure, picture};
pub use coverage::{Coverage, Hole, clock_position};
pub(crate) use description::Panorama;
pub use error::TextureError;
pub(crate) use error::at_path;
pub(crate) use grid::{Lattice, WallPoint, wall_at};
pub use grid::{PanoramaGrid, profile_json};
pub(crate) use resolution::RESOLUTION_COLOURS;
pub use resolution::Resolution;
pub use sink::Sheet;
pub use steps::Seams;
#[cfg(test)]
pub(crate) use tiles::write_tiles_for_tests;
pub use tiles::{PixelBox, Rgba8, TILE_PX, TileReader};
pub(crate) use tiles::{read_png, write_png};
pub(crate) use usable::Usable;
pub(crate) use view::{Footprint, View};

use crate::poses::Reconstruction;
use crate::surface::SurfaceStore;
use crate::survey::{Loss, Survey};
use cache::Cache;
use scout::{Candidate, Scouted};
use sink::Sinks;
use strips::StripJob;
use tone::Tones;

/// Side of a mid-lattice cell in photo pixels, at least; and photos are divided into at most so many cells across.
const MID_CELL_PX: f64 = 2.0;
const MID_CELLS_ACROSS: f64 = 500.0;

/// Finer panoramas than this many times the photos' own resolution hold no more.
const FINEST_SHARE: f64 = 0.1;

/// What may be chosen.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct TextureOptions {
    /// Size of a texel; `None`: the median over the wall of the best photo's resolution.
    pub mm_per_px: Option<f64>,
    /// Bytes of decoded photos kept in memory.
    pub cache_bytes: usize,
}

impl Default for TextureOptions {
    fn default() -> Self {
        // Fifty photos of 0.75 MP take 200 MB; thirty of 12 MP, what a strip needs, 1.4 GB: those are decoded again.
        Self { mm_per_px: None, cache_bytes: 512 << 20 }
    }
}

/// What is going on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TextureProgress {
    /// Work is known: this many [`TextureProgress::Step`]s will follow.
    Total(usize),
    /// One photo looked at, or one strip written.
    Step,
}

/// A photo's exposure against the common one.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PhotoGain {
    /// The photo.
    pub photo: String,
    /// Factor on the red, green and blue light (before the sRGB curve) that the exposure makes, against the mean of all photos.
    pub gain: [f64; 3],
}

/// What the texture stage made.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct TextureReport {
    /// Geometry of the panorama.
    pub grid: PanoramaGrid,
    /// Median over the wall of the best photo's resolution.
    pub native_mm_per_px: f64,
    /// The panorama in one file (in `panorama/`), if it is small enough for one.
    pub picture: Option<String>,
    /// Planar parts.
    pub sheets: Vec<Sheet>,
    /// Photos that were used.
    pub photos_used: usize,
    /// Photos decoded, each time counted.
    pub photos_decoded: usize,
    /// Area of the texels that got a colour.
    pub coloured_area_m2: f64,
    /// Exposure per photo.
    pub gains: Vec<PhotoGain>,
    /// Mean light in the corners of a photo against its middle, green: vignetting and the lamp's fall-off.
    pub corner_brightness: f64,
    /// Root mean square relative difference between photos of the same place, before and after the correction.
    pub tone_rms_before: f64,
    /// After the correction.
    pub tone_rms_after: f64,
    /// The seams between photos.
    pub seams: Seams,
    /// Coverage.
    pub coverage: Coverage,
    /// How finely the wall is shown.
    pub resolution: Resolution,
    /// Photos or masks that could not be used.
    pub losses: Vec<Loss>,
    /// Time for the first look at the photos.
    pub scout_s: f64,
    /// Time for the panorama.
    pub panorama_s: f64,
}

/// Textures the wall `surface`: writes `panorama/`, `sheets/`, `coverage.json`, `coverage.png` and `resolution.png` below `out`.
///
/// `panorama/panorama.json` is written last: where it is, the rest is whole.
///
/// # Errors
/// [`TextureError`] if nothing of the wall is seen, the resolution makes no sense, or `out` cannot be written. Single
/// photos that cannot be used are losses in the report.
pub fn build(
    survey: &Survey,
    reconstruction: &Reconstruction,
    surface: &SurfaceStore,
    options: &TextureOptions,
    out: &Path,
    progress: &(dyn Fn(TextureProgress) + Sync),
) -> Result<TextureReport, TextureError> {
    let started = Instant::now();
    let profile = reconstruction.profile.build()?;
    let mut losses = Vec::new();
    let candidates = scout::candidates(survey, reconstruction, &profile, &mut losses);
    let nothing_seen = || TextureError::NothingSeen { photos: survey.photos.len() };
    let coarse = lattice(&candidates, &profile).ok_or_else(nothing_seen)?;
    progress(TextureProgress::Total(candidates.len()));
    let step = || progress(TextureProgress::Step);
    let mut scouted = scout::scout(&candidates, surface, &coarse, options.cache_bytes, &mut losses, &step)?;
    let native_mm_per_px = scouted.native_mm_per_px().ok_or_else(nothing_seen)?;
    let rows = scouted.seen_rows(&coarse).ok_or_else(nothing_seen)?;
    let grid = panorama_grid(options, native_mm_per_px, &profile, &coarse, rows)?;
    let tones = tone::solve(std::mem::take(&mut scouted.samples), candidates.len());
    let scout_s = started.elapsed().as_secs_f64();

    let started = Instant::now();
    let description = out.join("panorama/panorama.json");
    if description.exists() {
        fs::remove_file(&description).map_err(at_path(&description))?;
    }
    let cache = std::mem::replace(&mut scouted.cache, Cache::new(0));
    let (coverage, resolution) = write_coverage(&scouted, &candidates, &coarse, &profile, native_mm_per_px, out)?;
    let sinks = Sinks::create(out, grid, &profile)?;
    progress(TextureProgress::Total(candidates.len() + strips::strip_count(&grid)));
    let job = StripJob {
        candidates: &candidates,
        good: &scouted.good,
        tones: &tones,
        surface,
        coarse: &coarse,
        best: &scouted.best,
        grid: &grid,
        cache_bytes: options.cache_bytes,
    };
    let (sinks, strip_report) = strips::run(&job, cache, sinks, &step)?;
    let (picture, sheets) = sinks.finish()?;
    fs::write(&description, format!("{:#}\n", grid.to_json(&reconstruction.profile))).map_err(at_path(&description))?;
    losses.extend(strip_report.losses);
    let photos_used = scouted.good.iter().filter(|good| **good).count();
    Ok(TextureReport {
        grid,
        native_mm_per_px,
        picture,
        sheets,
        photos_used,
        photos_decoded: strip_report.decoded + photos_used,
        coloured_area_m2: strip_report.coloured_px as f64 * grid.texel_m().powi(2),
        gains: photo_gains(&candidates, &tones),
        corner_brightness: tones.corner_brightness(&reconstruction.camera),
        tone_rms_before: tones.rms_before,
        tone_rms_after: tones.rms_after,
        seams: strip_report.seams.figures(coarse.finer().step_s_m),
        coverage,
        resolution,
        losses,
        scout_s,
        panorama_s: started.elapsed().as_secs_f64(),
    })
}

/// The coarse lattice over everything that the photos may show.
fn lattice(candidates: &[Candidate], profile: &Profile<f64>) -> Option<Lattice> {
    let mut densities: Vec<f64> = candidates.iter().map(|candidate| candidate.footprint.axis_density_per_m).collect();
    densities.sort_by(f64::total_cmp);
    let density_per_m = *densities.get(densities.len() / 2)?;
    let width_px = candidates.first().map_or(0.0, |candidate| f64::from(candidate.view.camera.width_px));
    let mid_m = MID_CELL_PX.max(width_px / MID_CELLS_ACROSS) / density_per_m;
    let x0_m = candidates.iter().map(|candidate| candidate.footprint.x_m[0]).fold(f64::INFINITY, f64::min);
    let x1_m = candidates.iter().map(|candidate| candidate.footprint.x_m[1]).fold(f64::NEG_INFINITY, f64::max);
    Some(Lattice::coarse(profile.perimeter_m(), mid_m, x0_m, x1_m))
}

fn panorama_grid(
    options: &TextureOptions,
    native_mm_per_px: f64,
    profile: &Profile<f64>,
    coarse: &Lattice,
    rows: (usize, usize),
) -> Result<PanoramaGrid, TextureError> {
    let mm_per_px = options.mm_per_px.unwrap_or(native_mm_per_px);
    let least = native_mm_per_px * FINEST_SHARE;
    let perimeter_m = profile.perimeter_m();
    if !(mm_per_px >= least && mm_per_px <= perimeter_m * 1000.0 / 8.0) {
        let width_px = perimeter_m * 1000.0 / mm_per_px;
        return Err(TextureError::Resolution { found: mm_per_px, least, width_px });
    }
    let edge = |row: usize| coarse.x0_m + row as f64 * coarse.step_x_m;
    Ok(PanoramaGrid::new(perimeter_m, mm_per_px, edge(rows.0), edge(rows.1)))
}

fn write_coverage(
    scouted: &Scouted,
    candidates: &[Candidate],
    coarse: &Lattice,
    profile: &Profile<f64>,
    native_mm_per_px: f64,
    out: &Path,
) -> Result<(Coverage, Resolution), TextureError> {
    let aims = || candidates.iter().zip(&scouted.good).filter(|(_, good)| **good).map(|(c, _)| c.footprint.axis_x_m);
    let stretch = [aims().fold(f64::INFINITY, f64::min), aims().fold(f64::NEG_INFINITY, f64::max)];
    let coverage = coverage::measure(&scouted.counts, coarse, profile, stretch);
    fs::create_dir_all(out).map_err(at_path(out))?;
    let path = out.join("coverage.json");
    fs::write(&path, format!("{:#}\n", coverage.to_json())).map_err(at_path(&path))?;
    let picture = coverage::picture(&scouted.counts, coarse, stretch);
    tiles::write_png(&out.join("coverage.png"), picture.width, picture.height, &picture.data)?;
    let densities = &scouted.best_density_per_m;
    let resolution = resolution::measure(densities, coarse, stretch, native_mm_per_px);
    let picture = resolution::picture(densities, coarse, &resolution);
    tiles::write_png(&out.join("resolution.png"), picture.width, picture.height, &picture.data)?;
    Ok((coverage, resolution))
}

fn photo_gains(candidates: &[Candidate], tones: &Tones) -> Vec<PhotoGain> {
    candidates
        .iter()
        .zip(tones.light_gains())
        .map(|(candidate, gain)| PhotoGain { photo: candidate.photo.name.clone(), gain })
        .collect()
}
