//! Which matches of a pair agree with one small motion of its two cameras.
//!
//! A camera that is believed at a pose moved by `(t, w)` (translation, rotation vector; tunnel axes, about the optical
//! centre) lays what it sees beside its true place on the wall. To first order a wall point `P` with inward normal `n`,
//! seen along `d = P - C`, moves by `v - d (n.v) / (n.d)` with `v = t + w x d`: the ray moves by `v` and is then followed
//! back to the wall. The displacement found between two photos is the difference of two such fields, linear in twelve
//! unknowns, exact also around the corners of a section. They are found by reweighted least squares
//! (Geman-McClure weights, scale shrinking from the search window to the gate), held by the poses' priors.

use nalgebra::{Matrix2x6, Point3, SMatrix, SVector, Vector2};

use super::ViewPose;
use super::wall::WallPoint;

/// Unknowns: the motions of both cameras.
const UNKNOWNS: usize = 12;

/// The robust scale shrinks by about this factor from step to step, then stays.
const SHRINK: f64 = 1.5;

/// Steps at the final scale, the first of them included.
const LAST_STEPS: usize = 2;

/// Least standard deviations of a pose, metres and radians: leaves the fit some freedom when poses are said to be exact.
const POSE_FLOOR: [f64; 2] = [2e-3, 5e-4];

/// A match as seen by the pair.
#[derive(Clone, Copy, Debug)]
pub(super) struct Displacement {
    /// The wall point.
    pub(super) point: WallPoint,
    /// Place found by the second photo minus place in the first, `[s, x]` metres.
    pub(super) found_m: [f64; 2],
    /// One over the variance of each axis, if it is a right one, 1/m^2.
    pub(super) information: f64,
}

/// The small motion of a pair's two cameras that explains its matches.
#[derive(Clone, Debug)]
pub(super) struct PairMotion<'a> {
    poses: [&'a ViewPose; 2],
    motion: SVector<f64, UNKNOWNS>,
    /// `None` if the matches say nothing at all.
    covariance: Option<SMatrix<f64, UNKNOWNS, UNKNOWNS>>,
}

impl<'a> PairMotion<'a> {
    /// Fits the motion to matches of which many may be wrong, by up to `reach_m`; a right one is good to `gate_m`.
    pub(super) fn fit(matches: &[Displacement], poses: [&'a ViewPose; 2], reach_m: f64, gate_m: f64) -> Self {
        let rows: Vec<Row> = matches.iter().map(|one| row(&one.point, poses)).collect();
        let prior = prior_variances(poses).map(f64::recip);
        let mut motion = SVector::<f64, UNKNOWNS>::zeros();
        let mut covariance = None;
        let start_m = reach_m.max(2.0 * gate_m);
        let end_m = 0.7 * gate_m;
        let shrinking = ((start_m / end_m).ln() / SHRINK.ln()).ceil().max(1.0) as usize;
        let steps = shrinking + LAST_STEPS;
        for step in 0..steps {
            let share = (step as f64 / shrinking as f64).min(1.0);
            let scale_m = start_m * (end_m / start_m).powf(share);
            let mut normal = SMatrix::<f64, UNKNOWNS, UNKNOWNS>::from_diagonal(&prior);
            let mut right = SVector::<f64, UNKNOWNS>::zeros();
            for (row, one) in rows.iter().zip(matches) {
                let found = Vector2::from(one.found_m);
                let squared = (found - row * motion).norm_squared() / (scale_m * scale_m);
                let weight = one.information / ((1.0 + squared) * (1.0 + squared));
                let weighted = row * weight;
                // The lower triangle is all that is asked for.
                for column in 0..UNKNOWNS {
                    for other in column..UNKNOWNS {
                        normal[(other, column)] +=
                            row[(0, other)] * weighted[(0, column)] + row[(1, other)] * weighted[(1, column)];
                    }
                }
                right += weighted.transpose() * found;
            }
            let Some(factor) = normal.cholesky() else { break };
            motion = factor.solve(&right);
            if step + 1 == steps {
                covariance = Some(factor.inverse());
            }
        }
        Self { poses, motion, covariance }
    }

    /// Where the second photo should find a point, minus where the first has it, `[s, x]` metres.
    pub(super) fn displacement_m(&self, point: &WallPoint) -> Vector2<f64> {
        row(point, self.poses) * self.motion
    }

    /// One standard deviation of [`Self::displacement_m`], the larger of both axes; infinite if it cannot be told.
    pub(super) fn sigma_m(&self, point: &WallPoint) -> f64 {
        let slopes = row(point, self.poses);
        self.covariance.map_or(f64::INFINITY, |covariance| {
            let spread = slopes * covariance * slopes.transpose();
            spread.diagonal().max().sqrt()
        })
    }

    /// Tells whether a match lies within `gate_m` of the motion.
    pub(super) fn agrees(&self, one: &Displacement, gate_m: f64) -> bool {
        (Vector2::from(one.found_m) - self.displacement_m(&one.point)).norm() <= gate_m
    }
}

/// Derivative of the displacement between the two photos with respect to both motions.
type Row = SMatrix<f64, 2, UNKNOWNS>;

fn row(point: &WallPoint, poses: [&ViewPose; 2]) -> Row {
    let [first, second] = poses.map(|pose| displacement_jacobian(point, &pose.centre()));
    let mut row = Row::zeros();
    row.fixed_columns_mut::<6>(0).copy_from(&-first);
    row.fixed_columns_mut::<6>(6).copy_from(&second);
    row
}

/// Variances of both motions; the drift between the photos is put on the second one's x.
fn prior_variances(poses: [&ViewPose; 2]) -> SVector<f64, UNKNOWNS> {
    let mut variances = SVector::from_fn(|index, _| {
        let (pose, axis) = (poses[index / 6], index % 3);
        let sigma = if index % 6 < 3 {
            pose.position_sigma_m[axis].max(POSE_FLOOR[0])
        } else {
            pose.rotation_sigma_rad[axis].max(POSE_FLOOR[1])
        };
        sigma * sigma
    });
    variances[6] += (poses[1].drift_m - poses[0].drift_m).powi(2);
    variances
}

/// One standard deviation `[s, x]`, metres, of the displacement between two photos at a wall point.
pub(super) fn displacement_sigma_m(point: &WallPoint, poses: [&ViewPose; 2]) -> [f64; 2] {
    let (row, variances) = (row(point, poses), prior_variances(poses));
    [0, 1].map(|axis| {
        row.row(axis).iter().zip(&variances).map(|(slope, variance)| slope * slope * variance).sum::<f64>().sqrt()
    })
}

/// Derivative of a wall point's believed place `[s, x]` with respect to `(t, w)`.
fn displacement_jacobian(point: &WallPoint, centre: &Point3<f64>) -> Matrix2x6<f64> {
    let ray = point.position - centre;
    let along_s = point.along_s();
    let slope = point.normal.dot(&ray);
    // w . v - (w . d) (n . v) / (n . d) = g . v for each axis w of the wall.
    let gradient_s = along_s - point.normal * (along_s.dot(&ray) / slope);
    let mut gradient_x = -point.normal * (ray.x / slope);
    gradient_x.x += 1.0;
    let mut jacobian = Matrix2x6::zeros();
    for (row, gradient) in [gradient_s, gradient_x].into_iter().enumerate() {
        // g . (w x d) = w . (d x g)
        let turning = ray.cross(&gradient);
        for axis in 0..3 {
            jacobian[(row, axis)] = gradient[axis];
            jacobian[(row, 3 + axis)] = turning[axis];
        }
    }
    jacobian
}

#[cfg(test)]
mod tests {
    use adit_geometry::profile::{Profile, ProfileSpec};
    use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};

    use super::super::wall::wall_hit;
    use super::*;

    fn underpass() -> Profile<f64> {
        let spec = ProfileSpec::Underpass { width_m: 4.0, wall_m: 2.5, rise_m: 1.0, axis_height_m: 1.4 };
        spec.build().expect("a valid profile")
    }

    #[test]
    fn the_jacobian_is_the_derivative_of_the_ray_cast() {
        let profile = underpass();
        let step = 1e-6;
        for index in 0..40 {
            let angle = 0.157 * f64::from(index);
            let pose = Isometry3::from_parts(Translation3::new(0.3, 0.1, -0.2), UnitQuaternion::identity());
            let ray = Vector3::new(0.4, angle.sin(), -angle.cos());
            let (s_m, x_m, normal) = wall_hit(&profile, &pose, &ray).expect("a wall");
            let surface = profile.at(s_m).expect("a wall");
            let position = Point3::new(x_m, surface.point.x, surface.point.y);
            let jacobian =
                displacement_jacobian(&WallPoint { position, normal }, &Point3::from(pose.translation.vector));
            for unknown in 0..6 {
                let mut change = [0.0; 6];
                change[unknown] = step;
                let moved = Isometry3::from_parts(
                    Translation3::from(pose.translation.vector + Vector3::new(change[0], change[1], change[2])),
                    UnitQuaternion::from_scaled_axis(Vector3::new(change[3], change[4], change[5])) * pose.rotation,
                );
                let (s, x, _) = wall_hit(&profile, &moved, &ray).expect("a wall");
                let difference = Vector2::new(s - s_m, x - x_m) / step;
                assert!((difference - jacobian.column(unknown)).norm() < 1e-3, "ray {index}, unknown {unknown}");
            }
        }
    }

    #[test]
    fn matches_that_follow_one_motion_agree_and_strays_do_not() {
        let profile = underpass();
        let pose = |x_m: f64| ViewPose {
            tunnel_from_cam: Isometry3::translation(x_m, 0.0, 0.0),
            position_sigma_m: [0.03; 3],
            rotation_sigma_rad: [0.03; 3],
            drift_m: 0.0,
        };
        let poses = [pose(0.0), pose(0.5)];
        let motion = SVector::<f64, 6>::from([0.02, -0.01, 0.03, 0.02, -0.03, 0.01]);
        let mut matches = Vec::new();
        for index in 0..60 {
            let surface = profile.at(0.05 * f64::from(index)).expect("a wall");
            let x_m = 0.4 * f64::from(index % 5) - 0.8;
            let position = Point3::new(x_m, surface.point.x, surface.point.y);
            let normal = Vector3::new(0.0, surface.normal.x, surface.normal.y);
            let point = WallPoint { position, normal };
            let moved = displacement_jacobian(&point, &poses[1].centre()) * motion;
            let stray = if index % 3 == 0 { 0.2 * f64::from(index % 7) - 0.55 } else { 0.0 };
            matches.push(Displacement { point, found_m: [moved.x + stray, moved.y - stray], information: 2e4 });
        }
        let motion = PairMotion::fit(&matches, [&poses[0], &poses[1]], 0.3, 0.02);
        for (index, one) in matches.iter().enumerate() {
            assert_eq!(motion.agrees(one, 0.02), index % 3 != 0, "match {index}");
        }
    }

    #[test]
    fn without_matches_a_place_is_as_uncertain_as_the_poses_and_matches_make_it_certain() {
        let profile = underpass();
        let pose = |x_m: f64| ViewPose {
            tunnel_from_cam: Isometry3::translation(x_m, 0.0, 0.0),
            position_sigma_m: [0.03; 3],
            rotation_sigma_rad: [0.03; 3],
            drift_m: 0.0,
        };
        let poses = [pose(0.0), pose(0.5)];
        let point = |s_m: f64, x_m: f64| {
            let surface = profile.at(s_m).expect("a wall");
            let position = Point3::new(x_m, surface.point.x, surface.point.y);
            WallPoint { position, normal: Vector3::new(0.0, surface.normal.x, surface.normal.y) }
        };
        let of_poses = PairMotion::fit(&[], [&poses[0], &poses[1]], 0.3, 0.02);
        let here = point(0.2, 0.3);
        let [sigma_s_m, sigma_x_m] = displacement_sigma_m(&here, [&poses[0], &poses[1]]);
        assert!((of_poses.sigma_m(&here) - sigma_s_m.max(sigma_x_m)).abs() < 1e-9);
        let found = |index: u32| Displacement {
            point: point(0.1 * f64::from(index % 4), 0.1 * f64::from(index)),
            found_m: [0.0; 2],
            information: 2e4,
        };
        let found: Vec<Displacement> = (0..8).map(found).collect();
        let motion = PairMotion::fit(&found, [&poses[0], &poses[1]], 0.3, 0.02);
        let (near_m, far_m) = (motion.sigma_m(&here), motion.sigma_m(&point(1.8, -0.5)));
        assert!(near_m < 0.007 && far_m > 2.0 * near_m, "{near_m} {far_m}");
    }
}
