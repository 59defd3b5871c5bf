//! The wall as it is: a height over the section's profile, measured from the photos.
//!
//! Coordinates stay those of `reconstruction.profile` (the panorama's grid): arc length s and station x. The wall point is
//! `profile.at(s)` moved inwards along the profile's normal by `height_m(s, x)`, which has two parts: what rings do as a
//! whole (radius, shift, ovality; offset and tilt of planar parts), and the relief, which is everything else.
//!
//! The rings are fitted to the adjustment's free points (`fit`); the relief comes from a plane sweep over overlapping
//! photos (`sweep`), coarse to fine, smoothed where photos say little (`smooth`), strip by strip along the tunnel
//! (`strips`), so that memory does not grow with its length.
//! Model limit: a single-valued height, so pipes and brackets before the wall are at best bumps of it; across a corner of
//! the section faces that moved may overlap or gape by what they moved.

mod error;
mod figures;
mod fit;
mod output;
mod photo;
mod ring;
mod smooth;
mod store;
mod strips;
mod sweep;

use std::path::Path;
use std::time::Instant;

use serde::{Deserialize, Serialize};

pub use error::SurfaceError;
pub use figures::{ReliefExtreme, RingFigures, SurfaceReport};
pub use ring::Rings;
pub use store::{SurfaceStore, SurfaceWindow, WallPlace};

use crate::poses::Reconstruction;
use crate::survey::Survey;
use crate::texture::Lattice;
use figures::Tally;
use photo::Shot;
use store::{Description, StoreWriter};
use strips::Job;

/// What may be chosen.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SurfaceOptions {
    /// Samples are no smaller than this: finer photos would cost time and memory, not find lower relief.
    pub least_sample_m: f64,
}

impl Default for SurfaceOptions {
    fn default() -> Self {
        // A tenth of a sample at a parallax of 0.6 is 0.8 mm of height.
        Self { least_sample_m: 0.005 }
    }
}

/// Measures the wall: writes `surface/`, `relief.tif` and `relief.png` below `out`. `progress` hears the number of strips
/// done and to do.
///
/// # Errors
/// [`SurfaceError`] if no adjusted photo sees the wall or `out` cannot be written. Single photos that cannot be used are
/// losses in the report.
pub fn build(
    survey: &Survey,
    reconstruction: &Reconstruction,
    options: &SurfaceOptions,
    out: &Path,
    progress: &dyn Fn(usize, usize),
) -> Result<SurfaceReport, SurfaceError> {
    let profile = reconstruction.profile.build()?;
    let shots = photo::shots(survey, reconstruction, &profile);
    let nothing_seen = SurfaceError::NothingSeen { photos: survey.photos.len() };
    let Some((lattice, halvings)) = lattice(&shots, profile.perimeter_m(), options) else { return Err(nothing_seen) };
    let rings = fit::fit(&reconstruction.tracks, &profile);
    let mut writer = StoreWriter::create(out)?;
    let mut tally = Tally::default();
    let job = Job { shots: &shots, profile: &profile, lattice: &lattice, rings: &rings, halvings };
    let strips = strips::strip_count(&lattice);
    let mut finished = 0;
    progress(finished, strips);
    let started = Instant::now();
    let done = strips::run(&job, |strip| -> Result<(), SurfaceError> {
        tally.add(strip, &lattice, &profile);
        let rows = strip.relief_m.chunks_exact(lattice.columns).zip(strip.confidence.chunks_exact(lattice.columns));
        for (relief_m, confidence) in rows {
            writer.push_row(relief_m, confidence)?;
        }
        finished += 1;
        progress(finished, strips);
        Ok(())
    })?;
    let seconds = started.elapsed().as_secs_f64();
    let description = Description { format: 1, profile: reconstruction.profile.clone(), lattice, rings };
    writer.finish(&description)?;
    let store = SurfaceStore::open(out)?;
    output::write_tiff(&out.join("relief.tif"), &store, &lattice)?;
    let full_colour_m = output::write_picture(&out.join("relief.png"), &store, &lattice)?;
    let rings = figures::ring_figures(&description.rings, &profile, &lattice, &tally.known);
    let known = tally.known.iter().map(|row| f64::from(*row)).sum::<f64>();
    Ok(SurfaceReport {
        cell_mm: lattice.step_s_m * 1e3,
        cells: [lattice.columns, lattice.rows],
        known_area_m2: known * lattice.step_s_m * lattice.step_x_m,
        mean_confidence: tally.confidence / known.max(1.0),
        median_ovality_percent: figures::median_ovality(&rings),
        median_height_mm: figures::median_height_mm(&description.rings, &profile, &lattice),
        rings,
        highest: tally.highest,
        deepest: tally.deepest,
        full_colour_mm: full_colour_m * 1e3,
        photos_used: shots.len() - done.losses.len(),
        photos_decoded: done.decoded,
        photo_bytes: done.most_bytes,
        cells_per_s: done.cells as f64 / seconds,
        losses: done.losses,
    })
}

/// The cells over everything that photos show, and how often photos are halved for their samples.
fn lattice(shots: &[Shot], perimeter_m: f64, options: &SurfaceOptions) -> Option<(Lattice, u32)> {
    let densities: Vec<f64> = shots.iter().map(|shot| shot.footprint.axis_density_per_m).collect();
    let native_m = 1.0 / crate::adjust::median(&densities);
    let sample_m = native_m.max(options.least_sample_m);
    let halvings = (sample_m / native_m).log2().round().max(0.0) as u32;
    let ends = |end: usize| shots.iter().map(move |shot| shot.footprint.x_m[end]);
    let (from_m, to_m) = (ends(0).fold(f64::INFINITY, f64::min), ends(1).fold(f64::NEG_INFINITY, f64::max));
    if !(to_m > from_m) {
        return None;
    }
    let columns = (perimeter_m / (sample_m * sweep::FINE_SAMPLES as f64)).round().max(8.0);
    let step_m = perimeter_m / columns;
    let rows = ((to_m - from_m) / step_m).ceil().max(1.0) as usize;
    let lattice = Lattice { step_s_m: step_m, step_x_m: step_m, columns: columns as usize, rows, x0_m: from_m };
    Some((lattice, halvings))
}
