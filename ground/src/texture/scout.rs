//! The first look at every photo: which wall it shows and how well, and samples of its colours.

use adit_geometry::profile::Profile;
use rayon::prelude::*;

use super::cache::{Cache, photos_at_once};
use super::error::TextureError;
use super::grid::{Lattice, Region};
use super::sample::Mips;
use super::tone::{ToneSample, offset};
use super::usable::Usable;
use super::view::{Footprint, View};
use crate::poses::{PoseStatus, Reconstruction};
use crate::surface::{SurfaceStore, SurfaceWindow};
use crate::survey::{Loss, Photo, Size, Survey, decode_rgb, load_mask};

/// Quality of a photo that only its tag placed, as a factor: taken only where no other photo is nearly as good.
const PRIOR_ONLY_TRUST: f32 = 0.1;

/// Colour samples per photo, about.
const SAMPLES_PER_VIEW: f64 = 400.0;

/// A photo of the survey with a usable pose.
pub(super) struct Candidate<'a> {
    pub(super) photo: &'a Photo,
    pub(super) view: View,
    pub(super) footprint: Footprint,
}

impl Candidate<'_> {
    pub(super) fn size(&self) -> Size {
        Size { width_px: self.view.camera.width_px, height_px: self.view.camera.height_px }
    }

    /// Decodes the photo.
    pub(super) fn mips(&self, usable: &Usable) -> Result<Mips, Loss> {
        decode_rgb(&self.photo.path, self.size())
            .map(|photo| match usable.masked() {
                Some(masked) => Mips::masked(photo, masked),
                None => Mips::new(photo),
            })
            .map_err(|error| Loss::new(&self.photo.name, format!("not used for the texture: {error}")))
    }

    /// Reads the mask, if there is one.
    pub(super) fn usable(&self) -> Result<Usable, Loss> {
        let size = self.size();
        let mask = self.photo.mask.as_ref().map(|path| load_mask(path, size)).transpose();
        let mask = mask.map_err(|error| Loss::new(&self.photo.name, format!("mask: {error}")))?;
        Ok(Usable::new(size.width_px, size.height_px, mask.as_ref()))
    }
}

/// Pairs photos with poses; what has no pose or looks at no wall is lost by name.
pub(super) fn candidates<'a>(
    survey: &'a Survey,
    reconstruction: &Reconstruction,
    profile: &Profile<f64>,
    losses: &mut Vec<Loss>,
) -> Vec<Candidate<'a>> {
    let mut candidates = Vec::new();
    for photo in &survey.photos {
        let Some(pose) = reconstruction.poses.iter().find(|pose| pose.photo == photo.name) else {
            losses.push(Loss::new(&photo.name, "not used for the texture: it has no pose"));
            continue;
        };
        let trust = if pose.status == PoseStatus::Adjusted { 1.0 } else { PRIOR_ONLY_TRUST };
        let view = View::new(reconstruction.camera, &pose.tunnel_from_cam, trust);
        match view.footprint(profile) {
            Some(footprint) => candidates.push(Candidate { photo, view, footprint }),
            None => losses.push(Loss::new(&photo.name, "not used for the texture: its optical axis meets no wall")),
        }
    }
    candidates
}

/// What all photos together show of each coarse cell.
pub(super) struct Scouted {
    /// Quality of the best photo.
    pub(super) best: Vec<f32>,
    /// Pixels per metre of the best photo.
    pub(super) best_density_per_m: Vec<f32>,
    /// Number of photos.
    pub(super) counts: Vec<u16>,
    pub(super) samples: Vec<ToneSample>,
    /// Photos that can be decoded, by index of the candidate.
    pub(super) good: Vec<bool>,
    /// Photos for the second pass, as many as there is room for.
    pub(super) cache: Cache,
}

/// Looks at every photo once; keeps decoded photos up to `cache_bytes`.
///
/// # Errors
/// If the measured wall cannot be read.
pub(super) fn scout(
    candidates: &[Candidate],
    surface: &SurfaceStore,
    coarse: &Lattice,
    cache_bytes: usize,
    losses: &mut Vec<Loss>,
    tick: &(dyn Fn() + Sync),
) -> Result<Scouted, TextureError> {
    let cells = coarse.columns * coarse.rows;
    let mut scouted = Scouted {
        best: vec![0.0; cells],
        best_density_per_m: vec![0.0; cells],
        counts: vec![0; cells],
        samples: Vec::new(),
        good: vec![false; candidates.len()],
        cache: Cache::new(cache_bytes),
    };
    let stride = candidates.first().map_or(1, |first| sample_stride(&first.footprint.region(coarse)));
    let at_once = candidates.first().map_or(1, |first| photos_at_once(first.size(), cache_bytes));
    for first in (0..candidates.len()).step_by(at_once) {
        let batch = first..(first + at_once).min(candidates.len());
        let window = surface.window(stretch(&candidates[batch.clone()]))?;
        let looks: Vec<_> = batch
            .into_par_iter()
            .map(|index| {
                let look = look(&candidates[index], index, &window, coarse, stride);
                tick();
                (index, look)
            })
            .collect();
        for (index, look) in looks {
            match look {
                Ok(look) => scouted.merge(index, look, coarse),
                Err(loss) => losses.push(loss),
            }
        }
    }
    Ok(scouted)
}

/// The stretch along the axis that photos show, from and to.
pub(super) fn stretch<'a>(candidates: impl IntoIterator<Item = &'a Candidate<'a>>) -> [f64; 2] {
    candidates.into_iter().fold([f64::INFINITY, f64::NEG_INFINITY], |[from_m, to_m], candidate| {
        let x_m = candidate.footprint.x_m;
        [from_m.min(x_m[0]), to_m.max(x_m[1])]
    })
}

/// One photo's share of [`Scouted`].
struct Look {
    region: Region,
    /// Quality and density per cell of the region.
    cells: Vec<(f32, f32)>,
    samples: Vec<ToneSample>,
    mips: Mips,
}

fn sample_stride(region: &Region) -> usize {
    ((region.len() as f64 / SAMPLES_PER_VIEW).sqrt().round() as usize).max(1)
}

fn look(
    candidate: &Candidate,
    index: usize,
    surface: &SurfaceWindow,
    coarse: &Lattice,
    stride: usize,
) -> Result<Look, Loss> {
    let usable = candidate.usable()?;
    let mips = candidate.mips(&usable)?;
    let view = &candidate.view;
    let region = candidate.footprint.region(coarse);
    let sights = view.sights(surface, &usable, coarse, &region);
    let mut samples = Vec::new();
    for (at, sight) in sights.iter().enumerate().filter(|(_, sight)| sight.score > 0.0) {
        let column = coarse.wrap(region.column0 + (at % region.columns) as i64);
        let row = region.row0 + at / region.columns;
        if column.is_multiple_of(stride) && row.is_multiple_of(stride) {
            let octaves = (2.0 * coarse.step_s_m as f32 * sight.mean_density_per_m).max(1e-3).log2();
            let [r, g, b, _] = mips.sample(sight.pixel[0], sight.pixel[1], octaves);
            samples.push(ToneSample {
                cell: (row * coarse.columns + column) as u32,
                view: index as u32,
                colour: [r, g, b],
                offset: offset(&view.camera, sight.pixel),
            });
        }
    }
    let cells = sights.iter().map(|sight| (sight.score, sight.density_per_m)).collect();
    Ok(Look { region, cells, samples, mips })
}

impl Scouted {
    fn merge(&mut self, index: usize, look: Look, coarse: &Lattice) {
        self.good[index] = true;
        self.samples.extend(look.samples);
        self.cache.keep_whole(index, look.mips);
        for (at, (score, density)) in look.cells.into_iter().enumerate().filter(|(_, (score, _))| *score > 0.0) {
            let column = coarse.wrap(look.region.column0 + (at % look.region.columns) as i64);
            let cell = (look.region.row0 + at / look.region.columns) * coarse.columns + column;
            self.counts[cell] = self.counts[cell].saturating_add(1);
            if score > self.best[cell] {
                self.best[cell] = score;
                self.best_density_per_m[cell] = density;
            }
        }
    }

    /// Median over the wall of the best photo's millimetres per pixel.
    pub(super) fn native_mm_per_px(&self) -> Option<f64> {
        let mut densities: Vec<f32> =
            self.best_density_per_m.iter().copied().filter(|density| *density > 0.0).collect();
        if densities.is_empty() {
            return None;
        }
        let middle = densities.len() / 2;
        let (_, median, _) = densities.select_nth_unstable_by(middle, f32::total_cmp);
        Some(1000.0 / f64::from(*median))
    }

    /// First and last row (one past) that any photo shows.
    pub(super) fn seen_rows(&self, coarse: &Lattice) -> Option<(usize, usize)> {
        let seen = |row: &usize| self.counts[row * coarse.columns..][..coarse.columns].iter().any(|&count| count > 0);
        Some(((0..coarse.rows).find(seen)?, (0..coarse.rows).rfind(seen)? + 1))
    }
}
