//! Does the wall repeat itself?

use super::MatchConfig;
use super::patch::Patch;
use super::search::{Search, SearchSize};

/// Reference points looked at, about.
const POINTS: usize = 16;

/// From this half-width to the next, texels, another place is looked for that looks like a point.
const RING_PX: [usize; 2] = [5, 25];

/// Least correlation of a repetition.
const LEAST_NCC: f32 = 0.85;

/// Share of the points that must repeat: 0.00 to 0.44 of a photo's in brick, concrete, tiles and the underpass, 0.74 to 1 among
/// bricks all alike.
const LEAST_SHARE: f64 = 0.6;

/// The distance, texels, at which the wall of a photo looks like itself; `None` if most of its places are like no other.
///
/// Templates are searched for in their own photo. What repeats at `d` repeats at `-d`: half of the ring is enough.
pub(super) fn repeat_px(patch: &Patch, config: &MatchConfig, search: &mut Search) -> Option<f64> {
    let [least, most] = RING_PX.map(|px| px as i64);
    let half = (most - least) / 2;
    // Beside the point, and between the ring's inner edges below it.
    let parts = [([least + half, 0], [half, most]), ([0, least + half], [least, half])];
    let mut nearest_px = f64::INFINITY;
    let (mut tried, mut repeated) = (0_u32, 0_u32);
    for &point in patch.points.iter().step_by((patch.points.len() / POINTS).max(1)) {
        // Towards the middle of the photo: there is more of it.
        let towards = [0, 1].map(|axis| {
            let size = [patch.texels.width, patch.texels.height][axis];
            if 2 * point[axis] < size { 1 } else { -1 }
        });
        let mut repeats = false;
        for (middle, reach) in parts {
            let target = [0, 1].map(|axis| point[axis] as i64 + towards[axis] * middle[axis]);
            let reach = reach.map(|reach| reach as usize);
            let size = SearchSize { half: config.template_px / 2, reach, min_ncc: LEAST_NCC };
            if let Some(peak) = search.find(patch, point, patch, target, &size) {
                let offset = [0, 1].map(|axis| (towards[axis] * middle[axis]) as f64 + peak.offset[axis]);
                nearest_px = nearest_px.min(offset[0].hypot(offset[1]));
                repeats = true;
            }
        }
        tried += 1;
        repeated += u32::from(repeats);
    }
    (f64::from(repeated) > LEAST_SHARE * f64::from(tried)).then_some(nearest_px)
}
