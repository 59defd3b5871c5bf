//! Which photo belongs to which capture: candidates for the clock, alignment under each, the best with its doubts.
//!
//! The board may have restarted (its clock begins again: another session) and the camera's clock may have jumped (another
//! stretch of photos). Each session is aligned with each stretch, the clearest first; what it settles bounds the rest.

use super::align::{Alignment, Ends, Shot, align};
use super::clock::{Clock, LATENCY_SIGMAS_S, Stamp, candidate_offsets};

/// A capture, as far as pairing goes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Capture {
    pub(super) shot: Shot,
    /// Run of the board, from 0, never decreasing.
    pub(super) session: usize,
}

/// Two captures or photos that were found to belong together.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Pair {
    pub(super) capture: usize,
    pub(super) photo: usize,
    /// Probability that this is right.
    pub(super) confidence: f64,
}

/// A clock that was found.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct FoundClock {
    pub(super) session: usize,
    pub(super) clock: Clock,
    pub(super) pairs: usize,
}

/// What pairing found.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Pairing {
    /// In order of the captures.
    pub(super) pairs: Vec<Pair>,
    /// One per session and stretch that fit together.
    pub(super) clocks: Vec<FoundClock>,
}

/// Candidates for the clock that are aligned once, of these those whose clock is fitted, of these those that are refined.
const MOST_CANDIDATES: usize = 32;
const MOST_FITTED: usize = 12;
const MOST_REFINED: usize = 5;
/// Rounds of aligning and fitting the clock.
const ROUNDS: usize = 3;
/// A step of the camera's clock backwards by more than this, or forwards by more than the other, is a jump.
const JUMP_BACK_S: f64 = 2.5;
const JUMP_AHEAD_S: f64 = 30.0 * 24.0 * 3600.0;
/// Pairs below this are left open.
const LEAST_CONFIDENCE: f64 = 0.5;

/// Pairs captures (in order of time per session) with photos (in the order in which they were taken).
pub(super) fn pair(captures: &[Capture], photos: &[Option<Stamp>]) -> Pairing {
    let sessions = runs(captures.iter().map(|capture| capture.session));
    let stretches = stretches(photos);
    let mut open: Vec<(usize, usize)> =
        (0..sessions.len()).flat_map(|s| (0..stretches.len()).map(move |p| (s, p))).collect();
    let ends = if open.len() == 1 { Ends::WholeFlight } else { Ends::Open };
    let mut found = Pairing::default();
    while !open.is_empty() {
        let blocks = open.iter().enumerate().filter_map(|(i, &(s, p))| {
            let (captures_in, photos_in) = allowed(&found.pairs, sessions[s], stretches[p]);
            let block = solve(captures, photos, captures_in, photos_in, ends)?;
            Some((i, s, block))
        });
        let Some((i, s, block)) = blocks.max_by(|a, b| a.2.weight().total_cmp(&b.2.weight())) else { break };
        open.swap_remove(i);
        if let Some(clock) = block.clock {
            let session = captures[sessions[s].0].session;
            found.clocks.push(FoundClock { session, clock, pairs: block.pairs.len() });
        }
        found.pairs.extend(block.pairs);
        found.pairs.sort_by_key(|pair| pair.capture);
    }
    found
}

/// `(start, end)` of every run of equal values.
fn runs(values: impl Iterator<Item = usize>) -> Vec<(usize, usize)> {
    let mut runs: Vec<(usize, usize)> = Vec::new();
    let mut last = None;
    for (i, value) in values.enumerate() {
        match runs.last_mut() {
            Some(run) if last == Some(value) => run.1 = i + 1,
            _ => runs.push((i, i + 1)),
        }
        last = Some(value);
    }
    runs
}

/// `(start, end)` of every stretch of photos in which the camera's clock does not jump.
fn stretches(photos: &[Option<Stamp>]) -> Vec<(usize, usize)> {
    let (mut stretch, mut last_s) = (0, None);
    runs(photos.iter().map(|stamp| {
        if let Some(stamp) = stamp {
            let step_s = last_s.map_or(0.0, |last_s| stamp.from_s - last_s);
            if !(-JUMP_BACK_S..=JUMP_AHEAD_S).contains(&step_s) {
                stretch += 1;
            }
            last_s = Some(stamp.from_s);
        }
        stretch
    }))
}

/// What of a session and a stretch is still free, given that order is kept.
fn allowed(pairs: &[Pair], session: (usize, usize), stretch: (usize, usize)) -> ((usize, usize), (usize, usize)) {
    let (mut captures, mut photos) = (session, stretch);
    for pair in pairs {
        if pair.capture < session.0 {
            photos.0 = photos.0.max(pair.photo + 1);
        } else if pair.capture >= session.1 {
            photos.1 = photos.1.min(pair.photo);
        }
        if pair.photo < stretch.0 {
            captures.0 = captures.0.max(pair.capture + 1);
        } else if pair.photo >= stretch.1 {
            captures.1 = captures.1.min(pair.capture);
        }
    }
    (captures, photos)
}

/// A session aligned with a stretch.
struct Block {
    pairs: Vec<Pair>,
    clock: Option<Clock>,
}

impl Block {
    fn weight(&self) -> f64 {
        self.pairs.iter().map(|pair| pair.confidence).sum()
    }
}

fn solve(
    captures: &[Capture],
    photos: &[Option<Stamp>],
    captures_in: (usize, usize),
    photos_in: (usize, usize),
    ends: Ends,
) -> Option<Block> {
    let shots: Vec<Shot> = captures.get(captures_in.0..captures_in.1)?.iter().map(|capture| capture.shot).collect();
    let photos = photos.get(photos_in.0..photos_in.1)?;
    if shots.is_empty() || photos.is_empty() {
        return None;
    }
    let stamps: Vec<Stamp> = photos.iter().flatten().copied().collect();
    let times_s: Vec<f64> = shots.iter().map(|shot| shot.time_s).collect();
    let middle_s = times_s.iter().sum::<f64>() / times_s.len() as f64;
    let (clocks, known): (Vec<Clock>, bool) = if stamps.is_empty() {
        // Order alone decides; the clock is never asked.
        (vec![Clock::guess(0.0, middle_s)], false)
    } else {
        let offsets = candidate_offsets(&times_s, &stamps, MOST_CANDIDATES);
        (offsets.iter().map(|&offset_s| Clock::guess(offset_s, middle_s)).collect(), true)
    };
    let aligned = |clock: Clock| (clock, align(&shots, photos, &clock, ends));
    let solutions: Vec<Solution> = clocks.into_iter().map(aligned).collect();
    let solutions = best_of(solutions, MOST_FITTED).into_iter().map(|s| fit(&shots, photos, s, ends)).collect();
    let fitted = best_of(solutions, MOST_REFINED);
    let shots = fitted.first().map_or_else(|| shots.clone(), |(_, alignment)| with_rates(&shots, alignment));
    let solutions = fitted.into_iter().map(|s| refine(&shots, photos, s, ends)).collect();
    let solutions = best_of(solutions, MOST_REFINED);
    let (best_clock, best) = solutions.first()?;
    let weights: Vec<f64> = solutions.iter().map(|(_, other)| (other.ln_evidence - best.ln_evidence).exp()).collect();
    let total: f64 = weights.iter().sum();
    let confidence = |shot: usize, photo: usize| {
        let under = |alignment: &Alignment| {
            alignment.pairs.iter().find(|pair| (pair.0, pair.1) == (shot, photo)).map_or(0.0, |pair| pair.2)
        };
        solutions.iter().zip(&weights).map(|((_, alignment), weight)| weight * under(alignment)).sum::<f64>() / total
    };
    // Without any time, as many photos as captures are taken as complete, with the doubt that the sums leave.
    let in_order = !known && shots.len() == photos.len();
    let chosen: Vec<(usize, usize)> = if in_order {
        (0..shots.len()).map(|i| (i, i)).collect()
    } else {
        best.pairs.iter().filter(|pair| pair.2 > LEAST_CONFIDENCE).map(|&(shot, photo, _)| (shot, photo)).collect()
    };
    let pairs = chosen
        .into_iter()
        .map(|(shot, photo)| Pair {
            capture: captures_in.0 + shot,
            photo: photos_in.0 + photo,
            confidence: confidence(shot, photo),
        })
        .collect();
    Some(Block { pairs, clock: known.then_some(*best_clock) })
}

/// A clock and what it leads to.
type Solution = (Clock, Alignment);

/// Fits the clock and aligns in turns.
fn fit(shots: &[Shot], photos: &[Option<Stamp>], (mut clock, mut alignment): Solution, ends: Ends) -> Solution {
    for _ in 0..ROUNDS {
        let Some(fitted) = Clock::fit(&stamped(&alignment, shots, photos)) else { break };
        let moved_s = (fitted.offset_s - clock.offset_s).abs() + (fitted.sigma_s - clock.sigma_s).abs();
        clock = fitted;
        alignment = align(shots, photos, &clock, ends);
        if moved_s < 1e-3 {
            break;
        }
    }
    (clock, alignment)
}

/// Scales the expected shares of missed and double shots to what a first alignment found.
fn with_rates(shots: &[Shot], alignment: &Alignment) -> Vec<Shot> {
    let likely: Vec<_> = alignment.pairs.iter().filter(|pair| pair.2 > LEAST_CONFIDENCE).collect();
    let missed = (shots.len() - likely.len()) as f64;
    let inner_photos = likely.first().zip(likely.last()).map_or(0, |(first, last)| last.1 + 1 - first.1);
    let surplus = inner_photos.saturating_sub(likely.len()) as f64;
    // One more of each on both sides: a short flight without any says little.
    let ratio = |found: f64, expected: f64| ((found + 1.0) / (expected + 1.0)).clamp(0.1, 20.0);
    let missed_ratio = ratio(missed, shots.iter().map(|shot| 1.0 - shot.photo_share).sum());
    let echo_ratio = ratio(surplus, shots.iter().map(|shot| shot.echo_share).sum());
    let scaled = |share: f64, ratio: f64| {
        let odds = share / (1.0 - share) * ratio;
        odds / (1.0 + odds)
    };
    shots
        .iter()
        .map(|shot| Shot {
            photo_share: 1.0 - scaled(1.0 - shot.photo_share, missed_ratio),
            echo_share: scaled(shot.echo_share, echo_ratio),
            ..*shot
        })
        .collect()
}

/// Sharpens the clock and settles the camera's spread.
fn refine(shots: &[Shot], photos: &[Option<Stamp>], fitted: Solution, ends: Ends) -> Solution {
    let pairs = stamped(&fitted.1, shots, photos);
    if pairs.is_empty() {
        return fitted;
    }
    let clock = fitted.0;
    // Again, because the shares may have changed.
    let mut best = (clock, align(shots, photos, &clock, ends));
    for latency_sigma_s in LATENCY_SIGMAS_S {
        let tried = Clock { latency_sigma_s, ..clock }.refined(&pairs);
        let alignment = align(shots, photos, &tried, ends);
        if alignment.ln_evidence > best.1.ln_evidence {
            best = (tried, alignment);
        }
    }
    best
}

/// Board time and stamp of what is paired so far.
fn stamped(alignment: &Alignment, shots: &[Shot], photos: &[Option<Stamp>]) -> Vec<(f64, Stamp)> {
    let likely = alignment.pairs.iter().filter(|pair| pair.2 > LEAST_CONFIDENCE);
    likely.filter_map(|&(shot, photo, _)| Some((shots[shot].time_s, photos[photo]?))).collect()
}

/// The most probable solutions, best first; of those whose clocks agree (several guesses lead to the same) the best only.
fn best_of(mut solutions: Vec<Solution>, most: usize) -> Vec<Solution> {
    solutions.retain(|(_, alignment)| alignment.ln_evidence.is_finite());
    solutions.sort_by(|a, b| b.1.ln_evidence.total_cmp(&a.1.ln_evidence));
    let mut kept: Vec<Solution> = Vec::new();
    for (clock, alignment) in solutions {
        let same = |other: &Solution| {
            (other.0.camera_time_s(clock.middle_s) - clock.camera_time_s(clock.middle_s)).abs() < 0.3
        };
        if kept.len() < most && !kept.iter().any(same) {
            kept.push((clock, alignment));
        }
    }
    kept
}
