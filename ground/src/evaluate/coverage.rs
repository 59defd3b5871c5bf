//! Of the wall that some photo saw, how much is coloured in the panorama?

use adit_geometry::profile::Profile;
use nalgebra::{Isometry3, Point3, Vector2};
use rayon::prelude::*;
use serde::Serialize;

use super::relief::TrueRelief;
use super::wall_image::{WallGrid, WallImage};
use crate::poses::PhotoPose;
use crate::raster::Mask;
use crate::survey::{MaskError, Photo, Size, Survey, load_mask};

/// Edge of a wall cell.
const CELL_M: f64 = 0.05;
/// A wall point hidden by less than this (the wall's own curvature on the way to it) counts as visible.
const HIDDEN_M: f64 = 0.01;

/// What is true of a survey: where its photos were, and the wall.
pub(super) struct TrueWall<'a> {
    pub(super) survey: &'a Survey,
    /// The section that survey.toml states.
    pub(super) profile: Profile<f64>,
    /// Of the survey's photos, under their names.
    pub(super) poses: &'a [PhotoPose],
    /// The wall's height over the section; without it the wall is taken for its section.
    pub(super) relief: Option<&'a TrueRelief>,
}

/// Coverage by the true poses, in cells of 5 cm, judged at their centres. A photo sees a place if all four pixels that it lies
/// between are in the photo and outside its mask.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct CoverageEvaluation {
    /// Cells on the stretch of the wall that the panorama spans.
    pub cells: usize,
    /// Of these, seen by at least one photo.
    pub seen: usize,
    /// Of the seen ones, coloured.
    pub coloured: usize,
    /// `coloured / seen` in percent.
    pub coloured_percent: f64,
}

/// Counts seen and coloured cells. `ours_from_truth` says where the panorama has what is true: off by a millimetre, the last
/// row of cells that a photo sees would be missed.
pub(super) fn measure_coverage(
    truth: &TrueWall,
    panorama: &WallImage,
    ours_from_truth: &Isometry3<f64>,
) -> Result<CoverageEvaluation, MaskError> {
    let Seen { cells, photos, .. } = Seen::by(truth, &panorama.grid)?;
    let seen_cells: Vec<&Cell> =
        cells.iter().zip(&photos).filter(|(_, photos)| **photos > 0).map(|(cell, _)| cell).collect();
    let ours_per_true_m = panorama.grid.perimeter_m / truth.profile.perimeter_m();
    let covered = |cell: &&&Cell| {
        let ours = ours_from_truth * cell.wall;
        let nearest = truth.profile.nearest(ours.yz().coords);
        nearest.is_some_and(|nearest| panorama.covers(nearest.surface.s_m * ours_per_true_m, ours.x))
    };
    let coloured = seen_cells.iter().filter(covered).count();
    Ok(CoverageEvaluation {
        cells: cells.len(),
        seen: seen_cells.len(),
        coloured,
        coloured_percent: 100.0 * coloured as f64 / seen_cells.len().max(1) as f64,
    })
}

/// The middle of a cell of the wall.
struct Cell {
    /// On the section.
    section: Vector2<f64>,
    /// On the true wall.
    wall: Point3<f64>,
}

/// How many photos see each cell of the wall, by the true poses.
pub(super) struct Seen {
    cells: Vec<Cell>,
    /// Per cell, column by column.
    photos: Vec<u16>,
    x0_m: f64,
    along: usize,
}

impl Seen {
    /// Counts over the stretch of `grid`.
    pub(super) fn by(truth: &TrueWall, grid: &WallGrid) -> Result<Self, MaskError> {
        let along = (grid.height_px as f64 * grid.mm_per_px / 1000.0 / CELL_M) as usize;
        let cells = cells(truth, grid.x0_m, along);
        let photos = truth
            .poses
            .par_iter()
            .filter_map(|pose| {
                let photo = truth.survey.photos.iter().find(|photo| photo.name == pose.photo)?;
                Some(cells_seen(truth, photo, &pose.tunnel_from_cam, &cells))
            })
            .try_fold(
                || vec![0_u16; cells.len()],
                |mut counts, seen| {
                    counts.iter_mut().zip(seen?).for_each(|(count, seen)| *count += u16::from(seen));
                    Ok(counts)
                },
            )
            .try_reduce(
                || vec![0; cells.len()],
                |mut a, b| {
                    a.iter_mut().zip(b).for_each(|(a, b)| *a += b);
                    Ok(a)
                },
            )?;
        Ok(Self { cells, photos, x0_m: grid.x0_m, along })
    }

    /// Number of photos that see a place; 0 outside.
    pub(super) fn photos_at(&self, s_m: f64, x_m: f64) -> u16 {
        let (column, row) = ((s_m / CELL_M) as usize, (x_m - self.x0_m) / CELL_M);
        if row < 0.0 || row >= self.along as f64 {
            return 0;
        }
        self.photos.get(column * self.along + row as usize).copied().unwrap_or(0)
    }
}

/// The cells, column by column.
fn cells(truth: &TrueWall, x0_m: f64, along: usize) -> Vec<Cell> {
    let around = (truth.profile.perimeter_m() / CELL_M) as usize;
    let mut cells = Vec::with_capacity(around * along);
    for column in 0..around {
        let s_m = (column as f64 + 0.5) * CELL_M;
        let Some(surface) = truth.profile.at(s_m) else { continue };
        for row in 0..along {
            let x_m = x0_m + (row as f64 + 0.5) * CELL_M;
            let height_m = truth.relief.and_then(|relief| relief.lining_m(s_m, x_m)).unwrap_or(0.0);
            let wall = surface.point + surface.normal * height_m;
            cells.push(Cell { section: surface.point, wall: Point3::new(x_m, wall.x, wall.y) });
        }
    }
    cells
}

fn cells_seen(
    truth: &TrueWall,
    photo: &Photo,
    tunnel_from_cam: &Isometry3<f64>,
    cells: &[Cell],
) -> Result<Vec<bool>, MaskError> {
    let camera = &truth.survey.config.camera.camera;
    let size = Size { width_px: camera.width_px, height_px: camera.height_px };
    let mask: Option<Mask> = photo.mask.as_ref().map(|path| load_mask(path, size)).transpose()?;
    let cam_from_tunnel = tunnel_from_cam.inverse();
    let centre = tunnel_from_cam.translation.vector.yz();
    let visible = |cell: &Cell| {
        let Some(pixel) = camera.project(&(cam_from_tunnel * cell.wall).coords) else { return false };
        camera.contains(&pixel, 0.5)
            && mask.as_ref().is_none_or(|mask| around(&pixel).all(|[column, row]| mask.at(column, row) != [0]))
            && !hidden(&truth.profile, centre, cell.section)
    };
    Ok(cells.iter().map(visible).collect())
}

/// The four pixels between whose centres a place at least half a pixel within the photo lies.
fn around(pixel: &Vector2<f64>) -> impl Iterator<Item = [usize; 2]> {
    let first = [pixel.x - 0.5, pixel.y - 0.5].map(|at| at as usize);
    // On the last centres there is no next pixel.
    let last = [pixel.x + 0.5, pixel.y + 0.5].map(|at| at.ceil() as usize - 1);
    [first, [last[0], first[1]], [first[0], last[1]], last].into_iter()
}

/// Tells whether another part of the wall stands between.
fn hidden(profile: &Profile<f64>, centre: Vector2<f64>, point: Vector2<f64>) -> bool {
    let towards = point - centre;
    profile.ray_cast(centre, towards).is_some_and(|hit| (1.0 - hit.distance) * towards.norm() > HIDDEN_M)
}
