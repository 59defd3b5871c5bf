//! The SIFT-class detector: extrema of differences of Gaussians, refined below a sample, without edges and faint ones.
//!
//! Symbols and start values follow "Anatomy of the SIFT Method" (IPOL 2014), algorithms 4 to 8.

use nalgebra::{Matrix3, Vector3};
use rayon::prelude::*;

use super::describe::{describe, orientations, support_px};
use super::integral::Usable;
use super::scale_space::{FIRST_BLUR, Octave, SCALES, octaves};
use super::spread::spread;
use super::{Features, Keypoint, Orientation, SiftDescriptor};
use crate::raster::{Grey, Mask};

/// Steps of the refinement before a candidate that keeps wandering is dropped.
const REFINEMENTS: usize = 5;

/// Largest offset from the sample at which a refinement has converged.
const CONVERGED: f64 = 0.6;

/// What to look for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SiftOptions {
    /// Whether descriptors turn with the picture.
    pub orientation: Orientation,
    /// Least difference of Gaussians at an extremum, grey levels. The literature's 3.8 (0.015 of the range) finds nothing
    /// on bare concrete; noise of a usual photo begins at about 0.5.
    pub contrast: f32,
    /// Largest ratio of principal curvatures; above it, it is an edge.
    pub edge_ratio: f32,
    /// Most features; the best of each part of the photo are kept.
    pub most: usize,
    /// Begin at twice the photo's resolution: about three times the features in four times the time.
    pub doubled: bool,
}

impl Default for SiftOptions {
    /// For a rotating rig's photos of concrete: upright, faint extrema allowed.
    fn default() -> Self {
        Self { orientation: Orientation::Upright, contrast: 0.8, edge_ratio: 10.0, most: 6000, doubled: true }
    }
}

/// Finds and describes the features of a photo (grey values 0 to 255).
///
/// None whose descriptor would touch a masked pixel or leave the photo. Two features may share a place, with different
/// directions ([`Orientation::Free`]) or scales. The result does not depend on the number of threads.
///
/// Memory: about 60 bytes per pixel, 240 if doubled. Cost: see `benches/ground.rs`.
pub fn sift(photo: &Grey, mask: Option<&Mask>, options: &SiftOptions) -> Features<SiftDescriptor> {
    let usable = Usable::new(photo.width, photo.height, mask);
    let octaves = octaves(photo, options.doubled);
    let found: Vec<Keypoint> = octaves.iter().flat_map(|octave| extrema(octave, &usable, options)).collect();
    let directed = found
        .into_par_iter()
        .flat_map_iter(|keypoint| {
            let angles = match options.orientation {
                Orientation::Upright => vec![0.0],
                Orientation::Free => orientations(&Level::of(&keypoint, &octaves), &keypoint),
            };
            angles.into_iter().map(move |angle_rad| Keypoint { angle_rad, ..keypoint })
        })
        .collect();
    let keypoints = spread(directed, options.most, photo.width, photo.height);
    let descriptors = keypoints
        .par_iter()
        .map(|keypoint| describe(&Level::of(keypoint, &octaves), keypoint, options.orientation))
        .collect();
    Features { keypoints, descriptors }
}

/// An image of the scale space.
pub(super) struct Level<'a> {
    pub(super) image: &'a Grey,
    /// Pixels of the photo per sample.
    pub(super) step_px: f32,
}

impl<'a> Level<'a> {
    /// The image whose blur is nearest to a keypoint's.
    fn of(keypoint: &Keypoint, octaves: &'a [Octave]) -> Self {
        let doublings = (keypoint.scale_px / (FIRST_BLUR * octaves[0].step_px)).log2();
        let number = ((doublings * SCALES as f32).round() as usize).max(1);
        let octave = ((number - 1) / SCALES).min(octaves.len() - 1);
        let scale = (number - octave * SCALES).min(SCALES + 2);
        Self { image: &octaves[octave].images[scale], step_px: octaves[octave].step_px }
    }
}

/// The extrema of one octave that pass every test.
fn extrema(octave: &Octave, usable: &Usable, options: &SiftOptions) -> Vec<Keypoint> {
    let differences = octave.differences();
    let (width, height) = (differences[0].width, differences[0].height);
    // Before the refinement an extremum may look a little fainter than it is.
    let least = 0.8 * options.contrast;
    let in_row = |row: usize| {
        let mut found = Vec::new();
        for scale in 1..=SCALES {
            let line = &differences[scale].data[row * width..][..width];
            for column in 1..width - 1 {
                if line[column].abs() > least && is_extremum(&differences, [column, row, scale]) {
                    found.extend(refined(&differences, [column, row, scale], octave.step_px, options));
                }
            }
        }
        found
    };
    let clear = |keypoint: &Keypoint| {
        usable.is_clear(keypoint.pixel, f64::from(support_px(keypoint.scale_px, options.orientation)))
    };
    (1..height - 1).into_par_iter().flat_map_iter(in_row).filter(clear).collect()
}

/// Larger or smaller than all 26 neighbours.
fn is_extremum(differences: &[Grey], [column, row, scale]: [usize; 3]) -> bool {
    let width = differences[0].width;
    let middle = row * width + column;
    let value = differences[scale].data[middle];
    let sign = value.signum();
    let size = value.abs();
    [scale, scale - 1, scale + 1].iter().all(|&near| {
        [middle, middle - width, middle + width].iter().all(|&at| {
            let three = &differences[near].data[at - 1..at + 2];
            let centre = near == scale && at == middle;
            sign * three[0] < size && sign * three[2] < size && (centre || sign * three[1] < size)
        })
    })
}

/// Moves a candidate to the extremum of the local quadratic; `None` if it wanders off, is faint, or is an edge.
fn refined(differences: &[Grey], start: [usize; 3], step_px: f32, options: &SiftOptions) -> Option<Keypoint> {
    let (width, height) = (differences[0].width, differences[0].height);
    let [mut column, mut row, mut scale] = start;
    for _ in 0..REFINEMENTS {
        let at = |dx: i64, dy: i64, ds: i64| {
            let index = (row as i64 + dy) * width as i64 + column as i64 + dx;
            f64::from(differences[(scale as i64 + ds) as usize].data[index as usize])
        };
        let quadratic = Quadratic::new(&at);
        let offset = quadratic.extremum()?;
        if offset.amax() < CONVERGED {
            let value = quadratic.value(&offset) as f32;
            if value.abs() < options.contrast || quadratic.is_edge(f64::from(options.edge_ratio)) {
                return None;
            }
            let step = f64::from(step_px);
            let blur = FIRST_BLUR * ((scale as f32 + offset.z as f32) / SCALES as f32).exp2();
            return Some(Keypoint {
                pixel: [(column as f64 + offset.x) * step + 0.5, (row as f64 + offset.y) * step + 0.5],
                scale_px: step_px * blur,
                angle_rad: 0.0,
                response: value.abs(),
            });
        }
        let moved = |index: usize, by: f64, last: usize| {
            let next = index as f64 + by.round();
            (next >= 1.0 && next < last as f64).then_some(next as usize)
        };
        column = moved(column, offset.x, width - 1)?;
        row = moved(row, offset.y, height - 1)?;
        scale = moved(scale, offset.z, SCALES + 1)?;
    }
    None
}

/// The second-order expansion around a sample, over (column, row, scale).
struct Quadratic {
    value: f64,
    gradient: Vector3<f64>,
    hessian: Matrix3<f64>,
}

impl Quadratic {
    fn new(at: &impl Fn(i64, i64, i64) -> f64) -> Self {
        let value = at(0, 0, 0);
        let first = |d: [i64; 3]| 0.5 * (at(d[0], d[1], d[2]) - at(-d[0], -d[1], -d[2]));
        let second = |d: [i64; 3]| at(d[0], d[1], d[2]) + at(-d[0], -d[1], -d[2]) - 2.0 * value;
        let mixed = |a: [i64; 3], b: [i64; 3]| {
            let corner = |sa: i64, sb: i64| {
                let d: [i64; 3] = std::array::from_fn(|axis| sa * a[axis] + sb * b[axis]);
                at(d[0], d[1], d[2])
            };
            0.25 * (corner(1, 1) - corner(1, -1) - corner(-1, 1) + corner(-1, -1))
        };
        let (x, y, s) = ([1, 0, 0], [0, 1, 0], [0, 0, 1]);
        let (xy, xs, ys) = (mixed(x, y), mixed(x, s), mixed(y, s));
        Self {
            value,
            gradient: Vector3::new(first(x), first(y), first(s)),
            hessian: Matrix3::new(second(x), xy, xs, xy, second(y), ys, xs, ys, second(s)),
        }
    }

    fn extremum(&self) -> Option<Vector3<f64>> {
        Some(-self.hessian.try_inverse()? * self.gradient)
    }

    fn value(&self, offset: &Vector3<f64>) -> f64 {
        self.value + 0.5 * self.gradient.dot(offset)
    }

    /// The ratio of the principal curvatures in the image exceeds `ratio`, or they differ in sign.
    fn is_edge(&self, ratio: f64) -> bool {
        let (xx, yy, xy) = (self.hessian[(0, 0)], self.hessian[(1, 1)], self.hessian[(0, 1)]);
        let determinant = xx * yy - xy * xy;
        !(determinant > 0.0 && (xx + yy).powi(2) * ratio < (ratio + 1.0).powi(2) * determinant)
    }
}
