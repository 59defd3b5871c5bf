//! One round of matching over all photos, a few held at a time.

use std::sync::Arc;

use adit_geometry::camera::Camera;
use adit_geometry::profile::Profile;
use rayon::prelude::*;

use super::coherence::{Displacement, PairMotion, displacement_sigma_m};
use super::pairs::{ExpectedPair, expected_pairs, last_needed};
use super::patch::Patch;
use super::search::{Search, SearchSize};
use super::wall::{BLOCK, Footprint, WallGrid};
use super::{MatchConfig, MatchRound, PairReport, Photos, Pixels, ViewPose};
use crate::adjust::{Observation, Tracks, median};

/// Points of a pair that are searched for in the whole window before the others, about.
const PROBES: usize = 16;

/// Probes of a pair that does not agree at once, before it is given up.
const MOST_PROBES: usize = 48;

/// Share of the probes' matches that must agree for the others to be searched for near their prediction only.
const PROBES_AGREEING: f64 = 0.7;

/// Points at which the uncertainty of a pair's displacement is looked at.
const WINDOW_SAMPLES: usize = 5;

/// A reference point that another photo should see.
#[derive(Clone, Copy, Debug)]
struct Candidate {
    /// 0: the pair's first photo holds the reference point, 1: its second.
    from: usize,
    /// Its number there.
    point: usize,
    /// Its place in that photo's window.
    place: [usize; 2],
    /// Its place in the other photo's window, by the poses.
    predicted: [i64; 2],
    /// Its place on the wall, texels, in the columns of its own photo.
    reference: [f64; 2],
}

impl Candidate {
    /// A reference in the second photo that the first one finds is displaced the other way.
    fn sign(&self) -> f64 {
        if self.from == 0 { 1.0 } else { -1.0 }
    }
}

/// A reference point that another photo found.
#[derive(Clone, Copy, Debug)]
struct Match {
    candidate: Candidate,
    /// Where it was found minus where it was predicted, texels.
    displacement: [f64; 2],
}

/// Photos as loaded so far.
type Patches = Vec<Option<Arc<Patch>>>;

/// What [`match_round`] needs at every step.
struct Round<'a> {
    grid: WallGrid<'a>,
    poses: &'a [ViewPose],
    config: &'a MatchConfig,
}

/// Matches every two photos that should overlap.
///
/// `poses` are one per photo, in order of capture (photos that overlap should be near in the order: it bounds memory).
/// Only pairs that are `wanted` are tried. `progress` is told the number of photos done. The result does not depend on
/// the number of threads.
pub fn match_round<P: Photos + ?Sized>(
    profile: &Profile<f64>,
    camera: &Camera<f64>,
    poses: &[ViewPose],
    photos: &P,
    config: &MatchConfig,
    wanted: &dyn Fn([usize; 2]) -> bool,
    progress: &dyn Fn(usize),
) -> MatchRound {
    let grid = WallGrid::new(profile, camera, config.grid_m, config.max_incidence_rad);
    let round = Round { grid, poses, config };
    let footprints: Vec<Option<Footprint>> =
        poses.par_iter().map(|pose| Footprint::new(&round.grid, &pose.tunnel_from_cam)).collect();
    let mut expected = expected_pairs(&footprints, round.blocks_around(), config.min_overlap, config.max_partners);
    expected.retain(|pair| wanted(pair.photos));
    let last_needed = last_needed(&expected, poses.len());
    let mut patches: Patches = vec![None; poses.len()];
    let mut found: Vec<Vec<Found>> = vec![Vec::new(); poses.len()];
    let mut finished: Vec<Option<Tracks>> = vec![None; poses.len()];
    let mut next = 0;
    let mut result = MatchRound::default();
    let batch = (2 * rayon::current_num_threads()).max(8);
    let mut waiting = expected.as_slice();
    for start in (0..poses.len()).step_by(batch) {
        let end = (start + batch).min(poses.len());
        let loaded: Patches = (start..end)
            .into_par_iter()
            .map(|photo| {
                last_needed[photo]?;
                round.patch(photo, footprints[photo].as_ref()?, photos).map(Arc::new)
            })
            .collect();
        for (photo, patch) in (start..end).zip(loaded) {
            if patch.is_none() && (last_needed[photo].is_some() || footprints[photo].is_none()) {
                result.unusable.push(photo as u32);
            }
            patches[photo] = patch;
        }
        let (ready, later) = waiting.split_at(waiting.partition_point(|pair| pair.photos[1] < end));
        waiting = later;
        let done: Vec<Option<(PairReport, Vec<Match>)>> =
            ready.par_iter().map_init(Search::default, |search, pair| round.pair(pair, &patches, search)).collect();
        for (report, matches) in done.into_iter().flatten() {
            round.collect(&report, &matches, &mut found);
            result.pairs.push(report);
        }
        for photo in 0..end {
            if finished[photo].is_none() && last_needed[photo].is_none_or(|last| last < end) {
                let found = std::mem::take(&mut found[photo]);
                let patch = patches[photo].take();
                finished[photo] =
                    Some(patch.map_or_else(Tracks::default, |patch| round.tracks_of(photo, &patch, found)));
            }
        }
        // In order of the photos, whatever the batches are.
        while let Some(Some(tracks)) = finished.get(next).filter(|_| next < end) {
            result.tracks.append(tracks);
            finished[next] = Some(Tracks::default());
            next += 1;
        }
        progress(end);
    }
    result
}

/// A photo that found a reference point.
#[derive(Clone, Copy, Debug)]
struct Found {
    /// The reference point's number in its own photo.
    point: u32,
    /// Where it was found.
    seen: Observation,
}

impl Round<'_> {
    fn blocks_around(&self) -> i64 {
        self.grid.columns / BLOCK as i64
    }

    fn patch<P: Photos + ?Sized>(&self, photo: usize, footprint: &Footprint, photos: &P) -> Option<Patch> {
        let pixels = photos.load(photo)?;
        if !has_size_of(&pixels, self.grid.camera) {
            return None;
        }
        Some(Patch::new(&self.grid, &self.poses[photo].tunnel_from_cam, footprint, &pixels, self.config))
    }

    /// The reference points of a photo that others found, in the order of the points, then of the photos.
    fn tracks_of(&self, photo: usize, patch: &Patch, mut found: Vec<Found>) -> Tracks {
        let mut tracks = Tracks::default();
        found.sort_unstable_by_key(|one| (one.point, one.seen.photo));
        for group in found.chunk_by(|a, b| a.point == b.point) {
            let place = global_place(patch, patch.points[group[0].point as usize]);
            let pixel = self.grid.pixel(&self.poses[photo].tunnel_from_cam, place[0], place[1]);
            if let (Some(pixel), Some(point)) = (pixel, self.grid.point(place[0], place[1])) {
                let reference = Observation { photo: photo as u32, pixel: [pixel.x as f32, pixel.y as f32] };
                tracks.push(point.position, std::iter::once(reference).chain(group.iter().map(|one| one.seen)));
            }
        }
        tracks
    }

    /// Tries a pair; `None` if a photo is missing or the masks leave too little overlap.
    fn pair(
        &self,
        expected: &ExpectedPair,
        patches: &Patches,
        search: &mut Search,
    ) -> Option<(PairReport, Vec<Match>)> {
        let [first, second] = expected.photos;
        let pair = [patches[first].as_deref()?, patches[second].as_deref()?];
        let overlap = pair[0].footprint.overlap(&pair[1].footprint, self.blocks_around());
        if overlap < self.config.min_overlap {
            return None;
        }
        let candidates = self.candidates(pair);
        let reach_px = self.reach_px(expected.photos, &candidates);
        let mut report = PairReport {
            first: first as u32,
            second: second as u32,
            overlap,
            attempted: candidates.len() as u32,
            matched: 0,
            agreeing: 0,
            kept: false,
            widened: false,
            shift_m: [0.0; 2],
            too_uncertain: reach_px.iter().any(|&reach| reach > self.config.max_search_px),
        };
        if report.too_uncertain {
            return Some((report, Vec::new()));
        }
        let searched = PairSearch { round: self, photos: expected.photos, pair, candidates: &candidates };
        let mut matches = searched.run(reach_px, search, &mut report);
        if report.is_doubtful() && self.config.widen > 1.0 {
            let wider_px = reach_px.map(|reach| (reach as f64 * self.config.widen).round() as usize);
            let mut again = PairReport { widened: true, ..report };
            let found = searched.run(wider_px, search, &mut again);
            report.widened = true;
            if again.agreeing > report.agreeing {
                (report, matches) = (again, found);
            }
        }
        Some((report, matches))
    }

    /// Half-width and half-height of the search: the uncertainty of the displacement between the two photos.
    fn reach_px(&self, photos: [usize; 2], candidates: &[Candidate]) -> [usize; 2] {
        let poses = photos.map(|photo| &self.poses[photo]);
        let mut sigma_m = [0.0_f64; 2];
        for candidate in candidates.iter().step_by((candidates.len() / WINDOW_SAMPLES).max(1)) {
            if let Some(point) = self.grid.point(candidate.reference[0], candidate.reference[1]) {
                let here_m = displacement_sigma_m(&point, poses);
                sigma_m = [0, 1].map(|axis| sigma_m[axis].max(here_m[axis]));
            }
        }
        sigma_m.map(|sigma_m| {
            let reach_px = (self.config.search_sigmas * sigma_m / self.grid.step_m).ceil() as usize;
            reach_px.max(self.config.min_search_px)
        })
    }

    /// Reference points of both photos that the other should see, by the poses.
    fn candidates(&self, pair: [&Patch; 2]) -> Vec<Candidate> {
        let mut candidates = Vec::new();
        for from in [0, 1] {
            let (source, target) = (pair[from], pair[1 - from]);
            // The same wall may be counted a turn apart in the two photos.
            let turns = target.footprint.turns_to(&source.footprint, self.blocks_around()) * BLOCK as i64;
            for (point, &place) in source.points.iter().enumerate() {
                let predicted = [
                    place[0] as i64 + source.origin[0] + turns - target.origin[0],
                    place[1] as i64 + source.origin[1] - target.origin[1],
                ];
                if target.is_usable(predicted) {
                    candidates.push(Candidate {
                        from,
                        point,
                        place,
                        predicted,
                        reference: global_place(source, place),
                    });
                }
            }
        }
        candidates
    }

    fn size(&self, reach: [usize; 2]) -> SearchSize {
        SearchSize { half: self.config.template_px / 2, reach, min_ncc: self.config.min_ncc }
    }

    /// Half-width of the search around a prediction from probes.
    fn narrow_px(&self) -> usize {
        ((2.0 * self.config.gate_px).ceil() as usize + 2).max(self.config.min_search_px)
    }

    fn motion(&self, photos: [usize; 2], matches: &[Match], reach_px: [usize; 2]) -> PairMotion<'_> {
        let displacements: Vec<Displacement> = matches.iter().filter_map(|one| self.displacement(one)).collect();
        let step_m = self.grid.step_m;
        let poses = photos.map(|photo| &self.poses[photo]);
        let reach_m = reach_px[0].max(reach_px[1]) as f64 * step_m;
        PairMotion::fit(&displacements, poses, reach_m, self.config.gate_px * step_m)
    }

    fn agrees(&self, motion: &PairMotion<'_>, one: &Match) -> bool {
        let gate_m = self.config.gate_px * self.grid.step_m;
        self.displacement(one).is_some_and(|displacement| motion.agrees(&displacement, gate_m))
    }

    fn displacement(&self, one: &Match) -> Option<Displacement> {
        let point = self.grid.point(one.candidate.reference[0], one.candidate.reference[1])?;
        let sign = one.candidate.sign();
        Some(Displacement { point, found_m: one.displacement.map(|texels| sign * texels * self.grid.step_m) })
    }

    fn predicted_offset(&self, motion: &PairMotion<'_>, candidate: &Candidate) -> Option<[i64; 2]> {
        let point = self.grid.point(candidate.reference[0], candidate.reference[1])?;
        let texels = motion.displacement_m(&point) * (candidate.sign() / self.grid.step_m);
        Some([texels.x.round() as i64, texels.y.round() as i64])
    }

    fn collect(&self, report: &PairReport, matches: &[Match], found: &mut [Vec<Found>]) {
        if !report.kept {
            return;
        }
        let photos = [report.first, report.second];
        for one in matches {
            let photo = photos[1 - one.candidate.from];
            let place = [0, 1].map(|axis| one.candidate.reference[axis] + one.displacement[axis]);
            let pose = &self.poses[photo as usize].tunnel_from_cam;
            if let Some(pixel) = self.grid.pixel(pose, place[0], place[1]) {
                let seen = Observation { photo, pixel: [pixel.x as f32, pixel.y as f32] };
                found[photos[one.candidate.from] as usize].push(Found { point: one.candidate.point as u32, seen });
            }
        }
    }
}

/// A pair about to be searched.
struct PairSearch<'a> {
    round: &'a Round<'a>,
    photos: [usize; 2],
    pair: [&'a Patch; 2],
    candidates: &'a [Candidate],
}

impl PairSearch<'_> {
    /// Searches the pair's points in a window and keeps what agrees with one motion.
    ///
    /// A few probes are searched for in the whole window. If they clearly agree, the others are near their prediction; if
    /// even the most probes hardly agree, the others would not either.
    fn run(&self, reach_px: [usize; 2], search: &mut Search, report: &mut PairReport) -> Vec<Match> {
        let round = self.round;
        let (wide, narrow) = (round.size(reach_px), round.size([round.narrow_px(); 2]));
        let count = self.candidates.len();
        let worth_probing = 2 * narrow.reach[0].max(narrow.reach[1]) < reach_px[0].max(reach_px[1]);
        let mut probed = vec![false; count];
        let mut matches = Vec::new();
        let mut tries = 0;
        let mut clear = None;
        for most in if worth_probing { [PROBES, MOST_PROBES] } else { [count; 2] } {
            let stride = (count / most.max(1)).max(1);
            for index in (0..count).step_by(stride) {
                if !std::mem::replace(&mut probed[index], true) {
                    tries += 1;
                    matches.extend(self.find(&self.candidates[index], [0, 0], &wide, search));
                }
            }
            if !worth_probing {
                break;
            }
            let motion = round.motion(self.photos, &matches, reach_px);
            let agreeing = matches.iter().filter(|one| round.agrees(&motion, one)).count();
            if agreeing as f64 >= (PROBES_AGREEING * matches.len() as f64).max(0.5 * PROBES as f64) {
                clear = Some(motion);
                break;
            }
            if tries >= MOST_PROBES && agreeing < round.config.min_agreeing {
                report.matched = matches.len() as u32;
                return Vec::new();
            }
        }
        for (candidate, _) in self.candidates.iter().zip(&probed).filter(|(_, probed)| !**probed) {
            let offset = clear.as_ref().and_then(|motion| round.predicted_offset(motion, candidate));
            matches.extend(match offset {
                Some(offset) => self.find(candidate, offset, &narrow, search),
                None => self.find(candidate, [0, 0], &wide, search),
            });
        }
        report.matched = matches.len() as u32;
        let motion = round.motion(self.photos, &matches, reach_px);
        matches.retain(|one| round.agrees(&motion, one));
        report.agreeing = matches.len() as u32;
        report.shift_m = [0, 1].map(|axis| {
            let shifts: Vec<f64> = matches.iter().map(|one| one.candidate.sign() * one.displacement[axis]).collect();
            median(&shifts) * round.grid.step_m
        });
        let least = (round.config.min_agreeing_share * f64::from(report.matched)).max(round.config.min_agreeing as f64);
        report.kept = f64::from(report.agreeing) >= least;
        matches
    }

    fn find(&self, candidate: &Candidate, offset: [i64; 2], size: &SearchSize, search: &mut Search) -> Option<Match> {
        let (source, target) = (self.pair[candidate.from], self.pair[1 - candidate.from]);
        let middle = [0, 1].map(|axis| candidate.predicted[axis] + offset[axis]);
        let peak = search.find(source, candidate.place, target, middle, size)?;
        let displacement = [0, 1].map(|axis| peak.offset[axis] + offset[axis] as f64);
        Some(Match { candidate: *candidate, displacement })
    }
}

fn global_place(patch: &Patch, point: [usize; 2]) -> [f64; 2] {
    [0, 1].map(|axis| (patch.origin[axis] + point[axis] as i64) as f64)
}

fn has_size_of(pixels: &Pixels<'_>, camera: &Camera<f64>) -> bool {
    let expected = (camera.width_px as usize, camera.height_px as usize);
    let mask_fits = pixels.mask.as_ref().is_none_or(|mask| (mask.width, mask.height) == expected);
    (pixels.grey.width, pixels.grey.height) == expected && mask_fits
}
