//! How far the measured wall lies from the true one.
//!
//! Independent of how the wall was measured: points of our wall in space are looked up in the truth's own grid of heights
//! over the section that survey.toml states.

use std::fs;
use std::path::Path;

use adit_geometry::profile::{Profile, ProfileSpec};
use nalgebra::{DMatrix, DVector, Isometry3, Point3, Translation3, Vector2, Vector3};
use serde::Serialize;

use super::EvaluateError;
use super::coverage::{Seen, TrueWall};
use super::drift::mean_rotation;
use super::poses::Spread;
use super::wall_image::{WallGrid, WallImageError};
use crate::adjust::median;
use crate::poses::{PhotoPose, PoseStatus};
use crate::surface::SurfaceStore;

/// Distance of the places that are compared, around and along.
const STEP_M: f64 = 0.025;
/// Rows read at a time.
const STRIP_M: f64 = 1.0;
/// Places so near to where a pipe stands before the wall are left out: its shadow, and templates half on it.
const PIPE_MARGIN_M: f64 = 0.2;
/// Length of the rings whose ovality is compared.
const RING_M: f64 = 0.5;
/// Rings of which a smaller share is known are left out.
const RING_SHARE: f64 = 0.8;

/// One ring of a round tunnel: largest less smallest diameter over their mean, bulges and all.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct RingOvality {
    /// Its middle.
    pub x_m: f64,
    /// Of our wall.
    pub measured_percent: f64,
    /// Of the true wall, at the same places.
    pub true_percent: f64,
}

/// Our wall against truth/relief.f32, in millimetres along the section's normal.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ReliefEvaluation {
    /// Places of the wall, 25 mm apart, that two or more photos see (by the true poses); none near pipes.
    pub places: usize,
    /// Of these, places whose height is known, in percent.
    pub known_percent: f64,
    /// Known places, in the tunnel frame as it is.
    pub absolute_mm: Spread,
    /// Known places after the rigid motion that lays our photos onto the true ones.
    pub aligned_mm: Spread,
    /// The same without the constant: the wall's shape.
    pub shape_mm: Spread,
    /// Median of the aligned difference, measured less true: an error of the section's size, which ranges alone tell.
    pub constant_mm: f64,
    /// All places, filled ones too, aligned.
    pub filled_mm: Spread,
    /// The true heights without their median: the error of a wall that was taken for its section.
    pub true_relief_mm: Spread,
    /// Rings of a round tunnel.
    pub rings: Vec<RingOvality>,
    /// Largest error of a ring's ovality, percent of the diameter; absent without rings.
    pub ovality_error_percent: Option<f64>,
}

/// The truth's grid of heights; NaN where a pipe stands before the wall.
pub(super) struct TrueRelief {
    pub(super) grid: WallGrid,
    heights_m: Vec<f32>,
}

impl TrueRelief {
    /// Reads `relief.json` and `relief.f32`; `None` if they are not there.
    pub(super) fn read(folder: &Path) -> Result<Option<Self>, WallImageError> {
        let (json_path, path) = (folder.join("relief.json"), folder.join("relief.f32"));
        if !json_path.is_file() || !path.is_file() {
            return Ok(None);
        }
        let read = |path: &Path| fs::read(path).map_err(|source| WallImageError::Io { path: path.to_owned(), source });
        let grid: WallGrid = serde_json::from_slice(&read(&json_path)?)
            .map_err(|source| WallImageError::Json { path: json_path, source })?;
        let bytes = read(&path)?;
        let heights_m: Vec<f32> = bytes.as_chunks::<4>().0.iter().map(|bytes| f32::from_le_bytes(*bytes)).collect();
        if heights_m.len() != grid.width_px * grid.height_px {
            let height_px = heights_m.len() / grid.width_px.max(1);
            return Err(WallImageError::Size { path, width_px: grid.width_px, height_px, grid });
        }
        Ok(Some(Self { grid, heights_m }))
    }

    /// The lining's height between four cells; `None` outside, and where a pipe stands before it.
    pub(super) fn lining_m(&self, s_m: f64, x_m: f64) -> Option<f64> {
        let [column, row] = self.cell_at(s_m, x_m);
        let (left, upper) = (column.floor(), row.floor());
        let line = |row: f64| {
            let [a, b] = [self.cell(left, row)?, self.cell(left + 1.0, row)?];
            Some(a + (column - left) * (b - a))
        };
        let [above, below] = [line(upper)?, line(upper + 1.0)?];
        Some(above + (row - upper) * (below - above))
    }

    /// The same, but `None` near a pipe too.
    fn at(&self, s_m: f64, x_m: f64) -> Option<f64> {
        let [left, upper] = self.cell_at(s_m, x_m).map(f64::floor);
        let margin = PIPE_MARGIN_M / (self.grid.mm_per_px * 1e-3);
        for (ds, dx) in [(margin, 0.0), (-margin, 0.0), (0.0, margin), (0.0, -margin)] {
            self.cell((left + ds).round(), (upper + dx).round().clamp(0.0, self.grid.height_px as f64 - 1.0))?;
        }
        self.lining_m(s_m, x_m)
    }

    /// Column and row of a place, whole numbers in the middle of cells.
    fn cell_at(&self, s_m: f64, x_m: f64) -> [f64; 2] {
        let cell_m = self.grid.mm_per_px * 1e-3;
        [(s_m - self.grid.s0_m) / cell_m - 0.5, (x_m - self.grid.x0_m) / cell_m - 0.5]
    }

    fn cell(&self, column: f64, row: f64) -> Option<f64> {
        let inside = row >= 0.0 && row < self.grid.height_px as f64;
        let column = column.rem_euclid(self.grid.width_px as f64) as usize;
        let height_m = *self.heights_m.get(row.max(0.0) as usize * self.grid.width_px + column)?;
        (inside && height_m.is_finite()).then_some(f64::from(height_m))
    }
}

/// A place of our wall and of the true one.
struct Place {
    s_m: f64,
    x_m: f64,
    /// Ours in the tunnel frame as it is, less the truth there.
    absolute_m: Option<f64>,
    /// Ours after the rigid motion.
    height_m: f64,
    true_m: f64,
    known: bool,
}

/// Compares the wall in `out` with the truth.
pub(super) fn measure_relief(
    store: &SurfaceStore,
    wall: &TrueWall,
    truth: &TrueRelief,
    truth_from_ours: &Isometry3<f64>,
) -> Result<Option<ReliefEvaluation>, EvaluateError> {
    let seen = Seen::by(wall, &truth.grid)?;
    let profile = &wall.profile;
    let rows_m = truth.grid.height_px as f64 * truth.grid.mm_per_px * 1e-3;
    let mut places = Vec::new();
    for strip in 0..(rows_m / STRIP_M).ceil() as usize {
        let from_m = truth.grid.x0_m + strip as f64 * STRIP_M;
        let window = store.window([from_m, from_m + STRIP_M])?;
        let around = (store.profile().perimeter_m() / STEP_M) as usize;
        for row in 0..(STRIP_M / STEP_M).round() as usize {
            let x_m = from_m + (row as f64 + 0.5) * STEP_M;
            places.extend((0..around).filter_map(|column| {
                let s_m = (column as f64 + 0.5) * STEP_M;
                let ours = window.point(s_m, x_m).position;
                let (aligned_s_m, height_m, at) = over(profile, truth_from_ours * ours)?;
                let true_m = truth.at(aligned_s_m, at)?;
                let absolute_m =
                    over(profile, ours).and_then(|(s_m, height_m, x_m)| Some(height_m - truth.at(s_m, x_m)?));
                let known = window.confidence(s_m, x_m) > 0.0;
                (seen.photos_at(aligned_s_m, at) >= 2).then_some(Place {
                    s_m: aligned_s_m,
                    x_m: at,
                    absolute_m,
                    height_m,
                    true_m,
                    known,
                })
            }));
        }
    }
    let known = || places.iter().filter(|place| place.known);
    if known().next().is_none() {
        return Ok(None);
    }
    let aligned: Vec<f64> = known().map(|place| place.height_m - place.true_m).collect();
    let constant_m = median(&aligned);
    let true_median_m = median(&places.iter().map(|place| place.true_m).collect::<Vec<_>>());
    let rings = if matches!(wall.survey.config.profile, ProfileSpec::Circle { .. }) {
        rings(&places, profile)
    } else {
        Vec::new()
    };
    let worst = rings.iter().map(|ring| (ring.measured_percent - ring.true_percent).abs()).reduce(f64::max);
    Ok(Some(ReliefEvaluation {
        places: places.len(),
        known_percent: 100.0 * aligned.len() as f64 / places.len() as f64,
        absolute_mm: spread_mm(known().filter_map(|place| place.absolute_m)),
        constant_mm: constant_m * 1e3,
        shape_mm: spread_mm(aligned.iter().map(|error| error - constant_m)),
        aligned_mm: spread_mm(aligned),
        filled_mm: spread_mm(places.iter().map(|place| place.height_m - place.true_m)),
        true_relief_mm: spread_mm(places.iter().map(|place| place.true_m - true_median_m)),
        rings,
        ovality_error_percent: worst,
    }))
}

fn spread_mm(errors_m: impl IntoIterator<Item = f64>) -> Spread {
    Spread::of(errors_m.into_iter().map(|error_m| error_m * 1e3))
}

/// The rigid motion that lays our adjusted photos onto the true ones: mean rotation, then mean position. `None` without any.
pub(super) fn truth_from_ours(ours: &[PhotoPose], truth: &[PhotoPose]) -> Option<Isometry3<f64>> {
    let adjusted = ours.iter().filter(|pose| pose.status == PoseStatus::Adjusted);
    let pairs: Vec<(Isometry3<f64>, Isometry3<f64>)> = adjusted
        .filter_map(|pose| {
            let theirs = truth.iter().find(|theirs| theirs.photo == pose.photo)?;
            Some((pose.tunnel_from_cam, theirs.tunnel_from_cam))
        })
        .collect();
    let turn = mean_rotation(pairs.iter().map(|(ours, theirs)| theirs.rotation * ours.rotation.inverse()))?;
    let shifts = pairs.iter().map(|(ours, theirs)| theirs.translation.vector - turn * ours.translation.vector);
    let shift = shifts.sum::<Vector3<f64>>() / pairs.len() as f64;
    Some(Isometry3::from_parts(Translation3::from(shift), turn))
}

/// Arc length, height over the profile, station of a point.
fn over(profile: &Profile<f64>, point: Point3<f64>) -> Option<(f64, f64, f64)> {
    let nearest = profile.nearest(Vector2::new(point.y, point.z))?;
    Some((nearest.surface.s_m, nearest.clearance_m, point.x))
}

/// The ovality of rings of which enough is known, by least squares over the same places for both walls.
fn rings(places: &[Place], profile: &Profile<f64>) -> Vec<RingOvality> {
    let perimeter_m = profile.perimeter_m();
    let ring_of = |place: &Place| (place.x_m / RING_M).floor() as i64;
    let Some(first) = places.iter().map(ring_of).min() else { return Vec::new() };
    let last = places.iter().map(ring_of).max().unwrap_or(first);
    let least = RING_SHARE * perimeter_m * RING_M / (STEP_M * STEP_M);
    let ring = |number: i64| {
        let of_ring: Vec<&Place> = places.iter().filter(|place| place.known && ring_of(place) == number).collect();
        if (of_ring.len() as f64) < least {
            return None;
        }
        let percent = |height_m: &dyn Fn(&Place) -> f64| ovality_percent(&of_ring, perimeter_m, height_m);
        Some(RingOvality {
            x_m: (number as f64 + 0.5) * RING_M,
            measured_percent: percent(&|place| place.height_m)?,
            true_percent: percent(&|place| place.true_m)?,
        })
    };
    (first..=last).filter_map(ring).collect()
}

fn ovality_percent(places: &[&Place], perimeter_m: f64, height_m: &dyn Fn(&Place) -> f64) -> Option<f64> {
    let mut normal = DMatrix::<f64>::zeros(5, 5);
    let mut right = DVector::<f64>::zeros(5);
    for place in places {
        let angle = place.s_m / perimeter_m * std::f64::consts::TAU;
        let row =
            DVector::from_column_slice(&[1.0, angle.cos(), angle.sin(), (2.0 * angle).cos(), (2.0 * angle).sin()]);
        normal += &row * row.transpose();
        right += &row * height_m(place);
    }
    let terms = normal.cholesky()?.solve(&right);
    Some(200.0 * terms[3].hypot(terms[4]) / (perimeter_m / std::f64::consts::TAU - terms[0]))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn truth(height: impl Fn(usize) -> f32) -> TrueRelief {
        let grid = WallGrid { mm_per_px: 50.0, width_px: 100, height_px: 40, x0_m: -1.0, s0_m: 0.0, perimeter_m: 5.0 };
        TrueRelief { grid, heights_m: (0..4000).map(height).collect() }
    }

    #[test]
    fn heights_are_those_between_cells_and_around_the_seam() {
        let ramp = truth(|cell| (cell % 100) as f32 * 0.001);
        assert!((ramp.at(1.05, 0.0).unwrap() - 0.0205).abs() < 1e-6);
        assert!((ramp.at(4.975, 0.0).unwrap() - 0.099).abs() < 1e-6);
        assert!(ramp.at(1.0, -1.2).is_none());
    }

    #[test]
    fn nothing_near_a_pipe_is_compared() {
        let pipe = truth(|cell| if (48..52).contains(&(cell % 100)) { f32::NAN } else { 0.01 });
        assert!(pipe.at(2.5, 0.0).is_none() && pipe.at(2.3, 0.0).is_none() && pipe.at(2.7, 0.0).is_none());
        assert!(pipe.at(2.1, 0.0).is_some());
    }

    #[test]
    fn the_ovality_of_an_oval_is_found() {
        let place = |column: usize| {
            let s_m = column as f64 * 0.01;
            let true_m = 0.03 * (2.0 * s_m / 3.0 - 0.4).cos();
            Place { s_m, x_m: 0.0, absolute_m: None, height_m: true_m * 1.1, true_m, known: true }
        };
        let places: Vec<Place> = (0..1885).map(place).collect();
        let places: Vec<&Place> = places.iter().collect();
        let perimeter_m = 6.0 * std::f64::consts::PI;
        assert!((ovality_percent(&places, perimeter_m, &|place| place.true_m).unwrap() - 2.0).abs() < 1e-3);
        assert!((ovality_percent(&places, perimeter_m, &|place| place.height_m).unwrap() - 2.2).abs() < 1e-3);
    }
}
