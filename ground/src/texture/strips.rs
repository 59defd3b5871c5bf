//! The second pass: the panorama from top to bottom, a strip of rows at a time, with only the photos in memory that the
//! strip needs.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::sync::mpsc::sync_channel;

use rayon::prelude::*;

use super::blend::{Band, HALO_CELLS, Shares, blend};
use super::cache::{Cache, photos_at_once};
use super::error::TextureError;
use super::fine::{FineSource, TexelRows, add_detail, finish};
use super::gaps::{fill, gaps};
use super::grid::{Lattice, MID_PER_COARSE, PanoramaGrid, wall_at};
use super::layer::{BestScores, Layer, LayerSource, Rgbx, Useful, useful};
use super::sample::Mips;
use super::scout::{Candidate, stretch};
use super::seams::Labelling;
use super::sink::Sinks;
use super::steps::{SeamSums, SeamView};
use super::tiles::TILE_PX;
use super::tone::{ToneCurve, Tones};
use super::usable::Usable;
use crate::surface::SurfaceStore;
use crate::survey::Loss;

/// Rows of a strip: whole rows of tiles.
const STRIP_ROWS: usize = 2 * TILE_PX;

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
    pub(super) seams: SeamSums,
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
    cache: Cache,
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
        let size = job.candidates.first().map(Candidate::size);
        let at_once = size.map_or(1, |size| photos_at_once(size, job.cache_bytes));
        let (active, report) = (BTreeMap::new(), StripReport::default());
        let mut pass = Pass { job, active, cache, at_once, labelling: None, report };
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
    /// Photos decoded at the same time.
    at_once: usize,
    /// Which photo the last strip took where.
    labelling: Option<Labelling>,
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
        let plain: Vec<(u32, &Layer)> = layers.iter().map(|&(index, _, layer)| (index as u32, layer)).collect();
        let labelling = Labelling::new(&plain, band, self.labelling.as_ref());
        let (composite, shares) = blend(&plain, band, &labelling.grown());
        let seams = SeamView { layers: &plain, labelling: &labelling, composite: &composite };
        let mid_rows = self.own_mid_rows(v0, rows);
        let sums = seams.measure(mid_rows, |photo, cell, colour| self.unevened(photo, cell, colour));
        self.report.seams.add(&sums);
        let needed: Vec<_> =
            layers.iter().zip(&shares).filter_map(|(layer, shares)| Some((*layer, shares.as_ref()?))).collect();
        let mut detail: Vec<Rgbx> = vec![[0.0; 4]; job.grid.width_px * rows];
        for batch in needed.chunks(self.at_once) {
            let photos: Vec<_> = batch.iter().map(|((index, active, _), _)| (*index, *active)).collect();
            let photos = crops(job, &mut self.cache, &photos, &mut self.report);
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
        let mut gaps = gaps(&texels, &band, &labelling.photos, &detail);
        for (&index, active) in self.active.iter().filter_map(|(index, active)| Some((index, active.as_ref()?))) {
            if gaps.is_empty() {
                break;
            }
            let candidate = &job.candidates[index];
            let decoded = &mut self.report.decoded;
            let decode = || {
                *decoded += 1;
                candidate.mips(&active.usable)
            };
            let photo = (&candidate.view, &active.usable, &active.curve);
            if let Err(loss) = fill(&mut gaps, photo, &texels, &mut detail, decode) {
                self.report.lose(loss);
            }
        }
        self.report.coloured_px += detail.iter().filter(|texel| texel[3] != 0.0).count() as u64;
        self.labelling = Some(labelling);
        Ok(finish(&detail, &composite, &texels))
    }

    /// Rows of the mid lattice that belong to a strip of texel rows.
    fn own_mid_rows(&self, v0: usize, rows: usize) -> std::ops::Range<usize> {
        let coarse = self.job.coarse;
        let row = |v: usize| {
            let x_m = self.job.grid.x_m(v as f64) - coarse.x0_m;
            (x_m / coarse.step_x_m * MID_PER_COARSE as f64).round().max(0.0) as usize
        };
        row(v0)..row(v0 + rows)
    }

    /// The colour that a photo has at a mid cell (row, column) before it is evened out.
    fn unevened(&self, photo: u32, (row, column): (usize, usize), colour: Rgbx) -> Rgbx {
        let index = photo as usize;
        let (view, mid) = (&self.job.candidates[index].view, self.job.coarse.finer());
        // Shading changes too slowly for the relief to matter.
        let wall = wall_at(self.job.surface.profile(), mid.s_m(column as i64));
        let in_cam = view.section_in_cam(wall.point) + view.forward_in_cam() * mid.x_m(row as i64);
        let curve = self.active.get(&index).and_then(Option::as_ref).map(|active| &active.curve);
        match (view.camera.project(&in_cam), curve) {
            (Some(pixel), Some(curve)) => curve.unevened(colour, [pixel.x as f32, pixel.y as f32]),
            _ => colour,
        }
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
        self.cache.retain_crops(|index| active.contains_key(&index));
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
        for batch in new.chunks(self.at_once) {
            let surface = job.surface.window(stretch(batch.iter().map(|&index| &job.candidates[index])))?;
            let whole: Vec<_> = batch.iter().map(|&index| (index, self.cache.take_whole(index))).collect();
            self.report.decoded += whole.iter().filter(|(_, mips)| mips.is_none()).count();
            let active = &self.active;
            let layers: Vec<_> = whole
                .into_par_iter()
                .filter_map(|(index, mips)| {
                    let active = active.get(&index)?.as_ref()?;
                    let candidate = &job.candidates[index];
                    let layer = mips.map_or_else(|| candidate.mips(&active.usable), Ok).map(|mips| {
                        let source = LayerSource {
                            view: &candidate.view,
                            usable: &active.usable,
                            mips: &mips,
                            curve: &active.curve,
                        };
                        let layer = Layer::new(&source, &active.useful, &surface, job.coarse, job.grid.texel_m());
                        let [from_px, to_px] = active.useful.crop_px;
                        (layer, Arc::new(mips.cropped(from_px, to_px)))
                    });
                    Some((index, layer))
                })
                .collect();
            for (index, layer) in layers {
                match (layer, self.active.get_mut(&index)) {
                    (Ok((layer, crop)), Some(Some(active))) => {
                        active.layer = Some(layer);
                        self.cache.keep_crop(index, crop);
                    }
                    (Err(loss), Some(active)) => {
                        self.report.lose(loss);
                        *active = None;
                    }
                    _ => {}
                }
            }
        }
        Ok(())
    }
}

/// Returns the needed parts of photos, decoding in parallel what is not at hand; `None` where that fails.
fn crops(
    job: &StripJob,
    cache: &mut Cache,
    photos: &[(usize, &Active)],
    report: &mut StripReport,
) -> Vec<Option<Arc<Mips>>> {
    let found: Vec<(usize, bool, Result<Arc<Mips>, Loss>)> = photos
        .par_iter()
        .map(|(index, active)| {
            let kept = cache.crop(*index);
            let (decoded, [from_px, to_px]) = (kept.is_none(), active.useful.crop_px);
            let mips = || job.candidates[*index].mips(&active.usable);
            let decode = || mips().map(|mips| Arc::new(mips.cropped(from_px, to_px)));
            (*index, decoded, kept.map_or_else(decode, Ok))
        })
        .collect();
    let mut crops = Vec::with_capacity(found.len());
    for (index, decoded, crop) in found {
        report.decoded += usize::from(decoded);
        crops.push(crop.map_err(|loss| report.lose(loss)).ok());
        if decoded && let Some(Some(crop)) = crops.last() {
            cache.keep_crop(index, crop.clone());
        }
    }
    crops
}

impl StripReport {
    fn lose(&mut self, loss: Loss) {
        if !self.losses.contains(&loss) {
            self.losses.push(loss);
        }
    }
}
