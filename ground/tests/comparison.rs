//! The comparison of matching strategies on a rendered sample, judged by its exact poses.

use std::path::Path;

use adit_ground::comparison::{PairKind, Reference, StrategyName, compare, write_figure};
use adit_ground::pipeline::Verbosity;
use adit_ground::survey;

#[test]
fn on_brick_repmatch_finds_more_than_ratio_and_guided_the_best_pose() {
    let name = "shared/samples/cylinder-brick-spiral";
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).ancestors().map(|up| up.join(name)).find(|dir| dir.is_dir());
    let Some(folder) = folder else {
        eprintln!("skipped: no {name}");
        return;
    };
    let survey = survey::load(&folder).expect("a survey");
    let comparison = compare(&survey, 1, Verbosity::Quiet).expect("a comparison");
    eprintln!("{comparison}");
    assert_eq!(comparison.reference, Reference::Truth);
    let row = |kind, strategy| {
        comparison.rows.iter().find(|row| row.kind == kind && row.strategy == strategy).expect("a row")
    };
    for kind in [PairKind::Successive, PairKind::NextTurn] {
        let [ratio, repmatch, guided] =
            [StrategyName::Ratio, StrategyName::Repmatch, StrategyName::Guided].map(|strategy| row(kind, strategy));
        assert!(ratio.correct > 300.0 && repmatch.correct > 1.1 * ratio.correct);
        assert!(repmatch.precision_percent > Some(90.0) && guided.precision_percent > Some(99.0));
        assert!(guided.rotation_error_deg.max < 0.05);
    }
    let out = tempfile::tempdir().expect("a folder");
    let page =
        std::fs::read_to_string(write_figure(&comparison, &survey, out.path()).expect("a figure")).expect("text");
    assert_eq!(page.matches("<h3>").count(), 10);
    assert!(page.matches("class=\"right\"").count() > 1000 && page.matches("<image").count() == 4);
}
