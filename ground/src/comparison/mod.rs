//! `adit match --compare`: the strategies on the same pairs of photos, judged by the truth.
//!
//! The paper's comparison (SURF 31 matches, RepMatch 10,651 on one pair), with what it could not give: how many of the
//! matches are right, and how good a relative pose they make. Pairs are of two kinds, those a rotating rig has: successive
//! photos, and photos one turn apart.

mod figure;
mod judge;
mod table;

use std::collections::BTreeMap;
use std::time::Instant;

use adit_geometry::camera::Camera;
use anyhow::{Context, Result, bail};
use nalgebra::{UnitVector3, Vector2};
use serde::Serialize;

pub use figure::write_figure;
pub use judge::{Judge, Reference, RelativeErrors};

use crate::correspond::{Correspondences, Gms, Ratio, RepMatch, Strategy, Verify, View};
use crate::evaluate::Spread;
use crate::features::{BriefDescriptor, Descriptor, OrbOptions, SiftDescriptor, SiftOptions, orb, sift};
use crate::pipeline::{CoarseStage, MatchStage, SolveOptions, Solver, StageProgress, Verbosity};
use crate::poses::PhotoPose;
use crate::raster::{Grey, Mask};
use crate::survey::{Size, Survey, decode_grey, load_mask};
use crate::two_view::{TwoView, TwoViewOptions, estimate};

/// Largest reprojection error of a correct match, pixels.
pub const CORRECT_PX: f64 = 1.5;

/// How two photos of a pair lie to each other.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum PairKind {
    /// One after the other, a step of the shaft apart.
    Successive,
    /// A turn of the shaft apart.
    NextTurn,
}

/// A way to match, as the table names it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum StrategyName {
    /// SIFT, ratio test 0.8, RANSAC.
    Ratio,
    /// ORB, ratio test 0.8 and cross-check, RANSAC.
    Orb,
    /// ORB, grid-based motion statistics, RANSAC.
    Gms,
    /// SIFT, likelihood and motion curves.
    Repmatch,
    /// Templates on the wall, predicted by the tags and adjusted twice.
    Guided,
}

/// What one strategy found in one pair.
#[derive(Clone, Debug)]
pub struct PairResult {
    /// The photos.
    pub photos: [usize; 2],
    /// How they lie to each other.
    pub kind: PairKind,
    /// Which strategy.
    pub strategy: StrategyName,
    /// Matches before the geometry decided.
    pub tentative: usize,
    /// Pixels of the matches, and whether each is correct.
    pub matches: Vec<([[f64; 2]; 2], bool)>,
    /// Errors of the relative pose; `None` if none was found.
    pub errors: Option<RelativeErrors>,
    /// Time of matching and verifying (not of the features, which serve many pairs).
    pub seconds: f64,
}

impl PairResult {
    /// Number of correct matches.
    pub fn correct(&self) -> usize {
        self.matches.iter().filter(|(_, correct)| *correct).count()
    }
}

/// Figures of one strategy over all pairs of one kind.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Row {
    /// How the pairs lie.
    pub kind: PairKind,
    /// The strategy.
    pub strategy: StrategyName,
    /// Pairs.
    pub pairs: usize,
    /// Features per photo, mean; absent where there are none.
    pub features: Option<f64>,
    /// Matches per pair before the geometry decided, mean.
    pub tentative: f64,
    /// Matches per pair, mean.
    pub matches: f64,
    /// Correct matches per pair, mean.
    pub correct: f64,
    /// Fewest correct matches of any pair.
    pub fewest_correct: usize,
    /// Correct share of all matches; absent without a match.
    pub precision_percent: Option<f64>,
    /// Pairs with a relative pose.
    pub solved: usize,
    /// Errors of the relative rotation of the solved pairs.
    pub rotation_error_deg: Spread,
    /// Errors of the baseline's direction of the solved pairs.
    pub direction_error_deg: Spread,
    /// Time per pair: matching and verifying, without the features.
    pub seconds_per_pair: f64,
}

/// The comparison of all strategies.
#[derive(Clone, Debug, Serialize)]
pub struct Comparison {
    /// What correctness was judged by.
    pub reference: Reference,
    /// Largest error of a correct match.
    pub correct_px: f64,
    /// Threads at work.
    pub threads: usize,
    /// Time to find a photo's SIFT features.
    pub sift_seconds_per_photo: f64,
    /// Time to find a photo's ORB features.
    pub orb_seconds_per_photo: f64,
    /// One row per kind of pair and strategy.
    pub rows: Vec<Row>,
    /// The pairs behind them.
    #[serde(skip)]
    pub results: Vec<PairResult>,
}

/// Runs every strategy on up to `pairs` pairs of each kind, spread over the survey.
///
/// # Errors
/// If a photo, a mask or the truth cannot be read, or the survey has no two photos.
pub fn compare(survey: &Survey, pairs: usize, verbosity: Verbosity) -> Result<Comparison> {
    let chosen = choose_pairs(survey.photos.len(), usize::from(survey.config.rig.images_per_turn), pairs);
    if chosen.is_empty() {
        bail!("{}: one photo has nothing to be matched with", survey.folder.display());
    }
    let guided = Guided::run(survey, verbosity)?;
    let judge = Judge::new(survey, || guided.adjusted_poses())?;
    let views = Views::detect(survey, &chosen, verbosity)?;
    let progress = StageProgress::start(verbosity, "match", chosen.len());
    let camera = &survey.config.camera.camera;
    let mut results = Vec::new();
    for &(photos, kind) in &chosen {
        let mut add = |strategy, found: Found| results.push(judged(photos, kind, strategy, found, &judge));
        let [first, second] = photos.map(|photo| &views.sift[&photo]);
        add(StrategyName::Ratio, timed(&Ratio { cross_check: false, ..Ratio::default() }, first, second));
        add(StrategyName::Repmatch, timed(&RepMatch::default(), first, second));
        let [first, second] = photos.map(|photo| &views.orb[&photo]);
        add(StrategyName::Orb, timed(&Ratio::default(), first, second));
        add(StrategyName::Gms, timed(&Gms::default(), first, second));
        add(StrategyName::Guided, guided.found(photos, camera));
        progress.tick();
    }
    progress.finish(&format!("{} pairs", chosen.len()));
    Ok(Comparison {
        reference: judge.reference(),
        correct_px: CORRECT_PX,
        threads: rayon::current_num_threads(),
        sift_seconds_per_photo: views.seconds[0] / views.sift.len() as f64,
        orb_seconds_per_photo: views.seconds[1] / views.orb.len() as f64,
        rows: rows(&results, &views),
        results,
    })
}

/// Pairs `(i, i + 1)` and `(i, i + images_per_turn)`, at most `most` of each, evenly spread.
fn choose_pairs(photos: usize, images_per_turn: usize, most: usize) -> Vec<([usize; 2], PairKind)> {
    let mut chosen = Vec::new();
    for (step, kind) in [(1, PairKind::Successive), (images_per_turn, PairKind::NextTurn)] {
        let all = photos.saturating_sub(step);
        let count = most.min(all);
        chosen.extend((0..count).map(|index| {
            let first = index * all / count;
            ([first, first + step], kind)
        }));
    }
    chosen.dedup_by_key(|(photos, _)| *photos);
    chosen
}

/// The features of every photo that takes part.
struct Views {
    sift: BTreeMap<usize, View<SiftDescriptor>>,
    orb: BTreeMap<usize, View<BriefDescriptor>>,
    /// In all, for each class.
    seconds: [f64; 2],
}

impl Views {
    fn detect(survey: &Survey, pairs: &[([usize; 2], PairKind)], verbosity: Verbosity) -> Result<Self> {
        let mut photos: Vec<usize> = pairs.iter().flat_map(|(photos, _)| *photos).collect();
        photos.sort_unstable();
        photos.dedup();
        let camera = &survey.config.camera.camera;
        let progress = StageProgress::start(verbosity, "features", photos.len());
        let mut views = Self { sift: BTreeMap::new(), orb: BTreeMap::new(), seconds: [0.0; 2] };
        for &photo in &photos {
            let (grey, mask) = pixels(survey, photo)?;
            let started = Instant::now();
            let found = sift(&grey, mask.as_ref(), &SiftOptions::default());
            views.seconds[0] += started.elapsed().as_secs_f64();
            views.sift.insert(photo, View::new(found, camera));
            let started = Instant::now();
            let found = orb(&grey, mask.as_ref(), &OrbOptions::default());
            views.seconds[1] += started.elapsed().as_secs_f64();
            views.orb.insert(photo, View::new(found, camera));
            progress.tick();
        }
        progress.finish(&format!("{} photos", photos.len()));
        Ok(views)
    }

    /// Features per photo, mean.
    fn features(&self, strategy: StrategyName) -> Option<f64> {
        let sum: usize = match strategy {
            StrategyName::Ratio | StrategyName::Repmatch => self.sift.values().map(|view| view.rays.len()).sum(),
            StrategyName::Orb | StrategyName::Gms => self.orb.values().map(|view| view.rays.len()).sum(),
            StrategyName::Guided => return None,
        };
        Some(sum as f64 / self.sift.len() as f64)
    }
}

fn pixels(survey: &Survey, photo: usize) -> Result<(Grey, Option<Mask>)> {
    let camera = &survey.config.camera.camera;
    let size = Size { width_px: camera.width_px, height_px: camera.height_px };
    let photo = &survey.photos[photo];
    let mask = photo.mask.as_ref().map(|path| load_mask(path, size)).transpose()?;
    Ok((decode_grey(&photo.path, size)?, mask))
}

/// What a strategy says about a pair, not yet judged.
struct Found {
    tentative: usize,
    pixels: Vec<[[f64; 2]; 2]>,
    two_view: Option<TwoView>,
    seconds: f64,
}

fn timed<D: Descriptor>(strategy: &impl Strategy<D>, first: &View<D>, second: &View<D>) -> Found {
    let started = Instant::now();
    let Correspondences { matches, tentative, two_view } = strategy.correspond(first, second);
    let seconds = started.elapsed().as_secs_f64();
    let pixel = |view: &View<D>, feature: u32| view.features.keypoints[feature as usize].pixel;
    let pixels = matches.iter().map(|&[from, to]| [pixel(first, from), pixel(second, to)]).collect();
    Found { tentative, pixels, two_view, seconds }
}

fn judged(photos: [usize; 2], kind: PairKind, strategy: StrategyName, found: Found, judge: &Judge<'_>) -> PairResult {
    let matches = found.pixels.iter().map(|&pixels| (pixels, judge.is_correct(photos, pixels))).collect();
    let errors = found.two_view.map(|two_view| judge.errors(photos, &two_view));
    PairResult { photos, kind, strategy, tentative: found.tentative, matches, errors, seconds: found.seconds }
}

/// Guided matching of the whole survey: it lives on what all pairs tell together.
struct Guided<'a> {
    solver: Solver<'a>,
    coarse: CoarseStage,
    matches: MatchStage,
    /// By photo: number of the track and pixel.
    sightings: Vec<BTreeMap<usize, [f64; 2]>>,
    seconds_per_pair: f64,
}

impl<'a> Guided<'a> {
    fn run(survey: &'a Survey, verbosity: Verbosity) -> Result<Self> {
        let solver = Solver::new(survey, SolveOptions::default())?;
        let photos = survey.photos.len();
        let progress = StageProgress::start(verbosity, "guided", photos);
        let started = Instant::now();
        let coarse = solver.coarse(&solver.prior(), &progress).context("guided matching, coarse round")?;
        progress.restart(photos);
        let matches = solver.fine(&coarse, &progress);
        let seconds_per_pair = started.elapsed().as_secs_f64() / matches.round.pairs_expected.max(1) as f64;
        progress.finish(&format!("{} pairs", matches.round.pairs_expected));
        let mut sightings = vec![BTreeMap::new(); photos];
        for (track, found) in matches.tracks.iter().enumerate() {
            for seen in &found.sightings {
                sightings[seen.photo as usize].insert(track, seen.pixel);
            }
        }
        Ok(Self { solver, coarse, matches, sightings, seconds_per_pair })
    }

    /// Poses of all photos after the adjustment.
    fn adjusted_poses(&self) -> Result<Vec<PhotoPose>> {
        Ok(self.solver.adjust(&self.coarse, &self.matches)?.reconstruction.poses)
    }

    /// The points that both photos of a pair saw.
    fn found(&self, photos: [usize; 2], camera: &Camera<f64>) -> Found {
        let started = Instant::now();
        let [first, second] = photos.map(|photo| &self.sightings[photo]);
        let pixels: Vec<[[f64; 2]; 2]> =
            first.iter().filter_map(|(track, pixel)| Some([*pixel, *second.get(track)?])).collect();
        let ray = |pixel: [f64; 2]| Some(UnitVector3::new_normalize(camera.unproject(&Vector2::from(pixel))?));
        let rays: Vec<_> = pixels.iter().filter_map(|pixels| Some([ray(pixels[0])?, ray(pixels[1])?])).collect();
        let options =
            TwoViewOptions { threshold_rad: Verify::default().threshold_rad(camera), ..TwoViewOptions::default() };
        let two_view = estimate(&rays, &options);
        let seconds = self.seconds_per_pair + started.elapsed().as_secs_f64();
        Found { tentative: pixels.len(), pixels, two_view, seconds }
    }
}

fn rows(results: &[PairResult], views: &Views) -> Vec<Row> {
    let mut groups: BTreeMap<(PairKind, StrategyName), Vec<&PairResult>> = BTreeMap::new();
    for result in results {
        groups.entry((result.kind, result.strategy)).or_default().push(result);
    }
    let row = |((kind, strategy), results): ((PairKind, StrategyName), Vec<&PairResult>)| {
        let pairs = results.len();
        let mean = |figure: &dyn Fn(&PairResult) -> f64| results.iter().map(|r| figure(r)).sum::<f64>() / pairs as f64;
        let (matches, correct) = (mean(&|r| r.matches.len() as f64), mean(&|r| r.correct() as f64));
        let errors = || results.iter().filter_map(|result| result.errors.as_ref());
        Row {
            kind,
            strategy,
            pairs,
            features: views.features(strategy),
            tentative: mean(&|r| r.tentative as f64),
            matches,
            correct,
            fewest_correct: results.iter().map(|result| result.correct()).min().unwrap_or(0),
            precision_percent: (matches > 0.0).then_some(100.0 * correct / matches),
            solved: errors().count(),
            rotation_error_deg: Spread::of(errors().map(|errors| errors.rotation_deg)),
            direction_error_deg: Spread::of(errors().filter_map(|errors| errors.direction_deg)),
            seconds_per_pair: mean(&|r| r.seconds),
        }
    };
    groups.into_iter().map(row).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pairs_are_spread_over_the_survey_and_of_both_kinds() {
        let chosen = choose_pairs(50, 10, 4);
        let of =
            |wanted: PairKind| chosen.iter().filter(|(_, kind)| *kind == wanted).map(|(p, _)| *p).collect::<Vec<_>>();
        assert_eq!(of(PairKind::Successive), [[0, 1], [12, 13], [24, 25], [36, 37]]);
        assert_eq!(of(PairKind::NextTurn), [[0, 10], [10, 20], [20, 30], [30, 40]]);
        assert_eq!(choose_pairs(3, 10, 4).len(), 2);
        assert!(choose_pairs(1, 10, 4).is_empty());
    }
}
