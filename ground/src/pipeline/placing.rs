//! The coarse stage: from tags to poses that are good to a few millimetres, or a plain word that a photo has no place.
//!
//! A first round searches every pair within the tags' uncertainty and adjusts. Whatever it leaves open is taken up again:
//! - Pairs that were too uncertain against each other (no odometer, say) are searched once their photos have found a place.
//! - A photo that does not hang together with the others, or whose matches the adjustment disputes, is lost. Its tag may be
//!   worse than it says, or belong to another capture: a servo that slipped, a photo that the pairing of photos and tags
//!   counted twice. Each [`Guess`] about its tag is tried against the photos that have a place, and the one that most
//!   matches agree with is believed.
//!
//! Nothing is believed for one pair's sake only: repeated bricks give chance agreements.

use std::collections::{BTreeMap, BTreeSet};

use adit_protocol::tag::CaptureTag;
use anyhow::Result;
use nalgebra::{Isometry3, Vector3};

use super::groups::{Groups, PairShare, hanging_together, pair_shares};
use super::photos::Use;
use super::progress::StageProgress;
use super::solve::Solver;
use super::stages::{CoarseStage, PriorStage, RoundSummary, TagSlip};
use crate::adjust::{AdjustReport, Observation, Shared, Tracks, adjust_roughly};
use crate::matching::{MatchConfig, MatchRound, PairReport, ViewPose};
use crate::prior::TagPrior;
use crate::survey::Loss;

/// One standard deviation, against its neighbours, of a pose that the coarse round found: optical centre (metres), rotation
/// (radians). What all photos share (the roll gauge, the frame) moves no match.
const PLACED_SIGMAS: [f64; 2] = [0.002, 0.0005];
/// Times that open pairs and lost photos are taken up again.
const MOST_ROUNDS: usize = 4;
/// A guess about a lost photo needs this many agreeing matches, in two pairs or more.
const LEAST_AGREEING: u32 = 30;

/// What may be wrong with a lost photo's tag.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Guess {
    /// Nothing but that it is twice as uncertain as it says.
    Uncertain,
    /// Everything: the photo stands between its neighbours.
    Between,
    /// It is that of a capture before (negative) or after.
    Slipped(isize),
}

const GUESSES: [Guess; 6] =
    [Guess::Uncertain, Guess::Between, Guess::Slipped(1), Guess::Slipped(-1), Guess::Slipped(2), Guess::Slipped(-2)];

/// What is known of the photos while their places are looked for.
pub(super) struct Placing<'a> {
    solver: &'a Solver<'a>,
    /// Tags as believed.
    raw: Vec<Option<CaptureTag>>,
    tags: Vec<TagPrior>,
    views: Vec<ViewPose>,
    shared: Shared,
    /// Photos that hang together.
    placed: Vec<bool>,
    /// Photos that the adjustment disputed once: not believed a second time without a new guess.
    disputed: Vec<bool>,
    tracks: Tracks,
    pairs: BTreeMap<[u32; 2], PairReport>,
    slips: Vec<TagSlip>,
    /// There are tags to guess about.
    tagged: bool,
    losses: Vec<Loss>,
    unusable: Vec<u32>,
}

impl<'a> Placing<'a> {
    pub(super) fn new(solver: &'a Solver<'a>, prior: &PriorStage) -> Self {
        let photos = prior.views.len();
        Self {
            solver,
            raw: solver.survey.photos.iter().map(|photo| photo.tag).collect(),
            tags: prior.tags.clone(),
            views: prior.views.clone(),
            shared: solver.shared_prior(),
            placed: vec![false; photos],
            disputed: vec![false; photos],
            tracks: Tracks::default(),
            pairs: BTreeMap::new(),
            slips: Vec::new(),
            tagged: prior.tagged,
            losses: prior.losses.clone(),
            unusable: Vec::new(),
        }
    }

    /// Runs all rounds.
    ///
    /// # Errors
    /// If the normal equations cannot be solved.
    pub(super) fn run(mut self, progress: &StageProgress) -> Result<CoarseStage> {
        let config = self.solver.wide();
        let views = self.views.clone();
        let round = self.round(&views, &|photo| photo, &config, &|_| true, progress);
        self.unusable = round.unusable;
        self.pairs = round.pairs.into_iter().map(|pair| ([pair.first, pair.second], pair)).collect();
        self.tracks = round.tracks;
        if self.pairs.values().any(|pair| pair.too_uncertain) {
            self.line_up();
        }
        let mut report = self.adjust()?;
        for _ in 0..MOST_ROUNDS {
            let opened = self.search_open_pairs(&config, progress);
            let found = self.seek_lost(&config, progress);
            if !opened && !found {
                break;
            }
            report = self.adjust()?;
        }
        let (views, placed) = (self.views, self.placed);
        let pairs: Vec<PairReport> = self.pairs.into_values().collect();
        Ok(CoarseStage {
            round: RoundSummary::new(&pairs, &self.tracks, self.solver.survey),
            views,
            placed,
            tags: self.tags,
            slips: self.slips,
            shared: self.shared,
            adjustment: report,
            losses: self.losses,
        })
    }

    /// Moves the photos along the axis to where their pairs' shifts say, from photo to photo over the best joined pairs.
    ///
    /// A photo's unknown tilt shifts what it sees as well, but cancels along the chain: each place is wrong by its own
    /// photo's tilt only.
    fn line_up(&mut self) {
        let mut joins: Vec<&PairReport> = self.pairs.values().filter(|pair| is_joined(pair)).collect();
        joins.sort_by_key(|pair| std::cmp::Reverse(pair.agreeing));
        let tree = spanning_tree(self.views.len(), &joins);
        let mut moved = vec![None; self.views.len()];
        for root in 0..moved.len() {
            if moved[root].is_some() {
                continue;
            }
            moved[root] = Some(0.0);
            let mut open = vec![root];
            while let Some(from) = open.pop() {
                let Some(from_m) = moved[from] else { continue };
                for &(to, shift_m) in &tree[from] {
                    if moved[to].is_none() {
                        // A camera that stands farther along than believed sees everything nearer than it is.
                        moved[to] = Some(from_m - shift_m);
                        open.push(to);
                    }
                }
            }
        }
        for (view, moved_m) in self.views.iter_mut().zip(moved) {
            view.tunnel_from_cam.translation.x += moved_m.unwrap_or_default();
        }
    }

    fn round(
        &mut self,
        views: &[ViewPose],
        photo_of: &(dyn Fn(usize) -> usize + Sync),
        config: &MatchConfig,
        wanted: &dyn Fn([usize; 2]) -> bool,
        progress: &StageProgress,
    ) -> MatchRound {
        let (round, losses) = self.solver.round(views, photo_of, config, wanted, Use::Again, progress);
        self.losses.extend(losses);
        self.losses.sort_by(|a, b| (&a.what, &a.why).cmp(&(&b.what, &b.why)));
        self.losses.dedup();
        round
    }

    /// Takes over a round's pairs and matches, those between accepted views; `photo_of` tells which photo a view is of.
    fn take(&mut self, round: MatchRound, photo_of: &dyn Fn(usize) -> usize, accepted: impl Fn([usize; 2]) -> bool) {
        let photo = |view: u32| photo_of(view as usize) as u32;
        for pair in round.pairs {
            if accepted([pair.first, pair.second].map(|view| view as usize)) {
                let (first, second) = (photo(pair.first), photo(pair.second));
                self.pairs.insert([first, second], PairReport { first, second, ..pair });
            }
        }
        for (position, seen) in round.tracks.iter() {
            let with_reference = |other: u32| accepted([seen[0].photo as usize, other as usize]);
            let others = seen[1..].iter().filter(|other| with_reference(other.photo));
            let kept: Vec<_> = std::iter::once(&seen[0]).chain(others).copied().collect();
            if kept.len() > 1 {
                let of_photos = |seen: Observation| Observation { photo: photo(seen.photo), ..seen };
                self.tracks.push(*position, kept.into_iter().map(of_photos));
            }
        }
    }

    /// Adjusts what hangs together and takes over its poses; a photo whose matches are then mostly disputed loses them and its
    /// place, and the rest is adjusted again from where it stands.
    fn adjust(&mut self) -> Result<AdjustReport> {
        loop {
            let joined = self
                .pairs
                .values()
                .filter(|pair| is_joined(pair))
                .map(|pair| [pair.first as usize, pair.second as usize]);
            self.placed = hanging_together(joined, self.placed.len());
            let mut tracks = self.tracks.clone();
            tracks.retain(|_, seen| {
                seen.retain(|seen| self.placed[seen.photo as usize]);
                seen.len() >= 2
            });
            let poses: Vec<Isometry3<f64>> = self.views.iter().map(|view| view.tunnel_from_cam).collect();
            self.solver.put_on_wall(&mut tracks, &poses);
            let given = self.solver.problem(&self.tags, &poses, &tracks, self.shared);
            let adjusted = adjust_roughly(&given, &self.solver.coarse_weights())?;
            tracks.positions_mut().copy_from_slice(&adjusted.points);
            self.shared = adjusted.shared;
            let shares = pair_shares(
                &tracks,
                &adjusted.poses,
                &self.solver.survey.config.camera.camera,
                self.solver.disputed_px(),
            );
            let newly = self.newly_disputed(&shares);
            for &photo in &newly {
                self.forget(photo);
            }
            self.update_views(&adjusted.poses);
            if newly.is_empty() {
                return Ok(adjusted.report);
            }
        }
    }

    /// Placed photos for which most of the matches in most of their pairs are disputed, for the first time.
    fn newly_disputed(&self, shares: &BTreeMap<[u32; 2], PairShare>) -> Vec<usize> {
        let mut counts = vec![[0_usize; 2]; self.placed.len()];
        for (photos, share) in shares {
            for &photo in photos {
                let [all, bad] = &mut counts[photo as usize];
                *all += 1;
                *bad += usize::from(share.is_disputed());
            }
        }
        let is_new = |photo: &usize| {
            let [all, bad] = counts[*photo];
            self.placed[*photo] && !self.disputed[*photo] && 2 * bad > all
        };
        (0..counts.len()).filter(is_new).collect()
    }

    /// Takes a photo's matches and its place away.
    fn forget(&mut self, photo: usize) {
        self.disputed[photo] = true;
        self.placed[photo] = false;
        self.tracks.retain(|_, seen| {
            seen.retain(|seen| seen.photo as usize != photo);
            seen.len() >= 2
        });
        for (photos, pair) in &mut self.pairs {
            pair.kept &= !photos.contains(&(photo as u32));
        }
    }

    /// Poses after an adjustment. A photo without a place stands by its tag, moved along the axis like its neighbours.
    fn update_views(&mut self, adjusted: &[Isometry3<f64>]) {
        let prior = self.solver.views(&self.tags, &self.shared);
        let moved = |photo: usize| adjusted[photo].translation.x - prior[photo].tunnel_from_cam.translation.x;
        let placed: Vec<usize> = (0..self.placed.len()).filter(|&photo| self.placed[photo]).collect();
        let view = |(photo, pose): (usize, &Isometry3<f64>)| {
            if self.placed[photo] { placed_view(*pose) } else { beside(&prior, photo, &placed, moved) }
        };
        self.views = adjusted.iter().enumerate().map(view).collect();
    }

    /// Searches pairs of placed photos that were too uncertain, or did not look like overlapping, before. Tells if one was kept.
    fn search_open_pairs(&mut self, config: &MatchConfig, progress: &StageProgress) -> bool {
        if !self.pairs.values().any(|pair| pair.too_uncertain) {
            return false;
        }
        let (views, placed) = (self.views.clone(), self.placed.clone());
        let tried: BTreeSet<[u32; 2]> =
            self.pairs.iter().filter(|(_, pair)| !pair.too_uncertain).map(|(photos, _)| *photos).collect();
        let wanted = |photos: [usize; 2]| {
            photos.iter().all(|&photo| placed[photo]) && !tried.contains(&photos.map(|photo| photo as u32))
        };
        let round = self.round(&views, &|photo| photo, config, &wanted, progress);
        let any = round.pairs.iter().any(|pair| pair.kept);
        self.take(round, &|photo| photo, |_| true);
        any
    }

    /// Tries every guess about the lost photos' tags against the placed photos, all in one round. Tells if one was believed.
    fn seek_lost(&mut self, config: &MatchConfig, progress: &StageProgress) -> bool {
        let is_lost = |photo: usize| !self.placed[photo] && !self.unusable.contains(&(photo as u32));
        let lost: Vec<bool> = (0..self.placed.len()).map(is_lost).collect();
        if !self.tagged || !lost.contains(&true) || !self.placed.contains(&true) {
            return false;
        }
        let guessed = GUESSES.map(|guess| self.guessed(&lost, guess));
        let (mut trials, mut views) = (Vec::new(), Vec::new());
        for (photo, &is_lost) in lost.iter().enumerate() {
            if is_lost {
                trials.extend((0..GUESSES.len()).map(|guess| Trial { photo, guess: Some(guess) }));
                views.extend(guessed.iter().map(|guessed| guessed.views[photo]));
            } else if self.placed[photo] {
                trials.push(Trial { photo, guess: None });
                views.push(self.views[photo]);
            }
        }
        let wanted = |[a, b]: [usize; 2]| trials[a].guess.is_some() != trials[b].guess.is_some();
        // A wide window that did not find anything once is not tried a second time.
        let max_partners = config.max_partners * GUESSES.len();
        let config = MatchConfig { widen: 1.0, max_partners, ..config.clone() };
        let photo_of = |view: usize| trials[view].photo;
        let round = self.round(&views, &photo_of, &config, &wanted, progress);
        let best = best_guesses(lost.len(), &trials, &round.pairs);
        let believed = |view: usize| trials[view].guess.is_some_and(|guess| best[trials[view].photo] == Some(guess));
        for (photo, guess) in best.iter().enumerate() {
            let Some(guess) = *guess else { continue };
            match GUESSES[guess] {
                Guess::Slipped(by) => self.slips.push(TagSlip { photo: photo as u32, captures: Some(by as i32) }),
                Guess::Between if self.raw[photo].is_some() => {
                    self.slips.push(TagSlip { photo: photo as u32, captures: None });
                }
                Guess::Between | Guess::Uncertain => {}
            }
            self.raw[photo] = guessed[guess].raw[photo];
        }
        self.take(round, &photo_of, |[a, b]| believed(a) || believed(b));
        self.tags = self.solver.tag_priors(&self.raw);
        best.iter().any(Option::is_some)
    }

    /// Tags and views under a guess about the lost photos.
    fn guessed(&self, lost: &[bool], guess: Guess) -> Guessed {
        let of_photo = |photo: usize| match guess {
            _ if !lost[photo] => self.raw[photo],
            Guess::Uncertain => self.raw[photo],
            Guess::Between => None,
            Guess::Slipped(by) => {
                photo.checked_add_signed(by).and_then(|other| self.solver.survey.photos.get(other)?.tag)
            }
        };
        let raw: Vec<Option<CaptureTag>> = (0..lost.len()).map(of_photo).collect();
        let prior = self.solver.views(&self.solver.tag_priors(&raw), &self.shared);
        let placed: Vec<usize> = (0..lost.len()).filter(|&photo| self.placed[photo]).collect();
        let moved =
            |photo: usize| self.views[photo].tunnel_from_cam.translation.x - prior[photo].tunnel_from_cam.translation.x;
        let view = |photo: usize| {
            if !lost[photo] {
                return self.views[photo];
            }
            let mut view = beside(&prior, photo, &placed, moved);
            if guess == Guess::Uncertain {
                view.position_sigma_m = view.position_sigma_m.map(|sigma_m| 2.0 * sigma_m);
                view.rotation_sigma_rad = view.rotation_sigma_rad.map(|sigma_rad| 2.0 * sigma_rad);
            }
            view
        };
        let views = (0..lost.len()).map(view).collect();
        Guessed { raw, views }
    }
}

/// What a guess about the lost photos makes of the tags and views of all.
struct Guessed {
    raw: Vec<Option<CaptureTag>>,
    views: Vec<ViewPose>,
}

/// A view in the round that looks for lost photos: of a placed photo, or of a lost one under a guess, by its number.
struct Trial {
    photo: usize,
    guess: Option<usize>,
}

/// The pair holds its photos together.
fn is_joined(pair: &PairReport) -> bool {
    pair.kept && !pair.is_doubtful()
}

/// For every photo its neighbours in a tree of the first pairs that close no ring, with the neighbour's shift along the axis.
fn spanning_tree(photos: usize, pairs: &[&PairReport]) -> Vec<Vec<(usize, f64)>> {
    let mut tree = vec![Vec::new(); photos];
    let mut groups = Groups::new(photos);
    for pair in pairs {
        let [first, second] = [pair.first as usize, pair.second as usize];
        if groups.join([first, second]) {
            tree[first].push((second, pair.shift_m[1]));
            tree[second].push((first, -pair.shift_m[1]));
        }
    }
    tree
}

/// The view of a photo that has found its place.
pub(super) fn placed_view(tunnel_from_cam: Isometry3<f64>) -> ViewPose {
    let [position_m, rotation_rad] = PLACED_SIGMAS;
    ViewPose { tunnel_from_cam, position_sigma_m: [position_m; 3], rotation_sigma_rad: [rotation_rad; 3], drift_m: 0.0 }
}

/// A photo's prior view, moved along the axis as the placed photos before and after it were (`moved`, metres).
fn beside(prior: &[ViewPose], photo: usize, placed: &[usize], moved: impl Fn(usize) -> f64) -> ViewPose {
    let mut view = prior[photo];
    let after = placed.partition_point(|&other| other < photo);
    let beside = [after.checked_sub(1).and_then(|before| placed.get(before)), placed.get(after)];
    let [Some(&before), Some(&after)] = beside else {
        let Some(&only) = beside.into_iter().flatten().next() else { return view };
        view.tunnel_from_cam.translation.vector += Vector3::x() * moved(only);
        view.position_sigma_m[0] = view.position_sigma_m[0].hypot(prior[photo].drift_m - prior[only].drift_m);
        view.drift_m = 0.0;
        return view;
    };
    let share = (photo - before) as f64 / (after - before) as f64;
    view.tunnel_from_cam.translation.vector += Vector3::x() * ((1.0 - share) * moved(before) + share * moved(after));
    let drift_m = (prior[photo].drift_m - prior[before].drift_m).min(prior[after].drift_m - prior[photo].drift_m);
    view.position_sigma_m[0] = view.position_sigma_m[0].hypot(drift_m);
    view.drift_m = 0.0;
    view
}

/// For every photo the guess, by its number, that its matches believe; `pairs` are between `trials`.
fn best_guesses(photos: usize, trials: &[Trial], pairs: &[PairReport]) -> Vec<Option<usize>> {
    // Agreeing matches and joined pairs.
    let mut evidence = vec![[[0; 2]; GUESSES.len()]; photos];
    for pair in pairs.iter().filter(|pair| is_joined(pair)) {
        for view in [pair.first, pair.second] {
            let Trial { photo, guess: Some(guess) } = trials[view as usize] else { continue };
            let [agreeing, joined] = &mut evidence[photo][guess];
            *agreeing += pair.agreeing;
            *joined += 1;
        }
    }
    let best = |of_guess: &[[u32; 2]; GUESSES.len()]| {
        let guess = (0..GUESSES.len()).rev().max_by_key(|&guess| of_guess[guess][0])?;
        let [agreeing, pairs] = of_guess[guess];
        (agreeing >= LEAST_AGREEING && pairs >= 2).then_some(guess)
    };
    evidence.iter().map(best).collect()
}
