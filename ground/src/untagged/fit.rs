//! All poses at once, from matches and the known wall.
//!
//! Gauss-Newton with graduated non-convexity: matches are weighted by a Geman-McClure loss whose scale shrinks from the
//! start's error to a few pixels. Unknowns per photo as in the adjustment: a rotation on the right (camera axes), then a
//! shift of the optical centre (tunnel axes).

use adit_geometry::profile::Profile;
use adit_geometry::rig::{Rig, nominal_rotation};
use nalgebra::{Isometry3, SMatrix, UnitQuaternion, UnitVector3, Vector2, Vector3};

use super::graph::{Link, ViewGraph};
use super::miss::{Miss, UNKNOWNS, miss};
use super::{PlacedPhoto, UntaggedError};
use crate::adjust::{Envelope, Factor, NotPositiveDefinite, median};

/// Most matches of a pair that take part, evenly drawn: more add nothing to a prior.
const MOST_MATCHES: usize = 80;
/// One standard deviation of a match against the nominal wall: a pixel or two, and centimetres of bulges seen over a
/// short step.
const MATCH_RAD: f64 = 0.004;
/// Scales of the loss, one after the other.
const SCALES_RAD: [f64; 6] = [0.2, 0.1, 0.05, 0.025, 0.015, 0.01];
/// Steps per scale.
const STEPS: usize = 4;
/// A match supports a pose up to this error.
const SUPPORTS_RAD: f64 = 0.02;
/// Fewest matches that place a photo.
const LEAST_SUPPORT: usize = 12;

/// What is known of a vehicle in a tunnel beforehand, one standard deviation each: distance from the axis, ...
const OFF_AXIS_M: f64 = 0.3;
/// ... change of position from photo to photo, ...
const MOVES_M: f64 = 0.2;
/// ... pitch and yaw with the camera's mounting, and the shaft's error about its commanded angle (with the roll).
const ATTITUDE_RAD: f64 = 0.06;
const SHAFT_RAD: f64 = 0.08;
/// Starting shaft angles that are tried where the section tells them apart.
const STARTS: usize = 36;
/// How far the first photo may turn from the starting angle in such a section.
const START_RAD: f64 = 0.3;
/// Pins x of the first photo.
const ANCHOR_M: f64 = 0.001;
/// The nominal wall is no better than this, whatever the matches say.
const LEAST_SIGMAS: [f64; 2] = [0.005, 0.002];

/// Fits the poses of all photos to the section.
///
/// # Errors
/// [`UntaggedError::Singular`], for NaN.
pub fn place(graph: &ViewGraph, profile: &Profile<f64>, rig: &Rig<f64>) -> Result<Vec<PlacedPhoto>, UntaggedError> {
    let mut fit = Fit::new(graph, profile, rig);
    if !is_round(profile) {
        fit.choose_start()?;
    }
    for scale_rad in SCALES_RAD {
        fit.descend(scale_rad, STEPS)?;
    }
    let last = SCALES_RAD[SCALES_RAD.len() - 1];
    // Matches that pull at a photo they do not place are taken away, so that it lies between its neighbours.
    let support = fit.support();
    let lost = |photo: usize| support[photo] < LEAST_SUPPORT;
    fit.links.retain(|link| !link.photos.iter().any(|photo| lost(*photo)));
    fit.descend(last, STEPS)?;
    let factor = Factor::new(fit.normal(last).0).map_err(singular)?;
    Ok((0..fit.poses.len())
        .map(|photo| {
            let [rotation_sigma_rad, position_sigma_m] = fit.sigmas(&factor, photo);
            PlacedPhoto {
                tunnel_from_cam: fit.poses[photo],
                position_sigma_m: position_sigma_m.max(LEAST_SIGMAS[0]),
                rotation_sigma_rad: rotation_sigma_rad.max(LEAST_SIGMAS[1]),
                support: support[photo],
                placed: !lost(photo),
            }
        })
        .collect())
}

/// Whether the section looks the same from its axis all around.
pub(super) fn is_round(profile: &Profile<f64>) -> bool {
    let distances: Vec<f64> = (0..24)
        .filter_map(|i| {
            let (sin, cos) = (std::f64::consts::TAU * f64::from(i) / 24.0).sin_cos();
            Some(profile.ray_cast(Vector2::zeros(), Vector2::new(sin, -cos))?.distance)
        })
        .collect();
    let (low, high) = distances.iter().fold((f64::MAX, 0.0_f64), |(low, high), d| (low.min(*d), high.max(*d)));
    high - low < 1e-3 * high
}

struct Fit<'a> {
    profile: &'a Profile<f64>,
    rig: &'a Rig<f64>,
    /// Shaft angles that were commanded, from the starting angle on.
    shaft_rad: Vec<f64>,
    links: Vec<Link>,
    poses: Vec<Isometry3<f64>>,
    /// Expected step along the axis.
    step_m: f64,
    /// How well the starting angle is known.
    start_rad: f64,
}

impl<'a> Fit<'a> {
    fn new(graph: &ViewGraph, profile: &'a Profile<f64>, rig: &'a Rig<f64>) -> Self {
        let links = graph.links.iter().map(thinned).collect();
        let mut fit = Self {
            profile,
            rig,
            shaft_rad: graph.shaft_rad.clone(),
            links,
            poses: Vec::new(),
            step_m: 0.0,
            start_rad: SHAFT_RAD,
        };
        fit.start(0.0);
        fit
    }

    /// Level on the axis, the first photo at a shaft angle, x from the matches of successive photos.
    fn start(&mut self, first_rad: f64) {
        let shift_rad = first_rad - self.shaft_rad[0];
        for shaft_rad in &mut self.shaft_rad {
            *shaft_rad += shift_rad;
        }
        self.poses = self.shaft_rad.iter().map(|shaft_rad| self.rig.body_from_cam(*shaft_rad)).collect();
        let mut steps_m = vec![None; self.poses.len()];
        for link in &self.links {
            let [first, second] = link.photos;
            if second == first + 1 {
                steps_m[second] = self.axial_shift_m(link);
            }
        }
        self.step_m = median(&steps_m.iter().flatten().copied().collect::<Vec<f64>>());
        let mut x_m = 0.0;
        for (pose, step_m) in self.poses.iter_mut().zip(steps_m).skip(1) {
            x_m += step_m.unwrap_or(self.step_m);
            pose.translation.vector.x += x_m;
        }
    }

    /// How far the second photo lies ahead of the first: median of where either sees the same wall.
    fn axial_shift_m(&self, link: &Link) -> Option<f64> {
        let wall_x = |photo: usize, ray: &UnitVector3<f64>| {
            let pose = &self.poses[photo];
            let direction = pose.rotation * ray.into_inner();
            let hit = self.profile.ray_cast(pose.translation.vector.yz(), direction.yz())?;
            Some(hit.distance * direction.x + pose.translation.vector.x)
        };
        let [first, second] = link.photos;
        let shifts: Vec<f64> =
            link.rays.iter().filter_map(|[a, b]| Some(wall_x(first, a)? - wall_x(second, b)?)).collect();
        (!shifts.is_empty()).then(|| median(&shifts))
    }

    /// Tries starting angles all around and keeps the one whose fit agrees best.
    fn choose_start(&mut self) -> Result<(), UntaggedError> {
        self.start_rad = START_RAD;
        let mut best = (f64::MAX, 0.0);
        for index in 0..STARTS {
            let first_rad = std::f64::consts::TAU * index as f64 / STARTS as f64;
            self.start(first_rad);
            for scale_rad in &SCALES_RAD[..3] {
                self.descend(*scale_rad, 2)?;
            }
            let cost = self.normal(SCALES_RAD[3]).2;
            if cost < best.0 {
                best = (cost, first_rad);
            }
        }
        self.start(best.1);
        Ok(())
    }

    fn descend(&mut self, scale_rad: f64, steps: usize) -> Result<(), UntaggedError> {
        for _ in 0..steps {
            let (mut normal, mut step, _) = self.normal(scale_rad);
            normal.scale_diagonal(1.0 + 1e-3);
            let factor = Factor::new(normal).map_err(singular)?;
            factor.solve(&mut step);
            for (pose, by) in self.poses.iter_mut().zip(step.chunks_exact(UNKNOWNS)) {
                pose.rotation *= UnitQuaternion::from_scaled_axis(-Vector3::new(by[0], by[1], by[2]));
                pose.translation.vector -= Vector3::new(by[3], by[4], by[5]);
            }
        }
        Ok(())
    }

    /// Normal matrix, gradient and cost at the present poses.
    fn normal(&self, scale_rad: f64) -> (Envelope, Vec<f64>, f64) {
        let reach = self.links.iter().map(|link| link.photos[1] - link.photos[0]).max().unwrap_or(1).max(1);
        let size = self.poses.len() * UNKNOWNS;
        // Photos are linked with photos up to a turn away only, so the factor costs the same per photo however many there are.
        let normal = Envelope::new((0..self.poses.len()).map(|photo| (UNKNOWNS, photo.saturating_sub(reach))));
        let mut system = System { normal, gradient: vec![0.0; size], cost: 0.0 };
        let k2 = (scale_rad / MATCH_RAD).powi(2);
        for link in &self.links {
            let [first, second] = link.photos;
            for pair in &link.rays {
                let Some(miss) = miss(self.profile, [&self.poses[first], &self.poses[second]], pair) else { continue };
                let squared = miss.error.norm_squared() / (MATCH_RAD * MATCH_RAD);
                let ratio = k2 / (k2 + squared);
                system.cost += squared * ratio;
                let weight = ratio * ratio / (MATCH_RAD * MATCH_RAD);
                system.add(link.photos, &miss, weight);
            }
        }
        self.add_priors(&mut system);
        (system.normal, system.gradient, system.cost)
    }

    fn add_priors(&self, system: &mut System) {
        for (photo, (pose, shaft_rad)) in self.poses.iter().zip(&self.shaft_rad).enumerate() {
            let predicted = nominal_rotation(self.rig.image_up, *shaft_rad);
            // To first order a rotation on the right by w turns the error by R w.
            let error = (pose.rotation * predicted.inverse()).scaled_axis();
            let by_rotation = *pose.rotation.to_rotation_matrix().matrix();
            let about_shaft = if photo == 0 { self.start_rad } else { self.start_rad.max(SHAFT_RAD) };
            for (axis, sigma) in [about_shaft, ATTITUDE_RAD, ATTITUDE_RAD].into_iter().enumerate() {
                let jacobian: Vec<(usize, f64)> =
                    (0..3).map(|k| (UNKNOWNS * photo + k, by_rotation[(axis, k)])).collect();
                system.add_scalar(error[axis], &jacobian, sigma);
            }
            let at = |axis: usize| UNKNOWNS * photo + 3 + axis;
            let centre = pose.translation.vector;
            for axis in [1, 2] {
                system.add_scalar(centre[axis], &[(at(axis), 1.0)], OFF_AXIS_M);
            }
            if photo == 0 {
                system.add_scalar(centre.x, &[(at(0), 1.0)], ANCHOR_M);
                continue;
            }
            let moved = centre - self.poses[photo - 1].translation.vector - Vector3::x() * self.step_m;
            for axis in 0..3 {
                system.add_scalar(moved[axis], &[(at(axis), 1.0), (at(axis) - UNKNOWNS, -1.0)], MOVES_M);
            }
        }
    }

    /// Per photo, the matches whose error is small.
    fn support(&self) -> Vec<usize> {
        let mut support = vec![0; self.poses.len()];
        for link in &self.links {
            let poses = link.photos.map(|photo| &self.poses[photo]);
            let agree = |pair: &&[UnitVector3<f64>; 2]| {
                miss(self.profile, poses, pair).is_some_and(|m| m.error.norm() < SUPPORTS_RAD)
            };
            let agreeing = link.rays.iter().filter(agree).count();
            for photo in link.photos {
                support[photo] += agreeing;
            }
        }
        support
    }

    /// The worst axis of rotation and position against the photo a turn before (or after), whose camera axes are the same.
    fn sigmas(&self, factor: &Factor, photo: usize) -> [f64; 2] {
        let turn = usize::from(self.rig.images_per_turn);
        let other = photo.checked_sub(turn).unwrap_or_else(|| (photo + turn).min(self.poses.len() - 1));
        let mut worst = [0.0_f64; 2];
        for unknown in 0..UNKNOWNS {
            let (at, reference) = (UNKNOWNS * photo + unknown, UNKNOWNS * other + unknown);
            let mut difference = vec![0.0; UNKNOWNS * self.poses.len()];
            difference[at] += 1.0;
            if other != photo {
                difference[reference] -= 1.0;
            }
            factor.solve(&mut difference);
            let variance = difference[at] - if other == photo { 0.0 } else { difference[reference] };
            worst[unknown / 3] = worst[unknown / 3].max(variance.max(0.0).sqrt());
        }
        worst
    }
}

struct System {
    normal: Envelope,
    gradient: Vec<f64>,
    cost: f64,
}

impl System {
    fn add(&mut self, photos: [usize; 2], miss: &Miss, weight: f64) {
        for (a, photo_a) in photos.into_iter().enumerate() {
            let gradient = miss.by_pose[a].transpose() * miss.error * weight;
            for row in 0..UNKNOWNS {
                self.gradient[UNKNOWNS * photo_a + row] += gradient[row];
            }
            for (b, photo_b) in photos.into_iter().enumerate().take(a + 1) {
                let block: SMatrix<f64, UNKNOWNS, UNKNOWNS> = miss.by_pose[a].transpose() * miss.by_pose[b] * weight;
                for row in 0..UNKNOWNS {
                    for column in 0..if a == b { row + 1 } else { UNKNOWNS } {
                        self.normal.add(UNKNOWNS * photo_a + row, UNKNOWNS * photo_b + column, block[(row, column)]);
                    }
                }
            }
        }
    }

    /// A scalar residual with the few unknowns it depends on.
    fn add_scalar(&mut self, error: f64, jacobian: &[(usize, f64)], sigma: f64) {
        let weight = 1.0 / (sigma * sigma);
        self.cost += error * error * weight;
        for (i, (row, by_row)) in jacobian.iter().enumerate() {
            self.gradient[*row] += by_row * error * weight;
            for (column, by_column) in &jacobian[..=i] {
                self.normal.add(*row.max(column), *row.min(column), by_row * by_column * weight);
            }
        }
    }
}

fn singular(error: NotPositiveDefinite) -> UntaggedError {
    UntaggedError::Singular { photo: error.row / UNKNOWNS }
}

/// The link with at most [`MOST_MATCHES`] of its matches.
fn thinned(link: &Link) -> Link {
    let every = link.rays.len().div_ceil(MOST_MATCHES).max(1);
    Link { rays: link.rays.iter().step_by(every).copied().collect(), ..link.clone() }
}
