use adit_geometry::angles::shaft_step_rad;

use super::*;
use crate::live::enactment::{MISSING, STEP_M, setting, tag};
use crate::plan::predict::Flown;

fn strip() -> Strip {
    Strip::new(Arc::new(setting())).unwrap()
}

fn flown(captures: impl IntoIterator<Item = u32>) -> Strip {
    let mut strip = strip();
    captures.into_iter().for_each(|capture| photo(&mut strip, &tag(capture), true));
    strip
}

fn photo(strip: &mut Strip, tag: &CaptureTag, is_taken: bool) {
    assert!(strip.add(tag) && strip.tell(tag.capture, is_taken));
}

/// How often each cell in a stretch of a level flight was counted, beside what the plan predicts.
#[test]
fn a_level_flight_is_counted_as_the_plan_predicts_it() {
    let setting = setting();
    let strip = flown(0..80);
    let scene = Scene::new(&setting.profile, &setting.footprint, &setting.rig, SectionVector::zeros(), 0.0).unwrap();
    let planned = Flown { step_m: STEP_M, photos: Some(80), lever_forward_m: setting.rig.lever_forward_m };
    let (mut cells, mut differing) = (0, 0);
    for row in strip.row_at(2.0)..strip.row_at(4.0) {
        let block = &strip.blocks[&row.div_euclid(BLOCK_ROWS)];
        for column in 0..strip.columns() {
            let line = scene.wall_line((column as f64 + 0.5) * strip.cell_m).unwrap();
            let expected = planned.views(&line, strip.x_m(row));
            let found = block.cells[row.rem_euclid(BLOCK_ROWS) as usize * strip.columns() + column];
            cells += 1;
            differing += u32::from(u16::from(found) != expected);
        }
    }
    // The formula leaves out slivers beside curved edges, up to 2 % of a view.
    assert!(cells > 7000 && differing * 50 < cells, "{differing} of {cells}");
}

#[test]
fn a_flight_below_the_bound_leaves_no_gap_in_either_direction() {
    assert_eq!(flown(0..100).gaps(), []);
    let mut strip = strip();
    for capture in 0..100 {
        let back = CaptureTag { odometer_m: tag(100 - capture).odometer_m, ..tag(capture) };
        photo(&mut strip, &back, true);
    }
    assert_eq!(strip.gaps(), []);
}

#[test]
fn a_flight_at_twice_the_bound_leaves_gaps() {
    let mut strip = strip();
    for capture in 0..60 {
        photo(&mut strip, &CaptureTag { odometer_m: Some(capture as f32 * 0.25), ..tag(capture) }, true);
    }
    assert!(!strip.gaps().is_empty() && marked(&strip) > 500, "{} gaps, {} cells", strip.gaps().len(), marked(&strip));
}

/// Cells with fewer photos than needed that are marked.
fn marked(strip: &Strip) -> usize {
    let cells = strip.blocks().flat_map(|(number, block)| strip.seen_of(number, block));
    cells.filter(|cell| matches!(cell, Cell::Gap | Cell::Thin)).count()
}

#[test]
fn a_missed_photo_is_marked_at_once_until_another_is_known_to_be_taken() {
    let mut strip = flown((0..42).chain(43..45));
    assert_eq!(marked(&strip), 0);
    photo(&mut strip, &tag(42), false);
    assert!(!strip.tell(42, false) && !strip.tell(42, true), "its fate is told once");
    let missing = marked(&strip);
    assert!(missing > 150, "{missing} cells");
    assert_eq!(strip.gaps(), [], "photos from here may show it yet");
    let again = |capture| CaptureTag { capture, ..tag(42) };
    photo(&mut strip, &again(45), false);
    assert!(strip.add(&again(46)));
    assert_eq!(marked(&strip), missing, "whether it was taken is not known yet");
    assert!(strip.tell(46, true));
    assert_eq!(marked(&strip), 0);
}

#[test]
fn missed_photos_that_are_left_behind_are_a_gap_where_they_looked() {
    let mut strip = strip();
    (0..100).for_each(|capture| photo(&mut strip, &tag(capture), !MISSING.contains(&capture)));
    let gap = strip.gaps()[0];
    // They looked at 2 tenths of a turn, 2.4 o'clock, from 2.48 to 4.24 m.
    assert!(gap.clock_from < 2.4 && gap.clock_to > 2.4, "{gap:?}");
    assert!(gap.x_from_m > 2.0 && gap.x_to_m < 4.8 && gap.area_m2 > 0.1, "{gap:?}");
    for capture in MISSING {
        photo(&mut strip, &CaptureTag { capture: 100 + capture, ..tag(capture) }, true);
    }
    assert_eq!(strip.gaps(), [], "it was flown back to");
}

#[test]
fn a_stretch_without_photos_is_a_gap_once_it_lies_behind_and_flying_back_closes_it() {
    let mut strip = flown((0..40).chain(70..110));
    let gap = strip.gaps()[0];
    // The camera was last at 3.12 m and again at 5.60 m; its images reach a metre and more to each side.
    assert!(gap.x_from_m > 3.1 && gap.x_to_m < 5.7 && gap.clock_to - gap.clock_from > 11.9, "{gap:?}");
    (40..70).for_each(|capture| photo(&mut strip, &CaptureTag { capture: 100 + capture, ..tag(capture) }, true));
    assert_eq!(strip.gaps(), []);
}

#[test]
fn a_photo_is_counted_once_and_one_without_a_place_not_at_all() {
    let mut strip = flown([7]);
    assert!(!strip.add(&tag(7)));
    for odometer_m in [None, Some(f32::NAN), Some(f32::INFINITY), Some(1e9)] {
        assert!(!strip.add(&CaptureTag { capture: 8, odometer_m, ..tag(8) }));
    }
    assert!(!strip.add(&CaptureTag { shaft_rad: f32::NAN, ..tag(9) }));
    assert_eq!(strip.unplaced(), 5);
}

#[test]
fn an_odometer_gone_wild_takes_no_more_memory_than_six_kilometres() {
    let mut strip = strip();
    for number in 1..MOST_BLOCKS as i64 {
        strip.blocks.insert(-number, Block { revision: 0, cells: Vec::new() });
    }
    for capture in 0..4_u32 {
        photo(&mut strip, &CaptureTag { odometer_m: Some(capture as f32 * 20_000.0), ..tag(capture) }, true);
    }
    assert_eq!(strip.blocks.len(), MOST_BLOCKS);
}

#[test]
fn only_stretches_that_changed_have_a_new_revision() {
    let mut strip = flown(0..100);
    let before = strip.revision();
    photo(&mut strip, &tag(100), true);
    let changed: Vec<i64> =
        strip.blocks().filter(|(_, block)| block.revision() > before).map(|(number, _)| number).collect();
    assert!(!changed.contains(&0) && changed.contains(&strip.block_at(8.0)), "{changed:?}");
    assert!((shaft_step_rad::<f64>(10) - 0.628).abs() < 1e-3, "ten photos make a turn");
}
