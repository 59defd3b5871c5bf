//! From corners to a camera: start, adjustment, outliers, and how well each number is known.

mod homography;
mod solver;
mod start;

use adit_geometry::camera::{Camera, Distortion};
use nalgebra::Isometry3;
use rayon::prelude::*;
use serde::Serialize;

use super::detect::LEAST_CORNERS;
use super::{Board, Corner, Model};
use crate::adjust::median;
use crate::survey::Size;
pub(super) use homography::homography;
use solver::{
    Estimate, FINE, INTRINSICS, Sighting, cost, errors, minimise, parameters, squares, unit_covariance, values,
};

/// Fewer photos do not determine a camera.
pub(super) const LEAST_PHOTOS: usize = 3;
/// A photo whose root mean square error is so many times the median photo's, and above the floor, is an outlier.
const OUTLIER_TIMES: f64 = 3.0;
const OUTLIER_FLOOR_PX: f64 = 0.5;
/// A corner whose error is so many times the median corner's is one: of normal errors one in ten billion.
const CORNER_TIMES: f64 = 6.0;
/// Enough for a fit without one photo, whose start is all but its end.
const JACKKNIFE: f64 = 1e-7;

/// A camera fitted to photos of a board.
#[derive(Clone, Debug)]
pub struct Fit {
    /// The camera.
    pub camera: Camera<f64>,
    /// Root mean square over all corners of the distance between the corner and where the camera sees it.
    pub rms_px: f64,
    /// How well each intrinsic is known.
    pub sigmas: Sigmas,
    /// Of each photo used: its index among those given, its pose, and its own root mean square error.
    pub photos: Vec<FittedPhoto>,
    /// Photos left out because they do not fit the others: index and root mean square error.
    pub outliers: Vec<(usize, f64)>,
}

/// One photo's part in a fit.
#[derive(Clone, Copy, Debug)]
pub struct FittedPhoto {
    /// Index among the photos given.
    pub index: usize,
    /// The board's pose: x along its rows, y down its columns, origin in the first corner.
    pub cam_from_board: Isometry3<f64>,
    /// Corners that were used.
    pub corners: usize,
    /// Their root mean square error.
    pub rms_px: f64,
}

/// One standard deviation of each intrinsic, in two ways.
///
/// `formal` supposes that every corner errs on its own, by as much as the residuals say. `jackknife` leaves out each photo in
/// turn: what photos have in common with themselves (a bent board, a lens that is not as its model) shows there only (Efron,
/// "The Jackknife, the Bootstrap and Other Resampling Plans", 1982, section 3).
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Sigmas {
    /// From the normal equations.
    pub formal: IntrinsicSigmas,
    /// From fits without one photo each.
    pub jackknife: IntrinsicSigmas,
}

/// One standard deviation of each intrinsic.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct IntrinsicSigmas {
    /// Of the focal lengths.
    pub focal_px: [f64; 2],
    /// Of the principal point.
    pub centre_px: [f64; 2],
    /// Of the distortion, in the model's order; the fifth is Brown-Conrady's.
    pub distortion: [f64; 5],
}

impl From<[f64; INTRINSICS]> for IntrinsicSigmas {
    fn from([fx, fy, cx, cy, a, b, c, d, e]: [f64; INTRINSICS]) -> Self {
        Self { focal_px: [fx, fy], centre_px: [cx, cy], distortion: [a, b, c, d, e] }
    }
}

/// Fits a camera to the corners of several photos, as [`super::find_corners`] returns them.
///
/// `None` if fewer than three photos are given, or nothing can be fitted to them (no board is tilted).
///
/// # Method
/// Least squares over intrinsics and poses, all corners alike; photos whose own error is three times the median photo's (and
/// above half a pixel) are left out and the rest is fitted again; then corners off by six times the median corner's error.
pub fn fit_camera(photos: &[Vec<Corner>], board: &Board, size: Size, model: Model) -> Option<Fit> {
    let sighting = |corners: &Vec<Corner>| Sighting {
        board: corners.iter().map(|corner| board.place(corner.number)).collect(),
        pixels: corners.iter().map(|corner| corner.pixel).collect(),
    };
    let mut sightings: Vec<Sighting> = photos.iter().map(sighting).collect();
    let mut used: Vec<usize> = (0..photos.len()).collect();
    let mut outliers = Vec::new();
    loop {
        if used.len() < LEAST_PHOTOS {
            return None;
        }
        let chosen: Vec<Sighting> = used.iter().map(|&index| sightings[index].clone()).collect();
        let estimate = estimated(&chosen, size, model)?;
        let errors: Vec<f64> = chosen
            .iter()
            .zip(&estimate.cam_from_board)
            .map(|(sighting, pose)| (squares(&estimate.camera, pose, sighting) / sighting.pixels.len() as f64).sqrt())
            .collect();
        let limit_px = (OUTLIER_TIMES * median(&errors)).max(OUTLIER_FLOOR_PX);
        let worst = (0..errors.len()).max_by(|a, b| errors[*a].total_cmp(&errors[*b]))?;
        if errors[worst] > limit_px {
            outliers.push((used.remove(worst), errors[worst]));
            continue;
        }
        if leave_out_corners(&mut sightings, &used, &estimate) {
            continue;
        }
        let photos = (0..used.len()).map(|at| FittedPhoto {
            index: used[at],
            cam_from_board: estimate.cam_from_board[at],
            corners: chosen[at].pixels.len(),
            rms_px: errors[at],
        });
        return Some(Fit {
            camera: estimate.camera,
            rms_px: (2.0 * cost(&estimate, &chosen) / count(&chosen) as f64).sqrt(),
            sigmas: Sigmas {
                formal: formal(&estimate, &chosen)?.into(),
                jackknife: jackknife(&estimate, &chosen).into(),
            },
            photos: photos.collect(),
            outliers,
        });
    }
}

/// Takes the corners out of the photos used that are off by many times the median corner's error; tells whether there were any.
fn leave_out_corners(sightings: &mut [Sighting], used: &[usize], estimate: &Estimate) -> bool {
    let errors: Vec<Vec<f64>> = used
        .iter()
        .zip(&estimate.cam_from_board)
        .map(|(&index, pose)| errors(&estimate.camera, pose, &sightings[index]).collect())
        .collect();
    let limit_px = CORNER_TIMES * median(&errors.concat());
    let mut any = false;
    for (&index, errors) in used.iter().zip(errors) {
        let sighting = &mut sightings[index];
        let good: Vec<usize> = (0..errors.len()).filter(|&corner| errors[corner] <= limit_px).collect();
        // Of a photo that hardly fits at all no part is chosen.
        if good.len() < errors.len() && good.len() >= LEAST_CORNERS {
            any = true;
            sighting.board = good.iter().map(|&corner| sighting.board[corner]).collect();
            sighting.pixels = good.iter().map(|&corner| sighting.pixels[corner]).collect();
        }
    }
    any
}

fn estimated(sightings: &[Sighting], size: Size, model: Model) -> Option<Estimate> {
    let fisheye = start::fisheye(sightings, size)?;
    match model {
        Model::KannalaBrandt => Some(fisheye),
        Model::BrownConrady => {
            let mut estimate = start::as_brown_conrady(&fisheye, sightings)?;
            let free = parameters(&estimate.camera);
            minimise(&mut estimate, sightings, free, FINE)?;
            Some(estimate)
        }
    }
}

fn count(sightings: &[Sighting]) -> usize {
    sightings.iter().map(|sighting| sighting.pixels.len()).sum()
}

fn formal(estimate: &Estimate, sightings: &[Sighting]) -> Option<[f64; INTRINSICS]> {
    let unknowns = parameters(&estimate.camera) + 6 * sightings.len();
    let variance = 2.0 * cost(estimate, sightings) / (2 * count(sightings) - unknowns) as f64;
    let covariance = unit_covariance(estimate, sightings)?;
    Some(std::array::from_fn(|index| (variance * covariance[(index, index)]).sqrt()))
}

fn jackknife(estimate: &Estimate, sightings: &[Sighting]) -> [f64; INTRINSICS] {
    let without = |left_out: usize| {
        let mut estimate = estimate.clone();
        estimate.cam_from_board.remove(left_out);
        let mut rest = sightings.to_vec();
        rest.remove(left_out);
        let free = parameters(&estimate.camera);
        minimise(&mut estimate, &rest, free, JACKKNIFE)?;
        Some(values(&estimate.camera))
    };
    let fits: Vec<[f64; INTRINSICS]> = (0..sightings.len()).into_par_iter().filter_map(without).collect();
    let count = fits.len().max(1) as f64;
    std::array::from_fn(|index| {
        let mean = fits.iter().map(|fit| fit[index]).sum::<f64>() / count;
        let squares: f64 = fits.iter().map(|fit| (fit[index] - mean).powi(2)).sum();
        ((count - 1.0) / count * squares).sqrt()
    })
}

/// Name of the model as survey.toml has it.
pub(super) fn model_of(camera: &Camera<f64>) -> Model {
    match camera.distortion {
        Distortion::BrownConrady(_) => Model::BrownConrady,
        Distortion::KannalaBrandt(_) => Model::KannalaBrandt,
    }
}

#[cfg(test)]
mod tests;
