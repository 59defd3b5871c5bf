//! Speed of the ground's inner loops on the rendered samples. `cargo bench -p adit-ground`.

#[path = "../tests/support/mod.rs"]
mod support;

use adit_ground::matching::{MatchConfig, match_round};
use divan::Bencher;

fn main() {
    divan::main();
}

/// Rectifying, filtering and matching twelve photos, every pair that overlaps; divide by the pairs for the cost of one.
#[divan::bench(args = ["wide", "fine"], sample_count = 10)]
fn match_twelve_photos(bencher: Bencher<'_, '_>, stage: &str) {
    let Some(sample) = support::load("cylinder-concrete-spiral", 12) else { return };
    let native_m = MatchConfig::native_m(&sample.profile, &sample.camera);
    let (config, poses) = if stage == "wide" {
        (MatchConfig::wide(native_m), sample.perturbed(0.025, 0.03, 7))
    } else {
        (MatchConfig::fine(native_m), sample.perturbed(0.002, 0.001, 7))
    };
    bencher.bench(|| match_round(&sample.profile, &sample.camera, &poses, sample.photos.as_slice(), &config, &|_| ()));
}
