//! Similarity alignment of two point sets.

use nalgebra::{Matrix3, Point3, Rotation3, Similarity3, Translation3, UnitQuaternion, Vector3};

/// Returns the similarity `to_from_from` that carries `from` onto `to` with the least sum of squares.
///
/// # Method
/// Singular values of the covariance with the sign correction against reflections. Umeyama, "Least-squares estimation of
/// transformation parameters between two point patterns", PAMI 1991, equations 40 to 43.
/// # Errors
/// `None` for fewer than three pairs, and where the points of either side lie on a line or in one place, so that the
/// rotation is not determined.
pub(super) fn similarity(from: &[Point3<f64>], to: &[Point3<f64>]) -> Option<Similarity3<f64>> {
    let count = from.len().min(to.len());
    if count < 3 {
        return None;
    }
    let mean = |points: &[Point3<f64>]| points.iter().map(|p| p.coords).sum::<Vector3<f64>>() / count as f64;
    let (from_mean, to_mean) = (mean(from), mean(to));
    let mut covariance = Matrix3::zeros();
    let mut variance = 0.0;
    for (a, b) in from.iter().zip(to) {
        let (a, b) = (a.coords - from_mean, b.coords - to_mean);
        covariance += b * a.transpose() / count as f64;
        variance += a.norm_squared() / count as f64;
    }
    let svd = covariance.svd(true, true);
    let (u, v_t) = (svd.u?, svd.v_t?);
    let singular = svd.singular_values;
    if singular[1] <= 1e-12 * singular[0].max(f64::MIN_POSITIVE) {
        return None;
    }
    let mut sign = Vector3::repeat(1.0);
    if (u * v_t).determinant() < 0.0 {
        sign.z = -1.0;
    }
    let rotation = u * Matrix3::from_diagonal(&sign) * v_t;
    let scale = singular.dot(&sign) / variance;
    if !(scale.is_finite() && scale > 0.0) {
        return None;
    }
    let rotation = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(rotation));
    let shift = to_mean - rotation * from_mean * scale;
    Some(Similarity3::from_parts(Translation3::from(shift), rotation, scale))
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn point() -> impl Strategy<Value = Point3<f64>> {
        prop::array::uniform3(-5.0..5.0_f64).prop_map(|p| Point3::new(p[0], p[1], p[2]))
    }

    proptest! {
        #[test]
        fn the_similarity_that_moved_the_points_is_found_again(
            points in prop::collection::vec(point(), 4..20),
            axis in prop::array::uniform3(-3.0..3.0_f64),
            shift in prop::array::uniform3(-9.0..9.0_f64),
            scale in 0.1..10.0_f64,
        ) {
            let truth = Similarity3::new(Vector3::from(shift), Vector3::from(axis), scale);
            let moved: Vec<_> = points.iter().map(|p| truth * p).collect();
            let found = similarity(&points, &moved).unwrap();
            for (p, q) in points.iter().zip(&moved) {
                prop_assert!((found * p - q).norm() < 1e-6 * scale.max(1.0));
            }
            prop_assert!((found.scaling() / scale - 1.0).abs() < 1e-6);
        }
    }

    #[test]
    fn points_on_a_line_have_no_alignment() {
        let line: Vec<_> = (0..5).map(|i| Point3::new(f64::from(i), 0.0, 0.0)).collect();
        assert_eq!(similarity(&line, &line), None);
        assert_eq!(similarity(&line[..2], &line[..2]), None);
    }
}
