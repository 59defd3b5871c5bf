//! Levenberg-Marquardt over one camera and the boards' poses.
//!
//! Unknowns: `fx fy cx cy` and the distortion in the model's order, then six per board: `cam_from_board` is moved by
//! `exp(w) * pose.rotation`, `pose.translation + t`, tangent `[w, t]`. A board's corners know of its own pose only, so every
//! pose is eliminated from the normal equations (Schur complement) and a 9 x 9 system is left: cost is linear in the photos.

use adit_geometry::camera::{Camera, Distortion};
use nalgebra::{
    DMatrix, DVector, Isometry3, Matrix3, Matrix6, SMatrix, SVector, Translation3, UnitQuaternion, Vector2, Vector3,
    Vector6,
};

/// Room for the intrinsics of either model.
pub(super) const INTRINSICS: usize = 9;
const ITERATIONS: usize = 100;
/// Enough when the cost falls by less than this share: of an end, and of what only chooses among starts.
pub(super) const FINE: f64 = 1e-12;
pub(super) const ROUGH: f64 = 1e-3;
const FIRST_DAMPING: f64 = 1e-3;
const LARGEST_DAMPING: f64 = 1e12;

type Columns = SMatrix<f64, INTRINSICS, INTRINSICS>;
type Column = SVector<f64, INTRINSICS>;

/// One photo's corners: where each lies on the board (metres, z = 0), and its pixel.
#[derive(Clone, Debug)]
pub(super) struct Sighting {
    pub(super) board: Vec<Vector3<f64>>,
    pub(super) pixels: Vec<Vector2<f64>>,
}

/// A camera and where it saw each board from.
#[derive(Clone, Debug)]
pub(super) struct Estimate {
    pub(super) camera: Camera<f64>,
    pub(super) cam_from_board: Vec<Isometry3<f64>>,
}

/// The intrinsics that a model has.
pub(super) fn parameters(camera: &Camera<f64>) -> usize {
    match camera.distortion {
        Distortion::BrownConrady(_) => 9,
        Distortion::KannalaBrandt(_) => 8,
    }
}

/// Intrinsics as a list: `fx fy cx cy`, then the distortion; the ninth is zero for Kannala-Brandt.
pub(super) fn values(camera: &Camera<f64>) -> [f64; INTRINSICS] {
    let ([fx, fy], [cx, cy]) = (camera.focal_px, camera.centre_px);
    match camera.distortion {
        Distortion::BrownConrady([a, b, c, d, e]) => [fx, fy, cx, cy, a, b, c, d, e],
        Distortion::KannalaBrandt([a, b, c, d]) => [fx, fy, cx, cy, a, b, c, d, 0.0],
    }
}

fn moved(camera: &Camera<f64>, step: &Column) -> Camera<f64> {
    let old = values(camera);
    let [fx, fy, cx, cy, a, b, c, d, e] = std::array::from_fn(|index| old[index] + step[index]);
    let distortion = match camera.distortion {
        Distortion::BrownConrady(_) => Distortion::BrownConrady([a, b, c, d, e]),
        Distortion::KannalaBrandt(_) => Distortion::KannalaBrandt([a, b, c, d]),
    };
    Camera { focal_px: [fx, fy], centre_px: [cx, cy], distortion, ..*camera }
}

fn moved_pose(pose: &Isometry3<f64>, step: &Vector6<f64>) -> Isometry3<f64> {
    let turn = UnitQuaternion::from_scaled_axis(step.fixed_rows::<3>(0).into_owned());
    let translation = pose.translation.vector + step.fixed_rows::<3>(3);
    Isometry3::from_parts(Translation3::from(translation), turn * pose.rotation)
}

/// Half the sum of squared errors, pixels squared; infinite where a corner cannot be seen at all.
pub(super) fn cost(estimate: &Estimate, sightings: &[Sighting]) -> f64 {
    let photos = sightings.iter().zip(&estimate.cam_from_board);
    0.5 * photos.map(|(sighting, pose)| squares(&estimate.camera, pose, sighting)).sum::<f64>()
}

/// Sum of squared errors of a photo.
pub(super) fn squares(camera: &Camera<f64>, pose: &Isometry3<f64>, sighting: &Sighting) -> f64 {
    errors(camera, pose, sighting).map(|error| error * error).sum()
}

/// Distance of each corner from where the camera sees it; infinite if it does not.
pub(super) fn errors(camera: &Camera<f64>, pose: &Isometry3<f64>, sighting: &Sighting) -> impl Iterator<Item = f64> {
    sighting.board.iter().zip(&sighting.pixels).map(|(board, pixel)| {
        let seen = camera.project(&(pose.rotation * board + pose.translation.vector));
        seen.map_or(f64::INFINITY, |seen| (seen - pixel).norm())
    })
}

/// The normal equations of one photo.
struct Block {
    intrinsics: Columns,
    cross: SMatrix<f64, INTRINSICS, 6>,
    pose: Matrix6<f64>,
    right: Column,
    right_pose: Vector6<f64>,
}

/// `None` where a corner cannot be seen.
fn block(camera: &Camera<f64>, pose: &Isometry3<f64>, sighting: &Sighting) -> Option<Block> {
    let mut block = Block {
        intrinsics: Columns::zeros(),
        cross: SMatrix::zeros(),
        pose: Matrix6::zeros(),
        right: Column::zeros(),
        right_pose: Vector6::zeros(),
    };
    for (board, pixel) in sighting.board.iter().zip(&sighting.pixels) {
        let (seen, by_intrinsics, by_pose) = row(camera, pose, board)?;
        let error = pixel - seen;
        block.intrinsics += by_intrinsics.tr_mul(&by_intrinsics);
        block.cross += by_intrinsics.tr_mul(&by_pose);
        block.pose += by_pose.tr_mul(&by_pose);
        block.right += by_intrinsics.tr_mul(&error);
        block.right_pose += by_pose.tr_mul(&error);
    }
    Some(block)
}

/// A corner's pixel and its derivatives by the intrinsics and by the pose's tangent.
fn row(
    camera: &Camera<f64>,
    pose: &Isometry3<f64>,
    board: &Vector3<f64>,
) -> Option<(Vector2<f64>, SMatrix<f64, 2, INTRINSICS>, SMatrix<f64, 2, 6>)> {
    let turned = pose.rotation * board;
    let point = turned + pose.translation.vector;
    let (pixel, by_point) = camera.project_with_jacobian(&point)?;
    let mut point_by_pose = SMatrix::<f64, 3, 6>::zeros();
    point_by_pose.fixed_view_mut::<3, 3>(0, 0).copy_from(&-turned.cross_matrix());
    point_by_pose.fixed_view_mut::<3, 3>(0, 3).copy_from(&Matrix3::identity());
    Some((pixel, camera.jacobian_by_intrinsics(&point), by_point * point_by_pose))
}

/// Poses are eliminated: what is left for the intrinsics.
struct Reduced {
    matrix: Columns,
    right: Column,
}

fn reduce(blocks: &[Block], damping: f64) -> Option<Reduced> {
    let mut reduced = Reduced { matrix: Columns::zeros(), right: Column::zeros() };
    for block in blocks {
        reduced.matrix += block.intrinsics;
        reduced.right += block.right;
    }
    for index in 0..INTRINSICS {
        reduced.matrix[(index, index)] *= 1.0 + damping;
    }
    for block in blocks {
        let inverse = damped(&block.pose, damping).cholesky()?.inverse();
        let weighted = block.cross * inverse;
        reduced.matrix -= weighted * block.cross.transpose();
        reduced.right -= weighted * block.right_pose;
    }
    Some(reduced)
}

fn damped(matrix: &Matrix6<f64>, damping: f64) -> Matrix6<f64> {
    let mut matrix = *matrix;
    for index in 0..6 {
        matrix[(index, index)] *= 1.0 + damping;
    }
    matrix
}

/// Solves for the free intrinsics only: the first `free`.
fn solve(reduced: &Reduced, free: usize) -> Option<Column> {
    let matrix = DMatrix::from_fn(free, free, |row, column| reduced.matrix[(row, column)]);
    let right = DVector::from_fn(free, |row, _| reduced.right[row]);
    let solution = matrix.cholesky()?.solve(&right);
    let mut step = Column::zeros();
    step.rows_mut(0, free).copy_from(&solution);
    Some(step)
}

/// Minimises the sum of squared pixel errors until it falls by less than the share `enough`; returns its half. With `free` = 0
/// only poses move.
///
/// `None` if the start does not see every corner, or the normal equations are singular at it.
pub(super) fn minimise(estimate: &mut Estimate, sightings: &[Sighting], free: usize, enough: f64) -> Option<f64> {
    let mut best = cost(estimate, sightings);
    let mut damping = FIRST_DAMPING;
    for _ in 0..ITERATIONS {
        let blocks = blocks(estimate, sightings)?;
        let before = best;
        loop {
            if let Some(trial) = stepped(estimate, &blocks, free, damping) {
                let found = cost(&trial, sightings);
                if found <= best {
                    (*estimate, best) = (trial, found);
                    damping = (damping * 0.1).max(1e-12);
                    break;
                }
            }
            damping *= 10.0;
            if damping > LARGEST_DAMPING {
                return best.is_finite().then_some(best);
            }
        }
        if before - best <= enough * best {
            break;
        }
    }
    Some(best)
}

fn blocks(estimate: &Estimate, sightings: &[Sighting]) -> Option<Vec<Block>> {
    let photos = sightings.iter().zip(&estimate.cam_from_board);
    photos.map(|(sighting, pose)| block(&estimate.camera, pose, sighting)).collect()
}

fn stepped(estimate: &Estimate, blocks: &[Block], free: usize, damping: f64) -> Option<Estimate> {
    let step = if free == 0 { Column::zeros() } else { solve(&reduce(blocks, damping)?, free)? };
    let mut poses = Vec::with_capacity(blocks.len());
    for (block, pose) in blocks.iter().zip(&estimate.cam_from_board) {
        let right = block.right_pose - block.cross.transpose() * step;
        poses.push(moved_pose(pose, &damped(&block.pose, damping).cholesky()?.solve(&right)));
    }
    Some(Estimate { camera: moved(&estimate.camera, &step), cam_from_board: poses })
}

/// Covariance of the intrinsics for errors of one pixel per coordinate, poses unknown; zero for what the model lacks.
pub(super) fn unit_covariance(estimate: &Estimate, sightings: &[Sighting]) -> Option<Columns> {
    let free = parameters(&estimate.camera);
    let reduced = reduce(&blocks(estimate, sightings)?, 0.0)?;
    let inverse = DMatrix::from_fn(free, free, |row, column| reduced.matrix[(row, column)]).cholesky()?.inverse();
    let mut covariance = Columns::zeros();
    covariance.view_mut((0, 0), (free, free)).copy_from(&inverse);
    Some(covariance)
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    pub(in super::super) fn cameras() -> [Camera<f64>; 2] {
        let camera = Camera {
            width_px: 1280,
            height_px: 960,
            focal_px: [560.0, 562.0],
            centre_px: [648.0, 485.0],
            distortion: Distortion::BrownConrady([-0.24, 0.07, 2e-4, -3e-4, -0.01]),
        };
        [camera, Camera { distortion: Distortion::KannalaBrandt([0.06, 0.01, -0.02, 0.01]), ..camera }]
    }

    /// Photos of a board of 8 x 6 corners at 30 mm from a dozen sides, exact.
    pub(in super::super) fn exact(camera: Camera<f64>) -> (Estimate, Vec<Sighting>) {
        let board: Vec<Vector3<f64>> =
            (0..48).map(|index| Vector3::new(f64::from(index % 8), f64::from(index / 8), 0.0) * 0.03).collect();
        let mut cam_from_board = Vec::new();
        for index in 0..12 {
            let turn = f64::from(index) * 0.7;
            let tilt = Vector3::new(0.5 * turn.cos(), 0.5 * turn.sin(), 0.2 * turn.sin());
            let rotation = UnitQuaternion::from_scaled_axis(tilt);
            let middle = Vector3::new(0.09 * turn.sin(), 0.06 * (2.0 * turn).cos(), 0.22 + 0.01 * f64::from(index % 4));
            let translation = middle - rotation * Vector3::new(0.105, 0.075, 0.0);
            cam_from_board.push(Isometry3::from_parts(Translation3::from(translation), rotation));
        }
        let see = |pose: &Isometry3<f64>| {
            board
                .iter()
                .map(|point| camera.project(&(pose.rotation * point + pose.translation.vector)).unwrap())
                .collect()
        };
        let sightings =
            cam_from_board.iter().map(|pose| Sighting { board: board.clone(), pixels: see(pose) }).collect();
        (Estimate { camera, cam_from_board }, sightings)
    }

    #[test]
    fn derivatives_agree_with_differences() {
        for camera in cameras() {
            let (estimate, sightings) = exact(camera);
            let (pose, board) = (&estimate.cam_from_board[3], &sightings[3].board[41]);
            let (_, by_intrinsics, by_pose) = row(&camera, pose, board).unwrap();
            let pixel = |camera: &Camera<f64>, pose: &Isometry3<f64>| row(camera, pose, board).unwrap().0;
            for index in 0..parameters(&camera) {
                let h = 1e-5;
                let at = |h: f64| {
                    let mut step = Column::zeros();
                    step[index] = h;
                    pixel(&moved(&camera, &step), pose)
                };
                let expected = (at(h) - at(-h)) / (2.0 * h);
                assert!((by_intrinsics.column(index) - expected).norm() < 1e-4 * (1.0 + expected.norm()), "{index}");
            }
            for index in 0..6 {
                let h = 1e-6;
                let at = |h: f64| {
                    let mut step = Vector6::zeros();
                    step[index] = h;
                    pixel(&camera, &moved_pose(pose, &step))
                };
                let expected = (at(h) - at(-h)) / (2.0 * h);
                assert!((by_pose.column(index) - expected).norm() < 1e-4 * (1.0 + expected.norm()), "{index}");
            }
        }
    }

    #[test]
    fn the_true_camera_comes_back_from_a_wrong_one() {
        for truth in cameras() {
            let (mut estimate, sightings) = exact(truth);
            let off = Column::from([30.0, -20.0, 9.0, -7.0, 0.02, -0.01, 1e-3, 1e-3, 0.003]);
            estimate.camera = moved(&truth, &off);
            assert!(minimise(&mut estimate, &sightings, parameters(&truth), FINE).unwrap() < 1e-10);
            for (found, wanted) in values(&estimate.camera).iter().zip(values(&truth)) {
                assert!((found - wanted).abs() < 1e-5 * (1.0 + wanted.abs()), "{:?}", estimate.camera);
            }
        }
    }
}
