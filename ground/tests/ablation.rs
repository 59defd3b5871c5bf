//! The ablation of the pruning steps on a rendered sample with a static trolley behind masks, judged by its exact poses.

use std::path::Path;

use adit_ground::ablation::{Row, Variant, ablate};
use adit_ground::pipeline::Verbosity;
use adit_ground::survey;

#[test]
fn pruning_takes_something_and_ours_is_no_worse_than_standard_adjustment() {
    let name = "shared/samples/underpass-spiral";
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).ancestors().map(|up| up.join(name)).find(|dir| dir.is_dir());
    let Some(folder) = folder else {
        eprintln!("skipped: no {name}");
        return;
    };
    let mut survey = survey::load(&folder).expect("a survey");
    survey.photos.truncate(20);
    let ablation = ablate(&survey, Verbosity::Quiet).expect("an ablation");
    eprintln!("{ablation}");
    assert_eq!((ablation.photos, ablation.rows.len()), (20, 7));
    assert!(ablation.masked_photos > 0 && ablation.held_out_points > 100);
    let row = |variant| ablation.rows.iter().find(|row| row.variant == variant).expect("a row");
    let [sba, all, ours] = [Variant::Sba, Variant::P1P2P3, Variant::Ours].map(row);
    assert_eq!(sba.observations[0], sba.observations[1]);
    // P1 at least: the trolley is in every photo, and matching without masks matches it.
    assert!(all.observations[1] < all.observations[0] && all.mean_error_px[1] < all.mean_error_px[0]);
    let aligned_mm = |row: &Row| row.aligned_mm.expect("a truth").rmse;
    assert!(aligned_mm(ours) <= aligned_mm(sba));
    assert!(ours.held_out_px <= 1.02 * sba.held_out_px);
    assert_eq!(ours.registered, 20);
}
