//! How fast the error grows along the tunnel.

use nalgebra::{Isometry3, Point3, Quaternion, UnitQuaternion, Vector3};

/// So many photos make up the start: about a turn.
const START_PHOTOS: usize = 10;
/// A shorter way than this says nothing about growth.
const SHORTEST_M: f64 = 1.0;

/// Returns the growth of the position error in millimetres per metre of distance from the start.
///
/// # Method
/// The reconstruction is laid onto the truth at its first photos alone: rotation by the mean of their rotation errors,
/// position by the mean of their centres; `scale` (true length per estimated length) comes from the whole, for a
/// reconstruction without tags has none of its own. Then the error vector of every photo is fitted as `a + b d` by
/// least squares, `d` the true distance from the start; the drift is the length of `b`. Positions alone could not fix the
/// rotation: a turn's centres lie within some centimetres across, and their noise would pass for drift.
/// # Errors
/// `None` for fewer than twice as many photos as the start has, and for a way of less than a metre.
pub(super) fn drift_mm_per_m(pairs: &[(Isometry3<f64>, Isometry3<f64>)], scale: f64) -> Option<f64> {
    if pairs.len() < 2 * START_PHOTOS {
        return None;
    }
    let start = &pairs[..START_PHOTOS];
    let turn = mean_rotation(start.iter().map(|(estimated, truth)| truth.rotation * estimated.rotation.inverse()))?;
    let from =
        start.iter().map(|(estimated, _)| estimated.translation.vector).sum::<Vector3<f64>>() / START_PHOTOS as f64;
    let to = start.iter().map(|(_, truth)| truth.translation.vector).sum::<Vector3<f64>>() / START_PHOTOS as f64;
    let errors = pairs.iter().map(|(estimated, truth)| {
        let moved = to + turn * (estimated.translation.vector - from) * scale;
        let away_m = (Point3::from(truth.translation.vector) - Point3::from(to)).norm();
        (away_m, moved - truth.translation.vector)
    });
    slope(&errors.collect::<Vec<_>>()).map(|growth| growth.norm() * 1000.0)
}

/// The mean of rotations that are near to each other: the normalised sum of their quaternions, signs made alike.
pub(super) fn mean_rotation(rotations: impl IntoIterator<Item = UnitQuaternion<f64>>) -> Option<UnitQuaternion<f64>> {
    let mut sum: Option<Quaternion<f64>> = None;
    for rotation in rotations {
        let next = rotation.into_inner();
        sum = Some(sum.map_or(next, |sum| if sum.dot(&next) < 0.0 { sum - next } else { sum + next }));
    }
    UnitQuaternion::try_new(sum?, 1e-9)
}

/// Slope of vectors over a distance by least squares.
fn slope(errors: &[(f64, Vector3<f64>)]) -> Option<Vector3<f64>> {
    let count = errors.len() as f64;
    let mean_m = errors.iter().map(|(away_m, _)| away_m).sum::<f64>() / count;
    let mean = errors.iter().map(|(_, error)| error).sum::<Vector3<f64>>() / count;
    let longest_m = errors.iter().map(|(away_m, _)| *away_m).fold(0.0, f64::max);
    let (mut product, mut square) = (Vector3::zeros(), 0.0);
    for (away_m, error) in errors {
        product += (error - mean) * (away_m - mean_m);
        square += (away_m - mean_m).powi(2);
    }
    (longest_m >= SHORTEST_M).then(|| product / square)
}

#[cfg(test)]
mod tests {
    use nalgebra::Translation3;

    use super::*;

    fn spiral(count: usize) -> Vec<Isometry3<f64>> {
        let pose = |index: usize| {
            let t = index as f64 * 0.6;
            let centre = Translation3::new(index as f64 * 0.1, t.cos() * 0.1, t.sin() * 0.1);
            Isometry3::from_parts(centre, UnitQuaternion::from_scaled_axis(Vector3::new(t, 0.1, 0.0)))
        };
        (0..count).map(pose).collect()
    }

    #[test]
    fn a_moved_turned_and_scaled_copy_does_not_drift() {
        let truth = spiral(100);
        let moved = Isometry3::new(Vector3::new(1.0, -2.0, 3.0), Vector3::new(0.3, -0.5, 2.0));
        let copy = |pose: &Isometry3<f64>| {
            let mut copy = moved * pose;
            copy.translation.vector /= 3.0;
            (copy, *pose)
        };
        let drift = drift_mm_per_m(&truth.iter().map(copy).collect::<Vec<_>>(), 3.0).unwrap();
        assert!(drift < 1e-9, "{drift}");
    }

    #[test]
    fn a_bend_of_a_milliradian_after_the_start_is_a_millimetre_per_metre() {
        let truth = spiral(200);
        let bent = |(index, pose): (usize, &Isometry3<f64>)| {
            let mut bent = *pose;
            bent.translation.vector.z += 1e-3 * (index as f64 * 0.1 - 0.45);
            (bent, *pose)
        };
        let drift = drift_mm_per_m(&truth.iter().enumerate().map(bent).collect::<Vec<_>>(), 1.0).unwrap();
        assert!((drift - 1.0).abs() < 0.01, "{drift}");
    }

    #[test]
    fn an_offset_that_does_not_grow_is_no_drift_and_a_short_way_has_none() {
        let truth = spiral(100);
        let shifted = |(index, pose): (usize, &Isometry3<f64>)| {
            let mut shifted = *pose;
            shifted.translation.vector.y += if index % 2 == 0 { 0.001 } else { -0.001 };
            (shifted, *pose)
        };
        let pairs: Vec<_> = truth.iter().enumerate().map(shifted).collect();
        assert!(drift_mm_per_m(&pairs, 1.0).unwrap() < 0.01);
        assert_eq!(drift_mm_per_m(&pairs[..15], 1.0), None);
        let standing: Vec<_> = (0..40).map(|_| pairs[0]).collect();
        assert_eq!(drift_mm_per_m(&standing, 1.0), None);
    }
}
