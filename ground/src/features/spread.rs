//! Choosing features so that no part of the photo takes them all.

use super::Keypoint;

/// Cells per axis over which features are spread.
const CELLS: usize = 16;

/// Keeps at most `most` keypoints: the strongest of every cell, then the second of every cell, and so on.
///
/// Bricks in the light would otherwise take every place from the concrete beside them, and a pose from features in one
/// corner of the photo is a bad one. The order of what is kept is that of the choice.
pub(super) fn spread(keypoints: Vec<Keypoint>, most: usize, width: usize, height: usize) -> Vec<Keypoint> {
    let cell = |keypoint: &Keypoint| {
        let along = |at: f64, size: usize| ((at / size as f64 * CELLS as f64) as usize).min(CELLS - 1);
        along(keypoint.pixel[1], height) * CELLS + along(keypoint.pixel[0], width)
    };
    let mut ordered = keypoints;
    // The pixel decides between equals, so that the result does not depend on the order of detection.
    ordered.sort_by(|a, b| {
        let place = |keypoint: &Keypoint| (keypoint.pixel[1], keypoint.pixel[0], f64::from(keypoint.scale_px));
        b.response
            .total_cmp(&a.response)
            .then_with(|| place(a).partial_cmp(&place(b)).unwrap_or(std::cmp::Ordering::Equal))
    });
    let mut taken = [0_u32; CELLS * CELLS];
    let mut ranked: Vec<(u32, Keypoint)> = ordered
        .into_iter()
        .map(|keypoint| {
            let rank = &mut taken[cell(&keypoint)];
            *rank += 1;
            (*rank, keypoint)
        })
        .collect();
    ranked.sort_by_key(|(rank, _)| *rank);
    ranked.truncate(most);
    ranked.into_iter().map(|(_, keypoint)| keypoint).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn weak_features_alone_in_their_cell_go_before_strong_ones_in_a_crowd() {
        let keypoint = |x: f64, response| Keypoint { pixel: [x, 5.0], scale_px: 1.0, angle_rad: 0.0, response };
        let mut all: Vec<Keypoint> = (0..10).map(|i| keypoint(1.0 + 0.1 * f64::from(i), 100.0 + i as f32)).collect();
        all.push(keypoint(150.0, 1.0));
        let kept = spread(all, 3, 160, 160);
        let responses: Vec<f32> = kept.iter().map(|keypoint| keypoint.response).collect();
        assert_eq!(responses, [109.0, 1.0, 108.0]);
    }
}
