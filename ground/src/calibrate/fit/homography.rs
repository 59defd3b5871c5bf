//! A board and its image as planes: homographies, the focal length they imply, and the pose.

use nalgebra::{Isometry3, Matrix3, Rotation3, SMatrix, SVector, Translation3, UnitQuaternion, Vector2};

/// The homography `image_from_plane`, in the least-squares sense of the direct linear transform with normalised coordinates
/// (Hartley and Zisserman, "Multiple View Geometry", 2nd ed., algorithm 4.2); `None` of fewer than four points or of points
/// on a line.
pub(in super::super) fn homography(plane: &[Vector2<f64>], image: &[Vector2<f64>]) -> Option<Matrix3<f64>> {
    if plane.len() < 4 {
        return None;
    }
    let (from, to) = (normalisation(plane)?, normalisation(image)?);
    let mut normal = SMatrix::<f64, 9, 9>::zeros();
    for (plane, image) in plane.iter().zip(image) {
        let p = from * plane.push(1.0);
        let q = to * image.push(1.0);
        let mut row = |sign: f64, first: usize, second: usize| {
            let mut equation = SVector::<f64, 9>::zeros();
            for axis in 0..3 {
                equation[3 * first + axis] = sign * q[2] * p[axis];
                equation[6 + axis] = -sign * q[second] * p[axis];
            }
            normal += equation * equation.transpose();
        };
        row(1.0, 0, 0);
        row(1.0, 1, 1);
    }
    let eigen = normal.symmetric_eigen();
    let smallest = eigen.eigenvalues.imin();
    let h = eigen.eigenvectors.column(smallest);
    let h = Matrix3::new(h[0], h[1], h[2], h[3], h[4], h[5], h[6], h[7], h[8]);
    Some(to.try_inverse()? * h * from)
}

/// Moves points to their centroid and scales them to a mean distance of about one.
fn normalisation(points: &[Vector2<f64>]) -> Option<Matrix3<f64>> {
    let mean = points.iter().sum::<Vector2<f64>>() / points.len() as f64;
    let spread = points.iter().map(|point| (point - mean).norm()).sum::<f64>() / points.len() as f64;
    let scale = 1.0 / spread;
    scale.is_finite().then(|| Matrix3::new(scale, 0.0, -scale * mean.x, 0.0, scale, -scale * mean.y, 0.0, 0.0, 1.0))
}

/// The focal length by which the boards' axes are perpendicular and of equal length: Zhang, "A flexible new technique for
/// camera calibration" (2000), equations 3 and 4, with square pixels and a known principal point; homographies
/// `pixel_from_board`. `None` where no photo is tilted, or where distortion hides it.
pub(super) fn focal_px(homographies: &[Matrix3<f64>], centre_px: Vector2<f64>) -> Option<f64> {
    let (mut upper, mut lower) = (0.0, 0.0);
    for h in homographies {
        let mut h = *h;
        for column in 0..3 {
            h[(0, column)] -= centre_px.x * h[(2, column)];
            h[(1, column)] -= centre_px.y * h[(2, column)];
        }
        let h = h / h.column(0).norm().max(h.column(1).norm());
        let (a, b) = (h.column(0), h.column(1));
        let equations = [
            (a[0] * b[0] + a[1] * b[1], a[2] * b[2]),
            (a[0] * a[0] + a[1] * a[1] - b[0] * b[0] - b[1] * b[1], a[2] * a[2] - b[2] * b[2]),
        ];
        // x / f^2 + y = 0, least squares over all.
        for (x, y) in equations {
            upper -= x * y;
            lower += y * y;
        }
    }
    // Weighted by y, for x is the noisy side in pixels: f^2 = -sum(x y) / sum(y y).
    let squared = upper / lower;
    (squared > 0.0 && squared.is_finite()).then(|| squared.sqrt())
}

/// The pose `cam_from_board` of a homography from the board to the plane z = 1 of the camera; `None` if it is degenerate.
pub(super) fn pose(normalised_from_board: &Matrix3<f64>) -> Option<Isometry3<f64>> {
    let h = normalised_from_board;
    let scale = 2.0 / (h.column(0).norm() + h.column(1).norm());
    // The board is in front of the camera.
    let scale = if h[(2, 2)] < 0.0 { -scale } else { scale };
    if !scale.is_finite() {
        return None;
    }
    let (x, y) = ((h.column(0) * scale).into_owned(), (h.column(1) * scale).into_owned());
    let svd = Matrix3::from_columns(&[x, y, x.cross(&y)]).svd(true, true);
    let (u, v_t) = (svd.u?, svd.v_t?);
    let handedness = (u * v_t).determinant().signum();
    let rotation = u * Matrix3::from_diagonal(&nalgebra::Vector3::new(1.0, 1.0, handedness)) * v_t;
    let rotation = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(rotation));
    Some(Isometry3::from_parts(Translation3::from((h.column(2) * scale).into_owned()), rotation))
}

#[cfg(test)]
mod tests {
    use nalgebra::{Point3, Vector3};

    use super::*;

    /// How far a homography misses the points it was made of: root mean square, in the image's units.
    fn misfit(h: &Matrix3<f64>, plane: &[Vector2<f64>], image: &[Vector2<f64>]) -> f64 {
        let square = |(plane, image): (&Vector2<f64>, &Vector2<f64>)| {
            let p = h * plane.push(1.0);
            (p.xy() / p.z - image).norm_squared()
        };
        (plane.iter().zip(image).map(square).sum::<f64>() / image.len() as f64).sqrt()
    }

    fn board() -> Vec<Vector2<f64>> {
        (0..6)
            .flat_map(|row| (0..8).map(move |column| Vector2::new(f64::from(column), f64::from(row)) * 0.03))
            .collect()
    }

    fn tilted(rotvec: [f64; 3]) -> Isometry3<f64> {
        Isometry3::new(Vector3::new(-0.1, -0.05, 0.5), Vector3::from(rotvec))
    }

    fn seen(pose: &Isometry3<f64>) -> Vec<Vector2<f64>> {
        board().iter().map(|p| pose * Point3::new(p.x, p.y, 0.0)).map(|p| p.coords.xy() / p.z).collect()
    }

    #[test]
    fn a_pinhole_camera_s_pose_and_focal_length_come_back() {
        let poses = [tilted([0.4, 0.1, 0.0]), tilted([-0.2, 0.5, 0.3]), tilted([0.1, -0.4, 1.0])];
        let mut homographies = Vec::new();
        for wanted in &poses {
            let image = seen(wanted);
            let h = homography(&board(), &image).unwrap();
            assert!(misfit(&h, &board(), &image) < 1e-9);
            let found = pose(&h).unwrap();
            assert!((found.to_homogeneous() - wanted.to_homogeneous()).norm() < 1e-8, "{found} {wanted}");
            let pixels: Vec<_> = image.iter().map(|p| p * 600.0 + Vector2::new(320.0, 240.0)).collect();
            homographies.push(homography(&board(), &pixels).unwrap());
        }
        assert!((focal_px(&homographies, Vector2::new(320.0, 240.0)).unwrap() - 600.0).abs() < 1e-4);
    }

    #[test]
    fn a_board_that_is_never_tilted_says_nothing_of_the_focal_length() {
        let flat: Vec<_> = seen(&tilted([0.0; 3])).iter().map(|p| p * 600.0).collect();
        let h = homography(&board(), &flat).unwrap();
        let found = focal_px(&[h], Vector2::zeros());
        assert!(found.is_none_or(|found| !(300.0..1200.0).contains(&found)), "{found:?}");
    }

    #[test]
    fn too_few_points_and_points_in_one_place_have_no_homography() {
        assert!(homography(&board()[..3], &board()[..3]).is_none());
        assert!(homography(&[Vector2::zeros(); 5], &board()[..5]).is_none());
    }
}
