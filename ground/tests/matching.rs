//! Guided matching on the rendered sample sets, judged by their exact poses. Run with `--nocapture` for the figures.

mod support;

use adit_ground::matching::{MatchConfig, MatchRound, match_round};
use nalgebra::Vector2;
use support::Sample;

/// Sets and the median error, px, that the fine round must stay below.
const SETS: [(&str, f64); 3] =
    [("cylinder-brick-spiral", 0.04), ("cylinder-concrete-spiral", 0.1), ("underpass-spiral", 0.08)];

/// Photos of each set that the tests use: two and a half turns.
const PHOTOS: usize = 25;

/// Errors of a round's matches against the exact poses.
struct Transfer {
    /// Pixels of the original photo between a found place and the true one, sorted.
    errors_px: Vec<f64>,
}

impl Transfer {
    /// Middle error.
    fn median_px(&self) -> f64 {
        self.errors_px.get(self.errors_px.len() / 2).copied().unwrap_or(f64::INFINITY)
    }

    /// Share of matches below a limit.
    fn share_below(&self, limit_px: f64) -> f64 {
        self.errors_px.partition_point(|&error| error < limit_px) as f64 / self.errors_px.len().max(1) as f64
    }
}

fn run(
    sample: &Sample,
    config: &MatchConfig,
    position_sigma_m: f64,
    rotation_sigma_deg: f64,
) -> (MatchRound, Transfer) {
    let poses = sample.perturbed(position_sigma_m, rotation_sigma_deg.to_radians(), 7);
    let round = match_round(&sample.profile, &sample.camera, &poses, sample.photos.as_slice(), config, &|_| ());
    let transfer = transfer(sample, &round);
    (round, transfer)
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

/// Compares each match with where the true poses put it: the reference pixel's ray is cast on the section and the
/// point projected into the other photo.
fn transfer(sample: &Sample, round: &MatchRound) -> Transfer {
    let mut errors_px: Vec<f64> = Vec::new();
    for track in &round.tracks {
        let reference = &sample.truth[track.reference.photo as usize];
        let ray = sample.camera.unproject(&Vector2::from(track.reference.pixel)).expect("a ray");
        let (centre, ray) = (reference.translation.vector, reference.rotation * ray);
        let hit = sample.profile.ray_cast(centre.yz(), ray.yz()).expect("a wall");
        let point = (centre + ray * hit.distance).into();
        for other in &track.others {
            let in_cam = sample.truth[other.sighting.photo as usize].inverse_transform_point(&point);
            let expected = sample.camera.project(&in_cam.coords);
            errors_px.push(expected.map_or(f64::INFINITY, |p| (p - Vector2::from(other.sighting.pixel)).norm()));
        }
    }
    errors_px.sort_by(f64::total_cmp);
    Transfer { errors_px }
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
