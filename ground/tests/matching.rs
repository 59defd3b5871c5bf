//! Guided matching on the rendered sample sets, judged by their exact poses. Run with `--nocapture` for the figures.

mod support;
#[path = "support/transfer.rs"]
mod transfer;
#[path = "support/wall.rs"]
mod wall;

use adit_geometry::profile::ProfileSpec;
use adit_ground::matching::{MatchConfig, MatchRound, Pixels, match_round};
use nalgebra::{Isometry3, Point3, Vector2};
use support::Sample;
use transfer::Transfer;
use wall::{Paint, Wall};

/// Sets and the median error, px, that the fine round must stay below.
const SETS: [(&str, f64); 3] =
    [("cylinder-brick-spiral", 0.045), ("cylinder-concrete-spiral", 0.1), ("underpass-spiral", 0.08)];

/// Photos of each set that the tests use: two and a half turns.
const PHOTOS: usize = 25;

fn run(
    sample: &Sample,
    config: &MatchConfig,
    position_sigma_m: f64,
    rotation_sigma_deg: f64,
) -> (MatchRound, Transfer) {
    let poses = sample.perturbed(position_sigma_m, rotation_sigma_deg.to_radians(), 7);
    let round =
        match_round(&sample.profile, &sample.camera, &poses, sample.photos.as_slice(), config, &|_| true, &|_| ());
    let transfer = Transfer::new(&round, &sample.camera, &sample.truth, |pose, pixel| nominal_hit(sample, pose, pixel));
    (round, transfer)
}

/// The point of the nominal section that a pixel sees.
fn nominal_hit(sample: &Sample, pose: &Isometry3<f64>, pixel: Vector2<f64>) -> Point3<f64> {
    let ray = pose.rotation * sample.camera.unproject(&pixel).expect("a ray");
    let centre = pose.translation.vector;
    let hit = sample.profile.ray_cast(centre.yz(), ray.yz()).expect("a wall");
    (centre + ray * hit.distance).into()
}

fn describe(name: &str, round: &MatchRound, transfer: &Transfer) {
    let count = |keep: fn(&&adit_ground::matching::PairReport) -> bool| round.pairs.iter().filter(keep).count();
    eprintln!(
        "{name}: {} pairs, {} kept, {} doubtful; {} points, {} sightings; median {:.4} px, {:.4} below 1 px",
        round.pairs.len(),
        count(|pair| pair.kept),
        count(|pair| pair.is_doubtful()),
        round.tracks.len(),
        transfer.errors_px.len(),
        transfer.median_px(),
        transfer.share_below(1.0),
    );
}

#[test]
fn the_wide_round_finds_the_wall_from_poses_off_by_two_degrees() {
    for (name, _) in SETS {
        let Some(sample) = support::load(name, PHOTOS) else { continue };
        let native_m = MatchConfig::native_m(&sample.profile, &sample.camera);
        let config = MatchConfig::wide(native_m);
        let (round, transfer) = run(&sample, &config, 0.025, 1.8);
        describe(name, &round, &transfer);
        // Three texels of the wall grid, in pixels of the photo.
        let limit_px = 3.0 * config.grid_m / native_m;
        assert!(transfer.share_below(limit_px) > 0.99, "{name}: {:.3}", transfer.share_below(limit_px));
        let kept = round.pairs.iter().filter(|pair| pair.kept).count();
        assert!(100 * kept >= 97 * round.pairs.len(), "{name}: {kept} of {} pairs kept", round.pairs.len());
        assert!(transfer.errors_px.len() > 100 * PHOTOS, "{name}: only {} sightings", transfer.errors_px.len());
    }
}

#[test]
fn the_fine_round_finds_points_to_a_tenth_of_a_pixel() {
    for (name, median_px) in SETS {
        let Some(sample) = support::load(name, PHOTOS) else { continue };
        let config = MatchConfig::fine(MatchConfig::native_m(&sample.profile, &sample.camera));
        let (round, transfer) = run(&sample, &config, 0.002, 0.05);
        describe(name, &round, &transfer);
        assert!(transfer.median_px() < median_px, "{name}: {:.4} px", transfer.median_px());
        assert!(transfer.share_below(1.0) > 0.98, "{name}: {:.4}", transfer.share_below(1.0));
    }
}

#[test]
fn the_result_does_not_depend_on_the_number_of_threads() {
    let Some(sample) = support::load("cylinder-brick-spiral", 12) else { return };
    let config = MatchConfig::fine(MatchConfig::native_m(&sample.profile, &sample.camera));
    let with_threads = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
        pool.install(|| run(&sample, &config, 0.002, 0.05).0)
    };
    assert!(with_threads(1) == with_threads(5));
}

/// Photographs of a wall of our own, which needs no sample folder.
fn photographed(wall: Wall, count: usize) -> Sample {
    let truth: Vec<_> = Wall::poses().into_iter().take(count).collect();
    let photos = truth.iter().zip(0..).map(|(pose, seed)| wall.photo(pose, seed)).collect();
    let spec = ProfileSpec::Circle { radius_m: wall::RADIUS_M };
    Sample { profile: spec.build().expect("a valid profile"), camera: Wall::camera(), truth, photos }
}

#[test]
fn both_rounds_find_a_wall_across_the_crown() {
    let sample = photographed(Wall { paint: Paint::Grained, relief_m: 0.0 }, 12);
    let native_m = MatchConfig::native_m(&sample.profile, &sample.camera);
    let (round, transfer) = run(&sample, &MatchConfig::wide(native_m), 0.025, 1.8);
    describe("own wall, wide", &round, &transfer);
    assert!(round.pairs.iter().all(|pair| pair.kept) && round.pairs.len() >= 40, "{} pairs", round.pairs.len());
    assert!(transfer.share_below(6.0) > 0.99, "{:.3}", transfer.share_below(6.0));
    let (round, transfer) = run(&sample, &MatchConfig::fine(native_m), 0.002, 0.05);
    describe("own wall, fine", &round, &transfer);
    assert!(transfer.median_px() < 0.1, "{:.4} px", transfer.median_px());
}

#[test]
fn bricks_all_alike_are_told_apart_by_their_stains() {
    let sample = photographed(Wall { paint: Paint::StainedBricks, relief_m: 0.0 }, 12);
    let config = MatchConfig::wide(MatchConfig::native_m(&sample.profile, &sample.camera));
    let (round, transfer) = run(&sample, &config, 0.025, 1.8);
    describe("stained bricks", &round, &transfer);
    let kept = round.pairs.iter().filter(|pair| pair.kept).count();
    assert!(4 * kept >= 3 * round.pairs.len(), "{kept} of {} pairs kept", round.pairs.len());
    assert!(transfer.share_below(6.0) > 0.99, "{:.3}", transfer.share_below(6.0));
    let (round, transfer) = run(&sample, &MatchConfig { resolve_repeats: false, ..config }, 0.025, 1.8);
    describe("stained bricks as if they were not alike", &round, &transfer);
    let kept_without = round.pairs.iter().filter(|pair| pair.kept).count();
    assert!(2 * kept_without < kept, "{kept_without} pairs without, {kept} with: this wall is too easy");
}

#[test]
fn where_nothing_tells_bricks_apart_no_pair_is_believed() {
    let sample = photographed(Wall { paint: Paint::CleanBricks, relief_m: 0.0 }, 12);
    let config = MatchConfig::wide(MatchConfig::native_m(&sample.profile, &sample.camera));
    let (round, transfer) = run(&sample, &config, 0.025, 1.8);
    describe("clean bricks", &round, &transfer);
    assert!(round.pairs.iter().all(|pair| !pair.kept));
    // Where poses are known to less than half a brick, there is no question.
    let (round, transfer) = run(&sample, &config, 0.003, 0.1);
    describe("clean bricks, good poses", &round, &transfer);
    assert!(round.pairs.iter().all(|pair| pair.kept));
    assert!(transfer.share_below(6.0) > 0.99, "{:.3}", transfer.share_below(6.0));
}

#[test]
fn a_bulging_wall_is_matched_where_it_is_and_not_where_the_section_says() {
    let wall = Wall { paint: Paint::Grained, relief_m: 0.035 };
    let sample = photographed(wall, 9);
    let config = MatchConfig::fine(MatchConfig::native_m(&sample.profile, &sample.camera));
    let poses = sample.perturbed(0.002, 0.05_f64.to_radians(), 7);
    let round =
        match_round(&sample.profile, &sample.camera, &poses, sample.photos.as_slice(), &config, &|_| true, &|_| ());
    let transfer = Transfer::new(&round, &sample.camera, &sample.truth, |pose, pixel| wall.hit(pose, pixel));
    describe("own wall, bulging", &round, &transfer);
    let kept = round.pairs.iter().filter(|pair| pair.kept).count();
    assert!(10 * kept >= 9 * round.pairs.len(), "{kept} of {} pairs kept", round.pairs.len());
    assert!(transfer.median_px() < 0.2 && transfer.share_below(1.0) > 0.95, "{:.3} px", transfer.median_px());
}

#[test]
fn a_photo_of_the_wrong_size_is_named_and_the_others_are_matched() {
    let mut sample = photographed(Wall { paint: Paint::Grained, relief_m: 0.0 }, 5);
    let mut smaller = sample.photos[2].grey().clone();
    smaller.height -= 1;
    sample.photos[2] = Pixels::new(smaller);
    let config = MatchConfig::fine(MatchConfig::native_m(&sample.profile, &sample.camera));
    let (round, _) = run(&sample, &config, 0.002, 0.05);
    assert_eq!(round.unusable, [2]);
    assert!(round.pairs.iter().all(|pair| pair.first != 2 && pair.second != 2 && pair.kept));
}
