//! One round of matching over all photos, a few held at a time.

use std::mem::take;
use std::ops::Range;
use std::sync::{Mutex, MutexGuard, PoisonError};

use adit_geometry::camera::Camera;
use adit_geometry::profile::Profile;
use rayon::prelude::*;

use super::level::{Hint, Level, Match, PairSearch, global_place};
use super::pairs::{ExpectedPair, expected_pairs, last_needed};
use super::patch::{Bench, Patch};
use super::repeats::repeat_px;
use super::search::Search;
use super::wall::Footprint;
use super::{MatchConfig, MatchRound, PairReport, Photos, ViewPose};
use crate::adjust::{Observation, Tracks};

/// A photo as loaded.
struct View {
    sharp: Patch,
    /// Of a photo whose wall repeats itself: how soon, texels, and the photo too blurred to show it.
    repeating: Option<(f64, Patch)>,
}

/// Photos from whose points the room for those of all is guessed.
const RESERVE_AFTER: usize = 100;
/// And so much more: the first ones have fewer partners than most. What is reserved and not used costs no memory; to grow at the
/// end costs all of it once more.
const RESERVE: f64 = 1.25;

/// Photos as loaded so far.
type Views = Vec<Option<Box<View>>>;

/// What [`match_round`] needs at every step.
struct Round<'a> {
    sharp: Level<'a>,
    /// Where repetitions vanish; `None` if the windows are smaller than what repeats.
    blurred: Option<Level<'a>>,
    /// As many as photos were ever worked on at once.
    benches: Mutex<Vec<Bench>>,
    /// Memory of photos that are done with.
    texels: Mutex<Vec<Vec<i8>>>,
}

fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
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
    let round = Round {
        sharp: Level::new(profile, camera, poses, config.clone()),
        blurred: config.blurred().map(|config| Level::new(profile, camera, poses, config)),
        benches: Mutex::default(),
        texels: Mutex::default(),
    };
    let footprints: Vec<Option<Footprint>> =
        poses.par_iter().map(|pose| Footprint::new(&round.sharp.grid, &pose.tunnel_from_cam)).collect();
    let mut expected =
        expected_pairs(&footprints, round.sharp.blocks_around(), config.min_overlap, config.max_partners);
    expected.retain(|pair| wanted(pair.photos));
    let last_needed = last_needed(&expected, poses.len());
    let mut views: Views = std::iter::repeat_with(|| None).take(poses.len()).collect();
    let mut unfinished = Unfinished::new(poses.len());
    let mut result = MatchRound::default();
    let batch = (2 * rayon::current_num_threads()).max(8);
    let mut waiting = expected.as_slice();
    let load = |batch: Range<usize>| -> Views {
        let view = |search: &mut Search, photo: usize| {
            last_needed[photo]?;
            round.view(photo, footprints[photo].as_ref()?, photos, search).map(Box::new)
        };
        batch.into_par_iter().map_init(Search::default, view).collect()
    };
    let most_texels = footprints.iter().flatten().map(Footprint::texels).max().unwrap_or(0);
    // Made by the thread that frees it at the end of the round: what another one frees may stay with its maker for long.
    let provide = |photos: usize| {
        let mut memory: Vec<_> = std::iter::repeat_with(|| Vec::with_capacity(most_texels)).take(photos).collect();
        locked(&round.texels).append(&mut memory);
    };
    // Of the photos from one on: what two batches need.
    let needed = |first: usize| (poses.len() - first).min(2 * batch);
    provide(needed(0));
    let mut loaded = load(0..batch.min(poses.len()));
    for start in (0..poses.len()).step_by(batch) {
        let end = (start + batch).min(poses.len());
        for (photo, view) in (start..end).zip(loaded) {
            if view.is_none() && (last_needed[photo].is_some() || footprints[photo].is_none()) {
                result.unusable.push(photo as u32);
            }
            views[photo] = view;
        }
        let (ready, later) = waiting.split_at(waiting.partition_point(|pair| pair.photos[1] < end));
        waiting = later;
        let search = || -> Vec<Option<(PairReport, Vec<Finding>)>> {
            ready.par_iter().map_init(Search::default, |search, pair| round.pair(pair, &views, search)).collect()
        };
        let missing = {
            let mut texels = locked(&round.texels);
            texels.truncate(needed(end));
            needed(end) - texels.len()
        };
        let (mut searched, mut next_loaded) = (Vec::new(), Vec::new());
        // Neither waits for the other's last photo or pair, and no thread for the system to clear memory.
        rayon::in_place_scope(|scope| {
            scope.spawn(|_| searched = search());
            scope.spawn(|_| next_loaded = load(end..(end + batch).min(poses.len())));
            provide(missing);
        });
        loaded = next_loaded;
        for (report, findings) in searched.into_iter().flatten() {
            for Finding { of, found } in findings {
                unfinished.found[of as usize].push(found);
            }
            result.pairs.push(report);
        }
        unfinished.finish(&round, &mut views, &last_needed, end);
        unfinished.append_next(end, &mut result.tracks);
        progress(end);
    }
    result
}

/// What was found of photos so far, and the tracks of those of which no more will be.
struct Unfinished {
    found: Vec<Vec<Found>>,
    finished: Vec<Option<Tracks>>,
    /// The first photo whose tracks have not been handed on.
    next: usize,
}

impl Unfinished {
    fn new(photos: usize) -> Self {
        Self { found: vec![Vec::new(); photos], finished: vec![None; photos], next: 0 }
    }

    /// Makes the tracks of the photos before `end` that no later one needs, and takes their views' memory.
    fn finish(&mut self, round: &Round<'_>, views: &mut Views, last_needed: &[Option<usize>], end: usize) {
        let is_last =
            |photo: &usize| self.finished[*photo].is_none() && last_needed[*photo].is_none_or(|last| last < end);
        let last: Vec<usize> = (0..end).filter(is_last).collect();
        let last: Vec<_> =
            last.into_iter().map(|photo| (photo, views[photo].take(), take(&mut self.found[photo]))).collect();
        let tracks_of = |(photo, view, found): (usize, Option<Box<View>>, Vec<Found>)| {
            let Some(view) = view else { return (photo, Tracks::default()) };
            let tracks = round.tracks_of(photo, &view.sharp, found);
            locked(&round.texels).push(view.sharp.texels.into_memory());
            (photo, tracks)
        };
        for (photo, tracks) in last.into_par_iter().map(tracks_of).collect::<Vec<_>>() {
            self.finished[photo] = Some(tracks);
        }
    }

    /// Appends the tracks that are finished, in order of the photos, whatever the batches are.
    fn append_next(&mut self, end: usize, tracks: &mut Tracks) {
        while let Some(Some(finished)) = self.finished.get(self.next).filter(|_| self.next < end) {
            tracks.append(finished);
            if self.next == RESERVE_AFTER {
                tracks.reserve_times(RESERVE * self.finished.len() as f64 / self.next as f64);
            }
            self.finished[self.next] = Some(Tracks::default());
            self.next += 1;
        }
    }
}

/// A photo that found a reference point.
#[derive(Clone, Copy, Debug)]
struct Found {
    /// The reference point's number in its own photo.
    point: u32,
    /// Where it was found.
    seen: Observation,
}

/// A reference point of photo `of` was found.
struct Finding {
    of: u32,
    found: Found,
}

impl Round<'_> {
    fn view<P: Photos + ?Sized>(
        &self,
        photo: usize,
        footprint: &Footprint,
        photos: &P,
        search: &mut Search,
    ) -> Option<View> {
        let pixels = photos.load(photo)?;
        let (grey, camera) = (pixels.grey(), self.sharp.grid.camera);
        if [grey.width, grey.height] != [camera.width_px as usize, camera.height_px as usize] {
            return None;
        }
        let mut bench = locked(&self.benches).pop().unwrap_or_default();
        let memory = locked(&self.texels).pop().unwrap_or_default();
        let sharp = self.sharp.patch(photo, footprint, &pixels, &mut bench, memory);
        let repeating = self.blurred.as_ref().and_then(|level| {
            let repeat_px = repeat_px(&sharp, &self.sharp.config, search)?;
            let footprint = Footprint::new(&level.grid, &level.poses[photo].tunnel_from_cam)?;
            Some((repeat_px, level.patch(photo, &footprint, &pixels, &mut bench, Vec::new())))
        });
        locked(&self.benches).push(bench);
        Some(View { sharp, repeating })
    }

    /// The reference points of a photo that others found, in the order of the points, then of the photos.
    fn tracks_of(&self, photo: usize, patch: &Patch, mut found: Vec<Found>) -> Tracks {
        let mut tracks = Tracks::default();
        found.sort_unstable_by_key(|one| (one.point, one.seen.photo));
        for group in found.chunk_by(|a, b| a.point == b.point) {
            let place = global_place(patch, patch.points[group[0].point as usize]);
            let pixel = self.sharp.grid.pixel(&self.sharp.poses[photo].tunnel_from_cam, place[0], place[1]);
            if let (Some(pixel), Some(point)) = (pixel, self.sharp.grid.point(place[0], place[1])) {
                let reference = Observation { photo: photo as u32, pixel: [pixel.x as f32, pixel.y as f32] };
                tracks.push(point.position, std::iter::once(reference).chain(group.iter().map(|one| one.seen)));
            }
        }
        tracks
    }

    /// Tries a pair; `None` if a photo is missing or the masks leave too little overlap.
    fn pair(&self, expected: &ExpectedPair, views: &Views, search: &mut Search) -> Option<(PairReport, Vec<Finding>)> {
        let photos = expected.photos;
        let views = [views[photos[0]].as_deref()?, views[photos[1]].as_deref()?];
        let pair = views.map(|view| &view.sharp);
        let level = &self.sharp;
        let overlap = pair[0].footprint.overlap(&pair[1].footprint, level.blocks_around());
        if overlap < level.config.min_overlap {
            return None;
        }
        let candidates = level.candidates(pair);
        let needed_px = level.needed_px(photos, &candidates);
        let mut report = PairReport {
            first: photos[0] as u32,
            second: photos[1] as u32,
            overlap,
            attempted: candidates.len() as u32,
            matched: 0,
            agreeing: 0,
            kept: false,
            widened: false,
            shift_m: [0.0; 2],
            too_uncertain: needed_px.iter().any(|&reach| reach > level.config.max_search_px),
        };
        if report.too_uncertain {
            return Some((report, Vec::new()));
        }
        let searched = PairSearch { level, photos, pair, candidates: &candidates };
        let matches = match views.map(|view| view.repeating.as_ref()) {
            [Some(first), Some(second)] => {
                let most_px = 0.5 * first.0.min(second.0) - 1.0;
                self.among_repeats(&searched, [&first.1, &second.1], needed_px, most_px, search, &mut report)
            }
            _ => searched.run_widening(level.reach_px(needed_px), search, &mut report),
        };
        let findings = if report.kept { self.findings(photos, &matches) } else { Vec::new() };
        Some((report, findings))
    }

    /// Searches a pair whose wall repeats itself: nowhere farther than `most_px` from where the point is expected.
    fn among_repeats(
        &self,
        searched: &PairSearch<'_>,
        blurred: [&Patch; 2],
        needed_px: [usize; 2],
        most_px: f64,
        search: &mut Search,
        report: &mut PairReport,
    ) -> Vec<Match> {
        let hint = if needed_px.iter().all(|&needed| needed as f64 <= most_px) {
            Some(Hint::default())
        } else {
            self.hint(searched.photos, blurred, report, search)
        };
        let Some(hint) = hint else {
            report.too_uncertain = true;
            return Vec::new();
        };
        searched.run_near(&hint, most_px as usize, searched.level.reach_px(needed_px), search, report)
    }

    /// What two photos that are too blurred to show what repeats say of their motion.
    fn hint(&self, photos: [usize; 2], pair: [&Patch; 2], report: &PairReport, search: &mut Search) -> Option<Hint> {
        let level = self.blurred.as_ref()?;
        let candidates = level.candidates(pair);
        let searched = PairSearch { level, photos, pair, candidates: &candidates };
        let mut report = *report;
        let matches = searched.run_widening(level.reach_px(level.needed_px(photos, &candidates)), search, &mut report);
        let clear = report.kept && !report.is_doubtful();
        clear.then(|| Hint { found: level.displacements(&matches), gate_m: level.gate_m() })
    }

    /// Where matches lie in the photos that found them.
    fn findings(&self, photos: [usize; 2], matches: &[Match]) -> Vec<Finding> {
        let finding = |one: &Match| {
            let photo = photos[1 - one.candidate.from];
            let place = [0, 1].map(|axis| one.candidate.reference[axis] + one.displacement[axis]);
            let pixel = self.sharp.grid.pixel(&self.sharp.poses[photo].tunnel_from_cam, place[0], place[1])?;
            let seen = Observation { photo: photo as u32, pixel: [pixel.x as f32, pixel.y as f32] };
            let found = Found { point: one.candidate.point as u32, seen };
            Some(Finding { of: photos[one.candidate.from] as u32, found })
        };
        matches.iter().filter_map(finding).collect()
    }
}
