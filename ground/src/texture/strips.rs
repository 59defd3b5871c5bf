//! The second pass: the panorama from top to bottom, a strip of rows at a time, with only the photos in memory that the
//! strip needs.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::sync::mpsc::sync_channel;

use rayon::prelude::*;

use super::blend::{Band, HALO_CELLS, Shares, blend};
use super::error::TextureError;
use super::fine::{FineSource, TexelRows, add_detail, finish};
use super::grid::{Lattice, PanoramaGrid};
use super::layer::{BestScores, Layer, LayerSource, Rgbx, Useful, useful};
use super::sample::Mips;
use super::scout::{Candidate, stretch};
use super::sink::Sinks;
use super::tiles::TILE_PX;
use super::tone::{ToneCurve, Tones};
use super::usable::Usable;
use crate::surface::SurfaceStore;
use crate::survey::Loss;

/// Rows of a strip: whole rows of tiles.
const STRIP_ROWS: usize = 2 * TILE_PX;

/// Photos decoded at a time.
const BATCH: usize = 8;

/// Everything that stays the same from strip to strip.
pub(super) struct StripJob<'a> {
    pub(super) candidates: &'a [Candidate<'a>],
    /// Photos that can be decoded.
    pub(super) good: &'a [bool],
    pub(super) tones: &'a Tones,
    pub(super) surface: &'a SurfaceStore,
    pub(super) coarse: &'a Lattice,
    pub(super) best: &'a [f32],
    pub(super) grid: &'a PanoramaGrid,
    /// Bytes of decoded photos to keep.
    pub(super) cache_bytes: usize,
}

/// What the pass did.
#[derive(Default)]
pub(super) struct StripReport {
    /// Photos decoded, each time counted.
    pub(super) decoded: usize,
    /// Texels that got a colour.
    pub(super) coloured_px: u64,
    pub(super) losses: Vec<Loss>,
}

/// A photo near the strip under way.
struct Active {
    usable: Usable,
    curve: ToneCurve,
    useful: Useful,
    layer: Option<Layer>,
}

/// Number of strips.
pub(super) fn strip_count(grid: &PanoramaGrid) -> usize {
    grid.height_px.div_ceil(STRIP_ROWS)
}

/// Makes all strips and writes them; writing runs beside the making of the next strip.
pub(super) fn run(
    job: &StripJob,
    mut sinks: Sinks,
    tick: &(dyn Fn() + Sync),
) -> Result<(Sinks, StripReport), TextureError> {
    std::thread::scope(|scope| {
        let (sender, receiver) = sync_channel::<Vec<u8>>(1);
        let writer = scope.spawn(move || -> Result<Sinks, TextureError> {
            for rows in receiver {
                sinks.push(&rows)?;
                tick();
            }
            Ok(sinks)
        });
        let mut pass =
            Pass { job, active: BTreeMap::new(), cache: Cache::new(job.cache_bytes), report: StripReport::default() };
        for v0 in (0..job.grid.height_px).step_by(STRIP_ROWS) {
            let rows = pass.strip(v0, STRIP_ROWS.min(job.grid.height_px - v0))?;
            if sender.send(rows).is_err() {
                break;
            }
        }
        drop(sender);
        // A panic in the writer is a bug; carry it on.
        let sinks = writer.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic))?;
        Ok((sinks, pass.report))
    })
}

struct Pass<'a> {
    job: &'a StripJob<'a>,
    active: BTreeMap<usize, Option<Active>>,
    cache: Cache,
    report: StripReport,
}

impl Pass<'_> {
    fn strip(&mut self, v0: usize, rows: usize) -> Result<Vec<u8>, TextureError> {
        let job = self.job;
        let surface = job.surface.window([job.grid.x_m(v0 as f64), job.grid.x_m((v0 + rows) as f64)])?;
        let texels = TexelRows { grid: job.grid, mid: job.coarse.finer(), surface: &surface, v0 };
        let band = self.band(v0, rows);
        self.forget_before(band.row0);
        self.approach(&band)?;
        self.lay_down(&band)?;
        let layers: Vec<(usize, &Active, &Layer)> = self
            .active
            .iter()
            .filter_map(|(&index, active)| {
                let active = active.as_ref()?;
                let layer = active.layer.as_ref()?;
                let region = layer.region;
                (region.row0 < band.row0 + band.rows && region.row_end() > band.row0).then_some((index, active, layer))
            })
            .collect();
        let plain: Vec<&Layer> = layers.iter().map(|(.., layer)| *layer).collect();
        let (composite, shares) = blend(&plain, band);
        let needed: Vec<_> =
            layers.iter().zip(&shares).filter_map(|(layer, shares)| Some((*layer, shares.as_ref()?))).collect();
        let mut detail: Vec<Rgbx> = vec![[0.0; 4]; job.grid.width_px * rows];
        for batch in needed.chunks(BATCH) {
            let indices: Vec<usize> = batch.iter().map(|((index, ..), _)| *index).collect();
            let photos = self.cache.fetch(job.candidates, &indices, &mut self.report);
            let sources: Vec<FineSource> = batch
                .par_iter()
                .zip(&photos)
                .filter_map(|(entry, mips)| {
                    let ((index, active, layer), shares): ((usize, &Active, &Layer), &Shares) = *entry;
                    let photo = (&**mips.as_ref()?, &active.curve, &active.usable);
                    Some(FineSource::new(&job.candidates[index].view, layer, shares, photo, &texels))
                })
                .collect();
            add_detail(&sources, &texels, &mut detail);
        }
        self.report.coloured_px += detail.iter().filter(|texel| texel[3] > 0.0).count() as u64;
        Ok(finish(&detail, &composite, &texels))
    }

    /// The coarse rows that a strip of texel rows needs.
    fn band(&self, v0: usize, rows: usize) -> Band {
        let coarse = self.job.coarse;
        let row = |v: usize| (self.job.grid.x_m(v as f64) - coarse.x0_m) / coarse.step_x_m;
        let row0 = (row(v0).floor().max(0.0) as usize).saturating_sub(HALO_CELLS).min(coarse.rows - 1);
        let end = (row(v0 + rows).ceil().max(0.0) as usize + HALO_CELLS).clamp(row0 + 1, coarse.rows);
        Band { columns: coarse.columns, row0, rows: end - row0 }
    }

    /// Drops photos that lie behind.
    fn forget_before(&mut self, row0: usize) {
        let coarse = self.job.coarse;
        self.active.retain(|&index, active| {
            let region = active
                .as_ref()
                .map_or_else(|| self.job.candidates[index].footprint.region(coarse), |active| active.useful.region);
            region.row_end() > row0
        });
        let active = &self.active;
        self.cache.photos.retain(|index, _| active.contains_key(index));
    }

    /// Prepares photos whose footprint reaches the band, without decoding them.
    fn approach(&mut self, band: &Band) -> Result<(), TextureError> {
        let job = self.job;
        let best = BestScores { lattice: job.coarse, scores: job.best };
        let new: Vec<usize> = (0..job.candidates.len())
            .filter(|&index| {
                let region = job.candidates[index].footprint.region(job.coarse);
                let near = region.row0 < band.row0 + band.rows && region.row_end() > band.row0;
                near && job.good[index] && !self.active.contains_key(&index)
            })
            .collect();
        if new.is_empty() {
            return Ok(());
        }
        let surface = job.surface.window(stretch(new.iter().map(|&index| &job.candidates[index])))?;
        let prepared: Vec<_> = new
            .into_par_iter()
            .map(|index| {
                let candidate = &job.candidates[index];
                let active = candidate.usable().map(|usable| {
                    let useful = useful(&candidate.view, &candidate.footprint, &usable, &surface, &best)?;
                    let curve = ToneCurve::new(&candidate.view.camera, job.tones, index);
                    Some(Active { usable, curve, useful, layer: None })
                });
                (index, active)
            })
            .collect();
        for (index, active) in prepared {
            let active = active.unwrap_or_else(|loss| {
                self.report.losses.push(loss);
                None
            });
            self.active.insert(index, active);
        }
        Ok(())
    }

    /// Decodes photos that become useful in the band and lays them on the wall.
    fn lay_down(&mut self, band: &Band) -> Result<(), TextureError> {
        let job = self.job;
        let due = |active: &Active| {
            let region = active.useful.region;
            active.layer.is_none() && region.row0 < band.row0 + band.rows && region.row_end() > band.row0
        };
        let new: Vec<usize> = self
            .active
            .iter()
            .filter_map(|(&index, active)| active.as_ref().is_some_and(due).then_some(index))
            .collect();
        for batch in new.chunks(BATCH) {
            let photos = self.cache.fetch(job.candidates, batch, &mut self.report);
            let surface = job.surface.window(stretch(batch.iter().map(|&index| &job.candidates[index])))?;
            let active = &self.active;
            let layers: Vec<_> = batch
                .par_iter()
                .zip(&photos)
                .map(|(index, mips)| {
                    let (mips, active) = (mips.as_ref()?, active.get(index)?.as_ref()?);
                    let view = &job.candidates[*index].view;
                    let source = LayerSource { view, usable: &active.usable, mips, curve: &active.curve };
                    Some(Layer::new(&source, &active.useful, &surface, job.coarse, job.grid.texel_m()))
                })
                .collect();
            for (index, layer) in batch.iter().zip(layers) {
                match (layer, self.active.get_mut(index)) {
                    (Some(layer), Some(Some(active))) => active.layer = Some(layer),
                    (None, Some(active)) => *active = None,
                    _ => {}
                }
            }
        }
        Ok(())
    }
}

/// Decoded photos, those that are needed soonest first.
struct Cache {
    limit_bytes: usize,
    photos: BTreeMap<usize, Arc<Mips>>,
}

impl Cache {
    fn new(limit_bytes: usize) -> Self {
        Self { limit_bytes, photos: BTreeMap::new() }
    }

    /// Returns the photos, decoding in parallel what is not at hand.
    fn fetch(
        &mut self,
        candidates: &[Candidate],
        indices: &[usize],
        report: &mut StripReport,
    ) -> Vec<Option<Arc<Mips>>> {
        let photos: Vec<Result<Arc<Mips>, Loss>> = indices
            .par_iter()
            .map(|index| match self.photos.get(index) {
                Some(mips) => Ok(mips.clone()),
                None => candidates[*index].mips().map(Arc::new),
            })
            .collect();
        let mut found = Vec::with_capacity(photos.len());
        for (&index, photo) in indices.iter().zip(photos) {
            match photo {
                Ok(mips) => {
                    self.photos.entry(index).or_insert_with(|| {
                        report.decoded += 1;
                        mips.clone()
                    });
                    found.push(Some(mips));
                }
                Err(loss) => {
                    if !report.losses.contains(&loss) {
                        report.losses.push(loss);
                    }
                    found.push(None);
                }
            }
        }
        // Photos come in the order of the journey, so the highest number is needed last.
        while self.photos.values().map(|mips| mips.bytes()).sum::<usize>() > self.limit_bytes && self.photos.len() > 1 {
            self.photos.pop_last();
        }
        found
    }
}
