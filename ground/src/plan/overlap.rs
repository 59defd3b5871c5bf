//! How much of a photo its neighbours show as well: what matching lives on.

use adit_geometry::coverage::{Scene, View};
use serde::Serialize;

use super::bounds::Setting;

/// Wall lines on which footprints are compared.
const LINES: u32 = 480;

/// Share of a photo's wall area that another photo shows too, on average over a turn.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Overlap {
    /// With the next photo, one step of the shaft on.
    pub next_photo: f64,
    /// With the photo in the same direction one turn later.
    pub next_turn: f64,
}

/// Compares the footprints of a flight on the axis. `None` if no photo shows the wall.
///
/// A footprint is its stretches on many lines along the wall; two photos share on each line what their stretches share.
pub(super) fn overlap(setting: &Setting<'_>, scene: &Scene<'_, f64>, step_m: f64) -> Option<Overlap> {
    let images = setting.mission.survey.rig.images_per_turn;
    let spacing_m = setting.profile.perimeter_m() / f64::from(LINES);
    let (mut seen_m, mut photo_m, mut turn_m) = (0.0, 0.0, 0.0);
    for line in (0..LINES).filter_map(|index| scene.wall_line((f64::from(index) + 0.5) * spacing_m)) {
        for view in &line.views {
            seen_m += view.to_m - view.from_m;
            turn_m += shared_m(view, view, step_m * f64::from(images));
            let is_next = |other: &&View<f64>| other.image == (view.image + 1) % images;
            photo_m += line.views.iter().find(is_next).map_or(0.0, |next| shared_m(view, next, step_m));
        }
    }
    (seen_m > 0.0).then(|| Overlap { next_photo: photo_m / seen_m, next_turn: turn_m / seen_m })
}

/// What two stretches share, the second of a photo taken `ahead_m` farther.
fn shared_m(view: &View<f64>, other: &View<f64>, ahead_m: f64) -> f64 {
    (view.to_m.min(other.to_m + ahead_m) - view.from_m.max(other.from_m + ahead_m)).max(0.0)
}
