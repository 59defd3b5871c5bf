//! Pairing against many simulated flights: missed shots, double shots, photos before and after, whole seconds, drift.

use proptest::prelude::*;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, Normal};

use super::align::Shot;
use super::clock::Stamp;
use super::pairing::{Capture, Pairing, pair};

/// A flight's shape.
#[derive(Clone, Copy, Debug)]
struct Flight {
    captures: usize,
    period_s: f64,
    /// Spread of the time a turn takes to settle.
    settle_s: f64,
    missed_share: f64,
    double_share: f64,
    before: usize,
    after: usize,
    drift_ppm: f64,
    /// Does the board hear whether a photo was stored?
    confirmed: bool,
    unreadable_share: f64,
}

const USUAL: Flight = Flight {
    captures: 200,
    period_s: 1.5,
    settle_s: 0.12,
    missed_share: 0.02,
    double_share: 0.01,
    before: 3,
    after: 2,
    drift_ppm: 50.0,
    confirmed: false,
    unreadable_share: 0.0,
};

struct Simulated {
    captures: Vec<Capture>,
    photos: Vec<Option<Stamp>>,
    /// Photo of each capture.
    truth: Vec<Option<usize>>,
}

fn simulate(flight: &Flight, seed: u64) -> Simulated {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let latency = Normal::new(0.0, 0.03).unwrap();
    let offset_s = 1.5e9 + random.random_range(-1e6..1e6);
    let drift = random.random_range(-1.0..1.0) * flight.drift_ppm * 1e-6;
    let mut out = Simulated { captures: Vec::new(), photos: Vec::new(), truth: Vec::new() };
    let mut take = |board_s: f64, random: &mut ChaCha8Rng| {
        let camera_s = offset_s + board_s * (1.0 + drift) + latency.sample(random);
        let readable = !random.random_bool(flight.unreadable_share);
        out.photos.push(readable.then(|| Stamp { from_s: camera_s.floor(), resolution_s: 1.0 }));
        out.photos.len() - 1
    };
    let start_s = random.random_range(30.0..60.0);
    for i in 0..flight.before {
        take(start_s - 25.0 + 3.0 * i as f64, &mut random);
    }
    let mut board_s = start_s;
    for _ in 0..flight.captures {
        let stored = !random.random_bool(flight.missed_share);
        out.truth.push(stored.then(|| take(board_s, &mut random)));
        if stored && random.random_bool(flight.double_share) {
            take(board_s + random.random_range(0.3..0.9), &mut random);
        }
        let photo_share = match (flight.confirmed, stored) {
            (false, _) => 0.98,
            (true, true) => 0.999,
            (true, false) => 0.05,
        };
        out.captures.push(Capture { shot: Shot { time_s: board_s, photo_share, echo_share: 0.01 }, session: 0 });
        board_s += flight.period_s + random.random_range(0.0..flight.settle_s.max(1e-6));
    }
    for i in 0..flight.after {
        take(board_s + 5.0 + 4.0 * i as f64, &mut random);
    }
    out
}

#[derive(Default, Debug)]
struct Score {
    expected: usize,
    right: usize,
    wrong: usize,
    wrong_but_sure: usize,
    doubted: usize,
}

/// Pairs with less confidence are shown to the user.
const SURE: f64 = 0.95;

fn score(simulated: &Simulated, pairing: &Pairing, score: &mut Score) {
    score.expected += simulated.truth.iter().flatten().count();
    for pair in &pairing.pairs {
        let right = simulated.truth[pair.capture] == Some(pair.photo);
        score.right += usize::from(right);
        score.wrong += usize::from(!right);
        score.wrong_but_sure += usize::from(!right && pair.confidence >= SURE);
        score.doubted += usize::from(pair.confidence < SURE);
    }
}

fn fly_many(flight: &Flight, seeds: u64) -> Score {
    let mut total = Score::default();
    for seed in 0..seeds {
        let simulated = simulate(flight, seed);
        score(&simulated, &pair(&simulated.captures, &simulated.photos), &mut total);
    }
    total
}

#[test]
fn usual_flights_are_paired_right_to_one_in_a_thousand() {
    for flight in [USUAL, Flight { confirmed: true, ..USUAL }, Flight { period_s: 3.0, settle_s: 1.0, ..USUAL }] {
        let result = fly_many(&flight, 12);
        assert!(result.right as f64 >= 0.999 * result.expected as f64, "{flight:?}: {result:?}");
        assert_eq!(result.wrong_but_sure, 0, "{flight:?}: {result:?}");
        assert!(result.doubted as f64 <= 0.01 * result.expected as f64, "{flight:?}: {result:?}");
    }
}

/// What cannot be known (which of two photos in one second, a regular rhythm with its first photo missing) is doubted.
#[test]
fn hard_flights_are_paired_well_and_what_is_wrong_is_doubted() {
    let flights = [
        Flight { settle_s: 0.0, ..USUAL },
        Flight { period_s: 1.0, ..USUAL },
        Flight { period_s: 1.0, settle_s: 0.0, confirmed: true, ..USUAL },
        Flight { missed_share: 0.1, ..USUAL },
        Flight { double_share: 0.1, ..USUAL },
        Flight { captures: 12, ..USUAL },
        Flight { unreadable_share: 0.1, ..USUAL },
    ];
    for flight in flights {
        let result = fly_many(&flight, 8);
        assert!(
            result.right as f64 >= 0.98 * result.expected as f64 || result.doubted >= result.wrong,
            "{flight:?}: {result:?}"
        );
        assert!(result.wrong_but_sure as f64 <= 0.001 * result.expected as f64, "{flight:?}: {result:?}");
    }
}

#[test]
fn a_restart_of_the_board_and_a_jump_of_the_camera_s_clock_are_survived() {
    let first = simulate(&Flight { after: 0, ..USUAL }, 1);
    let second = simulate(&Flight { before: 0, captures: 60, ..USUAL }, 2);
    let both = |photos_offset_s: f64| {
        let mut all =
            Simulated { captures: first.captures.clone(), photos: first.photos.clone(), truth: first.truth.clone() };
        all.captures.extend(second.captures.iter().map(|capture| Capture { session: 1, ..*capture }));
        all.truth.extend(second.truth.iter().map(|photo| photo.map(|photo| photo + first.photos.len())));
        all.photos
            .extend(second.photos.iter().map(|stamp| stamp.map(|s| Stamp { from_s: s.from_s + photos_offset_s, ..s })));
        all
    };
    let last_s = first.photos.iter().flatten().last().unwrap().from_s;
    let next_s = second.photos.iter().flatten().next().unwrap().from_s;
    // Ten minutes later by the camera's clock; then with its clock reset by years.
    for photos_offset_s in [last_s - next_s + 600.0, last_s - next_s - 1e8] {
        let all = both(photos_offset_s);
        let mut result = Score::default();
        score(&all, &pair(&all.captures, &all.photos), &mut result);
        assert!(result.right + 2 >= result.expected && result.wrong_but_sure == 0, "{photos_offset_s}: {result:?}");
    }
}

#[test]
fn without_any_time_the_order_alone_pairs_what_is_complete() {
    let flight = Flight { missed_share: 0.0, double_share: 0.0, before: 0, after: 0, unreadable_share: 1.0, ..USUAL };
    let simulated = simulate(&flight, 3);
    let mut result = Score::default();
    score(&simulated, &pair(&simulated.captures, &simulated.photos), &mut result);
    assert_eq!((result.right, result.wrong), (200, 0));
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]
    #[test]
    fn pairs_keep_the_order_and_use_nothing_twice(
        seed in any::<u64>(),
        captures in 1_usize..40,
        missed_share in 0.0..0.5_f64,
        double_share in 0.0..0.5_f64,
        unreadable_share in 0.0..1.0_f64,
        jump_at in any::<prop::sample::Index>(),
    ) {
        let flight = Flight { captures, missed_share, double_share, unreadable_share, ..USUAL };
        let mut simulated = simulate(&flight, seed);
        let jump_at = jump_at.index(simulated.photos.len().max(1));
        for stamp in simulated.photos.iter_mut().skip(jump_at).flatten() {
            stamp.from_s -= 1e7;
        }
        let pairing = pair(&simulated.captures, &simulated.photos);
        for two in pairing.pairs.windows(2) {
            prop_assert!(two[0].capture < two[1].capture && two[0].photo < two[1].photo);
        }
        for pair in &pairing.pairs {
            prop_assert!(pair.capture < simulated.captures.len() && pair.photo < simulated.photos.len());
            prop_assert!((0.0..=1.0 + 1e-9).contains(&pair.confidence));
        }
    }
}
